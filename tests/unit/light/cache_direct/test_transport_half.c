/* Half floats: every one of the 65536 widened, and floats rounded, against arithmetic in double precision. */
#include "base/half.h"
#include "base/mem.h"
#include "base/rng.h"
#include "light/cache_direct/internal.h"
#include "light/estimators/kernels.h"
#include "light/estimators/levels.h"

#include <math.h>

#include "support/unit.h"

/* The value of a half as IEEE 754 has it. */
static double value_of(uint16_t h)
{
    const int exponent = h >> 10 & 31, mantissa = h & 1023;
    const double sign = h & 0x8000 ? -1.0 : 1.0;

    if (exponent == 31)
        return mantissa ? (double)NAN : sign * (double)INFINITY;
    return sign * (exponent ? ldexp(1024.0 + mantissa, exponent - 25) : ldexp(mantissa, -24));
}

static bool is_nan(uint16_t h)
{
    return (h & 0x7fff) > 0x7c00;
}

static void every_half_is_widened_exactly(void **state)
{
    (void)state;

    for (uint32_t h = 0; h < 65536; h++) {
        const double want = value_of((uint16_t)h);
        const float got = half_widen((uint16_t)h);
        if (is_nan((uint16_t)h)) {
            assert_true(isnan(got));
            continue;
        }
        assert_true((double)got == want && !signbit(got) == !signbit(want));
    }
}

static void every_cpu_level_widens_alike(void **state)
{
    uint16_t *in = mem_alloc(65536, sizeof(*in));
    float *out = mem_alloc(65536, sizeof(*out));
    (void)state;

    for (uint32_t h = 0; h < 65536; h++)
        in[h] = (uint16_t)h;
    for (const struct kernels *const *k = kernels_all(); *k; k++) {
        transport_kernels_of(*k)->widen(in, out, 65536);
        for (uint32_t h = 0; h < 65536; h++) {
            const float want = half_widen((uint16_t)h);
            if (!is_nan((uint16_t)h))
                assert_memory_equal(&out[h], &want, sizeof(want));
        }
    }
    mem_free(in);
    mem_free(out);
}

static void what_a_half_holds_comes_back(void **state)
{
    (void)state;

    for (uint32_t h = 0; h < 65536; h++)
        if (!is_nan((uint16_t)h))
            assert_int_equal(half_round(half_widen((uint16_t)h)), h);
    assert_true(is_nan(half_round(NAN)));
}

/* Of the two halves about x the nearer one, of two as near the even one. */
static void assert_nearest(float x)
{
    const uint16_t got = half_round(x);
    const double own = fabs(value_of(got) - (double)x);

    if (fabsf(x) >= 65520.0f) {
        assert_int_equal(got & 0x7fff, 0x7c00);
        return;
    }
    for (int side = -1; side <= 1; side += 2) {
        const int next = (got & 0x7fff) + side;
        if (next < 0 || next >= 0x7c00)
            continue;
        const double other = fabs(value_of((uint16_t)((got & 0x8000) | next)) - (double)x);
        assert_true(own < other || (own == other && !(got & 1)));
    }
    assert_int_equal(got >> 15, signbit(x) ? 1 : 0);
}

static void floats_go_to_the_nearest_half(void **state)
{
    struct rng r = { 71 };
    (void)state;

    for (uint32_t h = 0; h < 0x7bff; h++) { /* every tie, and both sides of it */
        const double tie = 0.5 * (value_of((uint16_t)h) + value_of((uint16_t)(h + 1)));
        assert_nearest((float)tie);
        assert_nearest(nextafterf((float)tie, 0.0f));
        assert_nearest(-nextafterf((float)tie, 1e9f));
    }
    for (int i = 0; i < 100000; i++)
        assert_nearest((float)((rng_next(&r) < 0.5 ? -1.0 : 1.0) * exp2(44.0 * rng_next(&r) - 27.0)));
    assert_nearest(65504.0f);
    assert_nearest(65519.996f);
    assert_nearest(65520.0f);
    assert_nearest(INFINITY);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_half_is_widened_exactly),
    cmocka_unit_test(every_cpu_level_widens_alike),
    cmocka_unit_test(what_a_half_holds_comes_back),
    cmocka_unit_test(floats_go_to_the_nearest_half),
};
UNIT_MAIN(tests)
