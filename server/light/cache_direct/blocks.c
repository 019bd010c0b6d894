/* Divides the packets of a G-buffer into blocks, and counts their memory. */
#include "base/mem.h"
#include "light/cache/cache_share.h"
#include "light/cache/memory.h"
#include "light/cache_direct/internal.h"

#include <assert.h>
#include <math.h>

#define SIDE 2 /* the defaults and limits of transport.h */
#define SIDE_MAX 8
#define LOBE_SAMPLES 64
#define LOBE_SAMPLES_MAX 4096
#define TOLERANCE 0.015f
#define TOLERANCE_GLOSSY 0.01f

struct transport_desc transport_resolve(const struct transport_desc *desc)
{
    struct transport_desc d = *desc;

    assert(d.per_cell <= SIDE_MAX && d.lobe_samples <= LOBE_SAMPLES_MAX);
    d.per_cell = d.per_cell ? d.per_cell : SIDE;
    d.lobe_samples = d.lobe_samples ? d.lobe_samples : LOBE_SAMPLES;
    d.tolerance = d.tolerance == 0.0f ? TOLERANCE : d.tolerance;
    d.tolerance_glossy = d.tolerance_glossy == 0.0f ? TOLERANCE_GLOSSY : d.tolerance_glossy;
    d.max_bytes = cache_memory_limit(d.max_bytes);
    return d;
}

static bool is_narrow(const struct shade_packet *p)
{
    for (uint32_t l = 0; l < p->count; l++)
        if (lobe_is_narrow(p, l, TRANSPORT_EXPONENT, TRANSPORT_ALPHA))
            return true;
    return false;
}

static uint32_t rows_of(const struct shade_packet *p)
{
    for (uint32_t l = 0; l < p->count; l++)
        if (lobe_shines(p, l))
            return lobe_rows((enum lobe_kind)p->kind);
    return 1;
}

/* Groups up to four consecutive packets of the same kind and number of rows into a block. Returns the number of blocks;
 * writes them unless blocks is NULL. */
static uint32_t lay_out(const struct gbuffer *g, struct transport_block *blocks)
{
    uint32_t count = 0;
    struct transport_block b = { 0 };

    for (uint32_t i = 0; i < g->packet_count; i++) {
        const struct shade_packet *p = &g->packets[i];
        const bool narrow = is_narrow(p);
        const uint32_t rows = narrow ? 1 : rows_of(p);
        if (count == 0 || b.packets == TRANSPORT_PACKETS || b.rows != rows || b.narrow != narrow ||
            g->packets[b.first].kind != p->kind) {
            b = (struct transport_block){ .first = i, .kind = p->kind, .rows = rows, .narrow = narrow };
            count++;
        }
        b.packets++;
        if (blocks)
            blocks[count - 1] = b;
    }
    return count;
}

static enum err make_blocks(struct transport *t)
{
    const struct gbuffer *g = t->gbuffer;

    t->block_count = lay_out(g, NULL);
    t->blocks = mem_alloc(t->block_count, sizeof(*t->blocks));
    if (!t->blocks)
        return ERR_NOMEM;
    lay_out(g, t->blocks);
    for (uint32_t k = 0; k < t->block_count; k++)
        t->stats.narrow += t->blocks[k].narrow ? t->blocks[k].packets : 0;
    t->narrow_index = mem_alloc(t->stats.narrow, sizeof(*t->narrow_index));
    if (!t->narrow_index)
        return ERR_NOMEM;
    for (uint32_t k = 0; k < t->block_count; k++)
        for (uint32_t i = 0; t->blocks[k].narrow && i < t->blocks[k].packets; i++)
            t->narrow_index[t->narrow.count++] = t->blocks[k].first + i;
    t->narrow.index = t->narrow_index;
    t->stats.packets = g->packet_count;
    t->stats.blocks = t->block_count;
    t->stats.bytes = t->block_count * sizeof(*t->blocks) + t->narrow.count * sizeof(*t->narrow_index) + sizeof(*t);
    return ERR_OK;
}

struct transport *transport_begin(const struct gbuffer *g, const struct rays *rays, const struct kernels *kernels,
                                  const struct transport_desc *desc)
{
    struct transport *t = mem_alloc(1, sizeof(*t));

    if (!t)
        return NULL;
    pthread_mutex_init(&t->lock, NULL);
    pthread_cond_init(&t->shaded, NULL);
    t->gbuffer = g;
    t->rays = desc->no_visibility ? NULL : rays;
    t->kernels = transport_kernels_of(kernels);
    t->index_bytes = cache_memory_limit(desc->max_bytes) / 8 * 3;
    if (make_blocks(t)) {
        transport_destroy(t);
        return NULL;
    }
    return t;
}

void transport_count_block(struct transport *t, const struct transport_block *b)
{
    t->stats.bytes += transport_block_bytes(b);
    for (uint32_t r = 0; r < b->rows; r++) {
        const struct transport_piece *q = &b->pieces[r];
        t->stats.dense += sizeof(uint16_t) * (uint64_t)b->packets * PACKET * SKY_CELLS;
        t->stats.raw += q->shape.form == TRANSPORT_RAW;
        t->stats.halves += q->bytes && q->shape.form == TRANSPORT_HALVES;
        t->stats.rank += q->shape.form == TRANSPORT_RAW ? 0 : q->shape.rank;
        t->stats.pieces++;
    }
}

double transport_packet_bytes(const struct transport *t, uint32_t packet)
{
    const struct transport_block *b = transport_block_of(t, packet);

    return (double)(transport_block_bytes(b) + b->freed) / b->packets;
}

void transport_count_kept(struct transport *t, const struct cache_share *s)
{
    const struct transport_stats before = t->stats;

    t->stats = (struct transport_stats){ .bytes = t->block_count * sizeof(*t->blocks) +
                                                  t->narrow.count * sizeof(*t->narrow_index) + sizeof(*t),
                                         .rays = before.rays,
                                         .packets = before.packets,
                                         .narrow = before.narrow,
                                         .blocks = before.blocks };
    for (uint32_t k = 0; k < t->block_count; k++)
        if (transport_keeps(t, s, t->blocks[k].first))
            transport_count_block(t, &t->blocks[k]);
    transport_close_stats(t);
}

enum err transport_say_too_large(const struct transport *t, uint64_t bytes, uint32_t blocks, uint64_t max_bytes,
                                 struct reason *why)
{
    const double all = (double)bytes * t->block_count / blocks;

    return err_say(
        why, ERR_RANGE,
        "the cache of direct light for %ux%u needs about %.0f MB, more than the limit of %.0f: use a smaller "
        "--size or a larger --cache-memory",
        t->gbuffer->width, t->gbuffer->height, ceil(1e-6 * all), 1e-6 * (double)max_bytes);
}

void transport_close_stats(struct transport *t)
{
    const uint32_t compressed = t->stats.pieces - t->stats.raw;

    t->stats.rank /= compressed ? compressed : 1;
}

uint64_t transport_gaze_bytes(const struct transport_block *b)
{
    return b->gazes ? (uint64_t)b->packets * TRANSPORT_GAZES * sizeof(*b->gazes) : 0;
}

uint64_t transport_block_bytes(const struct transport_block *b)
{
    uint64_t bytes = transport_gaze_bytes(b) + (b->sight ? sizeof(*b->sight) : 0);

    for (uint32_t r = 0; r < b->rows; r++)
        bytes += transport_piece_bytes(&b->pieces[r], b->packets * PACKET);
    return bytes;
}

void transport_block_finish(struct transport_block *b)
{
    for (uint32_t r = 0; r < TRANSPORT_ROWS; r++) {
        mem_free(b->pieces[r].bytes);
        b->pieces[r] = (struct transport_piece){ .bytes = NULL };
    }
    mem_free(b->gazes);
    mem_free(b->sight);
    b->gazes = NULL;
    b->sight = NULL;
}
