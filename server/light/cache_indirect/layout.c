/* Lays out the blocks' bytes for frames: in the order in which direct light is computed, not by group, each block after
 * a head that describes it. */
#include "base/mem.h"
#include "light/cache_indirect/internal.h"

#include <string.h>

#define ALIGNED(n) (((n) + 7) / 8 * 8)

static size_t block_size(const struct indirect_cache *b, const struct indirect_block *block)
{
    const struct indirect_group *g = &b->groups[block->group];
    size_t size = block->rows * sizeof(struct indirect_row);

    for (uint32_t r = 0; r < block->rows; r++)
        size += indirect_block_bytes(block->rank[r], indirect_columns(g->pieces[r].rank), block->packets * PACKET);
    return ALIGNED(size);
}

/* Sets the blocks' groups and places; *size: of the stream. ERR_NOMEM. */
static enum err find_places(struct indirect_cache *b, size_t *size)
{
    const uint32_t packets = b->gbuffer->packet_count;
    uint32_t *block_of = mem_alloc(packets, sizeof(*block_of)); /* + 1 */

    b->places = mem_alloc(packets, sizeof(*b->places));
    if (!block_of || !b->places) {
        mem_free(block_of);
        return ERR_NOMEM;
    }
    for (uint32_t k = 0; k < b->group_count; k++)
        for (uint32_t i = b->groups[k].first; i < b->groups[k].first + b->groups[k].count; i++) {
            b->blocks[i].group = k;
            block_of[b->blocks[i].first] = i + 1;
        }
    *size = 0;
    for (uint32_t p = 0; p < packets; p++)
        if (block_of[p] > 0) {
            const struct indirect_block *block = &b->blocks[block_of[p] - 1];
            b->places[p] =
                (struct indirect_place){ (uint32_t)(*size / 8), (uint16_t)block->rows, (uint16_t)block->packets };
            *size += block_size(b, block);
        }
    mem_free(block_of);
    return ERR_OK;
}

/* Moves one row's bytes of all blocks of a group to their places; the piece keeps V. */
static enum err move_piece(struct indirect_cache *b, const struct indirect_group *g, struct indirect_piece *q,
                           uint32_t row, size_t *filled)
{
    const uint32_t columns = indirect_columns(q->rank);
    const size_t v_size = (size_t)q->rank * 3 * q->basis;
    const int8_t *at = q->bytes ? q->bytes + v_size : NULL;

    for (uint32_t i = g->first; i < g->first + g->count; i++) {
        const struct indirect_block *block = &b->blocks[i];
        const uint32_t rank = at ? block->rank[row] : 0;
        const size_t size = indirect_block_bytes(rank, columns, block->packets * PACKET);
        uint8_t *place = b->stream + (size_t)b->places[block->first].at * 8;
        const struct indirect_row head = { (uint32_t)(g->z[row] - b->z), (uint16_t)rank, (uint16_t)columns };
        memcpy(place + row * sizeof(head), &head, sizeof(head));
        if (size > 0)
            memcpy(place + filled[i - g->first], at, size);
        filled[i - g->first] += size;
        at = at ? at + size : NULL;
    }
    if (!at)
        return ERR_OK;
    int8_t *v = mem_alloc_raw(v_size, 1);
    if (!v)
        return ERR_NOMEM;
    memcpy(v, q->bytes, v_size);
    mem_free(q->bytes);
    q->bytes = v;
    return ERR_OK;
}

static enum err move_blocks(struct indirect_cache *b)
{
    enum err e = ERR_OK;

    for (uint32_t k = 0; k < b->group_count && !e; k++) {
        struct indirect_group *g = &b->groups[k];
        size_t filled[INDIRECT_GROUP];
        for (uint32_t i = 0; i < g->count; i++)
            filled[i] = g->rows * sizeof(struct indirect_row);
        for (uint32_t r = 0; r < g->rows && !e; r++)
            e = move_piece(b, g, &g->pieces[r], r, filled);
    }
    return e;
}

enum err indirect_lay_out(struct indirect_cache *b)
{
    size_t floats = 0, size;

    for (uint32_t k = 0; k < b->group_count; k++)
        for (uint32_t r = 0; r < b->groups[k].rows; r++)
            floats += 3 * indirect_columns(b->groups[k].pieces[r].rank);
    b->z = mem_alloc(floats, sizeof(*b->z));
    if (!b->z)
        return ERR_NOMEM;
    float *z = b->z;
    for (uint32_t k = 0; k < b->group_count; k++)
        for (uint32_t r = 0; r < b->groups[k].rows; r++) {
            b->groups[k].z[r] = z;
            z += 3 * indirect_columns(b->groups[k].pieces[r].rank);
        }
    const enum err e = find_places(b, &size);
    if (e)
        return e;
    b->stream = mem_alloc_large(size, 1);
    b->stream_size = size;
    b->tents = mem_alloc(1, sizeof(*b->tents));
    if (!b->stream || !b->tents)
        return ERR_NOMEM;
    indirect_set_indirect(b);
    b->stats.bytes += floats * sizeof(*b->z) + b->gbuffer->packet_count * sizeof(*b->places) +
                      b->block_count * sizeof(struct indirect_row) * TRANSPORT_ROWS;
    return move_blocks(b);
}

const int8_t *indirect_block_row(const struct indirect_cache *b, const struct indirect_block *block, uint32_t row)
{
    const uint8_t *at = b->stream + (size_t)b->places[block->first].at * 8;
    size_t before = block->rows * sizeof(struct indirect_row);

    for (uint32_t r = 0; r < row; r++)
        before += indirect_block_bytes(block->rank[r], indirect_columns(b->groups[block->group].pieces[r].rank),
                                       block->packets * PACKET);
    return (const int8_t *)at + before;
}
