#include "light/resolve/resolve.h"

#include "base/mem.h"
#include "sky/tables/lookup_place.h"

#include <stdbool.h>
#include <string.h>

/* The common kinds of pixels: one shade point, or one escape with a place, of weight 1. Such a pixel equals that light,
 * so nothing else is read for it. All others are MIXED. */
#define PLAIN_SKY 0x80000000u /* then the escape's number, else the point's */
#define MIXED 0xffffffffu

/* The mixed pixels, with contiguous entries, in squares of SQUARE x SQUARE pixels: shade points have that order in the
 * packets, so data that one pixel reads is still cached for its neighbours. */
#define SQUARE 16u
#define AHEAD 24       /* entries whose points are prefetched, */
#define AHEAD_PIXELS 8 /* and pixels */

struct mixed {
    uint32_t pixel : 31; /* at most 2^28 */
    uint32_t misses : 1; /* it has some */
    uint32_t first;      /* its entries, up to those of the next one */
};

struct resolver {
    const struct gbuffer *g;
    struct lookup_key key;       /* of the places */
    struct lookup_place *places; /* of all escapes; NULL: not found yet, or no memory */
    bool wide;                   /* some need the pyramid */
    uint32_t *plain;             /* [pixels]; NULL likewise, and so are the next */
    struct mixed *mixed;         /* [mixed_count + 1] */
    struct gbuffer_entry *entries;
    uint32_t mixed_count;
    bool sky; /* they were made with places */
};

/* What escapes read of a frame. */
struct sight {
    const struct environment *e;       /* NULL: nothing */
    const struct lookup_place *places; /* NULL: none are known */
    struct lookup_image image;
};

static inline void see(const struct sight *s, const struct gbuffer_miss *miss, uint32_t k, float rgb[3])
{
    float seen[3];

    if (s->places && s->places[k].texel != LOOKUP_NONE)
        lookup_at(&s->image, &s->places[k], seen);
    else
        environment_lookup_wide(s->e, miss->direction, miss->width, seen);
    for (int c = 0; c < 3; c++)
        rgb[c] += miss->weight[c] * seen[c];
}

static inline const float *point_at(const float *lo, uint32_t point)
{
    return lo + (size_t)(point / PACKET) * 3 * PACKET + point % PACKET;
}

static inline void add_entry(const float *lo, const struct gbuffer_entry *entry, float sum[3])
{
    const float *point = point_at(lo, entry->point);

    for (int c = 0; c < 3; c++)
        sum[c] += entry->weight[c] * point[c * PACKET];
}

static inline void add_misses(const struct gbuffer *g, const struct sight *s, size_t pixel, float sum[3])
{
    for (uint32_t k = g->miss_first[pixel]; s->e && k < g->miss_first[pixel + 1]; k++)
        see(s, &g->misses[k], k, sum);
}

static inline void resolve_pixel(const struct gbuffer *g, const float *lo, const struct sight *s, size_t pixel,
                                 float rgb[3])
{
    float sum[3] = { 0.0f, 0.0f, 0.0f };

    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++)
        add_entry(lo, &g->entries[k], sum);
    add_misses(g, s, pixel, sum);
    memcpy(rgb, sum, sizeof(sum));
}

void resolve_pixels(const struct gbuffer *g, const float *lo, const struct environment *e, float *rgb)
{
    const struct sight s = { .e = e };

    if (e)
        environment_complete_pyramid(e);
#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t y = 0; y < g->height; y++)
        for (size_t pixel = (size_t)y * g->width; pixel < (size_t)(y + 1) * g->width; pixel++)
            resolve_pixel(g, lo, &s, pixel, rgb + 3 * pixel);
}

struct resolver *resolver_create(const struct gbuffer *g)
{
    struct resolver *r = mem_alloc(1, sizeof(*r));

    if (r)
        r->g = g;
    return r;
}

static void forget(struct resolver *r)
{
    mem_free(r->plain);
    mem_free(r->mixed);
    mem_free(r->entries);
    r->plain = NULL;
    r->mixed = NULL;
    r->entries = NULL;
}

void resolver_destroy(struct resolver *r)
{
    if (!r)
        return;
    mem_free(r->places);
    forget(r);
    mem_free(r);
}

static void find_places(struct resolver *r, const struct environment *e)
{
    const uint32_t count = r->g->miss_first[(size_t)r->g->width * r->g->height];
    const struct lookup_key key = lookup_key_of(e);

    if (r->places && lookup_key_equal(&key, &r->key))
        return;
    if (!r->places)
        r->places = mem_alloc_large(count ? count : 1, sizeof(*r->places));
    if (!r->places)
        return;
    r->key = key;
    r->sky = false;
    bool wide = false;
#pragma omp parallel for schedule(dynamic, 256) reduction(|| : wide)
    for (uint32_t k = 0; k < count; k++) {
        r->places[k] = lookup_place_find(e, r->g->misses[k].direction, r->g->misses[k].width);
        wide = wide || r->places[k].texel & LOOKUP_NONE;
    }
    r->wide = wide;
}

static bool is_one(const float weight[3])
{
    return weight[0] == 1.0f && weight[1] == 1.0f && weight[2] == 1.0f;
}

static uint32_t plain_of(const struct resolver *r, size_t pixel)
{
    const struct gbuffer *g = r->g;
    const uint32_t entry = g->entry_first[pixel], miss = g->miss_first[pixel];
    const uint32_t entries = g->entry_first[pixel + 1] - entry, misses = g->miss_first[pixel + 1] - miss;

    if (entries == 1 && misses == 0 && is_one(g->entries[entry].weight) && g->entries[entry].point < PLAIN_SKY)
        return g->entries[entry].point;
    if (entries == 0 && misses == 1 && is_one(g->misses[miss].weight) && r->places &&
        r->places[miss].texel != LOOKUP_NONE && miss < MIXED - PLAIN_SKY)
        return PLAIN_SKY + miss;
    return MIXED;
}

/* Fills in all mixed pixels, square by square; only counts if r->mixed is NULL. */
static void gather_mixed(struct resolver *r, uint32_t *pixels, uint32_t *entries)
{
    const struct gbuffer *g = r->g;
    const uint32_t across = (g->width + SQUARE - 1) / SQUARE, down = (g->height + SQUARE - 1) / SQUARE;

    *pixels = *entries = 0;
    for (uint32_t k = 0; k < across * down * SQUARE * SQUARE; k++) {
        const uint32_t square = k / (SQUARE * SQUARE), in = k % (SQUARE * SQUARE);
        const uint32_t x = square % across * SQUARE + in % SQUARE, y = square / across * SQUARE + in / SQUARE;
        const size_t pixel = (size_t)y * g->width + x;
        if (x >= g->width || y >= g->height || r->plain[pixel] != MIXED)
            continue;
        const uint32_t first = g->entry_first[pixel], count = g->entry_first[pixel + 1] - first;
        if (r->mixed) {
            const bool misses = g->miss_first[pixel + 1] > g->miss_first[pixel];
            r->mixed[*pixels] = (struct mixed){ (uint32_t)pixel & INT32_MAX, misses, *entries };
            memcpy(r->entries + *entries, g->entries + first, count * sizeof(*r->entries));
        }
        *pixels += 1;
        *entries += count;
    }
}

static void find_plain(struct resolver *r)
{
    const size_t count = (size_t)r->g->width * r->g->height;
    uint32_t pixels, entries;

    if (r->plain && r->sky == (r->places != NULL))
        return;
    forget(r);
    r->plain = mem_alloc_large(count, sizeof(*r->plain));
    if (!r->plain)
        return;
    r->sky = r->places != NULL;
#pragma omp parallel for schedule(static)
    for (size_t pixel = 0; pixel < count; pixel++)
        r->plain[pixel] = plain_of(r, pixel);
    gather_mixed(r, &pixels, &entries);
    r->entries = mem_alloc_large(entries + AHEAD, sizeof(*r->entries));
    r->mixed = r->entries ? mem_alloc_large(pixels + 1, sizeof(*r->mixed)) : NULL;
    if (!r->mixed) {
        forget(r);
        return;
    }
    gather_mixed(r, &r->mixed_count, &entries);
    r->mixed[pixels].first = entries;
    memset(r->entries + entries, 0, AHEAD * sizeof(*r->entries));
}

static void resolve_plain(const struct resolver *r, const float *lo, const struct sight *s, uint32_t y, float *rgb)
{
    const size_t width = r->g->width;

    for (size_t pixel = y * width; pixel < (y + 1) * width; pixel++) {
        const uint32_t what = r->plain[pixel];
        float *to = rgb + 3 * pixel;
        if (what < PLAIN_SKY) {
            const float *point = point_at(lo, what);
            for (int c = 0; c < 3; c++)
                to[c] = point[c * PACKET];
        } else if (what != MIXED && s->e) {
            lookup_at(&s->image, &s->places[what - PLAIN_SKY], to);
        } else if (what != MIXED) {
            to[0] = to[1] = to[2] = 0.0f;
        }
    }
}

static void resolve_mixed(const struct resolver *r, const float *lo, const struct sight *s, uint32_t k, float *rgb)
{
    const struct mixed *m = &r->mixed[k];
    float sum[3] = { 0.0f, 0.0f, 0.0f };

    if (k + AHEAD_PIXELS < r->mixed_count)
        __builtin_prefetch(rgb + 3 * (size_t)m[AHEAD_PIXELS].pixel, 1);
    for (uint32_t i = m[0].first; i < m[1].first; i++) {
        const float *next = point_at(lo, r->entries[i + AHEAD].point);
        for (int c = 0; c < 3; c++)
            __builtin_prefetch(next + c * PACKET);
        add_entry(lo, &r->entries[i], sum);
    }
    if (m->misses)
        add_misses(r->g, s, m->pixel, sum);
    memcpy(rgb + 3 * (size_t)m->pixel, sum, sizeof(sum));
}

void resolver_pixels(struct resolver *r, const float *lo, const struct environment *e, float *rgb)
{
    struct sight s = { .e = e };

    if (e) {
        find_places(r, e);
        if (!r->places || r->wide)
            environment_complete_pyramid(e);
        s.places = r->places;
        s.image = lookup_image_of(e);
    }
    find_plain(r);
    if (!r->plain) {
        resolve_pixels(r->g, lo, e, rgb);
        return;
    }
#pragma omp parallel
    {
#pragma omp for schedule(dynamic, 4) nowait
        for (uint32_t y = 0; y < r->g->height; y++)
            resolve_plain(r, lo, &s, y, rgb);
#pragma omp for schedule(dynamic, 1024)
        for (uint32_t k = 0; k < r->mixed_count; k++)
            resolve_mixed(r, lo, &s, k, rgb);
    }
}

void resolve_mask(const struct gbuffer *g, uint8_t *mask)
{
    for (size_t pixel = 0; pixel < (size_t)g->width * g->height; pixel++)
        mask[pixel] = g->entry_first[pixel + 1] > g->entry_first[pixel];
}
