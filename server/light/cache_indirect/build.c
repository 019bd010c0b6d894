/* Builds the cache of indirect light step by step. */
#include "light/cache_indirect/internal.h"

#include "base/cancel.h"
#include "base/mem.h"

#include <math.h>

/* The effort of the quick cache takes a seventh of the time. It has many records with few rays each: what counts is
 * which surfaces the sun reaches. */
static const struct indirect_effort full = { 256, 0, 1536, 512, 512, INDIRECT_BASIS_MAX, INDIRECT_GROUP, 4, 16 };
static const struct indirect_effort quick = { 16, 8000, 256, 64, 256, 32, 1, PACKET, 4 };

/* Rooms see less of the sky than this: nearly all of their light is indirect, of small patches of sun, which a quick
 * cache shows as flakes. The room of docs/examples has 0.02, its house 0.28, the court 0.48. */
#define OPEN_LEAST 0.1

#define GATHER_MOST 4096u /* bounds buffers: rays of a point */

/* Of what comes before the blocks are gathered, as packets that take the same time: in proportion to the records. */
static uint64_t early_steps(const struct gbuffer *g)
{
    return (uint64_t)fmin(fmax(3.4 * (double)g->packet_count, 1700.0), 10000.0);
}

uint64_t indirect_steps(const struct gbuffer *g)
{
    return early_steps(g) + g->packet_count;
}

/* Lobes that fall to a half within 1.5 degrees would make the records visible, which are constant over a voxel. */
#define SHARP_EXPONENT 2000.0f
#define SHARP_ALPHA 0.02f

static bool has_sharp(const struct gbuffer *g, const struct transport_block *b)
{
    for (uint32_t k = 0; k < b->packets; k++)
        for (uint32_t l = 0; l < g->packets[b->first + k].count; l++)
            if (lobe_is_narrow(&g->packets[b->first + k], l, SHARP_EXPONENT, SHARP_ALPHA))
                return true;
    return false;
}

/* Copies the blocks of the cache of direct light; blocks with narrow lobes get all of their rows. */
static enum err take_blocks(struct indirect_cache *b, const struct transport *t)
{
    b->blocks = mem_alloc(t->block_count, sizeof(*b->blocks));
    b->left_index = mem_alloc(t->narrow.count, sizeof(*b->left_index));
    if (!b->blocks || !b->left_index)
        return ERR_NOMEM;
    for (uint32_t k = 0; k < t->block_count; k++) {
        const struct transport_block *from = &t->blocks[k];
        const uint32_t all = lobe_rows((enum lobe_kind)t->gbuffer->packets[from->first].kind);
        if (!from->narrow || !has_sharp(t->gbuffer, from))
            b->blocks[b->block_count++] = (struct indirect_block){ .first = from->first,
                                                                   .packets = from->packets,
                                                                   .rows = from->narrow ? all : from->rows };
        for (uint32_t i = 0; from->narrow && has_sharp(t->gbuffer, from) && i < from->packets; i++)
            b->left_index[b->left.count++] = from->first + i;
    }
    b->left.index = b->left_index;
    b->stats.bytes = sizeof(*b) + b->block_count * (sizeof(*b->blocks) + sizeof(*b->groups) / INDIRECT_GROUP) +
                     t->narrow.count * sizeof(*b->left_index);
    return ERR_OK;
}

struct indirect_cache *indirect_begin(const struct indirect_desc *d, const struct kernels *kernels)
{
    struct indirect_cache *b = mem_alloc(1, sizeof(*b));

    if (!b)
        return NULL;
    b->gbuffer = d->gbuffer;
    b->kernels = kernels;
    if (take_blocks(b, d->direct)) {
        indirect_destroy(b);
        return NULL;
    }
    return b;
}

enum err indirect_close(struct indirect_cache *b)
{
    struct indirect_stats *s = &b->stats;

    s->basis = b->basis.count;
    s->basis_rest = b->basis.rest;
    s->bytes += (uint64_t)b->basis.count * SKY_CELLS * sizeof(float);
    for (uint32_t k = 0; k < b->group_count; k++) {
        const struct indirect_group *g = &b->groups[k];
        for (uint32_t r = 0; r < g->rows; r++) {
            s->bytes += indirect_piece_bytes(g, b->blocks + g->first, r);
            for (uint32_t i = g->first; i < g->first + g->count; i++)
                s->rank += b->blocks[i].rank[r];
            s->pieces += g->count;
            s->shared += (double)g->pieces[r].rank * g->count;
        }
    }
    s->rank /= fmax(s->pieces, 1.0);
    s->shared /= fmax(s->pieces, 1.0);
    return indirect_lay_out(b);
}

enum err indirect_say_too_large(uint64_t max_bytes, struct reason *why)
{
    return err_say(why, ERR_RANGE,
                   "the cache of indirect light needs more than the %.0f MB that --cache-memory leaves for it",
                   ceil(1e-6 * (double)max_bytes));
}

static enum err begin(struct indirect_build *b)
{
    const struct indirect_desc *d = b->desc;
    enum err e = ERR_OK;

    b->gather = d->gather ? d->gather : b->effort->gather;
    if (b->gather > GATHER_MOST)
        b->gather = GATHER_MOST;
    const uint32_t most = b->gather > b->effort->basis_rays ? b->gather : b->effort->basis_rays;
    for (int k = 0; k < 2 && !e; k++) {
        b->numbers[k] = mem_alloc(most, sizeof(*b->numbers[k]));
        if (!b->numbers[k])
            e = ERR_NOMEM;
        for (uint32_t i = 0; i < most && !e; i++)
            rng_sobol2(rng_mix(d->seed, 10 + (uint64_t)k), i, b->numbers[k][i]);
    }
    if (e)
        return e;
    transport_compress_begin();
    return transport_directions_init(&b->directions, INDIRECT_SIDE, 1, rng_mix(d->seed, 12));
}

/* With other processes, all of which come here: none has failed, or all stop. */
static enum err share_light(struct indirect_build *b, enum err own, struct reason *why)
{
    const struct cache_share *s = b->desc->share;
    const enum err e = s->agree(s->context, !own && is_cancelled(b->desc->cancel) ? ERR_IO : own, why);

    return e ? e : indirect_exchange_light(b);
}

/* Of the time before the blocks are gathered, after each step: the court at 160x90 and 320x180. */
static const double share_before[] = { 0.0, 0.12, 0.55, 0.75, 1.0, 1.0 };

static enum err run_steps(struct indirect_build *b, struct reason *why)
{
    enum err (*const steps[])(
        struct indirect_build *) = { begin,          indirect_find_records, indirect_light_records, indirect_make_basis,
                                     indirect_solve, indirect_gather_blocks };
    const uint64_t early = early_steps(b->b->gbuffer);
    uint64_t done = 0;
    enum err e = ERR_OK;

    for (size_t k = 0; k < sizeof(steps) / sizeof(steps[0]); k++) {
        if (!e && !is_cancelled(b->desc->cancel) && !b->enclosed)
            e = steps[k](b);
        if (steps[k] == indirect_make_basis)
            b->enclosed = b->desc->quick && b->b->block_count > 0 && b->open < OPEN_LEAST;
        const uint64_t now = (uint64_t)(share_before[k] * (double)early);
        progress_step(b->desc->progress, now - done);
        done = now;
        if (b->desc->share && steps[k] == indirect_light_records)
            e = share_light(b, e, why);
    }
    return e;
}

enum err indirect_create(const struct indirect_desc *desc, const struct kernels *kernels, struct indirect_cache **out,
                         struct reason *why)
{
    struct indirect_cache *t = indirect_begin(desc, kernels);
    struct indirect_build b = {
        .b = t, .desc = desc, .effort = desc->quick ? &quick : &full, .widen = transport_kernels_of(kernels)->widen
    };

    *out = NULL;
    if (!t)
        return err_say(why, ERR_NOMEM, "out of memory for the cache of indirect light");
    enum err e = run_steps(&b, why);
    t->stats.rays = b.rays;
    const bool cancelled = (!e || desc->share) && is_cancelled(desc->cancel);
    if (desc->share) {
        const enum err shared = desc->share->agree(desc->share->context, cancelled ? ERR_IO : e, why);
        e = cancelled ? ERR_OK : shared;
        if (!e && !cancelled)
            e = indirect_exchange(&b, why);
    }
    if (!e && !cancelled && !b.enclosed)
        e = indirect_close(t);
    if (e == ERR_RANGE)
        e = indirect_say_too_large(desc->max_bytes, why);
    else if (e)
        err_say(why, e, "out of memory for the cache of indirect light");
    else if (!is_cancelled(b.desc->cancel) && !b.enclosed) {
        *out = t;
        t = NULL;
    }
    indirect_destroy(t);
    indirect_records_finish(&b.records);
    transport_directions_finish(&b.directions);
    mem_free(b.light);
    mem_free(b.sources);
    mem_free(b.even);
    mem_free(b.numbers[0]);
    mem_free(b.numbers[1]);
    return e;
}
