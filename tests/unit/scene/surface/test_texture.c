/* Textures: bytes to linear light, the pyramid's means, and filtered lookups held to closed forms. */
#include "support/unit.h"

#include "base/rng.h"
#include "scene/geometry/scene_build.h"

#include <math.h>

/* A byte of sRGB near 0.5 differs from the next by 0.006; rounding loses half of it. */
#define HALF_STEP 0.0031f

static struct texture make(uint32_t width, uint32_t height, enum texture_values values)
{
    struct texture t;

    assert_int_equal(texture_init(&t, width, height, values), ERR_OK);
    memset(t.texels, 255, 4 * (size_t)width * height);
    return t;
}

static void set_grey(struct texture *t, uint32_t x, uint32_t y, uint8_t value)
{
    memset(t->texels + 4 * ((size_t)y * t->width + x), value, 3);
}

static const uint8_t *last_level(const struct texture *t)
{
    return t->texels + 4 * (texture_texel_count(t->width, t->height) - 1);
}

static struct texture checkerboard(uint32_t side)
{
    struct texture t = make(side, side, TEXTURE_SRGB);

    for (uint32_t i = 0; i < side * side; i++)
        set_grey(&t, i % side, i / side, (i % side + i / side) % 2 ? 255 : 0);
    texture_build_levels(&t);
    return t;
}

static void every_byte_is_decoded_by_the_srgb_curve(void **state)
{
    struct texture t = make(256, 1, TEXTURE_SRGB);

    (void)state;
    for (uint32_t i = 0; i < 256; i++)
        set_grey(&t, i, 0, (uint8_t)i);
    for (uint32_t i = 0; i < 256; i++) {
        const double v = i / 255.0, want = v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
        assert_float_equal(texture_lookup(&t, ((float)i + 0.5f) / 256.0f, 0.5f).y, want, 1e-7);
    }
    texture_finish(&t);
}

static void a_checkerboard_far_away_is_its_mean_in_linear_light(void **state)
{
    struct texture t = checkerboard(256);
    struct rng r = { 1 };

    (void)state;
    for (float width = 4.0f; width <= 4096.0f; width *= 1.7f) {
        const float step[2][2] = { { width / 256.0f, 0.0f }, { 0.0f, width / 256.0f } };
        for (int i = 0; i < 50; i++) {
            const float u = (float)rng_next(&r), v = (float)rng_next(&r);
            assert_float_equal(texture_filter(&t, u, v, step).x, 0.5f, HALF_STEP);
        }
    }
    texture_finish(&t);
}

/* The filter is symmetric, so that a ramp is its own mean: at any size and shape of the footprint that stays off the
 * edges. Numbers, since sRGB would bend it. */
static void a_ramp_is_its_own_mean_under_any_footprint(void **state)
{
    struct texture t = make(256, 256, TEXTURE_LINEAR);
    struct rng r = { 2 };

    (void)state;
    for (uint32_t i = 0; i < 256 * 256; i++)
        set_grey(&t, i % 256, i / 256, (uint8_t)(i % 256));
    texture_build_levels(&t);
    for (int i = 0; i < 2000; i++) {
        const float u = 0.3f + 0.4f * (float)rng_next(&r), v = 0.3f + 0.4f * (float)rng_next(&r);
        float step[2][2];
        for (int k = 0; k < 4; k++)
            step[k / 2][k % 2] = 0.15f * (float)(rng_next(&r) - 0.5);
        assert_float_equal(texture_filter(&t, u, v, step).x, (256.0f * u - 0.5f) / 255.0f, 1.01f / 255.0f);
    }
    texture_finish(&t);
}

/* The variance of the filter, seen by the parabola 4 x^2, is on average that of the pixel: over a square of that width
 * the mean of x^2 is width^2 / 12 above its middle's. Rounding each level costs up to 0.6 of a byte here. */
static void a_footprint_is_as_wide_as_the_pixel(void **state)
{
    struct texture t = make(256, 256, TEXTURE_LINEAR);
    struct rng r = { 5 };

    (void)state;
    for (uint32_t i = 0; i < 256 * 256; i++) {
        const double x = (i % 256 + 0.5) / 256.0 - 0.5;
        set_grey(&t, i % 256, i / 256, (uint8_t)lround(255.0 * 4.0 * x * x));
    }
    texture_build_levels(&t);
    for (double width = 0.2; width < 0.3; width *= 1.05) {
        const float step[2][2] = { { (float)width, 0.0f }, { 0.0f, (float)width } };
        double excess = 0.0;
        for (int i = 0; i < 4000; i++) {
            const double x = 0.2 * rng_next(&r) - 0.1, y = rng_next(&r);
            excess += ((double)texture_filter(&t, (float)x + 0.5f, (float)y, step).x - 4.0 * x * x) / 4000.0;
        }
        assert_float_equal(excess, 4.0 * width * width / 12.0, 0.03 * 4.0 * width * width / 12.0 + 0.6 / 255.0);
    }
    texture_finish(&t);
}

/* Rows alternate; the footprint is 60 texels long and one high: a round filter would be grey. */
static void a_grazing_footprint_keeps_what_varies_across_it(void **state)
{
    const float step[2][2] = { { 60.0f / 256.0f, 0.0f }, { 0.0f, 1.0f / 256.0f } };
    struct texture t = make(256, 256, TEXTURE_SRGB);

    (void)state;
    for (uint32_t i = 0; i < 256 * 256; i++)
        set_grey(&t, i % 256, i / 256, i / 256 % 32 < 16 ? 0 : 255);
    texture_build_levels(&t);
    assert_float_equal(texture_filter(&t, 0.3f, 1.0f - 8.0f / 256.0f, step).x, 0.0f, 1e-6f);
    assert_float_equal(texture_filter(&t, 0.3f, 1.0f - 24.0f / 256.0f, step).x, 1.0f, 1e-6f);
    texture_finish(&t);
}

static void a_close_surface_is_looked_up_as_if_unfiltered(void **state)
{
    const float step[2][2] = { { 0.9f / 64.0f, 0.0f }, { 0.0f, 0.2f / 64.0f } };
    struct texture t = checkerboard(64);
    struct rng r = { 3 };

    (void)state;
    for (int i = 0; i < 500; i++) {
        const float u = (float)(3.0 * rng_next(&r) - 1.0), v = (float)(3.0 * rng_next(&r) - 1.0);
        const struct vec3 a = texture_filter(&t, u, v, step), b = texture_lookup(&t, u, v);
        assert_memory_equal(&a, &b, sizeof(a));
    }
    texture_finish(&t);
}

static void levels_of_any_side_keep_the_mean(void **state)
{
    struct rng r = { 4 };

    (void)state;
    for (uint32_t n = 0; n < 200; n++) {
        struct texture t = make(1 + (uint32_t)(40 * rng_next(&r)), 1 + (uint32_t)(40 * rng_next(&r)), TEXTURE_LINEAR);
        const uint32_t count = t.width * t.height;
        double sum = 0.0;
        for (uint32_t i = 0; i < count; i++) {
            const uint8_t value = (uint8_t)(256.0 * rng_next(&r));
            set_grey(&t, i % t.width, i / t.width, value);
            sum += value;
        }
        texture_build_levels(&t);
        /* each of at most five levels rounds to half a step, which partly cancels */
        assert_float_equal(last_level(&t)[0], sum / count, 1.5);
        assert_int_equal(last_level(&t)[3], 255);
        texture_finish(&t);
    }
}

/* Leaves on a background of another colour: from afar the leaves keep their colour, and half is covered. */
static void a_cutout_keeps_the_colour_of_what_is_there(void **state)
{
    (void)state;
    for (int role = 0; role < 2; role++) {
        struct texture t = make(32, 32, role ? TEXTURE_CUTOUT : TEXTURE_SRGB);
        for (uint32_t i = 0; i < 32 * 32; i++)
            memcpy(t.texels + 4 * (size_t)i, (i % 32 + i / 32) % 2 ? "\0\xff\0\xff" : "\xff\0\xff\0", 4);
        texture_build_levels(&t);
        const uint8_t *mean = last_level(&t);
        assert_int_equal(mean[0], role ? 0 : 188);
        assert_int_equal(mean[1], role ? 255 : 188);
        assert_int_equal(mean[3], 128);
        assert_float_equal(texture_alpha(&t, 0.5f / 32.0f, 0.5f / 32.0f), 1.0f, 1e-6f); /* row 31, column 0: odd */
        assert_float_equal(texture_alpha(&t, 1.0f / 32.0f, 0.5f / 32.0f), 0.5f, 1e-6f);
        texture_finish(&t);
    }
}

static void images_repeat_clamp_or_mirror(void **state)
{
    static const struct {
        enum texture_wrap wrap;
        float u, want; /* texels are 0, 1 and 2 */
    } cases[] = {
        { TEXTURE_REPEAT, 3.5f, 0.0f }, { TEXTURE_REPEAT, -0.5f, 2.0f }, { TEXTURE_REPEAT, 3.0f, 1.0f },
        { TEXTURE_CLAMP, 3.5f, 2.0f },  { TEXTURE_CLAMP, -8.0f, 0.0f },  { TEXTURE_CLAMP, 0.1f, 0.0f },
        { TEXTURE_MIRROR, 3.5f, 2.0f }, { TEXTURE_MIRROR, 4.5f, 1.0f },  { TEXTURE_MIRROR, -0.5f, 0.0f },
        { TEXTURE_MIRROR, 6.5f, 0.0f }, { TEXTURE_MIRROR, -2.0f, 1.5f }, { TEXTURE_MIRROR, 3.0f, 2.0f },
    };
    struct texture t = make(3, 1, TEXTURE_LINEAR);

    (void)state;
    for (uint32_t i = 0; i < 3; i++)
        set_grey(&t, i, 0, (uint8_t)i);
    texture_build_levels(&t);
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        t.wrap_u = cases[i].wrap;
        assert_float_equal(255.0f * texture_lookup(&t, cases[i].u / 3.0f, 0.3f).x, cases[i].want, 1e-4f);
    }
    texture_finish(&t);
}

static void any_number_is_a_place(void **state)
{
    const float odd[] = { NAN, INFINITY, -INFINITY, 1e30f, -1e30f, 1e-40f };
    struct texture t = checkerboard(7);

    (void)state;
    for (size_t i = 0; i < 6 * 6 * 3 * 6; i++) {
        t.wrap_u = t.wrap_v = (enum texture_wrap)(i / 36 % 3);
        const float step[2][2] = { { odd[i / 108], odd[i % 6] }, { 0.1f, odd[i / 6 % 6] } };
        const struct vec3 c = texture_filter(&t, odd[i % 6], odd[i / 6 % 6], step);
        assert_true(c.x >= 0.0f && c.x <= 1.0001f);
    }
    texture_finish(&t);
}

static uint64_t bytes_of(const struct scene *s)
{
    uint64_t sum = 0;

    for (size_t i = 0; i < s->texture_count; i++)
        sum += 4 * texture_texel_count(s->textures[i].width, s->textures[i].height);
    return sum;
}

/* Beyond the limit the largest textures become what their second level was; small ones stay. */
static void textures_lose_levels_beyond_a_limit(void **state)
{
    static const uint32_t sides[] = { 256, 1024, 512, 1024 };
    struct texture all[4], half = checkerboard(512);
    struct scene *s = scene_create();

    (void)state;
    s->texture_bytes = 9000000; /* all four: 12.9 MB */
    for (int i = 0; i < 4; i++) {
        all[i] = checkerboard(sides[i]);
        assert_int_equal(scene_add_texture(s, &all[i], NULL), ERR_OK);
        assert_true(bytes_of(s) <= s->texture_bytes);
    }
    for (size_t i = 0; i < 512 * 512; i++) /* what a checkerboard becomes */
        memset(half.texels + 4 * i, 188, 3);
    texture_build_levels(&half);
    assert_true(s->textures[0].width == 256 && s->textures[2].width == 512 && s->textures[3].width == 1024);
    assert_true(s->textures[1].width == 512 && s->textures[1].height == 512 && s->textures[1].left_out == 1);
    assert_memory_equal(s->textures[1].texels, half.texels, 4 * texture_texel_count(512, 512));
    s->texture_bytes = 1;
    struct texture one = checkerboard(2);
    assert_int_equal(scene_add_texture(s, &one, NULL), ERR_OK);
    for (size_t i = 0; i < 4; i++)
        assert_int_equal(s->textures[i].width, TEXTURE_SIDE_KEPT);
    assert_int_equal(s->textures[4].width, 2);
    texture_finish(&half);
    scene_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_byte_is_decoded_by_the_srgb_curve),
    cmocka_unit_test(a_checkerboard_far_away_is_its_mean_in_linear_light),
    cmocka_unit_test(a_ramp_is_its_own_mean_under_any_footprint),
    cmocka_unit_test(a_footprint_is_as_wide_as_the_pixel),
    cmocka_unit_test(a_grazing_footprint_keeps_what_varies_across_it),
    cmocka_unit_test(a_close_surface_is_looked_up_as_if_unfiltered),
    cmocka_unit_test(levels_of_any_side_keep_the_mean),
    cmocka_unit_test(a_cutout_keeps_the_colour_of_what_is_there),
    cmocka_unit_test(images_repeat_clamp_or_mirror),
    cmocka_unit_test(any_number_is_a_place),
    cmocka_unit_test(textures_lose_levels_beyond_a_limit),
};

UNIT_MAIN(tests)
