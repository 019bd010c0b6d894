#include "bounce/file.h"

#include "bounce/parts.h"
#include "base/mem.h"
#include "cache/memory.h"
#include "scene/scene_digest.h"

#include <math.h>
#include <string.h>

/* To be counted up whenever the same scene would get another interreflection. */
#define FORMAT 1

#define GAIN_MOST 1e20f

static const char index_name[] = "bounce.index", basis_name[] = "bounce.basis", bytes_name[] = "bounce.bytes";

/* The index: a head, the blocks in their order, the groups. The pieces' bytes stand behind each other by groups and
 * rows. */
struct head {
    uint32_t blocks, groups, basis;
    uint32_t records, bounces, zero;
    uint64_t rays;
    double basis_rest;
};

struct block_record {
    uint32_t first;
    uint8_t rank[TRANSPORT_ROWS], zero;
};

struct group_record {
    uint16_t rank[TRANSPORT_ROWS], basis[TRANSPORT_ROWS];
};

_Static_assert(sizeof(struct head) == 40 && sizeof(struct block_record) == 8 && sizeof(struct group_record) == 12,
               "a section's layout has no padding");

struct digest bounce_key(const struct digest *direct, const struct bounce_desc *desc)
{
    const float numbers[] = { desc->eye.x, desc->eye.y, desc->eye.z, desc->tolerance };
    struct digest key = { { 0 } };

    digest_u64(&key, FORMAT);
    digest_bytes(&key, direct, sizeof(*direct));
    digest_u64(&key, (uint64_t)BOUNCE_BASIS_MAX << 32 | BOUNCE_GROUP);
    digest_u64(&key, (uint64_t)desc->gather << 32 | desc->records);
    digest_u64(&key, desc->seed);
    digest_u64(&key, desc->no_smoothing);
    digest_bytes(&key, numbers, sizeof(numbers));
    digest_scene(&key, desc->scene);
    return key;
}

/* ---- Saving ---- */

static size_t index_size(const struct bounce *b)
{
    return sizeof(struct head) + b->block_count * sizeof(struct block_record) +
           b->group_count * sizeof(struct group_record);
}

static void write_index(const struct bounce *b, uint8_t *at)
{
    const struct bounce_stats *s = &b->stats;
    const struct head head = { b->block_count, b->group_count, b->basis.count, s->records, s->bounces, 0,
                               s->rays,        s->basis_rest };

    memcpy(at, &head, sizeof(head));
    at += sizeof(head);
    for (uint32_t k = 0; k < b->block_count; k++, at += sizeof(struct block_record)) {
        struct block_record record = { b->blocks[k].first, { 0 }, 0 };
        memcpy(record.rank, b->blocks[k].rank, b->blocks[k].rows);
        memcpy(at, &record, sizeof(record));
    }
    for (uint32_t k = 0; k < b->group_count; k++, at += sizeof(struct group_record)) {
        struct group_record record = { { 0 }, { 0 } };
        for (uint32_t r = 0; r < b->groups[k].rows; r++) {
            record.rank[r] = (uint16_t)b->groups[k].pieces[r].rank;
            record.basis[r] = (uint16_t)b->groups[k].pieces[r].basis;
        }
        memcpy(at, &record, sizeof(record));
    }
}

static void save_piece(const struct bounce *b, const struct bounce_group *g, uint32_t row, struct cache_writer *w)
{
    const struct bounce_piece *q = &g->pieces[row];

    if (!q->bytes)
        return;
    cache_writer_put(w, q->bytes, (size_t)q->rank * 3 * q->basis);
    for (uint32_t i = g->first; i < g->first + g->count; i++) {
        const struct bounce_block *block = &b->blocks[i];
        cache_writer_put(w, bounce_block_row(b, block, row),
                         bounce_block_bytes(block->rank[row], bounce_columns(q->rank), block->packets * PACKET));
    }
}

void bounce_save(const struct bounce *b, const struct digest *key, struct cache_writer *w)
{
    uint8_t *index = mem_alloc(index_size(b), 1);

    if (index)
        write_index(b, index);
    cache_writer_section(w, index_name, key);
    cache_writer_give(w, index, index_size(b));
    cache_writer_section(w, basis_name, key);
    cache_writer_put(w, b->basis.rows, (size_t)b->basis.count * SKY_CELLS * sizeof(*b->basis.rows));
    cache_writer_section(w, bytes_name, key);
    for (uint32_t k = 0; k < b->group_count; k++) {
        const struct bounce_group *g = &b->groups[k];
        for (uint32_t r = 0; r < g->rows; r++)
            save_piece(b, g, r, w);
    }
}

/* ---- Loading ---- */

static enum err refuse(const struct cache_reader *r, struct reason *why, const char *what)
{
    return err_say(why, ERR_FORMAT, "%.200s: %s", cache_reader_path(r), what);
}

/* Whatever stands in the records, the loops that read the pieces stay within them, the basis and their own memory. */
static bool take_group(struct bounce *b, struct bounce_group *g, const struct group_record *record)
{
    uint32_t points = 0;

    for (uint32_t k = g->first; k < g->first + g->count; k++)
        points += b->blocks[k].packets * PACKET;
    for (uint32_t r = 0; r < TRANSPORT_ROWS; r++) {
        const uint32_t rank = record->rank[r], basis = record->basis[r];
        if (rank == 0 ? basis != 0 : r >= g->rows || rank > points)
            return false;
        if (rank > 0 && (basis == 0 || basis % PACKET != 0 || basis > b->basis.count))
            return false;
        for (uint32_t k = g->first; k < g->first + g->count; k++)
            if (b->blocks[k].rank[r] > (rank > 0 ? b->blocks[k].packets * PACKET : 0))
                return false;
        g->pieces[r] = (struct bounce_piece){ NULL, rank, basis };
    }
    return true;
}

static bool take_records(struct bounce *b, const struct block_record *blocks, const struct group_record *groups)
{
    for (uint32_t k = 0; k < b->block_count; k++) {
        if (blocks[k].first != b->blocks[k].first || blocks[k].zero != 0)
            return false;
        memcpy(b->blocks[k].rank, blocks[k].rank, sizeof(blocks[k].rank));
    }
    for (uint32_t k = 0; k < b->group_count; k++)
        if (!take_group(b, &b->groups[k], &groups[k]))
            return false;
    return true;
}

static bool is_sound_head(const struct head *h)
{
    return h->zero == 0 && h->basis > 0 && h->basis <= BOUNCE_BASIS_MAX && h->basis % PACKET == 0 &&
           h->basis_rest >= 0.0 && h->basis_rest <= 1.0;
}

static enum err read_index(struct cache_reader *r, const struct digest *key, struct bounce *b, struct reason *why)
{
    struct block_record *blocks = mem_alloc(b->block_count, sizeof(*blocks));
    struct group_record *groups = mem_alloc(b->group_count, sizeof(*groups));
    struct head head;
    enum err e = blocks && groups ? cache_reader_find(r, index_name, key, why)
                                  : err_say(why, ERR_NOMEM, "no memory for the cache of interreflection");

    if (!e)
        e = cache_reader_get(r, &head, sizeof(head), why);
    if (!e && (head.blocks != b->block_count || head.groups != b->group_count))
        e = refuse(r, why, "has other blocks than this picture");
    if (!e && !is_sound_head(&head))
        e = refuse(r, why, "holds numbers that cannot be");
    if (!e)
        e = cache_reader_get(r, blocks, b->block_count * sizeof(*blocks), why);
    if (!e)
        e = cache_reader_get(r, groups, b->group_count * sizeof(*groups), why);
    if (!e)
        e = cache_reader_end(r, why);
    if (!e) {
        b->basis = (struct bounce_basis){ .count = head.basis, .rest = head.basis_rest };
        b->stats.records = head.records;
        b->stats.bounces = head.bounces;
        b->stats.rays = head.rays;
        if (!take_records(b, blocks, groups))
            e = refuse(r, why, "holds numbers that cannot be");
    }
    mem_free(blocks);
    mem_free(groups);
    return e;
}

/* Rows of unit length. */
static enum err read_basis(struct cache_reader *r, const struct digest *key, struct bounce *b, struct reason *why)
{
    const size_t count = (size_t)b->basis.count * SKY_CELLS;
    enum err e = cache_reader_find(r, basis_name, key, why);

    b->basis.rows = mem_alloc_raw(count, sizeof(*b->basis.rows));
    if (!e && !b->basis.rows)
        e = err_say(why, ERR_NOMEM, "no memory for the cache of interreflection");
    if (!e)
        e = cache_reader_get(r, b->basis.rows, count * sizeof(*b->basis.rows), why);
    for (size_t i = 0; i < count && !e; i++)
        if (!(fabsf(b->basis.rows[i]) < 1.001f))
            e = refuse(r, why, "holds numbers that cannot be");
    return e ? e : cache_reader_end(r, why);
}

/* Bytes may be any, what they are multiplied by may not. */
static bool has_sound_gains(const struct bounce *b, const struct bounce_group *g, uint32_t row)
{
    const struct bounce_piece *q = &g->pieces[row];
    const uint32_t columns = bounce_columns(q->rank);
    const int8_t *at = q->bytes + (size_t)q->rank * 3 * q->basis;

    for (uint32_t k = g->first; k < g->first + g->count; k++) {
        const struct bounce_block *block = &b->blocks[k];
        for (uint32_t i = 0; i < block->rank[row]; i++) {
            float gain;
            memcpy(&gain, at + i * sizeof(gain), sizeof(gain));
            if (!(gain >= 0.0f && gain < GAIN_MOST))
                return false;
        }
        at += bounce_block_bytes(block->rank[row], columns, block->packets * PACKET);
    }
    return true;
}

static enum err read_piece(struct cache_reader *r, const struct bounce *b, struct bounce_group *g, uint32_t row,
                           struct reason *why)
{
    struct bounce_piece *q = &g->pieces[row];
    const size_t size = bounce_piece_bytes(g, b->blocks + g->first, row);

    if (size == 0)
        return ERR_OK;
    q->bytes = mem_alloc_raw(size, 1);
    if (!q->bytes)
        return err_say(why, ERR_NOMEM, "no memory for the cache of interreflection");
    const enum err e = cache_reader_get(r, q->bytes, size, why);
    if (e)
        return e;
    return has_sound_gains(b, g, row) ? ERR_OK : refuse(r, why, "holds numbers that cannot be");
}

static enum err read_bytes(struct cache_reader *r, const struct digest *key, struct bounce *b, uint64_t max_bytes,
                           struct reason *why)
{
    enum err e = cache_reader_find(r, bytes_name, key, why);
    uint64_t bytes = 0;

    for (uint32_t k = 0; k < b->group_count; k++)
        for (uint32_t row = 0; row < b->groups[k].rows; row++)
            bytes += bounce_piece_bytes(&b->groups[k], b->blocks + b->groups[k].first, row);
    if (!e && cache_reader_left(r) != bytes)
        e = refuse(r, why, "holds more or less than it says");
    if (!e && !cache_memory_suffices(max_bytes, b->stats.bytes + bytes))
        return bounce_say_too_large(max_bytes, why);
    for (uint32_t k = 0; k < b->group_count && !e; k++)
        for (uint32_t row = 0; row < b->groups[k].rows && !e; row++)
            e = read_piece(r, b, &b->groups[k], row, why);
    return e ? e : cache_reader_end(r, why);
}

enum err bounce_load(struct cache_reader *r, const struct digest *key, const struct bounce_desc *desc,
                     const struct kernels *kernels, struct bounce **out, struct reason *why)
{
    struct bounce *b = bounce_begin(desc, kernels);
    enum err e = b ? bounce_group(b, desc) : ERR_NOMEM;

    *out = NULL;
    if (e)
        err_say(why, e, "no memory for the cache of interreflection");
    if (!e)
        e = read_index(r, key, b, why);
    if (!e)
        e = read_basis(r, key, b, why);
    if (!e)
        e = read_bytes(r, key, b, desc->max_bytes, why);
    if (!e) {
        e = bounce_close(b);
        if (e)
            err_say(why, e, "no memory for the cache of interreflection");
    }
    if (!e) {
        *out = b;
        b = NULL;
    }
    bounce_destroy(b);
    return e;
}
