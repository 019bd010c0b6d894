/* Filtered lookups: from the source image for narrow pixels, from the pyramid for wide ones. */
#include "sky/tables/environment.h"

#include "sky/tables/cube.h"
#include "sky/tables/layout.h"
#include "sky/tables/lookup_place.h"
#include "sky/tables/pyramid.h"
#include "sky/tables/resample.h"

#include <assert.h>
#include <math.h>

/* A level with texels of s radians per edge, interpolated bilinearly, spreads each direction with a variance of s^2/4
 * along each axis: s^2/12 from the texel, which is a mean, and s^2/6 from the tent filter. A square pixel of edge
 * `width` has a variance of width^2/12, so s = width / sqrt(3). Variances add in a mixture of two levels with the same
 * centre, so s^2 is interpolated between them. */
#define TEXEL_PER_WIDTH 0.57735027f
#define WHOLE_SPHERE 2.0466534f /* s for a width of sqrt(4 pi), whose square is the whole sphere */
#define TAPS_MAX 8
#define STEP 1.4142136f /* a cube map level must be at least this much coarser than the source to be used */
/* If levels differ by more than this, the finer one is widened by several taps, since a mixture would alias. */
#define GAP 2.0f

/* The source image or, with factor > 1, the resampler's blocks of it. */
struct texels {
    const float *rgb;
    uint32_t columns, rows, factor;
};

/* Keeps a neighbour within its contiguous part: the azimuth wraps around, everything else is clamped. */
static int64_t hold(int64_t at, uint32_t low, uint32_t high, bool wraps)
{
    if (wraps)
        return at < low ? at + (high - low) : at >= high ? at - (high - low) : at;
    return at < low ? low : at >= high ? (int64_t)high - 1 : at;
}

/* False for a texel of a ball or fisheye whose centre is outside the circle. */
static bool is_shown(const struct resample_table *t, const struct texels *p, int64_t column, int64_t row)
{
    const double x = 2.0 * (double)column + 1.0 - p->columns, y = 2.0 * (double)row + 1.0 - p->rows;
    const double side = p->columns < p->rows ? p->columns : p->rows;

    return !layout_is_disc(t->key.layout) || x * x + y * y < side * side;
}

/* From source texels to blocks. The last block of a face or image may be smaller; all are treated as equally large, so
 * that the azimuth closes. */
static void place_in_blocks(const struct resample_table *t, uint32_t factor, struct layout_place *at)
{
    const uint32_t size = layout_faces(t->key.layout) ? layout_face_size(t->key.layout, t->key.width) : 0;
    const uint32_t cell[2] = { size ? size : t->key.width, size ? size : t->key.height };
    double *place[2] = { &at->x, &at->y };

    for (int k = 0; k < 2; k++) {
        const uint32_t blocks = (cell[k] + factor - 1) / factor, low = at->low[k] / cell[k] * blocks;
        *place[k] = low + (*place[k] - at->low[k]) * blocks / cell[k];
        at->low[k] = low;
        at->high[k] = low + blocks;
    }
}

/* The four texels around a direction: two columns and two rows, and the weights of the second ones. */
struct four {
    int64_t column[2], row[2];
    float x, y;
};

/* False if the layout does not cover that direction. */
static bool find_four(const struct environment *e, const struct texels *p, struct vec3 w, struct four *out)
{
    const struct resample_table *t = e->resampler->table;
    const double c = cos(e->rotation), s = sin(e->rotation);
    const double own[3] = { c * w.x - s * w.z, w.y, c * w.z + s * w.x };
    struct layout_place at;

    const bool shown = layout_find(t->key.layout, t->key.width, t->key.height, own, &at);
    if (p->factor > 1)
        place_in_blocks(t, p->factor, &at);
    /* Texel centres are at half-integers. */
    const double x = at.x - 0.5, y = at.y - 0.5;
    const int64_t x0 = (int64_t)floor(x), y0 = (int64_t)floor(y);
    out->x = (float)(x - (double)x0);
    out->y = (float)(y - (double)y0);
    for (int k = 0; k < 2; k++) {
        out->column[k] = hold(x0 + k, at.low[0], at.high[0], at.wraps);
        out->row[k] = hold(y0 + k, at.low[1], at.high[1], false);
    }
    return shown;
}

static void interpolate(const struct environment *e, const struct texels *p, struct vec3 w, float rgb[3])
{
    const struct resample_table *t = e->resampler->table;
    float whole = 0.0f, sum[3] = { 0.0f, 0.0f, 0.0f };
    struct four f;

    const bool shown = find_four(e, p, w, &f);
    const float weight[4] = { (1 - f.x) * (1 - f.y), f.x * (1 - f.y), (1 - f.x) * f.y, f.x * f.y };
    for (int k = 0; k < 4 && shown; k++) {
        const int64_t column = f.column[k & 1], row = f.row[k >> 1];
        const float *texel = p->rgb + 3 * (row * p->columns + column);
        if (!is_shown(t, p, column, row))
            continue;
        whole += weight[k];
        for (int i = 0; i < 3; i++)
            sum[i] += weight[k] * texel[i];
    }
    for (int i = 0; i < 3; i++)
        rgb[i] = e->gain * (whole > 0.0f ? sum[i] / whole : e->resampler->mean[i]);
}

static struct texels source_of(const struct environment *e)
{
    return (struct texels){ e->image.rgb, e->image.width, e->image.height, 1 };
}

static struct texels blocks_of(const struct environment *e)
{
    const struct resample_table *t = e->resampler->table;
    return (struct texels){ e->resampler->reduced, t->columns, t->rows, t->factor };
}

void environment_lookup(const struct environment *e, struct vec3 w, float rgb[3])
{
    const struct texels p = source_of(e);
    interpolate(e, &p, w, rgb);
}

/* The resolution levels, from fine to coarse: the source; its blocks, if the resampler has made them; the cube map's
 * levels, from the first that is clearly coarser; the mean. Texel sizes are the square root of the mean solid angle
 * (lat-long: at the horizon), not of that in the given direction, which is 0.6 to 1.4 times as large on a cube. The
 * mixing weights then depend on the width alone. If they depended on direction, a small sun would be up to 40 %
 * brighter in some places than in others. */
enum { RUNG_SOURCE = -2, RUNG_BLOCKS = -1 }; /* then the pyramid's levels; their count means the mean */

#define FACE_EDGE 1.4472025f /* sqrt(4 pi / 6) */

struct rung {
    int what;
    float texel; /* radians per edge */
};

static struct rung finest(const struct environment *e)
{
    const struct resample_table *t = e->resampler->table;
    const float side = (float)(t->key.width < t->key.height ? t->key.width : t->key.height), pi = (float)PI;
    struct rung source = { RUNG_SOURCE, pi * sqrtf(2.0f / ((float)t->key.width * (float)t->key.height)) };

    if (layout_faces(t->key.layout))
        source.texel = FACE_EDGE / (float)layout_face_size(t->key.layout, t->key.width);
    else if (layout_is_disc(t->key.layout))
        source.texel = (t->key.layout == LAYOUT_BALL ? 4.0f : pi) / side;
    return source;
}

static struct rung coarser(const struct environment *e, struct rung from)
{
    const struct pyramid *p = e->pyramid;
    struct rung next = { from.what + 1, WHOLE_SPHERE };

    if (from.what == RUNG_SOURCE && e->resampler->table->factor > 1) {
        next.texel = (float)e->resampler->table->factor * from.texel;
        return next;
    }
    if (from.what < 0)
        for (next.what = 0; next.what < (int)p->count && FACE_EDGE / (float)p->level[next.what].n < STEP * from.texel;)
            next.what++;
    if (next.what < (int)p->count)
        next.texel = FACE_EDGE / (float)p->level[next.what].n;
    return next;
}

static void look_at_rung(const struct environment *e, int what, struct vec3 w, float rgb[3])
{
    const struct texels own = what == RUNG_SOURCE ? source_of(e) : blocks_of(e);
    float u, v;

    if (what < 0) {
        interpolate(e, &own, w, rgb);
        return;
    }
    const uint32_t face = cube_locate((const float[3]){ w.x, w.y, w.z }, &u, &v);
    pyramid_lookup_at(e->pyramid, (uint32_t)what, face, u, v, rgb);
}

/* Widens an image of texel size `texel` to size `wide`: the mean of T x T lookups at distance d adds (T^2 - 1) d^2 / 12
 * to the variance. T is the smallest, up to 8, for which d does not exceed a texel. */
static void look_by_taps(const struct environment *e, struct rung fine, float wide, struct vec3 w, float rgb[3])
{
    const float more = 3.0f * (wide * wide - fine.texel * fine.texel), t2 = fine.texel * fine.texel;
    const int taps = (int)fminf((float)TAPS_MAX, fmaxf(2.0f, ceilf(sqrtf(1.0f + more / t2))));
    const float step = sqrtf(more / (float)(taps * taps - 1));
    const struct vec3 axis = fabsf(w.y) < 0.7f ? vec3_make(0, 1, 0) : vec3_make(1, 0, 0);
    const struct vec3 a = vec3_normalize(vec3_cross(axis, w)), b = vec3_cross(w, a);

    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    for (int k = 0; k < taps * taps; k++) {
        const float x = step * ((float)(k % taps) - 0.5f * (float)(taps - 1));
        const float y = step * ((float)(k / taps) - 0.5f * (float)(taps - 1));
        const struct vec3 to = vec3_normalize(vec3_add(w, vec3_add(vec3_scale(a, x), vec3_scale(b, y))));
        float seen[3];
        look_at_rung(e, fine.what, to, seen);
        for (int c = 0; c < 3; c++)
            rgb[c] += seen[c] / (float)(taps * taps);
    }
}

/* The two levels of a lookup, the finer one widened to `wide`, and the share of the coarser one. */
struct mixture {
    struct rung fine, coarse;
    float wide, share;
};

/* want: above the finest level's texel. */
static struct mixture mixture_of(const struct environment *e, float want)
{
    struct mixture m = { .fine = finest(e) };

    for (m.coarse = coarser(e, m.fine); m.coarse.texel <= want && m.coarse.what < (int)e->pyramid->count;) {
        m.fine = m.coarse;
        m.coarse = coarser(e, m.fine);
    }
    m.wide = m.fine.what < 0 ? fmaxf(m.fine.texel, fminf(want, m.coarse.texel / GAP)) : m.fine.texel;
    const float f2 = m.wide * m.wide, span = m.coarse.texel * m.coarse.texel - f2;
    m.share = span > 0.0f ? fminf(1.0f, (want * want - f2) / span) : 1.0f;
    return m;
}

static void mix(float share, const float far[3], float rgb[3])
{
    for (int c = 0; c < 3; c++)
        rgb[c] += share * (far[c] - rgb[c]);
}

void environment_lookup_wide(const struct environment *e, struct vec3 w, float width, float rgb[3])
{
    const float want = width * TEXEL_PER_WIDTH;
    float far[3];

    if (!(want > finest(e).texel)) {
        environment_lookup(e, w, rgb);
        return;
    }
    assert(environment_has_pyramid(e));
    const struct mixture m = mixture_of(e, want);
    if (m.wide > m.fine.texel)
        look_by_taps(e, m.fine, m.wide, w, rgb);
    else
        look_at_rung(e, m.fine.what, w, rgb);
    if (m.share <= 0.0f)
        return;
    look_at_rung(e, m.coarse.what, w, far);
    mix(m.share, far, rgb);
}

/* ---- Precomputed lookups ---- */

struct lookup_key lookup_key_of(const struct environment *e)
{
    const struct resample_key *k = &e->resampler->table->key;
    return (struct lookup_key){ k->layout, k->width, k->height, e->n, e->rotation };
}

bool lookup_key_equal(const struct lookup_key *a, const struct lookup_key *b)
{
    return a->layout == b->layout && a->width == b->width && a->height == b->height && a->n == b->n &&
           a->rotation == b->rotation;
}

/* A place in the pyramid, unless the finer level is the source or its blocks. */
static struct lookup_place wide_place(const struct environment *e, struct vec3 w, float want)
{
    const struct mixture m = mixture_of(e, want);
    struct lookup_place p = { .texel = LOOKUP_NONE, .share = fmaxf(0.0f, m.share) };

    if (m.fine.what >= 0)
        p.texel = LOOKUP_WIDE | (uint32_t)m.fine.what |
                  cube_locate((const float[3]){ w.x, w.y, w.z }, &p.x, &p.y) << LOOKUP_FACE;
    return p;
}

void lookup_at_wide(const struct pyramid *from, const struct lookup_place *p, float rgb[3])
{
    const uint32_t face = p->texel >> LOOKUP_FACE & 0xffu, level = p->texel & 0xffu;
    float far[3];

    pyramid_lookup_at(from, level, face, p->x, p->y, rgb);
    if (p->share <= 0.0f)
        return;
    pyramid_lookup_at(from, level + 1, face, p->x, p->y, far);
    mix(p->share, far, rgb);
}

struct lookup_place lookup_place_find(const struct environment *e, struct vec3 w, float width)
{
    const struct lookup_place none = { .texel = LOOKUP_NONE };
    const struct texels p = source_of(e);
    struct four f;

    if (width * TEXEL_PER_WIDTH > finest(e).texel)
        return wide_place(e, w, width * TEXEL_PER_WIDTH);
    if (!find_four(e, &p, w, &f))
        return none;
    for (int k = 0; k < 4; k++)
        if (!is_shown(e->resampler->table, &p, f.column[k & 1], f.row[k >> 1]))
            return none;
    const int64_t right = f.column[1] - f.column[0], down = f.row[1] - f.row[0];
    const uint32_t way = (right == 1   ? 0u
                          : right == 0 ? 1u
                                       : 2u)
                             << LOOKUP_RIGHT |
                         (down == 1 ? 0u : 1u) << LOOKUP_DOWN;
    return (struct lookup_place){ (uint32_t)(f.row[0] * p.columns + f.column[0]) | way, f.x, f.y, 0.0f };
}

struct lookup_image lookup_image_of(const struct environment *e)
{
    const int32_t columns = (int32_t)e->image.width;
    return (struct lookup_image){ e->pyramid, e->image.rgb, e->gain, { 1, 0, 1 - columns, 0 }, { columns, 0 } };
}
