#include "light/cache_indirect/indirect.h"

#include "base/mem.h"
#include "light/cache_indirect/internal.h"

#include <string.h>

void indirect_destroy(struct indirect_cache *b)
{
    if (!b)
        return;
    for (uint32_t k = 0; b->groups && k < b->group_count; k++)
        for (uint32_t r = 0; r < TRANSPORT_ROWS; r++)
            mem_free(b->groups[k].pieces[r].bytes);
    mem_free(b->groups);
    mem_free(b->blocks);
    mem_free(b->left_index);
    mem_free(b->places);
    mem_free(b->stream);
    mem_free(b->z);
    mem_free(b->tents);
    indirect_basis_finish(&b->basis);
    mem_free(b);
}

const struct indirect_stats *indirect_stats(const struct indirect_cache *b)
{
    return &b->stats;
}

const struct packet_list *indirect_left(const struct indirect_cache *b)
{
    return &b->left;
}

static void take_sky(void *self, const struct environment *e, uint32_t part)
{
    struct indirect_cache *b = self;

    indirect_sky_part(e, part, b->tents);
}

static void sky_taken(void *self)
{
    struct indirect_cache *b = self;
    float sky[3][SKY_CELLS];

    indirect_sky_deal(b->tents, sky);
    indirect_kernels_of(b->kernels)->take(&b->basis, sky, b->y); /* faster than waking a thread */
}

static bool is_wanted(const struct indirect_cache *b, const struct indirect_group *g, transport_wants *wants,
                      const void *context)
{
    for (uint32_t i = g->first; wants && i < g->first + g->count; i++)
        if (wants(context, b->blocks[i].first))
            return true;
    return !wants;
}

/* Multiplies a group's V by the sky. */
static void prepare_group(void *self, uint32_t k, transport_wants *wants, const void *context)
{
    struct indirect_cache *b = self;

    if (!is_wanted(b, &b->groups[k], wants, context))
        return;
    for (uint32_t r = 0; r < b->groups[k].rows; r++)
        if (b->groups[k].pieces[r].bytes)
            indirect_kernels_of(b->kernels)->project(&b->groups[k].pieces[r], b->y, b->basis.count, b->groups[k].z[r]);
}

#define AHEAD 1024 /* bytes of the stream to prefetch */

static void indirect_rows(const void *self, uint32_t first, struct transport_rows *out)
{
    const struct indirect_cache *b = self;
    const struct indirect_place place = b->places[first];
    const uint32_t points = place.packets * PACKET;
    const uint8_t *head = b->stream + (size_t)place.at * 8;
    const int8_t *bytes = (const int8_t *)head + place.rows * sizeof(struct indirect_row);

    for (uint32_t r = 0; r < place.rows; r++, head += sizeof(struct indirect_row)) {
        struct indirect_row row;
        memcpy(&row, head, sizeof(row));
        indirect_kernels_of(b->kernels)->expand(bytes, row.rank, b->z + row.z, row.columns, points, out->at[r]);
        bytes += indirect_block_bytes(row.rank, row.columns, points);
    }
    for (uint32_t i = 0; i < AHEAD; i += 64) /* most likely the next block's */
        __builtin_prefetch(bytes + i);
    out->count = place.rows;
}

void indirect_set_indirect(struct indirect_cache *b)
{
    b->indirect = (struct transport_indirect){
        .self = b,
        .take = take_sky,
        .take_parts = INDIRECT_SKY_PARTS,
        .taken = sky_taken,
        .sky = b->y,
        .sky_count = 3 * b->basis.count,
        .prepare = prepare_group,
        .parts = b->group_count,
        .rows = indirect_rows,
    };
}

const struct transport_indirect *indirect_of_frame(const struct indirect_cache *b)
{
    return &b->indirect;
}
