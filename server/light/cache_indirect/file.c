#include "light/cache_indirect/indirect.h"

#include "base/mem.h"
#include "light/cache/cache_share.h"
#include "light/cache/memory.h"
#include "light/cache_indirect/internal.h"
#include "scene/geometry/scene_digest.h"

#include <math.h>
#include <string.h>

/* Increase it when the cache of the same scene or the file format changes. */
#define FORMAT 2

#define GAIN_MOST 1e20f /* a larger one, or NaN, is a damaged file */

/* One section: statistics, the basis, then group by group the ranks of its rows and blocks, and its pieces' bytes. */
static const char section[] = "bounce";

struct digest indirect_key(const struct digest *direct, const struct indirect_desc *desc)
{
    const float numbers[] = { desc->eye.x, desc->eye.y, desc->eye.z };
    struct digest key = { { 0 } };

    digest_u64(&key, FORMAT);
    digest_bytes(&key, direct, sizeof(*direct));
    digest_u64(&key, (uint64_t)INDIRECT_BASIS_MAX << 32 | INDIRECT_GROUP);
    digest_u64(&key, (uint64_t)desc->gather << 32 | desc->records);
    digest_u64(&key, desc->seed);
    digest_bytes(&key, numbers, sizeof(numbers));
    digest_scene(&key, desc->scene);
    return key;
}

static void save_piece(const struct indirect_cache *b, const struct indirect_group *g, uint32_t row,
                       struct cache_writer *w)
{
    const struct indirect_piece *q = &g->pieces[row];

    if (!q->bytes)
        return;
    if (!b->stream) { /* not laid out yet */
        cache_writer_put(w, q->bytes, indirect_piece_bytes(g, b->blocks + g->first, row));
        return;
    }
    cache_writer_put(w, q->bytes, (size_t)q->rank * 3 * q->basis);
    for (uint32_t i = g->first; i < g->first + g->count; i++) {
        const struct indirect_block *block = &b->blocks[i];
        cache_writer_put(w, indirect_block_row(b, block, row),
                         indirect_block_bytes(block->rank[row], indirect_columns(q->rank), block->packets * PACKET));
    }
}

void indirect_save_group(const struct indirect_cache *b, const struct indirect_group *g, struct cache_writer *w)
{
    for (uint32_t r = 0; r < g->rows; r++) {
        cache_writer_put(w, &g->pieces[r].rank, sizeof(g->pieces[r].rank));
        cache_writer_put(w, &g->pieces[r].basis, sizeof(g->pieces[r].basis));
    }
    for (uint32_t i = g->first; i < g->first + g->count; i++)
        cache_writer_put(w, b->blocks[i].rank, g->rows);
    for (uint32_t r = 0; r < g->rows; r++)
        save_piece(b, g, r, w);
}

void indirect_save(const struct indirect_cache *b, const struct digest *key, struct cache_writer *w)
{
    cache_writer_section(w, section, key);
    cache_writer_put(w, &b->stats.records, sizeof(b->stats.records));
    cache_writer_put(w, &b->stats.bounces, sizeof(b->stats.bounces));
    cache_writer_put(w, &b->stats.rays, sizeof(b->stats.rays));
    cache_writer_put(w, &b->basis.rest, sizeof(b->basis.rest));
    cache_writer_put(w, &b->basis.count, sizeof(b->basis.count));
    cache_writer_put(w, b->basis.rows, (size_t)b->basis.count * SKY_CELLS * sizeof(*b->basis.rows));
    for (uint32_t k = 0; k < b->group_count; k++)
        indirect_save_group(b, &b->groups[k], w);
}

/* ---- Loading ---- */

static enum err no_memory(struct reason *why)
{
    return err_say(why, ERR_NOMEM, "out of memory for the cache of indirect light");
}

/* Numbers and rows of unit length. */
static enum err read_basis(struct cache_reader *r, struct indirect_cache *b, struct reason *why)
{
    struct indirect_stats *s = &b->stats;
    struct indirect_basis *q = &b->basis;
    enum err e = cache_reader_get(r, &s->records, sizeof(s->records), why);

    if (!e)
        e = cache_reader_get(r, &s->bounces, sizeof(s->bounces), why);
    if (!e)
        e = cache_reader_get(r, &s->rays, sizeof(s->rays), why);
    if (!e)
        e = cache_reader_get(r, &q->rest, sizeof(q->rest), why);
    if (!e)
        e = cache_reader_get(r, &q->count, sizeof(q->count), why);
    if (!e &&
        !(q->count > 0 && q->count <= INDIRECT_BASIS_MAX && q->count % PACKET == 0 && q->rest >= 0.0 && q->rest <= 1.0))
        e = cache_reader_refuse(r, why);
    if (e)
        return e;
    const size_t count = (size_t)q->count * SKY_CELLS;
    q->rows = mem_alloc_raw(count, sizeof(*q->rows));
    e = q->rows ? cache_reader_get(r, q->rows, count * sizeof(*q->rows), why) : no_memory(why);
    for (size_t i = 0; i < count && !e; i++)
        if (!(fabsf(q->rows[i]) < 1.001f))
            e = cache_reader_refuse(r, why);
    return e;
}

/* Checks the ranks, so that the loops that read the pieces stay within them, the basis and their own memory. */
static bool is_sound(const struct indirect_cache *b, const struct indirect_group *g)
{
    uint32_t points = 0;

    for (uint32_t k = g->first; k < g->first + g->count; k++)
        points += b->blocks[k].packets * PACKET;
    for (uint32_t r = 0; r < g->rows; r++) {
        const uint32_t rank = g->pieces[r].rank, basis = g->pieces[r].basis;
        if (rank == 0 ? basis != 0 : rank > points)
            return false;
        if (rank > 0 && (basis == 0 || basis % PACKET != 0 || basis > b->basis.count))
            return false;
        for (uint32_t k = g->first; k < g->first + g->count; k++)
            if (b->blocks[k].rank[r] > (rank > 0 ? b->blocks[k].packets * PACKET : 0))
                return false;
    }
    return true;
}

/* Bytes may have any value; the gains that multiply them must be finite. */
static bool has_sound_gains(const struct indirect_cache *b, const struct indirect_group *g, uint32_t row)
{
    const struct indirect_piece *q = &g->pieces[row];
    const uint32_t columns = indirect_columns(q->rank);
    const int8_t *at = q->bytes + (size_t)q->rank * 3 * q->basis;

    for (uint32_t k = g->first; k < g->first + g->count; k++) {
        const struct indirect_block *block = &b->blocks[k];
        for (uint32_t i = 0; i < block->rank[row]; i++) {
            float gain;
            memcpy(&gain, at + i * sizeof(gain), sizeof(gain));
            if (!(gain >= 0.0f && gain < GAIN_MOST))
                return false;
        }
        at += indirect_block_bytes(block->rank[row], columns, block->packets * PACKET);
    }
    return true;
}

static enum err read_piece(struct cache_reader *r, const struct indirect_cache *b, struct indirect_group *g,
                           uint32_t row, struct reason *why)
{
    struct indirect_piece *q = &g->pieces[row];
    const size_t size = indirect_piece_bytes(g, b->blocks + g->first, row);

    if (size == 0)
        return ERR_OK;
    q->bytes = mem_alloc_raw(size, 1);
    if (!q->bytes)
        return no_memory(why);
    const enum err e = cache_reader_get(r, q->bytes, size, why);
    return e || has_sound_gains(b, g, row) ? e : cache_reader_refuse(r, why);
}

enum err indirect_load_group(struct cache_reader *r, struct indirect_cache *b, struct indirect_group *g,
                             uint64_t *bytes, uint64_t max_bytes, struct reason *why)
{
    enum err e = ERR_OK;

    for (uint32_t row = 0; row < g->rows && !e; row++) {
        e = cache_reader_get(r, &g->pieces[row].rank, sizeof(g->pieces[row].rank), why);
        if (!e)
            e = cache_reader_get(r, &g->pieces[row].basis, sizeof(g->pieces[row].basis), why);
    }
    for (uint32_t k = g->first; k < g->first + g->count && !e; k++)
        e = cache_reader_get(r, b->blocks[k].rank, g->rows, why);
    if (!e && !is_sound(b, g))
        e = cache_reader_refuse(r, why);
    for (uint32_t row = 0; row < g->rows && !e; row++)
        *bytes += indirect_piece_bytes(g, b->blocks + g->first, row);
    if (!e && !cache_memory_suffices(max_bytes, *bytes))
        e = indirect_say_too_large(max_bytes, why);
    for (uint32_t row = 0; row < g->rows && !e; row++)
        e = read_piece(r, b, g, row, why);
    return e;
}

enum err indirect_load(struct cache_reader *r, const struct digest *key, const struct indirect_desc *desc,
                       const struct kernels *kernels, struct indirect_cache **out, struct reason *why)
{
    struct indirect_cache *b = indirect_begin(desc, kernels);
    enum err e = !b || indirect_group(b, desc) ? no_memory(why) : cache_reader_find(r, section, key, why);

    *out = NULL;
    if (!e)
        e = read_basis(r, b, why);
    uint64_t bytes = b ? b->stats.bytes : 0;
    for (uint32_t k = 0; !e && k < b->group_count; k++) {
        const uint64_t before = bytes;
        e = indirect_load_group(r, b, &b->groups[k], &bytes, desc->max_bytes, why);
        if (!cache_share_takes_all(desc->share) && !indirect_keeps(b, desc->direct, desc->share, &b->groups[k])) {
            indirect_drop_group(b, &b->groups[k]);
            bytes = before;
        }
    }
    if (!e)
        e = cache_reader_end(r, why);
    if (!e && indirect_close(b))
        e = no_memory(why);
    if (e) {
        indirect_destroy(b);
        return e;
    }
    *out = b;
    return ERR_OK;
}
