/* What the shade points gather from the records: for the basis, by cells; for the blocks, by the basis. */
#include "bounce_parts.h"
#include "denormals.h"
#include "half.h"
#include "mem.h"

#include <cblas.h>
#include <lapacke.h>
#include <omp.h>

#include <math.h>
#include <string.h>

#define BASIS_POINTS 1536u
#define BASIS_RECORDS 512u
#define TOLERANCE 0.04
#define TAIL 0.25 /* of that, squared, what coefficients that are left out of V may take besides */
#define MAX_BYTES ((uint64_t)1 << 30)
#define BATCH 256u
#define LIKENESS 0.3 /* how unlike points may be whose light is averaged, as the error of [Ward et al. 1988] */

/* A shade point, and the parts of its BRDF as rows (transport_parts.h). */
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

/* BRDF times cosine by rows, for light from w: as the kernel of transport does it, by colours that tell them apart. */
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

/* What one thread gathers with. */
struct gatherer {
    const struct bounce_build *build;
    struct bounce_world world;
    struct bounce_ends ends;
};

static void add_light(const struct gatherer *g, uint32_t record, float weight, float *to)
{
    _Alignas(64) float light[TRANSPORT_CELLS];

    g->build->widen(g->build->light + (size_t)record * TRANSPORT_CELLS, light, TRANSPORT_CELLS);
    for (uint32_t i = 0; i < TRANSPORT_CELLS; i++)
        to[i] += weight * light[i];
}

/* Takes the ends of one ray: rows[r] += weight[r] ends. */
static void take_ends(const struct gatherer *g, const double weight[TRANSPORT_ROWS], uint32_t rows, size_t stride,
                      float *out, bool cells)
{
    const struct bounce_build *b = g->build;
    const uint32_t k = b->b->basis.count, records = b->records.count;

    for (uint32_t i = 0; i < g->ends.count; i++) {
        const struct bounce_end *e = &g->ends.at[i];
        for (uint32_t r = 0; r < rows; r++) {
            const float w[3] = { (float)(weight[r] * (double)e->weight[0]), (float)(weight[r] * (double)e->weight[1]),
                                 (float)(weight[r] * (double)e->weight[2]) };
            float *to = out + r * stride;
            if (!cells)
                b->b->kernels->add(to, b->sources + (size_t)e->source * 3 * k, w, k);
            else if (e->source >= records)
                to[e->source - records] += rgb_luminance(w[0], w[1], w[2]);
            else
                add_light(g, e->source, rgb_luminance(w[0], w[1], w[2]), to);
        }
    }
}

/* All rays of a point, half by the matte part and, where there is a lobe, as many by that, under the balance heuristic.
 * Adds to `rows` rows, stride floats apart. Returns the harmonic mean of distances. */
static double gather_point(struct gatherer *g, const struct point *p, uint64_t seed, uint32_t rays, float *out,
                           size_t stride, bool cells)
{
    const struct bounce_spot spot = { .geometric = p->own.geometric, .shading = p->own.shading };
    const uint64_t shift[2] = { rng_mix(seed, 0), rng_mix(seed, 1) };
    const uint32_t all = p->rows > 1 ? 2 * rays : rays;
    struct rng rng = { rng_mix(seed, 2) };
    double near = 0.0;

    for (uint32_t i = 0; i < all; i++) {
        double x[3] = { 0.0 }, row[TRANSPORT_ROWS];
        struct vec3 w;
        float unused;
        for (int c = 0; c < 2; c++)
            x[1 + c] = rng_unit((uint64_t)(g->build->numbers[i >= rays][i % rays][c] * 0x1p53) << 11 ^ shift[c]);
        if (i < rays)
            bounce_leave(&spot, x + 1, &w, &unused);
        else
            w = lobe_sample(&p->own, p->wo, x);
        if (!rows_at(p, w, row))
            continue;
        double density = rays * fmax(0.0, (double)vec3_dot(p->own.shading, w)) / PI;
        if (p->rows > 1)
            density += rays * lobe_density(&p->own, p->wo, w);
        if (!(density > 0.0))
            continue;
        for (int r = 0; r < TRANSPORT_ROWS; r++)
            row[r] /= density;
        g->ends.count = 0;
        const float t = bounce_walk(&g->world, p->at, w, &rng, &g->ends);
        near += i < rays ? 1.0 / fmax((double)t, 1e-6) : 0.0;
        take_ends(g, row, p->rows, stride, out, cells);
    }
    return rays / fmax(near, 1e-12);
}

static void gatherer_init(struct gatherer *g, const struct bounce_build *b)
{
    *g = (struct gatherer){ .build = b, .world = { b->desc->scene, b->desc->rays, &b->records, NULL } };
}

/* ---- The basis ---- */

static uint32_t rows_of_block(const struct bounce_build *b, uint32_t k)
{
    return b->b->blocks[k].rows;
}

/* The i-th of BASIS_POINTS points, evenly over the blocks, and of BASIS_RECORDS records. */
static bool basis_point(const struct bounce_build *b, uint32_t i, struct point *out)
{
    const struct bounce *t = b->b;

    if (i < BASIS_POINTS) {
        if (t->block_count == 0)
            return false;
        const uint64_t slots = (uint64_t)t->block_count * TRANSPORT_POINTS;
        const uint64_t slot =
            (uint64_t)i * slots / BASIS_POINTS + rng_mix(b->desc->seed, i) % (slots / BASIS_POINTS + 1);
        const uint32_t k = (uint32_t)(slot / TRANSPORT_POINTS) % t->block_count;
        const struct bounce_block *block = &t->blocks[k];
        const struct shade_packet *p =
            &t->gbuffer->packets[block->first + slot % TRANSPORT_POINTS / PACKET % block->packets];
        *out = point_of(p, (uint32_t)(slot % PACKET) % p->count, rows_of_block(b, k));
        return true;
    }
    if (b->records.count == 0)
        return false;
    const uint32_t r = (uint32_t)((uint64_t)(i - BASIS_POINTS) * b->records.count / BASIS_RECORDS);
    const struct bounce_spot *s = &b->records.spots[(size_t)r * BOUNCE_SPOTS];
    *out = (struct point){ .at = s->at,
                           .wo = s->shading,
                           .own = { .kind = LOBE_LAMBERT, .geometric = s->geometric, .shading = s->shading },
                           .rows = 1 };
    return true;
}

enum err bounce_make_basis(struct bounce_build *b)
{
    const uint32_t rows = BASIS_POINTS + BASIS_RECORDS;
    float *m = mem_alloc((size_t)rows * TRANSPORT_CELLS, sizeof(*m));
    enum err e = m ? ERR_OK : ERR_NOMEM;
    uint64_t rays = 0;
    int failed = 0;

    if (e)
        return e;
#pragma omp parallel reduction(+ : rays, failed)
    {
        struct gatherer g;
        gatherer_init(&g, b);
#pragma omp for schedule(dynamic, 8)
        for (uint32_t i = 0; i < rows; i++) {
            struct point p;
            if (!bounce_cancelled(b) && basis_point(b, i, &p)) /* all rows of a point's BRDF in one of the matrix */
                gather_point(&g, &p, rng_mix(rng_mix(b->desc->seed, 3), i), BOUNCE_BASIS_RAYS,
                             m + (size_t)i * TRANSPORT_CELLS, 0, true);
        }
        rays += g.ends.rays;
        failed += g.ends.failed;
        mem_free(g.ends.at);
    }
    b->rays += rays;
    if (failed)
        e = ERR_NOMEM;
    if (!e && !bounce_cancelled(b))
        e = bounce_basis_init(&b->b->basis, m, rows);
    b->b->stats.basis = b->b->basis.count;
    b->b->stats.basis_rest = b->b->basis.rest;
    mem_free(m);
    return e;
}

/* ---- Blocks ---- */

struct bench { /* what one thread works in */
    struct gatherer gatherer;
    float *matrix, *smooth; /* [TRANSPORT_ROWS][TRANSPORT_POINTS][3 K], [TRANSPORT_POINTS][3 K] */
    double near[TRANSPORT_POINTS];
    struct point points[TRANSPORT_POINTS];
    bool used[TRANSPORT_POINTS];
    float weights[TRANSPORT_POINTS * TRANSPORT_POINTS];
    float gram[TRANSPORT_POINTS * TRANSPORT_POINTS], values[TRANSPORT_POINTS];
    float work[1 + 6 * TRANSPORT_POINTS + 2 * TRANSPORT_POINTS * TRANSPORT_POINTS]; /* as ssyevd asks for */
    lapack_int whole[3 + 5 * TRANSPORT_POINTS];
};

/* How much of q's light p takes: none where distance over the mean distance of what is around, or normals, differ too
 * much. */
static double likeness(const struct bench *w, uint32_t p, uint32_t q)
{
    const struct point *a = &w->points[p], *b = &w->points[q];
    const double apart = (double)vec3_length(vec3_sub(a->at, b->at)), near = fmin(w->near[p], w->near[q]);
    const double turned = sqrt(fmax(0.0, 1.0 - (double)vec3_dot(a->own.shading, b->own.shading)));

    return fmax(0.0, 1.0 - (apart / near + turned) / LIKENESS);
}

/* The matte row of each point as a mean over points of its block that are alike: their rays are independent. */
static void smooth_block(struct bench *w, uint32_t points, uint32_t k)
{
    memset(w->weights, 0, sizeof(w->weights));
    for (uint32_t p = 0; p < points; p++) {
        double sum = 0.0;
        for (uint32_t q = 0; q < points && w->used[p]; q++)
            if (w->used[q])
                sum += w->weights[p * points + q] = (float)likeness(w, p, q);
        for (uint32_t q = 0; q < points && sum > 0.0; q++)
            w->weights[p * points + q] /= (float)sum;
    }
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, (int)points, 3 * (int)k, (int)points, 1.0f, w->weights,
                (int)points, w->matrix, 3 * (int)k, 0.0f, w->smooth, 3 * (int)k);
    memcpy(w->matrix, w->smooth, (size_t)points * 3 * k * sizeof(float));
}

/* Coefficients of the basis from which on all of V may be left out: those come in the order of what they are for all
 * points. */
static uint32_t short_basis(const float *v, uint32_t rows, uint32_t k, double allowed)
{
    double rest = 0.0;

    for (uint32_t first = k - PACKET; first > 0; first -= PACKET) {
        for (uint32_t r = 0; r < rows; r++)
            for (uint32_t i = 0; i < PACKET; i++)
                rest += pow((double)v[(size_t)r * k + first + i], 2.0);
        if (rest > allowed)
            return first + PACKET;
    }
    return PACKET;
}

/* V (rank x 3 rows of k) and U as half floats. */
static enum err keep(const float *v, const float *u, uint32_t rank, uint32_t points, uint32_t k, double allowed,
                     struct bounce_piece *out)
{
    const uint32_t rows = 3 * rank, basis = short_basis(v, rows, k, allowed);
    const size_t u_count = (size_t)rank * points;
    uint16_t *to = mem_alloc_raw((size_t)rows * basis + u_count, sizeof(*to));

    if (!to)
        return ERR_NOMEM;
    *out =
        (struct bounce_piece){ .halves = to, .rank = rank, .basis = basis, .scale = half_scale(v, (size_t)rows * k) };
    for (uint32_t r = 0; r < rows; r++)
        for (uint32_t i = 0; i < basis; i++)
            *to++ = half_round(v[(size_t)r * k + i] / out->scale);
    for (size_t i = 0; i < u_count; i++)
        *to++ = half_round(u[i]);
    return ERR_OK;
}

/* The least rank whose rest is allowed, as in transport_compress. */
static enum err compress(struct bench *w, const float *t, uint32_t points, uint32_t k, double allowed,
                         struct bounce_piece *out)
{
    const int n = (int)points, wide = 3 * (int)k;
    double rest = 0.0, whole = 0.0;
    uint32_t rank = points;

    *out = (struct bounce_piece){ .scale = 1.0f };
    cblas_ssyrk(CblasRowMajor, CblasUpper, CblasNoTrans, n, wide, 1.0f, t, wide, 0.0f, w->gram, n);
    if (LAPACKE_ssyevd_work(LAPACK_COL_MAJOR, 'V', 'L', n, w->gram, n, w->values, w->work,
                            sizeof(w->work) / sizeof(w->work[0]), w->whole, sizeof(w->whole) / sizeof(w->whole[0])))
        return ERR_NOMEM;
    for (uint32_t i = 0; i < points; i++)
        whole += fmax(0.0, (double)w->values[i]);
    for (uint32_t i = 0; i < points; i++, rank--) {
        rest += fmax(0.0, (double)w->values[i]);
        if (rest > allowed)
            break;
    }
    if (rank == 0)
        return ERR_OK;
    const float *u = w->gram + (size_t)(points - rank) * points;
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, (int)rank, wide, n, 1.0f, u, n, t, wide, 0.0f, w->smooth,
                wide);
    return keep(w->smooth, u, rank, points, k, TAIL * fmin(allowed, whole), out);
}

/* The mean square of a row's colours over a block. */
static double row_weight(const struct bounce_build *b, const struct bounce_block *block, uint32_t row)
{
    double sum = 0.0, count = 0.0;

    for (uint32_t i = 0; i < block->packets; i++) {
        const struct shade_packet *p = &b->b->gbuffer->packets[block->first + i];
        for (uint32_t l = 0; l < p->count; l++, count += 3.0)
            for (int c = 0; c < 3; c++)
                sum += pow((double)transport_row_colour(p, row, c, l), 2.0);
    }
    return sum / count;
}

static enum err compress_block(const struct bounce_build *b, struct bench *w, struct bounce_block *block)
{
    const uint32_t points = block->packets * PACKET, k = b->b->basis.count;
    const size_t stride = (size_t)TRANSPORT_POINTS * 3 * k, used = (size_t)points * 3 * k;
    const double tolerance = b->desc->tolerance > 0.0f ? (double)b->desc->tolerance : TOLERANCE;
    double weight[TRANSPORT_ROWS], all = 0.0;
    enum err e = ERR_OK;

    for (uint32_t r = 0; r < block->rows; r++) {
        weight[r] = row_weight(b, block, r);
        for (size_t i = 0; i < used; i++)
            all += weight[r] * (double)w->matrix[r * stride + i] * (double)w->matrix[r * stride + i];
    }
    for (uint32_t r = 0; r < block->rows && !e; r++)
        e = compress(w, w->matrix + r * stride, points, k,
                     weight[r] > 0.0 ? tolerance * tolerance * all / (weight[r] * block->rows) : INFINITY,
                     &block->pieces[r]);
    return e;
}

static enum err gather_block(const struct bounce_build *b, struct bench *w, struct bounce_block *block)
{
    const uint32_t points = block->packets * PACKET, k = b->b->basis.count;
    const size_t stride = (size_t)TRANSPORT_POINTS * 3 * k;

    memset(w->matrix, 0, TRANSPORT_ROWS * stride * sizeof(float));
    for (uint32_t i = 0; i < points; i++) {
        const struct shade_packet *p = &b->b->gbuffer->packets[block->first + i / PACKET];
        const uint32_t l = i % PACKET;
        w->used[i] = l < p->count;
        if (!w->used[i])
            continue;
        w->points[i] = point_of(p, l, block->rows);
        w->near[i] =
            gather_point(&w->gatherer, &w->points[i],
                         rng_mix(rng_mix(b->desc->seed, 4), (uint64_t)(block->first + i / PACKET) * PACKET + l),
                         b->gather, w->matrix + (size_t)i * 3 * k, stride, false);
    }
    if (!b->desc->no_smoothing)
        smooth_block(w, points, k);
    return w->gatherer.ends.failed ? ERR_NOMEM : compress_block(b, w, block);
}

static bool bench_init(struct bench *w, const struct bounce_build *b)
{
    const size_t matrix = (size_t)TRANSPORT_POINTS * 3 * b->b->basis.count;

    gatherer_init(&w->gatherer, b);
    w->matrix = mem_alloc(TRANSPORT_ROWS * matrix, sizeof(float));
    w->smooth = mem_alloc(matrix, sizeof(float));
    return w->matrix && w->smooth;
}

static void bench_finish(struct bench *w)
{
    mem_free(w->matrix);
    mem_free(w->smooth);
    mem_free(w->gatherer.ends.at);
}

/* One batch of blocks; what they take is added up behind it, so that a limit is met at the same place always. */
static enum err gather_batch(struct bounce_build *b, struct bench *benches, uint32_t first, uint32_t until)
{
    int failed = 0;

#pragma omp parallel reduction(+ : failed)
    {
        struct bench *w = &benches[omp_get_thread_num()];
        const unsigned before = denormals_flush();
#pragma omp for schedule(dynamic, 1)
        for (uint32_t k = first; k < until; k++) {
            if (bounce_cancelled(b))
                continue;
            failed += gather_block(b, w, &b->b->blocks[k]) != ERR_OK;
            progress_step(b->desc->progress, b->b->blocks[k].packets);
        }
        denormals_restore(before);
    }
    return failed ? ERR_NOMEM : ERR_OK;
}

static void count_blocks(struct bounce *b, uint32_t first, uint32_t until)
{
    for (uint32_t k = first; k < until; k++)
        for (uint32_t r = 0; r < b->blocks[k].rows; r++) {
            const struct bounce_piece *q = &b->blocks[k].pieces[r];
            b->stats.bytes += (uint64_t)q->rank * (3 * q->basis + b->blocks[k].packets * PACKET) * sizeof(*q->halves);
            b->stats.rank += q->rank;
            b->pieces++;
        }
}

enum err bounce_gather_blocks(struct bounce_build *b)
{
    const uint64_t most = b->desc->max_bytes ? b->desc->max_bytes : MAX_BYTES;
    const uint32_t threads = (uint32_t)omp_get_max_threads(), count = b->b->block_count;
    struct bench *benches = mem_alloc(threads, sizeof(*benches));
    enum err e = benches ? ERR_OK : ERR_NOMEM;

    for (uint32_t i = 0; i < threads && !e; i++)
        e = bench_init(&benches[i], b) ? ERR_OK : ERR_NOMEM;
    for (uint32_t first = 0; first < count && !e && !bounce_cancelled(b); first += BATCH) {
        const uint32_t until = first + BATCH < count ? first + BATCH : count;
        e = gather_batch(b, benches, first, until);
        count_blocks(b->b, first, until);
        if (!e && b->b->stats.bytes > most)
            e = ERR_RANGE;
    }
    for (uint32_t i = 0; benches && i < threads; i++) {
        b->rays += benches[i].gatherer.ends.rays;
        bench_finish(&benches[i]);
    }
    mem_free(benches);
    return e;
}
