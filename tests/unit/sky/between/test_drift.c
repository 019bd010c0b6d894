/* Clouds that drift by known winds: the motion is found, and skies between are nearer to the truth than fading is. */
#include "sky/between/between_skies.h"
#include "sky/between/drift.h"

enum { W = 512, H = 256 };

/* Mean squared relative difference of luminance above 10 degrees. */
static double differs(const float *a, const float *b)
{
    double sum = 0.0, count = 0.0;

    for (uint32_t y = 0; y < H * 4 / 9; y++)
        for (uint32_t x = 0; x < W; x++) {
            const size_t t = 3 * ((size_t)y * W + x) + 1;
            const double d = (double)(a[t] - b[t]) / (double)b[t], weight = sin(PI * (y + 0.5) / H);
            sum += weight * d * d;
            count += weight;
        }
    return sum / count;
}

static void the_wind_is_found_and_followed(void **state)
{
    static const double winds[][2] = { { 0.1, 0.0 }, { 0.2, -0.1 }, { -0.3, 0.2 }, { 0.0, 0.4 } };
    float *out = mem_alloc(3 * W * H, sizeof(*out));
    struct drift d = { .moves = false };
    (void)state;

    for (size_t k = 0; k < sizeof(winds) / sizeof(winds[0]); k++) {
        struct frame first = cloudy(W, H, 0.0, 0.0), second = cloudy(W, H, winds[k][0], winds[k][1]);
        double moved = 0.0, faded = 0.0;
        assert_int_equal(drift_find(&d, first.rgb, second.rgb, W, H), ERR_OK);
        assert_true(d.moves && hypot(d.wind[0] - winds[k][0], d.wind[1] - winds[k][1]) < 0.11);
        for (int i = 1; i < 4; i++) {
            const double t = 0.25 * i;
            struct frame truth = cloudy(W, H, t * winds[k][0], t * winds[k][1]);
            drift_blend(&d, first.rgb, second.rgb, W, H, t, out);
            moved += differs(out, truth.rgb);
            drift_blend(NULL, first.rgb, second.rgb, W, H, t, out);
            faded += differs(out, truth.rgb);
            frame_finish(&truth);
        }
        printf("wind %.1f %.1f: left %.2f; between, %.2g of what fading differs by\n", winds[k][0], winds[k][1], d.gain,
               moved / faded);
        assert_true(moved < (hypot(winds[k][0], winds[k][1]) < 0.15 ? 0.3 : 0.06) * faded);
        frame_finish(&first);
        frame_finish(&second);
    }
    drift_finish(&d);
    mem_free(out);
}

/* Clouds of another form. */
static struct frame unlike(void)
{
    static const double by[2] = { 3.0, 5.0 };
    struct frame f = sky_constant(W, H, 0.0f);

    for (uint32_t y = 0; y < H; y++)
        for (uint32_t x = 0; x < W; x++) {
            double w[3];
            texel_direction(W, H, x + 0.5, y + 0.5, w);
            const double turned[3] = { 1.9 * w[2] + 0.7 * w[0] * w[2], w[1], 0.4 * w[0] };
            const float g = cloud(turned, by);
            sky_paint(&f, x, y, g, g, g);
        }
    return f;
}

/* Bright ground and horizon do not drag along what stands still. */
static void what_stands_still_or_changes_at_random_fades(void **state)
{
    struct frame still = cloudy(W, H, 0.0, 0.0), brighter = cloudy(W, H, 0.0, 0.0), other = unlike();
    struct drift d = { .moves = true };
    (void)state;

    for (size_t t = 0; t < 3 * (size_t)W * H; t++)
        brighter.rgb[t] *= 1.3f;
    assert_int_equal(drift_find(&d, still.rgb, still.rgb, W, H), ERR_OK);
    assert_false(d.moves);
    assert_int_equal(drift_find(&d, still.rgb, brighter.rgb, W, H), ERR_OK);
    assert_false(d.moves);
    assert_int_equal(drift_find(&d, still.rgb, other.rgb, W, H), ERR_OK);
    printf("unlike clouds: left %.2f\n", d.gain);
    assert_false(d.moves);
    frame_finish(&still);
    frame_finish(&brighter);
    frame_finish(&other);
    drift_finish(&d);
}

static void ends_are_the_skies_themselves(void **state)
{
    struct frame first = cloudy(W, H, 0.0, 0.0), second = cloudy(W, H, 0.2, 0.1);
    float *out = mem_alloc(3 * W * H, sizeof(*out));
    struct drift d = { .moves = false };
    (void)state;

    drift_blend(NULL, first.rgb, second.rgb, W, H, 0.0, out);
    assert_memory_equal(out, first.rgb, 3 * W * H * sizeof(*out));
    drift_blend(NULL, first.rgb, second.rgb, W, H, 1.0, out);
    assert_memory_equal(out, second.rgb, 3 * W * H * sizeof(*out));
    assert_int_equal(drift_find(&d, first.rgb, second.rgb, W, H), ERR_OK);
    drift_blend(&d, first.rgb, second.rgb, W, H, 0.0, out);
    assert_true(differs(out, first.rgb) < 1e-6);
    drift_blend(&d, first.rgb, second.rgb, W, H, 1.0, out);
    assert_true(differs(out, second.rgb) < 1e-6);
    mem_free(out);
    frame_finish(&first);
    frame_finish(&second);
    drift_finish(&d);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_wind_is_found_and_followed),
    cmocka_unit_test(what_stands_still_or_changes_at_random_fades),
    cmocka_unit_test(ends_are_the_skies_themselves),
};

UNIT_MAIN(tests)
