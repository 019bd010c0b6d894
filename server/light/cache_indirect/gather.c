/* Gathers the light that shade points receive from records: per cell, to find the basis; in the basis, for the blocks.
 */
#include "light/cache_indirect/internal.h"

#include "base/cancel.h"
#include "base/denormals.h"
#include "base/mem.h"
#include "base/precedence.h"
#include "light/cache/cache_share.h"
#include "light/cache/memory.h"

#include <cblas.h>
#include <omp.h>

#include <math.h>
#include <string.h>

#define TOLERANCE 0.035 /* of a block's compression, relative; see docs/internals/transport-cache.md */
#define FLOOR 0.03f     /* share of a block's mean light; darker points are weighted as if they had this much */
#define BATCH 32u       /* groups */
#define OPEN_UNIT 1e6f  /* of sums of direct light */
#define FIRST_SHARE 32u /* of a point's most rays by the matte part one in so many is traced by every point, */
#define FIRST_LEAST 8u  /* but so many at least */
#define LOBE_SHARE 2u   /* points with lobes, such as most of leaves, trace one in so many by each part, by a lobe */
#define LOBE_WHOLE 0.35 /* that reflects this share of their light or more; */
#define LOBE_LEAST 12.0 /* so many at least */

/* A shade point with its BRDF, whose parts are rows (light/cache_direct/internal.h). */
struct point {
    struct vec3 at, wo;
    struct lobe own;
    uint32_t rows;
};

static struct point point_of(const struct shade_packet *p, uint32_t l, uint32_t rows)
{
    return (struct point){
        .at = { p->x[l], p->y[l], p->z[l] },
        .wo = { p->wo_x[l], p->wo_y[l], p->wo_z[l] },
        .own = { .kind = (enum lobe_kind)p->kind,
                 .geometric = { p->ng_x[l], p->ng_y[l], p->ng_z[l] },
                 .shading = { p->ns_x[l], p->ns_y[l], p->ns_z[l] },
                 .specular = { 1.0f, 1.0f, 1.0f },
                 .gloss = (double)p->gloss[l] },
        .rows = rows,
    };
}

/* BRDF times cosine by rows, for light from w; colours separate the rows, as in transport's kernel. */
static bool rows_at(const struct point *p, struct vec3 w, double row[TRANSPORT_ROWS])
{
    const double cosine = (double)vec3_dot(p->own.shading, w);
    struct lobe l = p->own;
    double brdf[3];

    l.diffuse = vec3_make(0.0f, 0.0f, 1.0f);
    l.specular = vec3_make(0.0f, 1.0f, 0.0f);
    lobe_evaluate(&l, p->wo, w, brdf);
    row[0] = fmax(0.0, brdf[2] - brdf[0]) * cosine;
    row[1] = fmax(0.0, brdf[1] - brdf[0]) * cosine;
    row[2] = brdf[0] * cosine;
    return brdf[0] + brdf[1] + brdf[2] > 0.0;
}

/* Per thread. */
struct gatherer {
    const struct indirect_build *build;
    struct indirect_world world;
    struct indirect_ends ends;
};

static void add_light(const struct gatherer *g, uint32_t record, float weight, float *to)
{
    _Alignas(64) float light[SKY_CELLS];

    g->build->widen(g->build->light + (size_t)record * SKY_CELLS, light, SKY_CELLS);
    for (uint32_t i = 0; i < SKY_CELLS; i++)
        to[i] += weight * light[i];
}

/* Some of a point's rays, by the matte part of its BRDF or by its lobe. */
struct turn {
    bool lobe;
    uint32_t first, until; /* those traced now */
    uint32_t all;          /* that the part has */
};

/* Chooses the i-th ray's direction and the rows of its part of the BRDF over the density, 0 in the others. False: it
 * brings nothing. */
static bool aim_ray(const struct gatherer *g, const struct point *p, uint64_t seed, const struct turn *turn, uint32_t i,
                    struct vec3 *w, double row[TRANSPORT_ROWS])
{
    const struct indirect_spot spot = { .geometric = p->own.geometric, .shading = p->own.shading };
    double x[3] = { 0.0 };
    float unused;

    for (int c = 0; c < 2; c++)
        x[1 + c] =
            rng_unit((uint64_t)(g->build->numbers[turn->lobe][i][c] * 0x1p53) << 11 ^ rng_mix(seed, (uint64_t)c));
    if (turn->lobe)
        *w = lobe_sample(&p->own, p->wo, x);
    else
        indirect_leave(&spot, x + 1, w, &unused);
    if (!rows_at(p, *w, row))
        return false;
    const double density =
        turn->lobe ? lobe_density(&p->own, p->wo, *w) : fmax(0.0, (double)vec3_dot(p->own.shading, *w)) / PI;
    for (int r = 0; r < TRANSPORT_ROWS; r++)
        row[r] = turn->lobe == (r > 0) ? row[r] / (density * turn->all) : 0.0;
    return density > 0.0;
}

/* Adds the ends of a ray to a row, times weight. */
static void take_ends(const struct gatherer *g, double weight, float *to, bool cells)
{
    const struct indirect_build *b = g->build;
    const uint32_t k = b->b->basis.count, records = b->records.count;

    for (uint32_t i = 0; i < g->ends.count; i++) {
        const struct indirect_end *e = &g->ends.at[i];
        const float w[3] = { (float)(weight * (double)e->weight[0]), (float)(weight * (double)e->weight[1]),
                             (float)(weight * (double)e->weight[2]) };
        if (!cells)
            indirect_kernels_of(b->b->kernels)->add(to, b->sources + (size_t)e->source * 3 * k, w, k);
        else if (e->source >= records)
            to[e->source - records] += rgb_luminance(w[0], w[1], w[2]);
        else
            add_light(g, e->source, rgb_luminance(w[0], w[1], w[2]), to);
    }
}

/* Traces a turn of a point's rays. Adds to the rows at `out`, stride floats apart, and to open[row] the direct light of
 * a sky of radiance 1. Returns the sum of one over the distance of the hits, m^-1. */
static double gather_point(struct gatherer *g, const struct point *p, uint64_t seed, const struct turn *turn,
                           float *out, size_t stride, bool cells, float open[TRANSPORT_ROWS])
{
    struct rng rng = { rng_mix(seed, 2 + 2 * (uint64_t)turn->first + turn->lobe) };
    double near = 0.0;

    precedence_give_way(g->build->desc->urgent);
    for (uint32_t i = turn->first; i < turn->until; i++) {
        double row[TRANSPORT_ROWS];
        struct vec3 w;
        if (!aim_ray(g, p, seed, turn, i, &w, row))
            continue;
        g->ends.count = 0;
        const float t = indirect_walk(&g->world, p->at, w, &rng, &g->ends);
        near += 1.0 / fmax((double)t, 1e-6);
        for (uint32_t r = turn->lobe ? 1 : 0; r < (turn->lobe ? p->rows : 1); r++) {
            open[r] += isinf(t) ? (float)row[r] : 0.0f;
            take_ends(g, row[r], out + r * stride, cells);
        }
    }
    return near;
}

static void gatherer_init(struct gatherer *g, const struct indirect_build *b)
{
    *g = (struct gatherer){ .build = b, .world = { b->desc->scene, b->desc->rays, &b->records, NULL } };
}

/* ---- The basis ---- */

/* Point i: the first effort.basis_points are spread evenly over the blocks, then basis_records over the records. */
static bool basis_point(const struct indirect_build *b, uint32_t i, struct point *out)
{
    const uint32_t points = b->effort->basis_points, records = b->effort->basis_records;
    const struct indirect_cache *t = b->b;

    if (i < points) {
        if (t->block_count == 0)
            return false;
        const uint64_t slots = (uint64_t)t->block_count * TRANSPORT_POINTS;
        const uint64_t slot = (uint64_t)i * slots / points + rng_mix(b->desc->seed, i) % (slots / points + 1);
        const uint32_t k = (uint32_t)(slot / TRANSPORT_POINTS) % t->block_count;
        const struct indirect_block *block = &t->blocks[k];
        const struct shade_packet *p =
            &t->gbuffer->packets[block->first + slot % TRANSPORT_POINTS / PACKET % block->packets];
        *out = point_of(p, (uint32_t)(slot % PACKET) % p->count, block->rows);
        return true;
    }
    if (b->records.count == 0)
        return false;
    const uint32_t r = (uint32_t)((uint64_t)(i - points) * b->records.count / records);
    const struct indirect_spot *s = &b->records.spots[(size_t)r * INDIRECT_SPOTS];
    *out = (struct point){ .at = s->at,
                           .wo = s->shading,
                           .own = { .kind = LOBE_LAMBERT, .geometric = s->geometric, .shading = s->shading },
                           .rows = 1 };
    return true;
}

enum err indirect_make_basis(struct indirect_build *b)
{
    const uint32_t rows = b->effort->basis_points + b->effort->basis_records;
    const uint32_t n = b->effort->basis_rays;
    float *m = mem_alloc((size_t)rows * SKY_CELLS, sizeof(*m));
    enum err e = m ? ERR_OK : ERR_NOMEM;
    uint64_t rays = 0, open = 0; /* whole numbers add up to the same in any order */
    int failed = 0;

    if (e)
        return e;
#pragma omp parallel reduction(+ : rays, open, failed)
    {
        struct gatherer g;
        gatherer_init(&g, b);
#pragma omp for schedule(dynamic, 8)
        for (uint32_t i = 0; i < rows; i++) {
            struct point p;
            float direct[TRANSPORT_ROWS] = { 0.0f };
            if (!is_cancelled(b->desc->cancel) &&
                basis_point(b, i, &p)) /* all rows of a point's BRDF share a row of the matrix */
                for (uint32_t part = 0; part < (p.rows > 1 ? 2 : 1); part++)
                    gather_point(&g, &p, rng_mix(rng_mix(b->desc->seed, 3), i), &(struct turn){ part > 0, 0, n, n },
                                 m + (size_t)i * SKY_CELLS, 0, true, direct);
            open += i < b->effort->basis_points ? (uint64_t)(OPEN_UNIT * direct[0]) : 0;
        }
        rays += g.ends.rays;
        failed += g.ends.failed;
        mem_free(g.ends.at);
    }
    b->rays += rays;
    b->open = (double)open / (OPEN_UNIT * b->effort->basis_points);
    if (failed)
        e = ERR_NOMEM;
    if (!e && !is_cancelled(b->desc->cancel))
        e = indirect_basis_init(&b->b->basis, m, rows, b->effort->basis);
    mem_free(m);
    return e;
}

/* ---- Blocks ---- */

struct bench { /* per thread */
    struct gatherer gatherer;
    float *matrix;                                     /* [TRANSPORT_ROWS][INDIRECT_GROUP_POINTS][3 K] */
    float *smooth;                                     /* [INDIRECT_GROUP_POINTS][3 K]: the matte row, smoothed */
    float open[INDIRECT_GROUP_POINTS][TRANSPORT_ROWS]; /* direct light of a sky of radiance 1 */
    double near[INDIRECT_GROUP_POINTS];                /* sum of one over the distance of hits, m^-1 */
    uint32_t rays[INDIRECT_GROUP_POINTS];              /* of the matte part */
    struct indirect_smoother *smoother;
    struct indirect_workspace *workspace;
};

/* A row of a block as it is compressed: [points][3 K]. */
static float *row_of(const struct indirect_build *b, const struct bench *w, uint32_t slot, uint32_t row)
{
    const size_t wide = 3 * (size_t)b->b->basis.count, first = (size_t)slot * TRANSPORT_POINTS;

    return row == 0 ? w->smooth + first * wide : w->matrix + (row * (size_t)INDIRECT_GROUP_POINTS + first) * wide;
}

/* The weight of a point's error in row r: the row's colour, relative to all light of the point under a sky of radiance
 * 1. */
static void fill_scales(const struct indirect_build *b, const struct bench *w, const struct indirect_block *block,
                        uint32_t slot, float scale[TRANSPORT_ROWS][TRANSPORT_POINTS])
{
    const uint32_t points = block->packets * PACKET, k = b->b->basis.count;
    float whole[TRANSPORT_POINTS] = { 0.0f }, mean = 0.0f;

    for (uint32_t r = 0; r < block->rows; r++)
        for (uint32_t p = 0; p < points; p++) {
            const float *row = row_of(b, w, slot, r) + (size_t)p * 3 * k;
            float light = w->open[slot * TRANSPORT_POINTS + p][r];
            for (uint32_t i = 0; i < 3 * k; i++)
                light += row[i] * b->even[i % k] / 3.0f;
            scale[r][p] = transport_mean_colour(&b->b->gbuffer->packets[block->first + p / PACKET], r, p % PACKET);
            whole[p] += scale[r][p] * light;
        }
    for (uint32_t p = 0; p < points; p++)
        mean += fmaxf(whole[p], 0.0f) / (float)points;
    for (uint32_t r = 0; r < block->rows; r++)
        for (uint32_t p = 0; p < points; p++)
            scale[r][p] = mean > 0.0f ? fmaxf(scale[r][p] / fmaxf(whole[p], FLOOR * mean), 1e-3f) : 1.0f;
}

/* The matte part's rays that every point traces. */
static uint32_t first_rays(const struct indirect_build *b)
{
    const uint32_t few = b->gather / FIRST_SHARE;

    return few > FIRST_LEAST ? few : FIRST_LEAST;
}

static void gather_turn(const struct indirect_build *b, struct bench *w, const struct indirect_block *block,
                        uint32_t at, const struct turn *turn)
{
    const uint32_t i = at % TRANSPORT_POINTS, packet = block->first + i / PACKET, l = i % PACKET;
    const size_t wide = 3 * (size_t)b->b->basis.count, stride = INDIRECT_GROUP_POINTS * wide;
    const struct point point = point_of(&b->b->gbuffer->packets[packet], l, block->rows);
    const uint64_t seed = rng_mix(rng_mix(b->desc->seed, 4), (uint64_t)packet * PACKET + l);

    const double near =
        gather_point(&w->gatherer, &point, seed, turn, w->matrix + at * wide, stride, false, w->open[at]);
    if (turn->lobe)
        return;
    w->near[at] += near;
    w->smoother->near[at] = (float)(turn->until / fmax(w->near[at], 1e-12));
}

static void begin_block(const struct indirect_build *b, struct bench *w, const struct indirect_block *block,
                        uint32_t slot)
{
    const size_t wide = 3 * (size_t)b->b->basis.count, stride = INDIRECT_GROUP_POINTS * wide;
    struct indirect_smoother *s = w->smoother;

    for (uint32_t i = 0; i < TRANSPORT_POINTS; i++) {
        const struct shade_packet *p = &b->b->gbuffer->packets[block->first + i / PACKET];
        const uint32_t l = i % PACKET, at = slot * TRANSPORT_POINTS + i;
        s->used[at] = i < block->packets * PACKET && l < p->count;
        for (uint32_t r = 0; r < block->rows; r++)
            memset(w->matrix + r * stride + at * wide, 0, wide * sizeof(float));
        memset(w->open[at], 0, sizeof(w->open[at]));
        w->near[at] = 0.0;
        if (!s->used[at])
            continue;
        const float place[3] = { p->x[l], p->y[l], p->z[l] }, normal[3] = { p->ns_x[l], p->ns_y[l], p->ns_z[l] };
        for (int c = 0; c < 3; c++) {
            s->at[c][at] = place[c];
            s->normal[c][at] = normal[c];
        }
        gather_turn(b, w, block, at, &(struct turn){ false, 0, first_rays(b), b->gather });
    }
}

/* The matte part's rays that a point needs if so many points are alike, itself included, whose light is averaged. Of a
 * number of rays the noise summed over all points is least if a point's are in proportion to 1 / sqrt(alike). */
static uint32_t matte_rays(const struct indirect_build *b, const struct indirect_block *block, float alike)
{
    const uint32_t most = block->rows == 1 ? b->gather : b->gather / LOBE_SHARE, first = first_rays(b);
    const uint32_t wanted = (uint32_t)fminf((float)b->gather / sqrtf(fmaxf(alike, 1.0f)), (float)most);

    return wanted > first ? wanted : first;
}

/* The lobe's rays that a point needs: their noise, which is averaged with no other point's, counts by the lobe's share
 * of the light that the point reflects. */
static uint32_t lobe_rays(const struct indirect_build *b, const struct indirect_block *block, uint32_t i)
{
    const struct shade_packet *packet = &b->b->gbuffer->packets[block->first + i / PACKET];
    const struct lobe lobe = lobe_of_lane(packet, i % PACKET);
    const struct vec3 wo = point_of(packet, i % PACKET, block->rows).wo;
    const double most = fmax(b->gather / LOBE_SHARE, FIRST_LEAST);

    if (block->rows == 1 || !lobe_shines(packet, i % PACKET))
        return 0;
    const double share = lobe_shine(&lobe, wo) / lobe_albedo(&lobe, wo) / LOBE_WHOLE;
    return (uint32_t)fmin(fmax(share * share * most, fmin(LOBE_LEAST, most)), most);
}

/* Traces the other rays; each of the matte part counts as much as the first ones. */
static void gather_rest(const struct indirect_build *b, struct bench *w, const struct indirect_group *g)
{
    const size_t wide = 3 * (size_t)b->b->basis.count;
    const uint32_t points = g->count * TRANSPORT_POINTS, few = first_rays(b);

    for (uint32_t at = 0; at < points; at++)
        if (w->smoother->used[at])
            w->rays[at] = matte_rays(b, &b->b->blocks[g->first + at / TRANSPORT_POINTS],
                                     indirect_alike(w->smoother, g->count, b->effort->reach, at));
    for (uint32_t at = 0; at < points; at++) {
        const struct indirect_block *block = &b->b->blocks[g->first + at / TRANSPORT_POINTS];
        if (!w->smoother->used[at])
            continue;
        gather_turn(b, w, block, at, &(struct turn){ false, few, w->rays[at], b->gather });
        const float scale = (float)b->gather / (float)w->rays[at];
        cblas_sscal((int)wide, scale, w->matrix + at * wide, 1);
        w->open[at][0] *= scale;
        const uint32_t lobes = lobe_rays(b, block, at % TRANSPORT_POINTS);
        gather_turn(b, w, block, at, &(struct turn){ true, 0, lobes, lobes });
    }
}

static enum err gather_group(const struct indirect_build *b, struct bench *w, struct indirect_group *g)
{
    const double least = TOLERANCE * TOLERANCE / (SKY_CELLS * g->rows);
    struct indirect_block *blocks = b->b->blocks + g->first;
    float scale[TRANSPORT_ROWS][TRANSPORT_POINTS];
    enum err e = ERR_OK;

    for (uint32_t k = 0; k < g->count; k++)
        begin_block(b, w, &blocks[k], k);
    gather_rest(b, w, g);
    if (w->gatherer.ends.failed)
        return ERR_NOMEM;
    indirect_smooth(w->smoother, g->count, b->effort->reach, 3 * b->b->basis.count, w->matrix, w->smooth);
    indirect_compress_begin(w->workspace);
    for (uint32_t k = 0; k < g->count; k++) {
        const uint32_t points = blocks[k].packets * PACKET;
        fill_scales(b, w, &blocks[k], k, scale);
        for (uint32_t r = 0; r < g->rows; r++)
            indirect_compress_block(w->workspace, k, r, points, row_of(b, w, k, r), scale[r], least);
    }
    for (uint32_t r = 0; r < g->rows && !e; r++)
        e = indirect_compress_end(w->workspace, g, blocks, r, least);
    return e;
}

static bool bench_init(struct bench *w, const struct indirect_build *b)
{
    const size_t matrix = (size_t)INDIRECT_GROUP_POINTS * 3 * b->b->basis.count;

    gatherer_init(&w->gatherer, b);
    w->matrix = mem_alloc(TRANSPORT_ROWS * matrix, sizeof(float));
    w->smooth = mem_alloc(matrix, sizeof(float));
    w->workspace = indirect_workspace_create(b->b->basis.count);
    w->smoother = indirect_smoother_create();
    return w->matrix && w->smooth && w->workspace && w->smoother;
}

static void bench_finish(struct bench *w)
{
    mem_free(w->matrix);
    mem_free(w->smooth);
    mem_free(w->gatherer.ends.at);
    indirect_smoother_destroy(w->smoother);
    indirect_workspace_destroy(w->workspace);
}

/* Gathers a batch of groups. The memory limit is checked after each batch, so that the result does not depend on the
 * number of threads. */
static enum err gather_batch(struct indirect_build *b, struct bench *benches, uint32_t first, uint32_t until)
{
    int failed = 0;

#pragma omp parallel reduction(+ : failed)
    {
        struct bench *w = &benches[omp_get_thread_num()];
        const unsigned before = denormals_flush();
#pragma omp for schedule(dynamic, 1)
        for (uint32_t k = first; k < until; k++) {
            if (is_cancelled(b->desc->cancel) || !cache_share_computes(b->desc->share, k))
                continue;
            struct indirect_group *g = &b->b->groups[k];
            failed += gather_group(b, w, g) != ERR_OK;
            for (uint32_t i = g->first; i < g->first + g->count; i++)
                progress_step(b->desc->progress, b->b->blocks[i].packets);
        }
        denormals_restore(before);
    }
    return failed ? ERR_NOMEM : ERR_OK;
}

static uint64_t group_bytes(const struct indirect_cache *b, const struct indirect_group *g)
{
    uint64_t bytes = 0;

    for (uint32_t r = 0; r < g->rows; r++)
        bytes += indirect_piece_bytes(g, b->blocks + g->first, r);
    return bytes;
}

/* The coefficients of a sky of radiance 1. */
static enum err make_even(struct indirect_build *b)
{
    const struct indirect_basis *basis = &b->b->basis;

    b->even = mem_alloc(basis->count, sizeof(*b->even));
    for (uint32_t k = 0; b->even && k < basis->count; k++)
        for (uint32_t i = 0; i < SKY_CELLS; i++)
            b->even[k] += basis->rows[(size_t)k * SKY_CELLS + i];
    return b->even ? ERR_OK : ERR_NOMEM;
}

enum err indirect_gather_blocks(struct indirect_build *b)
{
    uint64_t bytes = b->b->stats.bytes;
    const uint32_t threads = (uint32_t)omp_get_max_threads();
    struct bench *benches = mem_alloc(threads, sizeof(*benches));
    enum err e = benches ? indirect_group(b->b, b->desc) : ERR_NOMEM;

    if (!e)
        e = make_even(b);
    const uint32_t count = b->b->group_count;

    for (uint32_t i = 0; i < threads && !e; i++)
        e = bench_init(&benches[i], b) ? ERR_OK : ERR_NOMEM;
    for (uint32_t first = 0; first < count && !e && !is_cancelled(b->desc->cancel); first += BATCH) {
        const uint32_t until = first + BATCH < count ? first + BATCH : count;
        e = gather_batch(b, benches, first, until);
        for (uint32_t k = first; k < until; k++)
            bytes += group_bytes(b->b, &b->b->groups[k]);
        if (!e && !cache_memory_suffices(b->desc->max_bytes, bytes))
            e = ERR_RANGE;
    }
    for (uint32_t i = 0; benches && i < threads; i++) {
        b->own_rays += benches[i].gatherer.ends.rays;
        bench_finish(&benches[i]);
    }
    b->rays += b->own_rays;
    mem_free(benches);
    return e;
}
