/* Each CPU level's tone kernel against the scalar reference, bit for bit, and the reference against the exact formula
 * at every input that it tells apart. The seed is printed and may be given as RELIGHT_TEST_SEED. */
#include "image/film/tone_kernel.h"
#include "light/estimators/levels.h"

#include "base/luminance.h"
#include "base/rng.h"
#include "support/unit.h"

#include <float.h>
#include <math.h>

#define GUARD 16
#define N_MAX 131 /* 8 vectors of 16, and 3 */

static const enum tone_curve curves[] = { TONE_FILMIC, TONE_LINEAR };

static uint64_t first_seed(void)
{
    const char *text = getenv("RELIGHT_TEST_SEED");
    const uint64_t seed = text ? strtoull(text, NULL, 0) : 1;
    print_message("seed %llu\n", (unsigned long long)seed);
    return seed;
}

static float float_of(uint32_t bits)
{
    float f;
    memcpy(&f, &bits, sizeof(f));
    return f;
}

/* Mostly light in the curve's range, else what hurts: any bits at all, zeros, denormals, both infinities, NaN of both
 * signs, and the neighbours of the range's ends and of octaves. */
static float hurtful(struct rng *r)
{
    static const float odd[] = {
        0.0f, -0.0f,       0x1p-149f,    -0x1p-149f, FLT_MIN, FLT_MAX,  -FLT_MAX,        INFINITY,        -INFINITY,
        NAN,  -NAN,        -1.0f,        0x1p-13f,   0x1p3f,  0x1p-12f, 0x1.fffffep-14f, 0x1.000002p-13f, 0x1.8p-3f,
        1.0f, TONE_LOWEST, TONE_HIGHEST,
    };
    const double kind = rng_next(r);

    if (kind < 0.2)
        return odd[(size_t)(rng_next(r) * (sizeof(odd) / sizeof(odd[0])))];
    if (kind < 0.4)
        return float_of((uint32_t)(rng_next(r) * 0x1p32));
    return (float)exp2(18.0 * rng_next(r) - 14.0);
}

static void every_level_gives_the_bits_of_the_reference(void **state)
{
    static const float gains[] = { 1.0f, 0.37f, 0x1p-126f, 0x1p127f };
    const struct tone_kernel *const *all = tone_kernels_all();
    const uint64_t seed = first_seed();
    (void)state;

    for (size_t k = 1; all[k]; k++)
        for (uint64_t s = seed; s < seed + 200; s++) {
            struct rng r = { s };
            struct tone_table t;
            float in[N_MAX];
            uint8_t want[N_MAX + GUARD], got[N_MAX + GUARD];
            const float gain = gains[s % 4];
            tone_table_fill(&t, curves[s / 4 % 2]);
            for (size_t i = 0; i < N_MAX; i++)
                in[i] = hurtful(&r);
            for (size_t n = 0; n <= N_MAX; n++) { /* every tail, every start within a vector, and nothing at all */
                const size_t from = N_MAX - n < 15 ? N_MAX - n : n % 15;
                memset(want, 0x55, sizeof(want));
                memset(got, 0x55, sizeof(got));
                tone_kernels_all()[0]->codes(&t, in + from, n, gain, want);
                all[k]->codes(&t, in + from, n, gain, got);
                if (memcmp(want, got, sizeof(want)) != 0)
                    print_message("level %s, seed %llu, %zu values\n", cpu_names[all[k]->cpu], (unsigned long long)s,
                                  n);
                assert_memory_equal(want, got, sizeof(want)); /* the guard behind them, too */
            }
        }
}

/* The input's last 8 bits are dropped, so that these are all there are: a curve can be tested whole. */
static void no_level_falls_and_all_are_within_one_code_everywhere(void **state)
{
    enum { PLACES = 1 << 14 };
    static float in[PLACES];
    static uint8_t out[PLACES];
    const struct tone_kernel *const *all = tone_kernels_all();
    (void)state;

    for (size_t k = 0; all[k]; k++)
        for (size_t c = 0; c < 2; c++) {
            struct tone_table t;
            uint32_t bits = (uint32_t)(127 - 13) << 23;
            uint64_t differ = 0;
            int last = 0;
            tone_table_fill(&t, curves[c]);
            for (int s = 0; s < TONE_SEGMENTS; s++) {
                for (int i = 0; i < PLACES; i++, bits += 256)
                    in[i] = float_of(bits + 128);
                all[k]->codes(&t, in, PLACES, 1.0f, out);
                for (int i = 0; i < PLACES; i++) {
                    const double x = (double)in[i] / TONE_SCALE;
                    const int want = (int)floor(255.0 * srgb_encode(tone_value(curves[c], x)) + 0.5);
                    assert_true(out[i] >= last && out[i] <= last + 1);
                    assert_true(abs(out[i] - want) <= 1);
                    differ += out[i] != want;
                    last = out[i];
                }
            }
            assert_int_equal(last, 255);
            print_message("%s, %s: %llu of %d inputs differ from the exact formula\n", cpu_names[all[k]->cpu],
                          choice_name(tone_choices, (int)curves[c]), (unsigned long long)differ,
                          TONE_SEGMENTS * PLACES);
            assert_true(differ * 500 < (uint64_t)TONE_SEGMENTS * PLACES);
        }
}

static void the_last_bits_change_nothing(void **state)
{
    struct rng r = { 5 };
    struct tone_table t;
    (void)state;

    tone_table_fill(&t, TONE_FILMIC);
    for (int i = 0; i < 200000; i++) {
        const uint32_t bits = ((uint32_t)(127 - 13) << 23) + (uint32_t)(rng_next(&r) * (16 << 23));
        const float in[2] = { float_of(bits & ~255u), float_of(bits | 255u) };
        uint8_t out[2];
        tone_kernels_all()[0]->codes(&t, in, 2, 1.0f, out);
        assert_int_equal(out[0], out[1]);
    }
}

/* The cubic of a half octave is that of four of its points: at u = -1/4, -1/8, 1/8 and 1/4 it is the curve's code, plus
 * the half for rounding. */
static void a_cubic_meets_the_curve_in_four_points(void **state)
{
    static const double places[4] = { -0.25, -0.125, 0.125, 0.25 };
    struct tone_table t;
    (void)state;

    tone_table_fill(&t, TONE_LINEAR);
    for (uint32_t k = 0; k < TONE_SEGMENTS; k++)
        for (int i = 0; i < 4; i++) {
            const double u = places[i], octave = ldexp(1.0, -13 + (int)(k / 2));
            const double x = octave * ((k % 2 ? 1.75 : 1.25) + u), want = 255.0 * srgb_encode(x / TONE_SCALE) + 0.5;
            const float lowest = (float)(octave * (k % 2 ? 1.5 : 1.0));
            uint32_t bits;
            memcpy(&bits, &lowest, sizeof(bits));
            const uint32_t s = bits >> 22 & (TONE_SEGMENTS - 1);
            const double got =
                (((double)t.c[3][s] * u + (double)t.c[2][s]) * u + (double)t.c[1][s]) * u + (double)t.c[0][s];
            assert_true(fabs(got - want) < 2e-6 * want);
        }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_cubic_meets_the_curve_in_four_points),
    cmocka_unit_test(every_level_gives_the_bits_of_the_reference),
    cmocka_unit_test(no_level_falls_and_all_are_within_one_code_everywhere),
    cmocka_unit_test(the_last_bits_change_nothing),
};
UNIT_MAIN(tests)
