#include "base/denormals.h"

#include "base/cancel.h"
#include "base/mem.h"
#include "base/precedence.h"
#include "base/progress.h"
#include "base/rng.h"
#include "light/cache/cache_share.h"
#include "light/cache/memory.h"
#include "light/cache_direct/live.h"
#include "light/cache_direct/internal.h"

#include <math.h>
#include <omp.h>

#define FLOOR 0.03f  /* share of a block's mean light; darker points are weighted as if they had this much */
#define BATCH 64     /* blocks between two checks of the memory limit */
#define COARSER 2.5f /* factor of the tolerances of coarse blocks */

/* State of a build. */
struct build {
    struct transport *t;
    struct transport_desc desc; /* defaults filled in */
    struct transport_world world;
    struct transport_directions directions;
    float (*lobe_numbers)[2], (*gaze_numbers)[2];
    struct transport_live *to; /* NULL: blocks are not published */
    bool coarse;
    uint64_t bytes; /* of coarse pieces */
    uint32_t done;  /* number of blocks */
    bool stopped;   /* out of memory, over the limit, or cancelled */
    enum err error;
};

/* Per thread. */
struct bench {
    struct transport_matrix *matrices; /* [TRANSPORT_ROWS] */
    struct transport_neighbours *neighbours;
    struct transport_workspace *workspace;
};

static enum err bench_init(struct bench *b)
{
    b->matrices = mem_alloc(TRANSPORT_ROWS, sizeof(*b->matrices));
    b->neighbours = mem_alloc(1, sizeof(*b->neighbours));
    b->workspace = transport_workspace_create();
    return b->matrices && b->neighbours && b->workspace ? ERR_OK : ERR_NOMEM;
}

static void bench_finish(struct bench *b)
{
    mem_free(b->matrices);
    mem_free(b->neighbours);
    transport_workspace_destroy(b->workspace);
}

void transport_scales(const struct gbuffer *g, const struct transport_block *block,
                      const struct transport_matrix *matrices, float scale[TRANSPORT_ROWS][TRANSPORT_POINTS])
{
    const uint32_t points = block->packets * PACKET;
    float whole[TRANSPORT_POINTS] = { 0.0f }, mean = 0.0f, most = 0.0f;

    for (uint32_t r = 0; r < block->rows; r++) {
        float sum[TRANSPORT_POINTS] = { 0.0f };
        for (uint32_t c = 0; c < SKY_CELLS; c++)
            for (uint32_t p = 0; p < TRANSPORT_POINTS; p++)
                sum[p] += matrices[r].at[c][p];
        for (uint32_t p = 0; p < points; p++) {
            scale[r][p] = transport_mean_colour(&g->packets[block->first + p / PACKET], r, p % PACKET);
            whole[p] += scale[r][p] * sum[p];
            mean += scale[r][p] * sum[p] / (float)points;
        }
    }
    for (uint32_t r = 0; r < block->rows; r++)
        for (uint32_t p = 0; p < points; p++) {
            scale[r][p] = mean > 0.0f ? scale[r][p] / fmaxf(whole[p], FLOOR * mean) : 1.0f;
            most = fmaxf(most, scale[r][p]);
        }
    for (uint32_t r = 0; r < block->rows; r++)
        for (uint32_t p = 0; p < points; p++)
            scale[r][p] = most > 0.0f ? fmaxf(scale[r][p] / most, 1e-3f) : 1.0f;
}

/* Distributes the block's allowed error evenly over its rows. A row that is much darker than the others may be omitted
 * entirely. */
static void share_tolerance(const struct build *b, const struct transport_block *block,
                            const struct transport_matrix *matrices, float scale[TRANSPORT_ROWS][TRANSPORT_POINTS],
                            double allowed[TRANSPORT_ROWS])
{
    const double tolerance = (double)(block->rows > 1 ? b->desc.tolerance_glossy : b->desc.tolerance);
    double whole = 0.0;

    transport_scales(b->t->gbuffer, block, matrices, scale);
    for (uint32_t r = 0; r < block->rows; r++)
        whole += transport_weigh(&matrices[r], block->packets * PACKET, scale[r]);
    for (uint32_t r = 0; r < block->rows; r++)
        allowed[r] = tolerance < 0.0 ? -1.0 : tolerance * tolerance * whole / block->rows;
}

static enum err build_block(const struct build *b, struct bench *bench, struct transport_block *block, uint64_t *rays)
{
    const struct transport *t = b->t;
    float scale[TRANSPORT_ROWS][TRANSPORT_POINTS];
    double allowed[TRANSPORT_ROWS];
    const struct shade_packet *packets = &t->gbuffer->packets[block->first];
    const bool together = block->packets == TRANSPORT_PACKETS && b->directions.units == SKY_CELLS; /* not if coarse */
    enum err e = ERR_OK;

    precedence_give_way(b->desc.urgent);
    block->sight = mem_alloc(1, sizeof(*block->sight));
    if (!block->sight)
        return ERR_NOMEM;
    if (together)
        transport_find_neighbours(packets, bench->neighbours);
    *rays += t->kernels->trace(&b->world, packets, block->packets, block->rows, together ? bench->neighbours : NULL,
                               bench->matrices, block->sight);
    if (block->narrow) {
        block->gazes = mem_alloc_raw((size_t)block->packets * TRANSPORT_GAZES, sizeof(*block->gazes));
        if (!block->gazes)
            return ERR_NOMEM;
        for (uint32_t k = 0; k < block->packets; k++)
            *rays += t->kernels->aim(&b->world, &packets[k], block->gazes + (size_t)k * TRANSPORT_GAZES);
    }
    share_tolerance(b, block, bench->matrices, scale, allowed);
    for (uint32_t r = 0; r < block->rows && !e; r++)
        e = transport_compress(bench->workspace, &bench->matrices[r], block->packets * PACKET, scale[r], allowed[r],
                               &block->pieces[r]);
    return e;
}

/* Builds and publishes a block. A coarse block is only published and stays empty in t. */
static enum err make_block(struct build *b, struct bench *bench, uint32_t index, uint64_t *rays)
{
    struct transport_block made = b->t->blocks[index];

    enum err e = build_block(b, bench, &made, rays);
    const uint64_t bytes = transport_block_bytes(&made);
    if (!e && b->to)
        e = transport_live_publish(b->to, index, &made, !b->coarse);
    if (e) {
        transport_block_finish(&made);
        return e;
    }
    if (b->coarse) {
#pragma omp atomic
        b->bytes += bytes;
    } else {
        b->t->blocks[index] = made;
    }
    return ERR_OK;
}

/* Blocks are built in an order that sweeps over the whole image again and again, so that those already built represent
 * all: the k-th is k times this step modulo their number, to which it is coprime. */
static uint32_t step_of(uint32_t count)
{
    uint32_t step = (uint32_t)(0.6180339887 * count) | 1u;

    for (uint32_t a = step, b = count; b > 1;) {
        const uint32_t rest = a % b;
        a = b;
        b = rest;
        if (b == 0) { /* a > 1 divides both */
            step += 2;
            a = step;
            b = count;
        }
    }
    return step;
}

static uint32_t place_of(const struct build *b, uint32_t k, uint32_t step)
{
    return (uint32_t)((uint64_t)k * step % b->t->block_count);
}

/* Whether the limit is exceeded; or will be, when together with the remaining coarse blocks it is exceeded already. */
static bool is_too_large(const struct build *b)
{
    const struct transport *t = b->t;
    const uint64_t most = b->desc.max_bytes;

    if (!cache_memory_suffices(most, t->stats.bytes + b->bytes))
        return true;
    return b->to && !cache_memory_suffices(most, transport_live_bytes(b->to)) &&
           transport_will_exceed(most, t->stats.bytes, b->done, t->block_count);
}

/* Counts a batch and decides whether to continue. Batches do not depend on the number of threads, so the limit is
 * reached at the same block. */
static void close_batch(struct build *b, uint32_t until, uint32_t step, bool failed)
{
    struct transport *t = b->t;
    const bool cancelled = is_cancelled(b->desc.cancel);

    for (; b->done < until && !failed && !cancelled; b->done++) {
        const uint32_t index = place_of(b, b->done, step);
        if (!b->coarse && cache_share_computes(b->desc.share, index))
            transport_count_block(t, &t->blocks[index]);
    }
    if (failed)
        b->error = ERR_NOMEM;
    else if (!cancelled && is_too_large(b))
        b->error = ERR_RANGE;
    b->stopped = cancelled || b->error != ERR_OK;
}

static void build_all(struct build *b, uint32_t threads)
{
    struct transport *t = b->t;
    const uint32_t step = step_of(t->block_count);
    uint64_t rays = 0;
    int failed = 0;

#pragma omp parallel num_threads(threads) reduction(+ : rays)
    {
        const unsigned before = denormals_flush();
        struct bench bench;
        const enum err e = bench_init(&bench);
        for (uint32_t first = 0; first < t->block_count && !b->stopped; first += BATCH) {
            const uint32_t until = first + BATCH < t->block_count ? first + BATCH : t->block_count;
#pragma omp for schedule(dynamic, 1)
            for (uint32_t k = first; k < until; k++) {
                const uint32_t index = place_of(b, k, step);
                if (is_cancelled(b->desc.cancel) || !cache_share_computes(b->desc.share, index))
                    continue;
                if (e || make_block(b, &bench, index, &rays)) {
#pragma omp atomic
                    failed++;
                }
                progress_step(b->desc.progress, t->blocks[index].packets);
            }
#pragma omp single
            close_batch(b, until, step, failed != 0);
        }
        bench_finish(&bench);
        denormals_restore(before);
    }
    t->stats.rays = b->coarse ? 0 : rays;
}

static float (*make_numbers(uint32_t count, uint64_t seed))[2]
{
    float(*out)[2] = mem_alloc(count, sizeof(*out));

    for (uint32_t i = 0; out && i < count; i++) {
        double x[2];
        rng_sobol2(seed, i, x);
        for (int k = 0; k < 2; k++)
            out[i][k] = fminf((float)x[k], 1.0f - 0x1p-24f);
    }
    return out;
}

static enum err begin_build(struct build *b)
{
    struct transport_desc *d = &b->desc;

    if (b->coarse) {
        d->lobe_samples = (d->lobe_samples + 3) / 4;
        d->tolerance *= COARSER;
        d->tolerance_glossy *= COARSER;
    }
    const uint32_t samples = d->lobe_samples, side = b->coarse ? 1 : d->per_cell;
    enum err e = transport_directions_init(&b->directions, side, b->coarse ? 2 : 1, rng_mix(d->seed, 0));
    b->lobe_numbers = make_numbers(samples, rng_mix(d->seed, 1));
    b->gaze_numbers = make_numbers(TRANSPORT_GAZES, rng_mix(d->seed, 2));
    if (e || !b->lobe_numbers || !b->gaze_numbers)
        return ERR_NOMEM;
    b->world = (struct transport_world){ .rays = b->t->rays,
                                         .directions = &b->directions,
                                         .lobe_numbers = (const float(*)[2])b->lobe_numbers,
                                         .lobe_samples = samples,
                                         .gaze_numbers = (const float(*)[2])b->gaze_numbers };
    transport_compress_begin();
    return ERR_OK;
}

enum err transport_build(struct transport *t, const struct transport_desc *desc, bool coarse, uint32_t threads,
                         struct transport_live *to, bool *all, struct reason *why)
{
    struct build b = { .t = t, .desc = *desc, .to = to, .coarse = coarse };

    b.error = begin_build(&b);
    if (!b.error)
        build_all(&b, threads ? threads : (uint32_t)omp_get_max_threads());
    transport_directions_finish(&b.directions);
    mem_free(b.lobe_numbers);
    mem_free(b.gaze_numbers);
    *all = !b.stopped && !b.error;
    if (*all && !coarse)
        transport_close_stats(t);
    if (b.error == ERR_RANGE)
        return transport_say_too_large(t, t->stats.bytes + b.bytes, b.done, b.desc.max_bytes, why);
    return b.error ? err_say(why, b.error, "out of memory for the cache of direct light") : ERR_OK;
}

enum err transport_create(const struct gbuffer *g, const struct rays *rays, const struct kernels *kernels,
                          const struct transport_desc *desc, struct transport **out, struct reason *why)
{
    const struct transport_desc whole = transport_resolve(desc);
    struct transport *t = transport_begin(g, rays, kernels, desc);
    bool all = false;

    *out = NULL;
    if (!t)
        return err_say(why, ERR_NOMEM, "out of memory for the cache of direct light");
    enum err e = transport_build(t, &whole, false, 0, NULL, &all, why);
    if (desc->share) {
        const enum err shared = desc->share->agree(desc->share->context, !e && !all ? ERR_IO : e, why);
        e = !e && !all ? ERR_OK : shared; /* cancelled */
        all = all && !e;
        if (all)
            e = transport_exchange(t, &whole, why);
        all = all && !e;
    }
    if (all)
        *out = t;
    else
        transport_destroy(t);
    return e;
}
