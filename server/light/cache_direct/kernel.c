/* The loops of the cache of direct light (light/cache_direct/internal.h): compiled once per CPU level, see
 * CMakeLists.txt.
 */
#include "base/vec.h"
#include "light/cache_direct/half_lanes.h"
#include "light/cache_direct/internal.h"
#include "light/cache_direct/trace.h"
#include "scene/surface/lobes.h"
#include "sky/tables/pyramid.h"

#include <math.h>

static void widen(const uint16_t *in, float *out, uint32_t n)
{
    struct lanes x;

    for (uint32_t i = 0; i < n; i += PACKET) {
        widen_lanes(in + i, &x);
        memcpy(out + i, x.v, sizeof(x));
    }
}

/* ---- A frame ---- */

#define AHEAD 2048 /* bytes of V to prefetch: about the latency of memory */

/* Adds up rows of V that stand side by side, times the sky. */
static inline void project_rows(const struct transport_piece *q, const struct sky_split *sky, const uint8_t *v,
                                bool bytes, uint32_t rows, struct lanes sum[TRANSPORT_TOGETHER][3])
{
    for (uint32_t i = 0; i < q->shape.chunk_count; i++) {
        const float(*cells)[SKY_CHUNK] = sky->cells[q->shape.chunks[i]];
        __builtin_prefetch(v + AHEAD); /* across pages, where the hardware prefetcher stops */
        for (uint32_t r = 0; r < rows; r++, v += bytes ? SKY_CHUNK : 2 * SKY_CHUNK) {
            struct lanes x;
            if (bytes)
                widen_bytes((const int8_t *)v, &x);
            else
                widen_lanes((const uint16_t *)(const void *)v, &x);
            LANES(l)
            {
                sum[r][0].v[l] += x.v[l] * cells[0][l];
                sum[r][1].v[l] += x.v[l] * cells[1][l];
                sum[r][2].v[l] += x.v[l] * cells[2][l];
            }
        }
    }
}

/* y[rank][3] = V times the sky, per colour. */
static inline void project_form(const struct transport_piece *q, const struct sky_split *sky, bool bytes, float y[][3])
{
    const float *gains = (const float *)(const void *)q->bytes;
    const uint8_t *v = q->bytes + transport_gains(&q->shape) * sizeof(float);

    for (uint32_t first = 0; first < q->shape.rank; first += TRANSPORT_TOGETHER) {
        const uint32_t rows = q->shape.rank - first < TRANSPORT_TOGETHER ? q->shape.rank - first : TRANSPORT_TOGETHER;
        struct lanes sum[TRANSPORT_TOGETHER][3];
        memset(sum, 0, sizeof(sum));
        if (rows == TRANSPORT_TOGETHER)
            project_rows(q, sky, v, bytes, TRANSPORT_TOGETHER, sum);
        else
            project_rows(q, sky, v, bytes, rows, sum);
        v += (size_t)rows * q->shape.chunk_count * SKY_CHUNK * (bytes ? 1 : sizeof(uint16_t));
        for (uint32_t r = first; r < first + rows; r++) {
            sum_lanes(sum[r - first], y[r]);
            for (int c = 0; c < 3; c++)
                y[r][c] *= bytes ? gains[r] : q->shape.scale;
        }
    }
}

static void project(const struct transport_piece *q, const struct sky_split *sky, float y[][3])
{
    if (q->shape.form == TRANSPORT_BYTES)
        project_form(q, sky, true, y);
    else
        project_form(q, sky, false, y);
}

/* One packet's U times y. */
static inline void expand_packet(const uint16_t *u, uint32_t rank, float y[][3], struct lanes out[3])
{
    memset(out, 0, 3 * sizeof(*out));
    for (uint32_t k = 0; k < rank; k++, u += PACKET) {
        struct lanes x;
        widen_lanes(u, &x);
        LANES(l)
        {
            out[0].v[l] += x.v[l] * y[k][0];
            out[1].v[l] += x.v[l] * y[k][1];
            out[2].v[l] += x.v[l] * y[k][2];
        }
    }
}

static void take_packet(const struct transport_piece *q, float y[][3], uint32_t packet, struct lanes out[3])
{
    const uint16_t *u = (const uint16_t *)(const void *)(q->bytes + transport_head(&q->shape));

    if (q->shape.form != TRANSPORT_RAW) {
        expand_packet(u + (size_t)packet * q->shape.rank * PACKET, q->shape.rank, y, out);
        return;
    }
    for (int c = 0; c < 3; c++)
        LANES(l) out[c].v[l] = y[packet * PACKET + (uint32_t)l][c];
}

static void expand(const struct transport_piece *q, const struct sky_split *sky, uint32_t points,
                   float out[3][TRANSPORT_POINTS])
{
    float y[TRANSPORT_POINTS][3];

    memset(out, 0, 3 * TRANSPORT_POINTS * sizeof(float));
    if (!q->bytes)
        return;
    project(q, sky, y);
    for (uint32_t k = 0; k < points / PACKET; k++) {
        struct lanes sum[3];
        take_packet(q, y, k, sum);
        for (int c = 0; c < 3; c++)
            memcpy(&out[c][k * PACKET], sum[c].v, sizeof(sum[c]));
    }
}

/* lo += colour of the row * x. Reads only the colours that the row needs, since they are far apart in memory. */
static inline void colour_row(const struct shade_packet *p, uint32_t row, int c, const struct lanes *x, float *lo)
{
    if (row == 0)
        LANES(l) lo[l] += p->diffuse[c][l] * x->v[l];
    else if (row == 1)
        LANES(l) lo[l] += p->specular[c][l] * x->v[l];
    else
        LANES(l) lo[l] += x->v[l];
}

/* Clamps negative values, which compression may cause. more: [3][TRANSPORT_POINTS] from the packet's first lane on, or
 * NULL. */
static inline void add_coloured(const struct shade_packet *p, uint32_t row, const struct lanes sum[3],
                                const float *more, float *lo)
{
    for (int c = 0; c < 3; c++) {
        struct lanes x;
        LANES(l) x.v[l] = sum[c].v[l] > 0.0f ? sum[c].v[l] : 0.0f;
        if (more) {
            const float *from = more + (size_t)c * TRANSPORT_POINTS;
            LANES(l) x.v[l] += from[l] > 0.0f ? from[l] : 0.0f;
        }
        colour_row(p, row, c, &x, lo + c * PACKET);
    }
}

/* Prefetches the colours, which are far apart and are read at the end of the block. */
static inline void ask_for_colours(const struct transport_block *b, const struct shade_packet *packets)
{
    const bool shines = b->kind != LOBE_LAMBERT;

    for (uint32_t k = 0; k < b->packets; k++)
        for (int c = 0; c < 3; c++) {
            __builtin_prefetch(packets[k].diffuse[c]);
            if (shines)
                __builtin_prefetch(packets[k].specular[c]);
        }
}

static void cells(const struct transport_block *b, const struct shade_packet *packets, const struct sky_split *sky,
                  const struct transport_rows *more, float *lo)
{
    const uint32_t added = more ? more->count : 0, rows = b->rows > added ? b->rows : added;

    ask_for_colours(b, packets);
    memset(lo, 0, (size_t)b->packets * 3 * PACKET * sizeof(float));
    for (uint32_t r = 0; r < rows; r++) {
        const struct transport_piece *q = &b->pieces[r];
        const bool has = r < b->rows && q->bytes;
        const float *from = r < added ? more->at[r][0] : NULL;
        float y[TRANSPORT_POINTS][3];
        if (has)
            project(q, sky, y);
        for (uint32_t k = 0; k < b->packets && (has || from); k++) {
            struct lanes sum[3] = { { { 0.0f } } };
            if (has)
                take_packet(q, y, k, sum);
            add_coloured(&packets[k], r, sum, from ? from + (size_t)k * PACKET : NULL, lo + (size_t)k * 3 * PACKET);
        }
    }
}

/* Where a packet's lanes look: on which face of the sky and where, and at which level of its pyramid. */
struct glances {
    struct lanes u, v, density;
    int32_t face[PACKET], level[PACKET];
};

/* The level is the coarsest one whose texels are no larger than half the solid angle of one gaze; [Krivanek and
 * Colbert 2008] use twice as large ones, but draw new samples for each pixel. */
static inline void find_glances(const struct pyramid *p, const struct transport_gaze *q, struct glances *g)
{
    const float most = (float)(2.0 * 4.0 * PI / CUBE_FACES); /* texels have 4 pi / (6 n^2) sr */

    widen_lanes(q->root_density, &g->density);
    LANES(l)
    {
        g->u.v[l] = direction_u(q->to[l]);
        g->v.v[l] = direction_v(q->to[l]);
        g->face[l] = (int32_t)direction_face(q->to[l]);
        g->density.v[l] *= g->density.v[l];
        g->level[l] = 0;
    }
    for (uint32_t k = 1; k < p->count; k++) {
        const float texels = (float)(p->level[k].n * p->level[k].n);
        LANES(l) g->level[l] += most * g->density.v[l] <= texels;
    }
}

/* A texel as one vector. */
#define FOUR_FLOATS __attribute__((vector_size(4 * sizeof(float)))) float

/* The four texels around a glance, and their weights. False if they are not all on one face. */
static inline bool find_four(const float *texels, uint32_t n, const struct glances *g, int l, FOUR_FLOATS out[4],
                             float weight[4])
{
    const float half = 0.5f * (float)n, last = (float)(n - 1);
    const float x = (g->u.v[l] + 1.0f) * half - 0.5f, y = (g->v.v[l] + 1.0f) * half - 0.5f;

    if (!(x >= 0.0f && y >= 0.0f && x < last && y < last))
        return false;
    const uint32_t j = (uint32_t)x, i = (uint32_t)y;
    const float fx = x - (float)j, fy = y - (float)i;
    const float *at = texels + 4 * (((size_t)g->face[l] * n + i) * n + j);
    memcpy(out, at, 2 * sizeof(*out));
    memcpy(out + 2, at + 4 * (size_t)n, 2 * sizeof(*out));
    weight[0] = (1 - fx) * (1 - fy);
    weight[1] = fx * (1 - fy);
    weight[2] = (1 - fx) * fy;
    weight[3] = fx * fy;
    return true;
}

static inline void look_level(const struct pyramid *p, const struct glances *g, int l, float rgb[3])
{
    const struct pyramid_level *level = &p->level[g->level[l]];
    FOUR_FLOATS t[4];
    float k[4];

    if (level->gain || !find_four(level->texels, level->n, g, l, t, k)) {
        pyramid_lookup_at(p, (uint32_t)g->level[l], (uint32_t)g->face[l], g->u.v[l], g->v.v[l], rgb);
        return;
    }
    const FOUR_FLOATS sum = (k[0] * t[0] + k[1] * t[1]) + (k[2] * t[2] + k[3] * t[3]);
    memcpy(rgb, &sum, 3 * sizeof(*rgb));
}

/* The lower part along a gaze, interpolated, because steps between texels would be visible as the sky turns. Where the
 * pyramid's level contains some of the sun, the lower part is interpolated from texels instead. */
static inline void look_low(const struct transport_look *look, const struct glances *g, const struct transport_gaze *q,
                            int l, float rgb[3])
{
    const struct environment *e = look->environment;
    FOUR_FLOATS t[4], sum = { 0.0f };
    float k[4];

    look_level(e->pyramid, g, l, rgb);
    if (!(rgb_luminance(rgb[0], rgb[1], rgb[2]) > look->level))
        return;
    if (!find_four(&e->texels->r, e->n, g, l, t, k)) {
        memcpy(t, &e->texels[direction_texel(q->to[l], e->n)], sizeof(*t));
        t[1] = t[2] = t[3] = t[0];
        k[0] = 1.0f;
        k[1] = k[2] = k[3] = 0.0f;
    }
    for (int i = 0; i < 4; i++)
        sum += k[i] * sky_lower(look->level, rgb_luminance(t[i][0], t[i][1], t[i][2])) * t[i];
    memcpy(rgb, &sum, 3 * sizeof(*rgb));
}

/* Adds the balance heuristic's share of the sun in the texel that a gaze meets. */
static inline void look_sun(const struct transport_look *look, const struct glances *g, const struct transport_gaze *q,
                            int l, float rgb[3])
{
    const struct environment *e = look->environment;
    const uint32_t at = direction_texel(q->to[l], e->n);
    const struct texel *x = &e->texels[at];
    const float luminance = rgb_luminance(x->r, x->g, x->b), above = 1.0f - sky_lower(look->level, luminance);

    if (!(above > 0.0f))
        return;
    const float other = (float)((double)(luminance * above) * e->solid_angle[at % (e->n * e->n)] * look->per_energy) *
                        cube_jacobian(g->u.v[l], g->v.v[l]);
    const float share = above * g->density.v[l] / (g->density.v[l] + other);
    rgb[0] += share * x->r;
    rgb[1] += share * x->g;
    rgb[2] += share * x->b;
}

/* Which lanes look near the sun: spares most gazes the texel, which is outside the near caches. */
static inline void find_near(const struct transport_look *look, const struct glances *g, int32_t near[PACKET])
{
    const float *a = look->sun->axis, cosine = look->sun->cosine;

    LANES(l)
    {
        const float u = g->u.v[l], v = g->v.v[l], along = g->face[l] & 1 ? -1.0f : 1.0f;
        const int32_t on = g->face[l] >> 1;
        const float dot = on == 0   ? along * a[0] + u * a[1] + v * a[2]
                          : on == 1 ? along * a[1] + u * a[2] + v * a[0]
                                    : along * a[2] + u * a[0] + v * a[1];
        near[l] = dot >= cosine * sqrtf(1.0f + u * u + v * v);
    }
}

static void gaze(const struct transport_look *look, const struct shade_packet *p, const struct transport_gaze *gazes,
                 float *lo)
{
    const bool sun = look->level<INFINITY, three = lobe_rows((enum lobe_kind)p->kind)> 2;

    for (uint32_t i = 0; i < TRANSPORT_GAZES; i++) {
        const struct transport_gaze *q = &gazes[i];
        struct lanes specular, one = { { 0.0f } }, light[3] = { { { 0.0f } } };
        struct glances g;
        int32_t near[PACKET] = { 0 };
        widen_lanes(q->by_specular, &specular);
        if (three)
            widen_lanes(q->by_one, &one);
        find_glances(look->environment->pyramid, q, &g);
        if (sun)
            find_near(look, &g, near);
        for (int l = 0; l < (int)p->count; l++) {
            float rgb[3];
            if (!(specular.v[l] + one.v[l] > 0.0f))
                continue;
            look_low(look, &g, q, l, rgb);
            if (near[l])
                look_sun(look, &g, q, l, rgb);
            for (int c = 0; c < 3; c++)
                light[c].v[l] = rgb[c];
        }
        for (int c = 0; c < 3; c++)
            LANES(l) lo[c * PACKET + l] += (p->specular[c][l] * specular.v[l] + one.v[l]) * light[c].v[l];
    }
}

extern const struct sun_kernels KERNEL(sun_kernels);
extern const struct transport_kernels KERNEL(transport_kernels);
const struct transport_kernels KERNEL(transport_kernels) = { trace, cells, expand, aim, gaze, &KERNEL(sun_kernels),
                                                             widen };
