/* The loops of the cache of light transport (transport_parts.h): compiled once per CPU level, see CMakeLists.txt. */
#include "half_lanes.h"
#include "kernels.h"
#include "lobes.h"
#include "rng.h"
#include "transport_parts.h"
#include "transport_trace.h"
#include "vec.h"

#include <math.h>

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

static void widen(const uint16_t *in, float *out, uint32_t n)
{
    struct lanes x;

    for (uint32_t i = 0; i < n; i += PACKET) {
        widen_lanes(in + i, &x);
        memcpy(out + i, x.v, sizeof(x));
    }
}

/* ---- A frame ---- */

/* Sixteen partial sums of each of n, in one order at all levels. */
static inline void sum_lanes(const struct lanes *x, uint32_t n, float *out)
{
    _Alignas(64) float half[8], quarter[3 * TRANSPORT_TOGETHER][4];

    for (uint32_t k = 0; k < n; k++) {
        for (int l = 0; l < 8; l++)
            half[l] = x[k].v[l] + x[k].v[l + 8];
        for (int l = 0; l < 4; l++)
            quarter[k][l] = half[l] + half[l + 4];
    }
    for (uint32_t k = 0; k < n; k++)
        out[k] = (quarter[k][0] + quarter[k][2]) + (quarter[k][1] + quarter[k][3]);
}

/* Adds up rows of V that stand side by side, times the sky. */
static inline void project_rows(const struct transport_piece *q, const struct transport_sky *sky, const uint16_t *v,
                                uint32_t rows, struct lanes sum[TRANSPORT_TOGETHER][3])
{
    for (uint32_t i = 0; i < q->chunk_count; i++) {
        const float(*cells)[TRANSPORT_CHUNK] = sky->cells[q->chunks[i]];
        for (uint32_t r = 0; r < rows; r++, v += TRANSPORT_CHUNK) {
            struct lanes x;
            widen_lanes(v, &x);
            LANES(l)
            {
                sum[r][0].v[l] += x.v[l] * cells[0][l];
                sum[r][1].v[l] += x.v[l] * cells[1][l];
                sum[r][2].v[l] += x.v[l] * cells[2][l];
            }
        }
    }
}

/* y [rank][3] = V times the sky, by colours. */
static void project(const struct transport_piece *q, const struct transport_sky *sky, float y[][3])
{
    const uint16_t *v = q->halves;

    for (uint32_t first = 0; first < q->rank; first += TRANSPORT_TOGETHER) {
        const uint32_t rows = q->rank - first < TRANSPORT_TOGETHER ? q->rank - first : TRANSPORT_TOGETHER;
        struct lanes sum[TRANSPORT_TOGETHER][3];
        memset(sum, 0, sizeof(sum));
        if (rows == TRANSPORT_TOGETHER)
            project_rows(q, sky, v, TRANSPORT_TOGETHER, sum);
        else
            project_rows(q, sky, v, rows, sum);
        v += (size_t)rows * q->chunk_count * TRANSPORT_CHUNK;
        sum_lanes(sum[0], 3 * rows, y[first]);
        for (uint32_t r = first; r < first + rows; r++)
            for (int c = 0; c < 3; c++)
                y[r][c] *= q->scale;
    }
}

/* One packet's sums out of U and y. */
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
    const uint16_t *u = q->halves + (size_t)q->rank * q->chunk_count * TRANSPORT_CHUNK;

    if (!q->raw) {
        expand_packet(u + (size_t)packet * q->rank * PACKET, q->rank, y, out);
        return;
    }
    for (int c = 0; c < 3; c++)
        LANES(l) out[c].v[l] = y[packet * PACKET + (uint32_t)l][c];
}

static void expand(const struct transport_piece *q, const struct transport_sky *sky, uint32_t points,
                   float out[3][TRANSPORT_POINTS])
{
    float y[TRANSPORT_POINTS][3];

    memset(out, 0, 3 * TRANSPORT_POINTS * sizeof(float));
    if (!q->halves)
        return;
    project(q, sky, y);
    for (uint32_t k = 0; k < points / PACKET; k++) {
        struct lanes sum[3];
        take_packet(q, y, k, sum);
        for (int c = 0; c < 3; c++)
            memcpy(&out[c][k * PACKET], sum[c].v, sizeof(sum[c]));
    }
}

/* A compressed row may come out below 0 by its error, radiance may not. */
static inline void add_coloured(const struct shade_packet *p, uint32_t row, const struct lanes sum[3], float *lo)
{
    for (int c = 0; c < 3; c++)
        LANES(l)
        {
            const float x = sum[c].v[l] > 0.0f ? sum[c].v[l] : 0.0f;
            lo[c * PACKET + l] += transport_row_colour(p, row, c, (uint32_t)l) * x;
        }
}

static void cells(const struct transport_block *b, const struct shade_packet *packets, const struct transport_sky *sky,
                  float *lo)
{
    memset(lo, 0, (size_t)b->packets * 3 * PACKET * sizeof(float));
    for (uint32_t k = 0; k < b->packets; k++)
        for (int c = 0; c < 3; c++)
            __builtin_prefetch(packets[k].diffuse[c]);
    for (uint32_t r = 0; r < b->rows; r++) {
        const struct transport_piece *q = &b->pieces[r];
        float y[TRANSPORT_POINTS][3];
        if (!q->halves)
            continue;
        project(q, sky, y);
        for (uint32_t k = 0; k < b->packets; k++) {
            struct lanes sum[3];
            take_packet(q, y, k, sum);
            add_coloured(&packets[k], r, sum, lo + (size_t)k * 3 * PACKET);
        }
    }
}

/* The texel where a gaze ends: its lower part, and of the bright one what balances with the samples of that. */
static inline void look_at(const struct transport_look *look, const float w[3], float density, float rgb[3])
{
    const struct environment *e = look->environment;
    float u, v;
    const uint32_t at = cube_texel(e->n, w, &u, &v);
    const struct texel *x = &e->texels[at];
    const float g = importance_of(e->importance, x->r, x->g, x->b);
    float share = 1.0f;

    if (g > look->level) {
        const float low = look->level / g;
        const float other = (float)((double)(g - look->level) * e->solid_angle[at % (e->n * e->n)] * look->per_energy) *
                            cube_jacobian(u, v);
        share = low + (1.0f - low) * density / (density + other);
    }
    rgb[0] = share * x->r;
    rgb[1] = share * x->g;
    rgb[2] = share * x->b;
}

static void gaze(const struct transport_look *look, const struct shade_packet *p, const struct transport_gaze *gazes,
                 float *lo)
{
    const bool ggx = p->kind == LOBE_GGX;

    for (uint32_t i = 0; i < TRANSPORT_GAZES; i++) {
        const struct transport_gaze *q = &gazes[i];
        for (uint32_t l = 0; l < p->count; l++) {
            const float w[3] = { q->x[l], q->y[l], q->z[l] }, by_one = ggx ? q->by_one[l] : 0.0f;
            float rgb[3];
            if (!(q->by_specular[l] + by_one > 0.0f))
                continue;
            look_at(look, w, q->density[l], rgb);
            for (int c = 0; c < 3; c++)
                lo[c * PACKET + l] += (p->specular[c][l] * q->by_specular[l] + by_one) * rgb[c];
        }
    }
}

/* A packet whose lobes balance with their gazes: by themselves, without the matte part. */
struct glints {
    struct shade_packet points;
    struct lobes lobes;
};

static void set_up_glints(const struct shade_packet *p, struct glints *s)
{
    s->points = *p;
    memset(s->points.diffuse, 0, sizeof(s->points.diffuse));
    lobes_set_up(p, &s->lobes);
    LANES(l) s->lobes.diffuse_part.v[l] = 0.0f;
}

/* Of the lobes' light along d only the share that such samples have beside the gazes. */
static void balance_glints(const struct glints *s, const struct transport_bright *b, const int32_t at[PACKET],
                           const struct lanes d[3], const struct lanes *cosine, struct lanes brdf[3])
{
    struct lanes lobe[3], pdf;

    lobes_evaluate(&s->lobes, &s->points, d, cosine, lobe, &pdf);
    for (int c = 0; c < 3; c++)
        LANES(l)
        {
            const float own = b->density[at[l]], theirs = TRANSPORT_GAZES * pdf.v[l];
            brdf[c].v[l] -= lobe[c].v[l] * (theirs > 0.0f ? theirs / (own + theirs) : 0.0f);
        }
}

/* One sample of the bright part for each lane, each its own: the lanes' variants of a stratum. */
static uint64_t add_bright(const struct rays *rays, const struct transport_bright *b, const struct shade_packet *p,
                           const struct lobes *lobes, const struct glints *glints, struct ray16 *ray,
                           const int32_t at[PACKET], float sum[3][PACKET], struct transport_view *view)
{
    _Alignas(64) int32_t valid[PACKET];
    struct lanes d[3], cosine, brdf[3], pdf;
    int32_t count = 0, lit = 0, dark = 0;

    LANES(l)
    {
        d[0].v[l] = b->x[at[l]];
        d[1].v[l] = b->y[at[l]];
        d[2].v[l] = b->z[at[l]];
    }
    if (!lobes_see(p, d, &cosine))
        return 0;
    LANES(l)
    {
        valid[l] = cosine.v[l] > 0.0f ? p->valid[l] : 0;
        count -= valid[l];
    }
    if (count == 0)
        return 0;
    LANES(l)
    {
        ray->dir_x[l] = d[0].v[l];
        ray->dir_y[l] = d[1].v[l];
        ray->dir_z[l] = d[2].v[l];
        ray->tfar[l] = INFINITY;
    }
    if (rays)
        rays_occluded16(rays, RAYS_TOGETHER, valid, ray);
    LANES(l)
    {
        const int32_t sees = ray->tfar[l] > 0.0f ? valid[l] : 0;
        lit |= sees;
        dark |= valid[l] & ~sees;
        valid[l] = sees;
    }
    view->lit |= lit != 0;
    view->dark |= dark != 0;
    if (lit) {
        lobes_evaluate(lobes, p, d, &cosine, brdf, &pdf);
        if (glints)
            balance_glints(glints, b, at, d, &cosine, brdf);
        LANES(l)
        {
            sum[0][l] += valid[l] ? brdf[0].v[l] * b->r[at[l]] : 0.0f;
            sum[1][l] += valid[l] ? brdf[1].v[l] * b->g[at[l]] : 0.0f;
            sum[2][l] += valid[l] ? brdf[2].v[l] * b->b[at[l]] : 0.0f;
        }
    }
    return rays ? (uint64_t)count : 0;
}

/* Of each TRANSPORT_MORE strata that follow each other pass 0 takes one, by the lane's variant, so that over many
 * points it takes all alike, and pass 1 the others. Variants of 16 points are 16 that follow each other in a sequence
 * that spreads well. */
static uint64_t bright(const struct rays *rays, const struct transport_bright *b, const struct shade_packet *p,
                       bool narrow, uint32_t index, uint32_t pass, float sum[3][PACKET], struct transport_view *view)
{
    const uint32_t base = (uint32_t)(rng_mix(b->seed, index) % (TRANSPORT_VARIANTS / PACKET)) * PACKET;
    struct lobes lobes;
    struct glints glints;
    struct ray16 ray = { .org_x = { 0 } };
    uint64_t traced = 0;

    lobes_set_up(p, &lobes);
    if (narrow)
        set_up_glints(p, &glints);
    LANES(l)
    {
        ray.org_x[l] = p->x[l];
        ray.org_y[l] = p->y[l];
        ray.org_z[l] = p->z[l];
        ray.mask[l] = UINT32_MAX;
    }
    for (uint32_t i = 0; i < b->few; i++)
        for (uint32_t j = pass; j < (pass ? TRANSPORT_MORE : 1u); j++) {
            int32_t at[PACKET];
            LANES(l)
            {
                const uint32_t variant = base + (uint32_t)l, turn = (variant + i + j) % TRANSPORT_MORE;
                const uint32_t stratum = TRANSPORT_MORE * i + turn;
                at[l] = (int32_t)(stratum * TRANSPORT_VARIANTS + variant);
            }
            traced += add_bright(rays, b, p, &lobes, narrow ? &glints : NULL, &ray, at, sum, view);
        }
    return traced;
}

/* Sixteen points that stand for a block's: every fourth of each packet, or of fewer packets more. */
static uint64_t probe(const struct rays *rays, const struct transport_bright *b, const struct shade_packet *packets,
                      uint32_t count, uint32_t index, struct transport_view *view)
{
    const uint32_t base = (uint32_t)(rng_mix(b->seed, index) % (TRANSPORT_VARIANTS / PACKET)) * PACKET;
    _Alignas(64) int32_t valid[PACKET];
    struct ray16 ray = { .org_x = { 0 } };
    int32_t faced = 0;

    for (uint32_t l = 0; l < PACKET; l++) {
        const struct shade_packet *p = &packets[l % count];
        const uint32_t k = (l / count * count + l % count * 5 + l % count) % PACKET; /* other places in each */
        const uint32_t at = (l * b->strata / PACKET) * TRANSPORT_VARIANTS + base + l;
        const float x = b->x[at], y = b->y[at], z = b->z[at];
        const bool faces = p->ns_x[k] * x + p->ns_y[k] * y + p->ns_z[k] * z > 0.0f &&
                           p->ng_x[k] * x + p->ng_y[k] * y + p->ng_z[k] * z > 0.0f;
        valid[l] = faces ? p->valid[k] : 0;
        faced -= valid[l];
        ray.org_x[l] = p->x[k];
        ray.org_y[l] = p->y[k];
        ray.org_z[l] = p->z[k];
        ray.dir_x[l] = x;
        ray.dir_y[l] = y;
        ray.dir_z[l] = z;
        ray.tfar[l] = INFINITY;
        ray.mask[l] = UINT32_MAX;
    }
    if (faced == 0)
        return 0;
    rays_occluded16(rays, RAYS_TOGETHER, valid, &ray);
    for (uint32_t l = 0; l < PACKET; l++) {
        view->lit |= valid[l] && ray.tfar[l] > 0.0f;
        view->dark |= valid[l] && !(ray.tfar[l] > 0.0f);
    }
    return (uint64_t)faced;
}

extern const struct transport_kernels JOIN(transport_kernels_, KERNEL_LEVEL);
const struct transport_kernels JOIN(transport_kernels_, KERNEL_LEVEL) = { trace, cells,  expand, aim,
                                                                          gaze,  bright, probe,  widen };
