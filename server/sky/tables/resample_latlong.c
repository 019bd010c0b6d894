#include "base/vec.h"
#include "sky/tables/resample.h"

#include <math.h>
#include <stdbool.h>

/* The cube texel being integrated, and the list for its overlaps. */
struct target {
    uint32_t texel;
    double solid_angle;
    struct overlaps *out;
};

/* A straight border of a cube texel, seen from the centre: a horizontal line at height y, at distance d in direction
 * `azimuth`. With k = y / d and psi the azimuth relative to it, the height of the unit vector along the line is h(psi)
 * = k cos(psi) / sqrt(1 + k^2 cos(psi)^2), and the integral of h = asin(k sin(psi) / sqrt(1 + k^2)). If the texel
 * contains a pole, the border is the pole itself and h is constant. */
struct border {
    double k, azimuth;
    double constant; /* 1 or -1 at a pole, else 0 */
};

/* The azimuths of an interval relative to a border's, and their cosines and sines, which all borders with one azimuth
 * share. */
struct span {
    double psi[2], cosine[2], sine[2];
};

/* A border within an interval of azimuths. All that does not depend on a row of the source is computed once here. */
struct arc {
    struct border border;
    const struct span *span;
    double scale;       /* k / sqrt(1 + k^2) */
    double integral[2]; /* of h, at both ends of the span */
    double low, high;   /* h within the span */
};

static double wrap_angle(double a)
{
    while (a > PI)
        a -= 2.0 * PI;
    while (a <= -PI)
        a += 2.0 * PI;
    return a;
}

static double least(double a, double b)
{
    return a < b ? a : b;
}

static double most(double a, double b)
{
    return a > b ? a : b;
}

/* The interval phi0..phi1, relative to `azimuth`. */
static void span_init(struct span *s, double azimuth, double phi0, double phi1)
{
    s->psi[0] = wrap_angle(0.5 * (phi0 + phi1) - azimuth) - 0.5 * (phi1 - phi0);
    s->psi[1] = s->psi[0] + (phi1 - phi0);
    for (int k = 0; k < 2; k++) {
        s->cosine[k] = cos(s->psi[k]);
        s->sine[k] = sin(s->psi[k]);
    }
}

static double border_height(const struct border *b, double cosine)
{
    const double c = b->k * cosine;
    return b->constant != 0.0 ? b->constant : c / sqrt(1.0 + c * c);
}

static void arc_init(struct arc *a, const struct border *b, const struct span *s)
{
    const double h0 = border_height(b, s->cosine[0]), h1 = border_height(b, s->cosine[1]);
    const double middle = s->psi[0] < 0.0 && s->psi[1] > 0.0 ? border_height(b, 1.0) : h0;

    a->border = *b;
    a->span = s;
    a->low = least(least(h0, h1), middle);
    a->high = most(most(h0, h1), middle);
    a->scale = b->k / sqrt(1.0 + b->k * b->k);
    for (int k = 0; k < 2; k++)
        a->integral[k] = asin(a->scale * s->sine[k]);
}

static double integral_at(const struct arc *a, double psi)
{
    const struct span *s = a->span;
    return psi == s->psi[0] ? a->integral[0] : psi == s->psi[1] ? a->integral[1] : asin(a->scale * sin(psi));
}

#define COSINE_SLACK 1e-9 /* far above rounding, far below the difference that a crossing makes */

/* Integral of min(h, cap) over the span; cap_sine: sqrt(1 - cap^2). |h| decreases away from psi = 0, so it crosses the
 * cap at -psi* and psi*, where cos(psi*) = cap / (k sqrt(1 - cap^2)). Few spans contain a crossing; the others are
 * recognised by its cosine alone. */
static double capped_integral(const struct arc *a, double cap, double cap_sine)
{
    const struct span *s = a->span;
    const double k = a->border.k, width = s->psi[1] - s->psi[0], whole = a->integral[1] - a->integral[0];

    if (a->border.constant != 0.0)
        return least(a->border.constant, cap) * width;
    if (k * cap <= 0.0) /* the border lies entirely on one side of the cap */
        return k > 0.0 || (k == 0.0 && cap < 0.0) ? cap * width : whole;
    const double ratio = cap / (k * cap_sine);
    const double nearest = s->psi[0] < 0.0 && s->psi[1] > 0.0 ? 1.0 : most(s->cosine[0], s->cosine[1]);
    if (ratio < least(s->cosine[0], s->cosine[1]) - COSINE_SLACK) /* the crossings are outside */
        return k > 0.0 ? cap * width : whole;
    if (ratio >= least(1.0, nearest + COSINE_SLACK)) /* both are on one side, or there is none */
        return k > 0.0 ? whole : cap * width;
    const double crossing = acos(ratio);
    const double in0 = least(s->psi[1], most(s->psi[0], -crossing)), in1 = least(s->psi[1], most(s->psi[0], crossing));
    const double within = integral_at(a, in1) - integral_at(a, in0);
    if (k > 0.0) /* above the cap between the crossings */
        return cap * (in1 - in0) + (integral_at(a, in0) - a->integral[0]) + (a->integral[1] - integral_at(a, in1));
    return within + cap * (width - (in1 - in0));
}

/* The azimuths of the texel's corners and extremes, ascending. Returns their number. */
static int texel_azimuths(uint32_t face, const double u[2], const double v[2], double out[6])
{
    const int pole_inside = face >> 1 == 1 && u[0] < 0 && u[1] > 0 && v[0] < 0 && v[1] > 0;
    double centre[3], w[3];
    int count = 0;

    if (pole_inside) {
        out[0] = -PI;
        out[1] = PI;
        count = 2;
    }
    cube_direction(face, 0.5 * (u[0] + u[1]), 0.5 * (v[0] + v[1]), centre);
    const double phi_centre = pole_inside ? 0.0 : atan2(centre[0], centre[2]);
    for (int k = 0; k < 4; k++) {
        cube_direction(face, u[k & 1], v[k >> 1], w);
        if (fabs(w[0]) < 1e-12 && fabs(w[2]) < 1e-12)
            continue; /* a pole has no azimuth */
        out[count++] = phi_centre + wrap_angle(atan2(w[0], w[2]) - phi_centre);
    }
    for (int i = 1; i < count; i++) /* insertion sort of at most six */
        for (int k = i; k > 0 && out[k - 1] > out[k]; k--) {
            const double swap = out[k];
            out[k] = out[k - 1];
            out[k - 1] = swap;
        }
    return count;
}

/* Walks from one corner azimuth or border between source columns to the next. */
struct walk {
    double stops[6];
    int count, stop;
    /* The current interval: azimuths, the source column that contains it, and that column's width in radians. */
    double from, to;
    uint32_t column;
    double column_width;
};

static void walk_init(struct walk *w, uint32_t face, const double u[2], const double v[2])
{
    w->count = texel_azimuths(face, u, v, w->stops);
    w->stop = 0;
    w->to = w->stops[0];
}

static bool walk_next(struct walk *w, const struct blocks *b, double rotation)
{
    const double texels_per_radian = b->width / (2.0 * PI);

    w->from = w->to;
    while (w->stop + 1 < w->count && !(w->from < w->stops[w->stop + 1] - 1e-14))
        w->from = w->stops[++w->stop];
    if (w->stop + 1 >= w->count)
        return false;
    /* Azimuth in the source: phi = pi - 2 pi x / width, after undoing the rotation. */
    const double x = (PI - (w->from - rotation)) * texels_per_radian;
    /* The block to the left of x and its left border, which is the next one with increasing azimuth. */
    const double turn = b->width * floor((x - 1e-9) / b->width);
    const double block = most(0.0, ceil((x - turn) / b->factor - 1e-9) - 1.0);
    w->column = block < b->columns ? (uint32_t)block : b->columns - 1;
    const double border = turn + (double)b->factor * w->column;
    w->to = least(PI - border / texels_per_radian + rotation, w->stops[w->stop + 1]);
    w->column_width = least(b->factor, b->width - (double)b->factor * w->column) / texels_per_radian;
    return true;
}

static const double normal_azimuth[4] = { 0.5 * PI, -0.5 * PI, 0.0, PI }; /* +x, -x, +z, -z */

/* The borders where the meridian at phi enters and leaves a texel of face +Y. u runs along z, v along x: the meridian
 * is a ray from the plane's origin, clipped against both slabs. */
static void find_borders(const double u[2], const double v[2], double phi, struct border out[2])
{
    const double along[2] = { cos(phi), sin(phi) }, low[2] = { u[0], v[0] }, high[2] = { u[1], v[1] };
    double near = 0.0, far = 1e30;

    out[0] = out[1] = (struct border){ 0.0, 0.0, 1.0 };
    for (int k = 0; k < 2; k++) {
        if (fabs(along[k]) < 1e-15)
            continue;
        const double enter = along[k] > 0.0 ? low[k] : high[k], leave = along[k] > 0.0 ? high[k] : low[k];
        const double toward = normal_azimuth[(k == 0 ? 2 : 0) + (along[k] < 0.0)];
        if (enter / along[k] > near + 1e-15) {
            near = enter / along[k];
            out[0] = (struct border){ 1.0 / fabs(enter), toward, 0.0 };
        }
        if (leave / along[k] < far) {
            far = leave / along[k];
            out[1] = (struct border){ 1.0 / fabs(leave), toward, 0.0 };
        }
    }
}

/* Integrates a texel over an interval exactly: between its lower and upper border, row by row of the source, from row
 * *r or so on, which becomes the first row. */
static enum err add_rows(const struct blocks *b, const struct row_edges *edges, const struct walk *w,
                         const struct arc *lower, const struct arc *upper, struct target *t, uint32_t *first)
{
    uint32_t r = *first;
    enum err e = ERR_OK;

    while (r > 0 && upper->high > edges->height[r])
        r--;
    while (r + 1 < b->rows && upper->high <= edges->height[r + 1])
        r++;
    *first = r;
    double above = capped_integral(upper, edges->height[r], edges->sine[r]);
    double above_lower = capped_integral(lower, edges->height[r], edges->sine[r]);
    for (; r < b->rows && !e; r++) {
        const double below = capped_integral(upper, edges->height[r + 1], edges->sine[r + 1]);
        const double below_lower = capped_integral(lower, edges->height[r + 1], edges->sine[r + 1]);
        const double found = (above - below) - (above_lower - below_lower);
        const double whole = w->column_width * (edges->height[r] - edges->height[r + 1]);
        if (found > OVERLAP_MIN * least(whole, t->solid_angle)) {
            const uint32_t y = b->layout == LAYOUT_LATLONG_BOTTOM_FIRST ? b->rows - 1 - r : r;
            e = overlaps_add(t->out, t->texel, y * b->columns + w->column, found);
        }
        if (lower->low >= edges->height[r + 1])
            break;
        above = below;
        above_lower = below_lower;
    }
    return e;
}

/* A texel of both polar faces, which lie above each other and so have the same intervals. */
static enum err add_polar_texels(const struct blocks *b, const struct cube_side *c, const struct row_edges *edges,
                                 uint32_t in_face, uint32_t first[2], struct overlaps *out)
{
    const uint32_t n = c->n, i = in_face / n, j = in_face % n;
    const double u[2] = { -1.0 + 2.0 * j / n, -1.0 + 2.0 * (j + 1) / n };
    const double v[2] = { -1.0 + 2.0 * i / n, -1.0 + 2.0 * (i + 1) / n };
    struct walk w;
    enum err e = ERR_OK;

    walk_init(&w, 2, u, v);
    while (!e && walk_next(&w, b, c->rotation)) {
        struct border border[2];
        struct span span[2];
        struct arc arc[2];
        find_borders(u, v, 0.5 * (w.from + w.to), border);
        for (int k = 0; k < 2; k++)
            span_init(&span[k], border[k].azimuth, w.from, w.to);
        for (uint32_t south = 0; south < 2 && !e; south++) {
            struct target t = { (2 + south) * n * n + in_face, c->solid_angle[in_face], out };
            for (int k = 0; k < 2; k++) {
                if (south)
                    border[k] = (struct border){ -border[k].k, border[k].azimuth, -border[k].constant };
                arc_init(&arc[k], &border[k], &span[k]);
            }
            e = add_rows(b, edges, &w, &arc[!south], &arc[south], &t, &first[south]);
        }
    }
    return e;
}

/* The first `count` texels of a row. */
static enum err add_polar_row(const struct blocks *b, const struct cube_side *c, const struct row_edges *edges,
                              uint32_t row, uint32_t count, struct overlaps *out)
{
    uint32_t first[2] = { 0, b->rows - 1 };
    enum err e = ERR_OK;

    for (uint32_t j = 0; j < count && !e; j++)
        e = add_polar_texels(b, c, edges, row * c->n + j, first, out);
    return e;
}

/* A slice of a side face: the texels between two meridians, from the bottom up. All have the same intervals, and the
 * upper border of one is the lower border of the next. */
static enum err add_side_slice(const struct blocks *b, const struct cube_side *c, const struct row_edges *edges,
                               uint32_t slice, struct overlaps *out)
{
    const uint32_t n = c->n, side = slice / n, s = slice % n, face = side < 2 ? side : side + 2;
    const double azimuth = normal_azimuth[side], all[2] = { -1.0, 1.0 };
    const double across[2] = { -1.0 + 2.0 * s / n, -1.0 + 2.0 * (s + 1) / n };
    struct walk w;
    enum err e = ERR_OK;

    walk_init(&w, face, face < 2 ? all : across, face < 2 ? across : all);
    while (!e && walk_next(&w, b, c->rotation)) {
        struct span span;
        struct arc arc[2];
        uint32_t first = b->rows - 1;
        span_init(&span, azimuth, w.from, w.to);
        arc_init(&arc[0], &(struct border){ -1.0, azimuth, 0.0 }, &span);
        for (uint32_t m = 0; m < n && !e; m++) {
            const uint32_t in_face = face < 2 ? s * n + m : m * n + s; /* u or v runs along y */
            struct target t = { face * n * n + in_face, c->solid_angle[in_face], out };
            arc_init(&arc[(m + 1) & 1], &(struct border){ -1.0 + 2.0 * (m + 1) / n, azimuth, 0.0 }, &span);
            e = add_rows(b, edges, &w, &arc[m & 1], &arc[(m + 1) & 1], &t, &first);
        }
    }
    return e;
}

/* Whether a quarter turn about y maps the source and the cube map onto themselves. */
bool resample_is_fourfold(const struct blocks *b, uint32_t n)
{
    const bool latlong = b->layout == LAYOUT_LATLONG || b->layout == LAYOUT_LATLONG_BOTTOM_FIRST;

    return latlong && b->columns % 4 == 0 && b->columns * b->factor == b->width && n % 2 == 0;
}

void resample_latlong_part(const struct blocks *b, const struct cube_side *c, const struct row_edges *edges,
                           uint32_t part, struct overlaps *out)
{
    const bool fourfold = resample_is_fourfold(b, c->n);
    const uint32_t n = c->n, sides = (RESAMPLE_LATLONG_PARTS - 1) * n, row = part - sides;

    out->e = ERR_OK;
    if (fourfold && (part < sides ? part >= n : row >= n / 2))
        return;
    out->e = part < sides ? add_side_slice(b, c, edges, part, out)
                          : add_polar_row(b, c, edges, row, fourfold ? n / 2 : n, out);
}
