#include "scene/geometry/gbuffer_build.h"

#include "base/mem.h"

#include <assert.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

/* 2^bits pixels per side of the tiles within which similar points are grouped. Measured: larger tiles fill packets
 * better (fewer lanes below the horizon); smaller ones do not trace faster. */
#define TILE_BITS 4u
#define KEY_BITS 44u
#define DIGIT_BITS 11u
#define KIND_SHIFT 42u /* the kind is in the top two bits of the key */

/* Spreads the low 16 bits of x to the even bit positions. */
static uint64_t spread(uint64_t x)
{
    x &= 0xffffu;
    x = (x | (x << 8)) & 0x00ff00ffu;
    x = (x | (x << 4)) & 0x0f0f0f0fu;
    x = (x | (x << 2)) & 0x33333333u;
    x = (x | (x << 1)) & 0x55555555u;
    return x;
}

static uint64_t morton(uint32_t x, uint32_t y)
{
    return spread(x) | spread(y) << 1;
}

/* One of 64 cells of the sphere: the signs of the coordinates, then the halves of the two smaller ones. */
static uint64_t normal_cell(struct vec3 n)
{
    uint64_t cell = (uint64_t)(n.x < 0.0f) | (uint64_t)(n.y < 0.0f) << 1 | (uint64_t)(n.z < 0.0f) << 2;
    cell |=
        (uint64_t)(fabsf(n.x) > 0.5f) << 3 | (uint64_t)(fabsf(n.y) > 0.5f) << 4 | (uint64_t)(fabsf(n.z) > 0.5f) << 5;
    return cell;
}

/* Sort key: kind (2 bits), tile in Morton order, material and layer (8), normal (6), position in the tile. Pixels of an
 * image with 2^14 per side take 28 bits. */
static uint64_t sort_key(const struct shade_point *p)
{
    const uint32_t inside = (1u << TILE_BITS) - 1u;
    uint64_t key = p->kind;

    key = key << (28 - 2 * TILE_BITS) | morton(p->x >> TILE_BITS, p->y >> TILE_BITS);
    key = key << 8 | ((p->material * 29u + p->mesh + 85u * p->layer) & 0xffu);
    key = key << 6 | normal_cell(p->shading);
    key = key << 2 * TILE_BITS | morton(p->x & inside, p->y & inside);
    return key;
}

struct item {
    uint32_t key_high, key_low; /* in halves: 12 bytes instead of 16 */
    uint32_t point;
};
_Static_assert(2 * sizeof(struct item) == PACKING_BYTES, "two buffers of items");

static uint32_t digit(const struct item *item, unsigned shift)
{
    return ((uint64_t)item->key_high << 32 | item->key_low) >> shift & ((1u << DIGIT_BITS) - 1u);
}

/* Stable: equal keys keep the image's order. */
static void radix_sort(struct item *items, struct item *spare, uint32_t count)
{
    enum { DIGITS = 1 << DIGIT_BITS };

    for (unsigned shift = 0; shift < KEY_BITS; shift += DIGIT_BITS) {
        uint32_t start[DIGITS + 1] = { 0 };
        for (uint32_t i = 0; i < count; i++)
            start[digit(&items[i], shift) + 1]++;
        for (unsigned d = 0; d < DIGITS; d++)
            start[d + 1] += start[d];
        for (uint32_t i = 0; i < count; i++)
            spare[start[digit(&items[i], shift)]++] = items[i];
        struct item *swap = items;
        items = spare;
        spare = swap;
    }
    /* KEY_BITS / DIGIT_BITS is even, so the result ends in the caller's array */
}
_Static_assert(KEY_BITS % (2 * DIGIT_BITS) == 0, "an even number of passes");

static void put(struct shade_packet *k, uint32_t lane, const struct shade_point *p, int32_t valid)
{
    k->x[lane] = p->position.x;
    k->y[lane] = p->position.y;
    k->z[lane] = p->position.z;
    k->ng_x[lane] = p->geometric.x;
    k->ng_y[lane] = p->geometric.y;
    k->ng_z[lane] = p->geometric.z;
    k->ns_x[lane] = p->shading.x;
    k->ns_y[lane] = p->shading.y;
    k->ns_z[lane] = p->shading.z;
    k->wo_x[lane] = p->wo.x;
    k->wo_y[lane] = p->wo.y;
    k->wo_z[lane] = p->wo.z;
    k->diffuse[0][lane] = p->diffuse.x;
    k->diffuse[1][lane] = p->diffuse.y;
    k->diffuse[2][lane] = p->diffuse.z;
    k->specular[0][lane] = p->specular.x;
    k->specular[1][lane] = p->specular.y;
    k->specular[2][lane] = p->specular.z;
    k->gloss[lane] = p->gloss;
    k->pixel[lane] = p->pixel;
    k->cell[lane] = (uint8_t)p->cell;
    uint32_t left = p->cells, count = (uint32_t)__builtin_popcount(left);
    for (uint32_t i = 0; i < PIXEL_CELLS; i++) { /* each for an equal share of the places */
        k->cells[i / 8][lane] |= (uint32_t)__builtin_ctz(left) << i % 8 * 4;
        if ((i + 1) * count / PIXEL_CELLS > i * count / PIXEL_CELLS)
            left &= left - 1;
    }
    k->mesh[lane] = p->mesh;
    k->material[lane] = p->material;
    k->behind[lane] = p->behind;
    k->layer[lane] = (uint8_t)p->layer;
    k->valid[lane] = valid;
}

/* The kind is in the top bits of the key. */
static uint8_t kind_of(const struct item *item)
{
    return (uint8_t)(item->key_high >> (KIND_SHIFT - 32));
}

/* Number of packets for `items` if a new kind starts a new packet; writes their heads and the slots if
 * requested. */
static uint32_t lay_out(const struct item *items, uint32_t count, struct packet_head *heads, uint32_t *slots)
{
    uint32_t packets = 0, lane = 0;

    for (uint32_t i = 0; i < count; i++) {
        const uint8_t kind = kind_of(&items[i]);
        if (i == 0 || lane == PACKET || kind != kind_of(&items[i - 1])) {
            packets++;
            lane = 0;
        }
        lane++;
        if (heads)
            heads[packets - 1] = (struct packet_head){ .kind = kind, .count = (uint8_t)lane };
        if (slots)
            slots[items[i].point] = (packets - 1) * PACKET + lane - 1;
    }
    return packets;
}

/* Sorts the points of all rows into packet order. */
static void sort_points(const struct row *rows, uint32_t row_count, uint32_t point_count,
                        struct item *items, struct item *spare)
{
    uint32_t n = 0;

    for (uint32_t y = 0; y < row_count; y++) {
        for (uint32_t i = 0; i < rows[y].point_count; i++, n++) {
            const uint64_t key = sort_key(&rows[y].points[i]);
            items[n] = (struct item){ (uint32_t)(key >> 32), (uint32_t)key, n };
        }
    }
    assert(n == point_count);
    radix_sort(items, spare, point_count);
}

enum err packing_init(struct packing *p, const struct row *rows, uint32_t row_count, uint32_t point_count)
{
    struct item *items = mem_alloc_raw(point_count, sizeof(*items));
    void *spare = mem_alloc_raw(point_count, sizeof(*items));
    enum err e = items && spare ? ERR_OK : ERR_NOMEM;

    *p = (struct packing){ .slots = NULL };
    if (e)
        goto done;
    sort_points(rows, row_count, point_count, items, spare);
    p->packet_count = lay_out(items, point_count, NULL, NULL);
    p->heads = mem_alloc(p->packet_count, sizeof(*p->heads));
    e = p->heads ? ERR_OK : ERR_NOMEM;
    if (e)
        goto done;
    p->slots = spare; /* reuses an existing buffer */
    spare = NULL;
    lay_out(items, point_count, p->heads, p->slots);
done:
    mem_free(spare);
    mem_free(items);
    return e;
}

void packing_finish(struct packing *p)
{
    mem_free(p->slots);
    mem_free(p->heads);
    *p = (struct packing){ .slots = NULL };
}

void packing_put(struct packing *p, const struct row *r, uint32_t first, const struct view *view,
                 struct shade_packet *packets)
{
    for (uint32_t i = 0; i < r->point_count; i++) {
        const uint32_t slot = p->slots[first + i], lane = slot % PACKET;
        struct packet_head *head = &p->heads[slot / PACKET];
        struct shade_packet *k = &packets[slot / PACKET];
        if (!head->begun) {
            memset(k, 0, sizeof(*k));
            k->kind = head->kind;
            k->count = head->count;
            const struct vec3 right = view_right(view, r->points[i].x + 0.5, r->points[i].y + 0.5);
            memcpy(k->right, &right, sizeof(k->right));
            head->begun = true;
        }
        put(k, lane, &r->points[i], -1);
        for (uint32_t rest = lane + 1; lane + 1u == head->count && rest < PACKET; rest++)
            put(k, rest, &r->points[i], 0);
    }
}

void shade_packet_put(struct shade_packet *to, uint32_t at, const struct shade_packet *from, uint32_t lane,
                      int32_t valid)
{
    /* Up to `behind`, a packet consists of rows of sixteen four-byte numbers. */
    for (size_t row = 0; row < offsetof(struct shade_packet, behind); row += sizeof(to->x))
        memcpy((char *)to + row + at * sizeof(*to->x), (const char *)from + row + lane * sizeof(*to->x),
               sizeof(*to->x));
    to->valid[at] = valid;
    to->behind[at] = from->behind[lane];
    to->layer[at] = from->layer[lane];
    to->cell[at] = from->cell[lane];
}
