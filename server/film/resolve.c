#include "resolve.h"

#include "look_place.h"
#include "mem.h"

struct resolver {
    const struct gbuffer *g;
    struct look_key key;       /* of the places */
    struct look_place *places; /* of all escapes; NULL: not found yet, or no memory */
};

/* What escapes read of a frame. */
struct sight {
    const struct environment *e;     /* NULL: nothing */
    const struct look_place *places; /* NULL: none are known */
    struct look_picture picture;
};

static inline void see(const struct sight *s, const struct gbuffer_escape *escape, uint32_t k, float rgb[3])
{
    float seen[3];

    if (s->places && s->places[k].texel != LOOK_NONE)
        look_at(&s->picture, &s->places[k], seen);
    else
        environment_look_wide(s->e, escape->direction, escape->width, seen);
    for (int c = 0; c < 3; c++)
        rgb[c] += escape->weight[c] * seen[c];
}

static inline void resolve_pixel(const struct gbuffer *g, const float *lo, const struct sight *s, size_t pixel,
                                 float rgb[3])
{
    float sum[3] = { 0.0f, 0.0f, 0.0f };

    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *entry = &g->entries[k];
        const float *point = lo + (size_t)(entry->point / PACKET) * 3 * PACKET + entry->point % PACKET;
        for (int c = 0; c < 3; c++)
            sum[c] += entry->weight[c] * point[c * PACKET];
    }
    for (uint32_t k = g->escape_first[pixel]; s->e && k < g->escape_first[pixel + 1]; k++)
        see(s, &g->escapes[k], k, sum);
    for (int c = 0; c < 3; c++)
        rgb[c] = sum[c];
}

static void resolve(const struct gbuffer *g, const float *lo, const struct sight *s, float *rgb)
{
#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t y = 0; y < g->height; y++)
        for (uint32_t x = 0; x < g->width; x++) {
            const size_t pixel = (size_t)y * g->width + x;
            resolve_pixel(g, lo, s, pixel, rgb + 3 * pixel);
        }
}

void resolve_pixels(const struct gbuffer *g, const float *lo, const struct environment *e, float *rgb)
{
    const struct sight s = { .e = e };

    resolve(g, lo, &s, rgb);
}

struct resolver *resolver_create(const struct gbuffer *g)
{
    struct resolver *r = mem_alloc(1, sizeof(*r));

    if (r)
        r->g = g;
    return r;
}

void resolver_destroy(struct resolver *r)
{
    if (!r)
        return;
    mem_free(r->places);
    mem_free(r);
}

static void find_places(struct resolver *r, const struct environment *e)
{
    const uint32_t count = r->g->escape_first[(size_t)r->g->width * r->g->height];
    const struct look_key key = look_key_of(e);

    if (count == 0 || (r->places && look_key_equal(&key, &r->key)))
        return;
    if (!r->places)
        r->places = mem_alloc_raw(count, sizeof(*r->places));
    if (!r->places)
        return;
    r->key = key;
#pragma omp parallel for schedule(dynamic, 256)
    for (uint32_t k = 0; k < count; k++)
        r->places[k] = look_place_find(e, r->g->escapes[k].direction, r->g->escapes[k].width);
}

void resolver_pixels(struct resolver *r, const float *lo, const struct environment *e, float *rgb)
{
    struct sight s = { .e = e };

    if (e) {
        find_places(r, e);
        s.places = r->places;
        s.picture = look_picture_of(e);
    }
    resolve(r->g, lo, &s, rgb);
}

void resolve_mask(const struct gbuffer *g, uint8_t *mask)
{
    for (size_t pixel = 0; pixel < (size_t)g->width * g->height; pixel++)
        mask[pixel] = g->entry_first[pixel + 1] > g->entry_first[pixel];
}
