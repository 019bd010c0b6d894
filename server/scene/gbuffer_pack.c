#include "gbuffer_build.h"

#include "mem.h"

#include <math.h>
#include <string.h>

/* 2^bits pixels a side: the neighbourhoods within which alike points come together. Measured: larger ones fill the
 * packets better (fewer lanes below the horizon), smaller ones trace no faster. */
#define TILE_BITS 4u
#define KEY_BITS 44u
#define DIGIT_BITS 11u

/* Spreads the low 16 bits of x to the even places. */
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

/* One of 64 cells of the sphere: signs of the coordinates, then the halves of the two smaller ones. */
static uint64_t normal_cell(struct vec3 n)
{
    uint64_t cell = (uint64_t)(n.x < 0.0f) | (uint64_t)(n.y < 0.0f) << 1 | (uint64_t)(n.z < 0.0f) << 2;
    cell |=
        (uint64_t)(fabsf(n.x) > 0.5f) << 3 | (uint64_t)(fabsf(n.y) > 0.5f) << 4 | (uint64_t)(fabsf(n.z) > 0.5f) << 5;
    return cell;
}

/* Kind (2 bits), neighbourhood in Morton order, material (8), normal (6), place in the neighbourhood: pixels of a
 * picture of 2^14 a side take 28 bits together. */
static uint64_t sort_key(const struct shade_point *p)
{
    const uint32_t inside = (1u << TILE_BITS) - 1u;
    uint64_t key = p->kind;

    key = key << (28 - 2 * TILE_BITS) | morton(p->x >> TILE_BITS, p->y >> TILE_BITS);
    key = key << 8 | ((p->material * 29u + p->mesh) & 0xffu);
    key = key << 6 | normal_cell(p->shading);
    key = key << 2 * TILE_BITS | morton(p->x & inside, p->y & inside);
    return key;
}

struct item {
    uint64_t key;
    uint32_t point;
};

/* Stable, so that equal keys keep the picture's order. */
static void radix_sort(struct item *items, struct item *spare, uint32_t count)
{
    enum { DIGITS = 1 << DIGIT_BITS };

    for (unsigned shift = 0; shift < KEY_BITS; shift += DIGIT_BITS) {
        uint32_t start[DIGITS + 1] = { 0 };
        for (uint32_t i = 0; i < count; i++)
            start[((items[i].key >> shift) & (DIGITS - 1)) + 1]++;
        for (unsigned d = 0; d < DIGITS; d++)
            start[d + 1] += start[d];
        for (uint32_t i = 0; i < count; i++)
            spare[start[(items[i].key >> shift) & (DIGITS - 1)]++] = items[i];
        struct item *swap = items;
        items = spare;
        spare = swap;
    }
    /* KEY_BITS / DIGIT_BITS is even: the result is back in the caller's items */
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
    k->mesh[lane] = p->mesh;
    k->material[lane] = p->material;
    k->valid[lane] = valid;
}

/* Packets that `items` take when a new kind begins a new packet. */
static uint32_t count_packets(const struct shade_point *points, const struct item *items, uint32_t count)
{
    uint32_t packets = 0, lane = 0;

    for (uint32_t i = 0; i < count; i++) {
        if (i == 0 || lane == PACKET || points[items[i].point].kind != points[items[i - 1].point].kind) {
            packets++;
            lane = 0;
        }
        lane++;
    }
    return packets;
}

static void fill(const struct shade_point *points, const struct item *items, uint32_t count,
                 struct shade_packet *packets, uint32_t *slots)
{
    struct shade_packet *k = packets;

    for (uint32_t i = 0; i < count; i++) {
        const struct shade_point *p = &points[items[i].point];
        if (k->count == PACKET || (k->count > 0 && k->kind != p->kind))
            k++;
        k->kind = p->kind;
        slots[items[i].point] = (uint32_t)(k - packets) * PACKET + k->count;
        put(k, k->count++, p, -1);
        for (uint32_t lane = k->count; lane < PACKET; lane++)
            put(k, lane, p, 0);
    }
}

enum err points_pack(const struct shade_point *points, uint32_t count, struct shade_packet **packets,
                     uint32_t *packet_count, uint32_t *slots)
{
    struct item *items = mem_alloc(count, sizeof(*items));
    struct item *spare = mem_alloc(count, sizeof(*spare));
    enum err e = items && spare ? ERR_OK : ERR_NOMEM;

    *packets = NULL;
    if (e)
        goto done;
    for (uint32_t i = 0; i < count; i++)
        items[i] = (struct item){ sort_key(&points[i]), i };
    radix_sort(items, spare, count);
    *packet_count = count_packets(points, items, count);
    *packets = mem_alloc(*packet_count, sizeof(**packets));
    if (*packets)
        fill(points, items, count, *packets, slots);
    else
        e = ERR_NOMEM;
done:
    mem_free(spare);
    mem_free(items);
    return e;
}
