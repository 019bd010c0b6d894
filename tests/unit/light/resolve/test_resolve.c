/* Where escapes look a sky up is found once: the images must have the bits of looking anew. */
#include "support/skies.h"

#include "light/resolve/resolve.h"
#include "scene/geometry/gbuffer.h"
#include "sky/tables/layout.h"
#include "sky/tables/lookup_place.h"

enum { WIDTH = 32, HEIGHT = 24, PIXELS = WIDTH * HEIGHT };

struct shape {
    enum layout layout;
    uint32_t width, height;
};

static const struct shape shapes[] = {
    { LAYOUT_LATLONG, 64, 32 }, { LAYOUT_LATLONG_BOTTOM_FIRST, 62, 31 },
    { LAYOUT_CUBE, 16, 96 },    { LAYOUT_HCROSS, 64, 48 },
    { LAYOUT_VCROSS, 48, 64 },  { LAYOUT_BALL, 48, 40 },
    { LAYOUT_FISHEYE, 40, 48 }, { LAYOUT_LATLONG, 64, 33 },
    { LAYOUT_LATLONG, 1, 1 },
};
enum { SHAPES = sizeof(shapes) / sizeof(shapes[0]) };

static double number(uint64_t seed, uint64_t k)
{
    return rng_unit(rng_mix(seed, k));
}

static struct environment *make_sky(const struct shape *shape, double rotation, uint64_t seed)
{
    struct frame f = sky_constant(shape->width, shape->height, 0.0f);

    for (uint32_t t = 0; t < shape->width * shape->height; t++)
        sky_paint(&f, t % shape->width, t / shape->width, (float)number(seed, 3 * t), (float)number(seed, 3 * t + 1),
                  (float)number(seed, 3 * t + 2));
    return sky_environment_of(f, shape->layout, 8, rotation);
}

/* All over the sphere, the first ones along axes and diagonals: poles, seams, edges and corners of cubes. */
static struct vec3 direction(uint32_t k)
{
    if (k < 27 && k != 13)
        return vec3_normalize(vec3_make((float)(k % 3) - 1.0f, (float)(k / 3 % 3) - 1.0f, (float)(k / 9) - 1.0f));
    const double z = 2.0 * number(7, 2 * k) - 1.0, phi = 2.0 * PI * number(7, 2 * k + 1);
    return vec3_make((float)(sqrt(1.0 - z * z) * cos(phi)), (float)(sqrt(1.0 - z * z) * sin(phi)), (float)z);
}

static void a_place_shows_the_bits_that_looking_does(void **state)
{
    (void)state;
    for (int s = 0; s < SHAPES; s++)
        for (int turn = 0; turn < 3; turn++) {
            struct environment *e = make_sky(&shapes[s], 40.0 * turn, 1);
            const struct lookup_image image = lookup_image_of(e);
            uint32_t found = 0, wide = 0;
            environment_complete_pyramid(e);
            for (uint32_t k = 0; k < 8000; k++) {
                const struct vec3 w = direction(k % 4000);
                const float width = k < 4000 ? 1e-3f : 0.1f + 4e-4f * (float)(k % 4000 * 1543 % 8000);
                float want[3], got[3];
                const struct lookup_place p = lookup_place_find(e, w, width);
                if (p.texel == LOOKUP_NONE)
                    continue;
                environment_lookup_wide(e, w, width, want);
                lookup_at(&image, &p, got);
                assert_memory_equal(got, want, sizeof(want));
                found += k < 4000;
                wide += k >= 4000;
            }
            /* all but the rims; a fisheye sees half of the sphere */
            assert_true(found >= (layout_is_disc(shapes[s].layout) ? 1600 : 4000));
            assert_true(wide >= 3000);
            environment_destroy(e);
        }
}

static void between_source_and_pyramid_there_is_no_place(void **state)
{
    struct environment *e = make_sky(&shapes[0], 0.0, 1);
    const float texel = (float)PI * sqrtf(2.0f / (float)(shapes[0].width * shapes[0].height)),
                width = sqrtf(3.0f) * texel;

    (void)state;
    assert_false(lookup_place_find(e, direction(100), 0.99f * width).texel & LOOKUP_NONE);
    assert_int_equal(lookup_place_find(e, direction(100), 1.01f * width).texel, LOOKUP_NONE);
    assert_int_equal(lookup_place_find(e, direction(100), 1.0f).texel & LOOKUP_WIDE, LOOKUP_WIDE);
    environment_destroy(e);
}

/* Pixels with none, one and two escapes, every seventh of which is wide; one packet of shade points. */
static void make_gbuffer(struct gbuffer *g, uint32_t *first, struct gbuffer_miss *misses, uint32_t *entry_first,
                         struct gbuffer_entry *entries)
{
    *g = (struct gbuffer){ .width = WIDTH,
                           .height = HEIGHT,
                           .packet_count = 1,
                           .entry_first = entry_first,
                           .entries = entries,
                           .miss_first = first,
                           .misses = misses };
    for (uint32_t i = 0; i < PIXELS; i++) {
        first[i + 1] = first[i] + i % 3;
        for (uint32_t k = first[i]; k < first[i + 1]; k++)
            misses[k] = (struct gbuffer_miss){ direction(k), { 0.25f, 0.5f, 0.75f }, k % 7 ? 0.01f : 0.3f };
        entry_first[i + 1] = entry_first[i] + 1;
        entries[i] = (struct gbuffer_entry){ i % PACKET, { 0.5f, 0.6f, 0.7f } };
    }
}

static void a_resolver_keeps_the_bits_whatever_sky_comes(void **state)
{
    static uint32_t first[PIXELS + 1], entry_first[PIXELS + 1];
    static struct gbuffer_miss misses[2 * PIXELS];
    static struct gbuffer_entry entries[PIXELS];
    static float want[3 * PIXELS], got[3 * PIXELS];
    float lo[3 * PACKET];
    struct gbuffer g;
    (void)state;

    make_gbuffer(&g, first, misses, entry_first, entries);
    for (uint32_t k = 0; k < 3 * PACKET; k++)
        lo[k] = (float)k;
    struct resolver *r = resolver_create(&g);
    assert_non_null(r);
    for (uint64_t k = 0; k < 40; k++) { /* each twice, of which the second has other texels; then it is turned */
        struct environment *e = make_sky(&shapes[k / 4 % SHAPES], k / 2 % 2 ? 30.0 : 0.0, k);
        e->gain = 1.0f + (float)k;
        resolve_pixels(&g, lo, e, want);
        resolver_pixels(r, lo, e, got);
        assert_memory_equal(got, want, sizeof(want));
        environment_destroy(e);
    }
    resolve_pixels(&g, lo, NULL, want);
    resolver_pixels(r, lo, NULL, got);
    assert_memory_equal(got, want, sizeof(want));
    resolver_destroy(r);
    resolver_destroy(NULL);
}

static void the_mask_has_the_pixels_with_points(void **state)
{
    uint32_t first[7] = { 0, 1, 1, 2, 2, 2, 4 };
    const struct gbuffer g = { .width = 3, .height = 2, .entry_first = first };
    const uint8_t want[6] = { 1, 0, 1, 0, 0, 1 };
    uint8_t mask[6];
    (void)state;

    memset(mask, 7, sizeof(mask));
    resolve_mask(&g, mask);
    assert_memory_equal(mask, want, sizeof(want));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_place_shows_the_bits_that_looking_does),
    cmocka_unit_test(between_source_and_pyramid_there_is_no_place),
    cmocka_unit_test(a_resolver_keeps_the_bits_whatever_sky_comes),
    cmocka_unit_test(the_mask_has_the_pixels_with_points),
};

UNIT_MAIN(tests)
