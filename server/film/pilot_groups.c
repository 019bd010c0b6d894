#include "mem.h"
#include "pilot_measure.h"

#include <stdlib.h>
#include <string.h>

/* Pixels a side. Packets hold points of a neighbourhood of 16 x 16 (gbuffer_pack.c): where the picture is large enough
 * for groups of many such, no packet stands in two groups. */
#define TILE 16u
#define TILE_SMALL 8u
#define TILES_A_GROUP 10u /* at least: with fewer, one group shows what another does not */
#define NOBODY UINT8_MAX  /* owner of a pixel that holds no shade point */

static uint32_t tiles_of(uint32_t pixels, uint32_t tile)
{
    return (pixels + tile - 1) / tile;
}

static uint32_t tile_of(const struct groups *s, size_t pixel)
{
    const uint32_t width = s->gbuffer->width;
    return (uint32_t)(pixel / width) / s->side * s->across + (uint32_t)(pixel % width) / s->side;
}

/* The packets of one kind that `seen` marks, appended to the group's list. */
static void append(const struct gbuffer *g, const uint8_t *seen, enum surface_kind kind, struct group *group,
                   uint32_t *used)
{
    struct packet_list *list = &group->list[kind];

    list->index = group->index + *used;
    for (uint32_t i = 0; i < g->packet_count; i++)
        if (seen[i] && surface_of(&g->packets[i]) == kind) {
            group->index[(*used)++] = i;
            list->count++;
            group->points[kind] += g->packets[i].count;
        }
}

static bool list_packets(const struct gbuffer *g, const uint8_t *seen, struct group *group)
{
    uint32_t count = 0, used = 0;

    for (uint32_t i = 0; i < g->packet_count; i++)
        count += seen[i];
    group->index = mem_alloc(count, sizeof(*group->index));
    if (!group->index)
        return false;
    for (int kind = 0; kind < SURFACE_KINDS; kind++)
        append(g, seen, (enum surface_kind)kind, group, &used);
    group->both = (struct packet_list){ group->index, count };
    return true;
}

/* One group's pixels and packets; owner[pixel] names the group. */
static bool fill_group(const struct gbuffer *g, const uint8_t *owner, uint8_t number, uint8_t *seen,
                       struct group *group)
{
    const size_t pixels = (size_t)g->width * g->height;

    memset(seen, 0, g->packet_count);
    for (size_t i = 0; i < pixels; i++)
        group->pixel_count += owner[i] == number;
    group->pixels = mem_alloc(group->pixel_count, sizeof(*group->pixels));
    if (!group->pixels)
        return false;
    group->pixel_count = 0;
    for (size_t i = 0; i < pixels; i++) {
        if (owner[i] != number)
            continue;
        group->pixels[group->pixel_count++] = (uint32_t)i;
        for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++) {
            const float *w = g->entries[k].weight;
            const uint32_t packet = g->entries[k].point / PACKET;
            seen[packet] = 1;
            group->weight[surface_of(&g->packets[packet])] += ((double)w[0] + (double)w[1] + (double)w[2]) / 3.0;
        }
    }
    return list_packets(g, seen, group);
}

/* The tiles' side, in pixels. */
static uint32_t choose_side(const struct gbuffer *g)
{
    const uint32_t interleave = g->interleave ? g->interleave : 1, large = TILE * interleave;
    const uint32_t tiles = tiles_of(g->width, large) * tiles_of(g->height, large);

    return tiles >= TILES_A_GROUP * GROUPS_MAX ? large : TILE_SMALL * interleave;
}

static void finish(struct group *g)
{
    mem_free(g->pixels);
    mem_free(g->index);
    *g = (struct group){ 0 };
}

/* The groups, as s->deal has the tiles. */
static bool fill_groups(struct groups *s)
{
    const struct gbuffer *g = s->gbuffer;
    const size_t pixels = (size_t)g->width * g->height;
    bool all = true;

    for (size_t i = 0; i < pixels; i++)
        if (s->owner[i] != NOBODY)
            s->owner[i] = s->deal[tile_of(s, i)];
    for (uint32_t k = 0; k < s->count && all; k++) {
        finish(&s->group[k]);
        all = fill_group(g, s->owner, (uint8_t)k, s->seen, &s->group[k]);
    }
    return all;
}

static bool allocate(struct groups *s)
{
    const struct gbuffer *g = s->gbuffer;

    s->owner = mem_alloc((size_t)g->width * g->height, 1);
    s->seen = mem_alloc(g->packet_count, 1);
    s->deal = mem_alloc(s->tiles, 1);
    s->order = mem_alloc(s->tiles, sizeof(*s->order));
    s->mean = mem_alloc(s->tiles, sizeof(*s->mean));
    return s->owner && s->seen && s->deal && s->order && s->mean;
}

bool groups_init(struct groups *s, const struct gbuffer *g)
{
    const size_t pixels = (size_t)g->width * g->height;
    uint64_t edge = 0;

    *s = (struct groups){ .gbuffer = g, .side = choose_side(g) };
    s->across = tiles_of(g->width, s->side);
    s->tiles = s->across * tiles_of(g->height, s->side);
    s->count = s->tiles / TILES_A_GROUP;
    s->count = s->count < 1 ? 1 : s->count > GROUPS_MAX ? GROUPS_MAX : s->count;
    if (!allocate(s))
        return false;
    for (size_t i = 0; i < pixels; i++) {
        const uint32_t entries = g->entry_first[i + 1] - g->entry_first[i];
        s->owner[i] = entries ? 0 : NOBODY;
        s->pixels += entries > 0;
        edge += entries > 1 ? entries : 0;
    }
    s->edge_points = g->point_count ? (double)edge / (double)g->point_count : 0.0;
    if (!fill_group(g, s->owner, 0, s->seen, &s->all))
        return false;
    /* Neighbouring tiles are of different groups, and each group's lie all over the picture. */
    for (uint32_t k = 0; k < s->tiles; k++)
        s->deal[k] = (uint8_t)((uint64_t)k * 40503u % 65537u % s->count);
    return fill_groups(s);
}

static int by_weight(const void *a, const void *b)
{
    const struct group_tile *x = a, *y = b;

    if (x->weight != y->weight)
        return x->weight < y->weight ? 1 : -1;
    return (x->tile > y->tile) - (x->tile < y->tile);
}

/* Dealt like cards from the heaviest tile down, to and fro: no group gets more than its share by one tile. */
bool groups_deal(struct groups *s, const struct yardstick *y)
{
    const size_t pixels = (size_t)s->gbuffer->width * s->gbuffer->height;

    for (uint32_t k = 0; k < s->tiles; k++)
        s->order[k] = (struct group_tile){ 0.0, k };
    for (size_t i = 0; i < pixels; i++) {
        if (s->owner[i] == NOBODY)
            continue;
        for (size_t c = 0; c < 3; c++) {
            const double r = (double)y->rgb[3 * i + c], measure = r * r + y->soft;
            s->order[tile_of(s, i)].weight += measure > 0.0 ? 1.0 / measure : 0.0;
        }
    }
    qsort(s->order, s->tiles, sizeof(*s->order), by_weight);
    for (uint32_t k = 0; k < s->tiles; k++) {
        const uint32_t round = k / s->count, at = k % s->count;
        s->deal[s->order[k].tile] = (uint8_t)(round % 2 ? s->count - 1 - at : at);
    }
    s->dealt = true;
    return fill_groups(s);
}

void groups_finish(struct groups *s)
{
    for (uint32_t k = 0; k < GROUPS_MAX; k++)
        finish(&s->group[k]);
    finish(&s->all);
    mem_free(s->owner);
    mem_free(s->seen);
    mem_free(s->deal);
    mem_free(s->order);
    mem_free(s->mean);
    *s = (struct groups){ 0 };
}
