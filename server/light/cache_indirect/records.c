/* Finds the voxel of a position and its record. */
#include "base/mem.h"
#include "light/cache_indirect/internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LEVEL_LEAST (-24) /* levels need 6 bits of a key, normals and kind 7, */
#define LEVEL_MOST 30
#define PLACE_BITS 17 /* and each axis 17: 64 in all */
/* A voxel is no larger than NEAR times the length of the ray that hit it, so that near surfaces are not blurred, but at
 * least LEAST times as large as it is elsewhere. */
#define NEAR 0.5
#define LEAST 0.0625

/* One of 54 parts of the sphere: 3 x 3 on each face of the cube, so that each axis is in the middle of a part. */
static uint64_t normal_part(struct vec3 n)
{
    const float w[3] = { n.x, n.y, n.z };
    float u, v;
    const uint32_t face = cube_locate(w, &u, &v);
    const uint32_t i = u < -0.4f ? 0 : u > 0.4f ? 2 : 1, j = v < -0.4f ? 0 : v > 0.4f ? 2 : 1;

    return (face * 3 + i) * 3 + j;
}

/* The grid is shifted, so that surfaces at round coordinates are not on its borders. */
static uint64_t place(float x, double scale)
{
    return (uint64_t)(int64_t)floor((double)x * scale + 0.3819660112501051) & (((uint64_t)1 << PLACE_BITS) - 1);
}

/* The voxel size, as a power of two, at a place hit by a ray of length t. */
static int level_of(const struct indirect_records *r, struct vec3 at, float t)
{
    const double whole = (double)r->angle * (double)vec3_length(vec3_sub(at, r->eye));
    const double size = fmax(fmin(whole, NEAR * (double)t), LEAST * whole);
    const int level = size > 0.0 ? (int)floor(log2(size)) : LEVEL_LEAST;

    return level < LEVEL_LEAST ? LEVEL_LEAST : level > LEVEL_MOST ? LEVEL_MOST : level;
}

static uint64_t key_of(int level, struct vec3 at, const struct indirect_spot *s)
{
    const double scale = ldexp(1.0, -level);
    uint64_t key = (uint64_t)(level - LEVEL_LEAST) << 7 | normal_part(s->shading) << 1 | lobe_covers_matte(s->kind);

    key = key << PLACE_BITS | place(at.x, scale);
    key = key << PLACE_BITS | place(at.y, scale);
    return key << PLACE_BITS | place(at.z, scale);
}

static uint32_t find(const struct indirect_records *r, uint64_t key)
{
    for (uint32_t at = (uint32_t)rng_hash(key) & r->mask; r->table[at]; at = (at + 1) & r->mask)
        if (r->spots[(size_t)(r->table[at] - 1) * INDIRECT_SPOTS].key == key)
            return r->table[at] - 1;
    return INDIRECT_NO_RECORD;
}

/* Looks up a random place on the surface within half a voxel, so that the borders of voxels are smooth on average; else
 * the place itself, then larger voxels. */
uint32_t indirect_find(const struct indirect_records *r, const struct indirect_spot *s, const double x[2])
{
    const int level = level_of(r, s->at, s->length), top = level_of(r, s->at, INFINITY);
    const float half = ldexpf(1.0f, level - 1);
    struct vec3 t, u;

    frame_about(s->geometric, &t, &u);
    const struct vec3 beside = vec3_add(s->at, vec3_add(vec3_scale(t, half * (float)(2.0 * x[0] - 1.0)),
                                                        vec3_scale(u, half * (float)(2.0 * x[1] - 1.0))));
    uint32_t found = find(r, key_of(level, beside, s));
    for (int k = level; k <= top && found == INDIRECT_NO_RECORD; k++)
        found = find(r, key_of(k, s->at, s));
    return found;
}

static int by_key(const void *a, const void *b)
{
    const struct indirect_spot *x = a, *y = b;

    if (x->key != y->key)
        return x->key < y->key ? -1 : 1;
    return x->order < y->order ? -1 : x->order > y->order;
}

static void set_keys(const struct indirect_records *r, struct indirect_spots *s)
{
#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < s->count; i++) {
        struct indirect_spot *x = &s->at[i];
        x->key = key_of(level_of(r, x->at, x->length), x->at, x);
    }
}

/* Whether the spots are in at most `most` voxels, without sorting all of them. set: [mask + 1], more than `most`. */
static bool fits(const struct indirect_spots *s, uint32_t most, uint64_t *set, uint32_t mask)
{
    uint32_t count = 0;

    memset(set, 0, ((size_t)mask + 1) * sizeof(*set));
    for (uint32_t i = 0; i < s->count; i++) {
        const uint64_t key = ~s->at[i].key; /* never 0, since no level has all bits */
        uint32_t at = (uint32_t)rng_hash(key) & mask;
        while (set[at] && set[at] != key)
            at = (at + 1) & mask;
        if (!set[at] && count++ == most)
            return false;
        set[at] = key;
    }
    return true;
}

/* Chooses the smallest voxels that are few enough. */
static enum err choose_angle(struct indirect_records *r, struct indirect_spots *s, uint32_t most)
{
    uint32_t slots = 16;

    while (slots < 2 * (uint64_t)most)
        slots *= 2;
    uint64_t *set = mem_alloc_raw(slots, sizeof(*set));
    if (!set)
        return ERR_NOMEM;
    for (set_keys(r, s); !fits(s, most, set, slots - 1); set_keys(r, s))
        r->angle *= 1.25f;
    mem_free(set);
    return ERR_OK;
}

/* Sorts the spots by voxel; returns the number of voxels. */
static uint32_t sort_spots(struct indirect_spots *s)
{
    uint32_t count = 0;

    if (s->count > 0) /* qsort requires a pointer even for no elements */
        qsort(s->at, s->count, sizeof(*s->at), by_key);
    for (uint32_t i = 0; i < s->count; i++)
        count += i == 0 || s->at[i].key != s->at[i - 1].key;
    return count;
}

static void take_spots(struct indirect_records *r, const struct indirect_spots *s)
{
    uint32_t record = 0;

    for (uint32_t first = 0, end; first < s->count; first = end, record++) {
        for (end = first + 1; end < s->count && s->at[end].key == s->at[first].key; end++)
            ;
        for (uint32_t l = 0; l < INDIRECT_SPOTS; l++)
            r->spots[(size_t)record * INDIRECT_SPOTS + l] = s->at[first + l % (end - first)];
        uint32_t at = (uint32_t)rng_hash(s->at[first].key) & r->mask;
        while (r->table[at])
            at = (at + 1) & r->mask;
        r->table[at] = record + 1;
    }
}

enum err indirect_records_init(struct indirect_records *r, struct indirect_spots *spots, uint32_t most)
{
    uint32_t slots = 16;

    if (choose_angle(r, spots, most))
        return ERR_NOMEM;
    r->count = sort_spots(spots);
    while (slots < 4 * r->count)
        slots *= 2;
    r->mask = slots - 1;
    r->table = mem_alloc(slots, sizeof(*r->table));
    r->spots = mem_alloc(((size_t)r->count + 1) * INDIRECT_SPOTS, sizeof(*r->spots));
    if (!r->table || !r->spots)
        return ERR_NOMEM;
    take_spots(r, spots);
    return ERR_OK;
}

void indirect_records_finish(struct indirect_records *r)
{
    mem_free(r->spots);
    mem_free(r->table);
    *r = (struct indirect_records){ .count = 0 };
}
