#include "base/mem.h"
#include "choose/pilot_measure.h"

#include <math.h>
#include <string.h>

/* Pixels a side. Packets hold points of a neighbourhood of 16 x 16 (gbuffer_pack.c): where the picture is large enough
 * for groups of many such, no packet stands in two groups. */
#define TILE 16u
#define TILE_SMALL 8u
#define TILES_A_GROUP 10u /* at least: with fewer, one group shows what another does not */
#define GOLDEN 0.6180339887498949

static uint32_t tiles_of(uint32_t pixels, uint32_t tile)
{
    return (pixels + tile - 1) / tile;
}

static uint32_t tile_of(const struct groups *s, size_t pixel)
{
    const uint32_t width = s->gbuffer->width;
    return (uint32_t)(pixel / width) / s->side * s->across + (uint32_t)(pixel % width) / s->side;
}

/* The tiles that hold shade points, dealt out by a sequence that spreads each group over the picture. */
static void deal(const struct groups *s, uint8_t *group)
{
    const struct gbuffer *g = s->gbuffer;
    const size_t pixels = (size_t)g->width * g->height;
    uint32_t rank = 0;

    for (size_t i = 0; i < pixels; i++)
        if (g->entry_first[i + 1] > g->entry_first[i])
            group[tile_of(s, i)] = 1;
    for (uint32_t k = 0; k < s->tiles; k++)
        if (group[k])
            group[k] = (uint8_t)(fmod(GOLDEN * rank++, 1.0) * s->count);
}

/* The pixels of one group, or of all (dealt NULL), and their packets, which `seen` marks. */
static bool fill_group(const struct groups *s, const uint8_t *dealt, uint32_t number, uint8_t *seen, struct group *out)
{
    const struct gbuffer *g = s->gbuffer;
    const size_t pixels = (size_t)g->width * g->height;

    out->pixels = mem_alloc_raw(pixels, sizeof(*out->pixels)); /* what is not written takes no memory */
    out->index = mem_alloc_raw(g->packet_count, sizeof(*out->index));
    if (!out->pixels || !out->index)
        return false;
    memset(seen, 0, g->packet_count);
    for (size_t i = 0; i < pixels; i++) {
        if (g->entry_first[i + 1] == g->entry_first[i] || (dealt && dealt[tile_of(s, i)] != number))
            continue;
        out->pixels[out->pixel_count++] = (uint32_t)i;
        for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++)
            seen[g->entries[k].point / PACKET] = 1;
    }
    for (uint32_t i = 0; i < g->packet_count; i++)
        if (seen[i]) {
            out->index[out->list.count++] = i;
            out->points += g->packets[i].count;
        }
    out->list.index = out->index;
    return true;
}

bool groups_init(struct groups *s, const struct gbuffer *g)
{
    const uint32_t interleave = g->interleave ? g->interleave : 1, large = TILE * interleave;
    const bool many = tiles_of(g->width, large) * tiles_of(g->height, large) >= TILES_A_GROUP * GROUPS_MAX;

    *s = (struct groups){ .gbuffer = g, .side = many ? large : TILE_SMALL * interleave };
    s->across = tiles_of(g->width, s->side);
    s->tiles = s->across * tiles_of(g->height, s->side);
    s->count = s->tiles / TILES_A_GROUP;
    s->count = s->count < 1 ? 1 : s->count > GROUPS_MAX ? GROUPS_MAX : s->count;
    s->mean = mem_alloc(s->tiles, sizeof(*s->mean));
    uint8_t *seen = mem_alloc(g->packet_count, 1), *dealt = mem_alloc(s->tiles, 1);
    bool all = s->mean && seen && dealt && fill_group(s, NULL, 0, seen, &s->all);
    if (all)
        deal(s, dealt);
    for (uint32_t k = 0; k < s->count && all; k++)
        all = fill_group(s, dealt, k, seen, &s->group[k]);
    mem_free(seen);
    mem_free(dealt);
    return all;
}

static void finish(struct group *g)
{
    mem_free(g->pixels);
    mem_free(g->index);
    *g = (struct group){ .pixels = NULL };
}

void groups_finish(struct groups *s)
{
    for (uint32_t k = 0; k < GROUPS_MAX; k++)
        finish(&s->group[k]);
    finish(&s->all);
    mem_free(s->mean);
    *s = (struct groups){ .gbuffer = NULL };
}
