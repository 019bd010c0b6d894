/* Skies of any size and content, which producers may send: everything ends, and all that comes out is light. */
#include "sky/between/between.h"
#include "sky/between/between_skies.h"

#include "base/rng.h"

#include <math.h>
#include <string.h>

enum { SKIES = 4, ROUNDS = 6 };

/* Black, even, from 1e-6 to 1e6 by chance, or even but for one texel. */
static void fill(struct frame *f, struct rng *r)
{
    const size_t texels = (size_t)f->width * f->height;
    const int kind = (int)(4.0 * rng_next(r));

    for (size_t i = 0; i < 3 * texels; i++)
        f->rgb[i] = kind == 0 ? 0.0f : kind == 2 ? (float)pow(10.0, 12.0 * rng_next(r) - 6.0) : 0.25f;
    if (kind == 3)
        f->rgb[3 * ((size_t)(rng_next(r) * (double)texels)) + (size_t)(3.0 * rng_next(r))] =
            (float)pow(10.0, 12.0 * rng_next(r) - 6.0);
}

static void must_be_light(const struct frame *f)
{
    for (size_t i = 0; i < 3 * (size_t)f->width * f->height; i++)
        if (!(f->rgb[i] >= 0.0f && isfinite(f->rgb[i])))
            fail_msg("%ux%u: value %zu is %g", f->width, f->height, i, (double)f->rgb[i]);
}

static void watch(uint32_t width, uint32_t height, bool corrected, struct rng *r)
{
    const struct between_desc desc = { .mode = BETWEEN_MOTION,
                                       .deflicker = corrected,
                                       .sun = corrected ? BETWEEN_SUN_AUTO : BETWEEN_SUN_KEEP,
                                       .align = corrected ? BETWEEN_ALIGN_SUN : BETWEEN_ALIGN_OFF,
                                       .place = { 48.0, 11.0 } };
    struct between *b;
    static struct frame shown;
    struct reason why;

    assert_int_equal(between_create(&desc, &b), ERR_OK);
    for (int k = 0; k < SKIES; k++) {
        struct frame f = sky_constant(width, height, 0.0f);
        fill(&f, r);
        f.capture_us = INT64_C(1718200800000000) + 15000000 * k; /* a morning in June 2024 */
        assert_int_equal(between_take(b, &f, 15.0 * k, NULL, &why), ERR_OK);
        for (int part = 0; part < 3; part++) {
            assert_int_equal(between_show(b, 15.0 * k - 5.0 * part, &shown), ERR_OK);
            must_be_light(&shown);
        }
        if (!corrected) {
            assert_int_equal(between_show(b, 15.0 * k, &shown), ERR_OK);
            assert_memory_equal(shown.rgb, f.rgb, 3 * (size_t)width * height * sizeof(float));
        }
        frame_finish(&f);
    }
    between_destroy(b);
}

static void skies_of_any_size_and_content_are_taken(void **state)
{
    static const uint32_t heights[] = { 1, 2, 3, 4, 5, 8, 13, 15, 16, 17, 32, 48 };
    struct rng r = { 1 };
    (void)state;

    for (size_t k = 0; k < sizeof(heights) / sizeof(heights[0]); k++)
        for (int round = 0; round < ROUNDS; round++)
            watch(2 * heights[k], heights[k], round == 0 && k % 4 == 0, &r);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(skies_of_any_size_and_content_are_taken),
};
UNIT_MAIN(tests)
