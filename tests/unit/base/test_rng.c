#include "support/unit.h"

#include "base/rng.h"

#include <math.h>
#include <stdbool.h>

/* Every elementary box 2^-a x 2^-(k-a) must hold exactly one of 2^k points; the sum of those that hold none. */
static size_t empty_boxes(uint64_t seed, uint32_t first, unsigned k, bool scrambled)
{
    static uint8_t hit[1 << 12];
    size_t empty = 0;

    for (unsigned a = 0; a <= k; a++) {
        memset(hit, 0, sizeof(hit));
        for (uint32_t i = 0; i < 1u << k; i++) {
            double p[2];
            rng_sobol2(seed, first + i, p);
            if (!scrambled)
                p[1] = p[0]; /* the planted fault: a net in neither pair of coordinates */
            const uint32_t x = (uint32_t)(p[0] * (double)(1u << a)), y = (uint32_t)(p[1] * (double)(1u << (k - a)));
            hit[(size_t)x << (k - a) | y] = 1;
        }
        for (size_t b = 0; b < (size_t)1 << k; b++)
            empty += !hit[b];
    }
    return empty;
}

static void sobol_prefixes_are_nets(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 12; seed++)
        for (unsigned k = 0; k <= 10; k++)
            assert_int_equal(empty_boxes(rng_hash(seed), 0, k, true), 0);
    assert_int_equal(empty_boxes(UINT64_MAX, 0, 12, true), 0);
}

static void sobol_later_blocks_are_nets_too(void **state)
{
    (void)state;
    for (unsigned k = 0; k <= 8; k++)
        for (uint32_t block = 1; block < 6; block++)
            assert_int_equal(empty_boxes(7, block << k, k, true), 0);
    assert_int_equal(empty_boxes(7, UINT32_MAX - 255, 8, true), 0); /* up to the last index */
}

static void net_check_sees_points_that_are_none(void **state)
{
    (void)state;
    assert_true(empty_boxes(1, 0, 6, false) > 0);
}

#define SIDE 16
#define CELLS (SIDE * SIDE)

/* Chi-square of counts that should be equal. */
static double chi_square(const uint32_t *count, size_t cells, double expected)
{
    double sum = 0.0;

    for (size_t i = 0; i < cells; i++)
        sum += ((double)count[i] - expected) * ((double)count[i] - expected) / expected;
    return sum;
}

/* 255 degrees of freedom: mean 255, standard deviation 22.6. All checks together are 20: six deviations are safe. */
#define CHI_BOUND (255.0 + 6.0 * 22.6)

static double chi_of_index(uint32_t index, uint64_t seeds, bool seeded)
{
    uint32_t count[CELLS] = { 0 };

    for (uint64_t seed = 0; seed < seeds; seed++) {
        double p[2];
        rng_sobol2(seeded ? seed : seed % 64, index, p); /* the planted fault: few seeds */
        assert_true(p[0] >= 0.0 && p[0] < 1.0 && p[1] >= 0.0 && p[1] < 1.0);
        count[(size_t)(p[0] * SIDE) * SIDE + (size_t)(p[1] * SIDE)]++;
    }
    return chi_square(count, CELLS, (double)seeds / CELLS);
}

static void every_sobol_point_alone_is_uniform_over_the_seeds(void **state)
{
    static const uint32_t indices[] = { 0, 1, 2, 3, 5, 8, 63, 64, 1000, 65535, 1u << 31, UINT32_MAX };

    (void)state;
    for (size_t i = 0; i < sizeof(indices) / sizeof(indices[0]); i++) {
        const double chi = chi_of_index(indices[i], 40000, true);
        printf("index %u: chi-square %.1f of 255\n", indices[i], chi);
        assert_true(chi < CHI_BOUND);
        assert_true(chi > 255.0 - 6.0 * 22.6); /* nor too even to be chance */
    }
}

static void chi_square_sees_points_that_are_not_uniform(void **state)
{
    (void)state;
    assert_true(chi_of_index(5, 40000, false) > CHI_BOUND);
}

/* The low bits are used as well: the cells are those of the point's 8 finest bits of 24. */
static void sobol_points_are_uniform_in_their_fine_bits(void **state)
{
    uint32_t count[2][CELLS] = { { 0 } };
    const uint64_t seeds = 40000;

    (void)state;
    for (uint64_t seed = 0; seed < seeds; seed++) {
        double p[2];
        rng_sobol2(seed, 9, p);
        for (int c = 0; c < 2; c++)
            count[c][(uint32_t)(p[c] * 0x1p24) & 255]++;
    }
    for (int c = 0; c < 2; c++)
        assert_true(chi_square(count[c], CELLS, (double)seeds / CELLS) < CHI_BOUND);
}

/* A net is worth its name when it integrates better than chance: x y over the square has the mean 1/4. */
static void sobol_integrates_a_product_better_than_chance(void **state)
{
    double squares = 0.0;
    const int seeds = 200, points = 1024;

    (void)state;
    for (int seed = 0; seed < seeds; seed++) {
        double sum = 0.0;
        for (int i = 0; i < points; i++) {
            double p[2];
            rng_sobol2((uint64_t)seed, (uint32_t)i, p);
            sum += p[0] * p[1];
        }
        squares += (sum / points - 0.25) * (sum / points - 0.25);
    }
    const double chance = sqrt((1.0 / 9.0 - 1.0 / 16.0) / points), have = sqrt(squares / seeds);
    printf("standard error %.2e, of independent points %.2e\n", have, chance);
    assert_true(have < 0.05 * chance);
}

static void same_counters_give_the_same_numbers(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 100; i++) {
        double a[2], b[2];
        rng_sobol2(42, i, a);
        rng_sobol2(42, i, b);
        assert_memory_equal(a, b, sizeof(a));
        rng_sobol2(43, i, b);
        assert_true(a[0] != b[0] && a[1] != b[1]);
    }
    assert_true(rng_mix(1, 2) == rng_mix(1, 2) && rng_mix(1, 2) != rng_mix(2, 1));
}

/* The first numbers of SplitMix64 from state 0, as its authors' program prints them; our stream begins at the second,
 * since the finaliser adds the increment once more. */
static void stream_is_splitmix64(void **state)
{
    struct rng r = { 0 };

    (void)state;
    assert_true(rng_hash(0) == 0xe220a8397b1dcdafu);
    assert_true(rng_next(&r) == rng_unit(0x6e789e6aa1b965f4u));
    assert_true(rng_next(&r) == rng_unit(0x06c45d188009454fu));
}

static void unit_numbers_stay_below_one(void **state)
{
    (void)state;
    assert_true(rng_unit(UINT64_MAX) < 1.0 && rng_unit(UINT64_MAX) > 0.9999999999999998);
    assert_true(rng_unit(0) == 0.0);
}

static void stream_is_uniform_and_uncorrelated(void **state)
{
    uint32_t count[CELLS] = { 0 };
    struct rng r = { 12345 };
    const int pairs = 100000;

    (void)state;
    double before = rng_next(&r);
    for (int i = 0; i < pairs; i++) {
        const double now = rng_next(&r);
        count[(size_t)(before * SIDE) * SIDE + (size_t)(now * SIDE)]++;
        before = now;
    }
    assert_true(chi_square(count, CELLS, (double)pairs / CELLS) < CHI_BOUND);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(sobol_prefixes_are_nets),
    cmocka_unit_test(sobol_later_blocks_are_nets_too),
    cmocka_unit_test(net_check_sees_points_that_are_none),
    cmocka_unit_test(every_sobol_point_alone_is_uniform_over_the_seeds),
    cmocka_unit_test(chi_square_sees_points_that_are_not_uniform),
    cmocka_unit_test(sobol_points_are_uniform_in_their_fine_bits),
    cmocka_unit_test(sobol_integrates_a_product_better_than_chance),
    cmocka_unit_test(same_counters_give_the_same_numbers),
    cmocka_unit_test(stream_is_splitmix64),
    cmocka_unit_test(unit_numbers_stay_below_one),
    cmocka_unit_test(stream_is_uniform_and_uncorrelated),
};

UNIT_MAIN(tests)
