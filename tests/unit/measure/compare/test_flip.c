#include "measure/compare/metrics.h"

#include "base/rng.h"
#include "light/frame/near.h"
#include "support/unit.h"

#include <math.h>
#include <omp.h>
#include <string.h>

#define WIDTH 41
#define HEIGHT 29
#define COUNT (WIDTH * HEIGHT)
#define PI 3.14159265358979323846

/* At one pixel per degree no Gaussian reaches the next pixel: colours stay as they are, the edge filter is the
 * difference of the two neighbours and the point filter their mean less the pixel. */
#define NO_BLUR 1.0

/* Black against white: 100^0.7 lies beyond the knee of 0.4 c_max, c_max = 41.2761 by the authors' own figure,
 * which other digits of the matrices move by 1e-5. */
#define C_MAX 41.2761
static const double black_white = 0.95 + 0.05 * (25.118864315 - 0.4 * C_MAX) / (0.6 * C_MAX);

struct sent_image {
    float rgb[COUNT][3];
};

static void fill(struct sent_image *p, float r, float g, float b)
{
    for (size_t i = 0; i < COUNT; i++) {
        p->rgb[i][0] = r;
        p->rgb[i][1] = g;
        p->rgb[i][2] = b;
    }
}

static void scatter(struct sent_image *p, uint64_t seed)
{
    struct rng r = { seed };
    for (size_t i = 0; i < COUNT; i++)
        for (int k = 0; k < 3; k++)
            p->rgb[i][k] = (float)rng_next(&r);
}

static double between(const struct sent_image *x, const struct sent_image *r, const uint8_t *mask, double ppd,
                      float *map)
{
    struct flip_view a, b;
    assert_true(flip_view_init(&a, &x->rgb[0][0], WIDTH, HEIGHT, ppd));
    assert_true(flip_view_init(&b, &r->rgb[0][0], WIDTH, HEIGHT, ppd));
    const double mean = flip_mean(&a, &b, mask, map);
    flip_view_finish(&a);
    flip_view_finish(&b);
    return mean;
}

static void an_image_does_not_differ_from_itself(void **state)
{
    static struct sent_image p;
    static float map[COUNT];
    (void)state;

    scatter(&p, 1);
    assert_near(between(&p, &p, NULL, FLIP_PIXELS_PER_DEGREE, map), 0.0, 0.0);
    for (size_t i = 0; i < COUNT; i++)
        assert_near((double)map[i], 0.0, 0.0);
}

static void green_and_blue_differ_as_much_as_can_be(void **state)
{
    static struct sent_image green, blue;
    (void)state;

    fill(&green, 0.0f, 1.0f, 0.0f);
    fill(&blue, 0.0f, 0.0f, 1.0f);
    assert_near(between(&green, &blue, NULL, FLIP_PIXELS_PER_DEGREE, NULL), 1.0, 3e-5);
    assert_near(between(&green, &blue, NULL, 20.0, NULL), 1.0, 3e-5);
}

/* Grey is as it was after any blur; L* of 0.18 is 49.496. */
static void greys_are_the_formula(void **state)
{
    static struct sent_image black, white, grey;
    const double l = 116.0 * cbrt(0.18) - 16.0, l_less = 116.0 * cbrt(0.17) - 16.0;
    (void)state;

    fill(&black, 0.0f, 0.0f, 0.0f);
    fill(&white, 1.0f, 1.0f, 1.0f);
    fill(&grey, 0.18f, 0.18f, 0.18f);
    assert_near(between(&black, &white, NULL, FLIP_PIXELS_PER_DEGREE, NULL), black_white, 3e-5);
    assert_near(between(&black, &grey, NULL, FLIP_PIXELS_PER_DEGREE, NULL), 0.95 * pow(l, 0.7) / (0.4 * C_MAX), 3e-5);
    fill(&white, 0.17f, 0.17f, 0.17f);
    assert_near(between(&white, &grey, NULL, FLIP_PIXELS_PER_DEGREE, NULL), 0.95 * pow(l - l_less, 0.7) / (0.4 * C_MAX),
                1e-5);
}

/* Both features of it are sqrt(2) after the sum of squares over two axes: the exponent becomes 0. */
static void a_lone_pixel_that_comes_counts_all(void **state)
{
    static struct sent_image black, dot;
    static float map[COUNT];
    const size_t at = 7 * WIDTH + 9;
    (void)state;

    fill(&black, 0.0f, 0.0f, 0.0f);
    dot = black;
    dot.rgb[at][0] = dot.rgb[at][1] = dot.rgb[at][2] = 1.0f;
    assert_near(between(&dot, &black, NULL, NO_BLUR, map), 1.0 / COUNT, 1e-6);
    assert_near((double)map[at], 1.0, 1e-6);
    assert_near((double)map[at + 1], 0.0, 0.0); /* a feature without a colour that differs is none */
}

/* An ideal edge is found with strength 1 on both its sides; its point filter says 1/2. */
static void an_edge_that_comes_counts_more_than_its_colour(void **state)
{
    static struct sent_image black, half;
    static float map[COUNT];
    const double beside = pow(black_white, 1.0 - sqrt(1.0 / sqrt(2.0)));
    (void)state;

    fill(&black, 0.0f, 0.0f, 0.0f);
    half = black;
    for (size_t i = 0; i < COUNT; i++)
        for (int k = 0; k < 3; k++)
            half.rgb[i][k] = i % WIDTH >= 20 ? 1.0f : 0.0f;
    (void)between(&half, &black, NULL, NO_BLUR, map);
    assert_near((double)map[5 * WIDTH + 20], beside, 3e-5);
    assert_near((double)map[5 * WIDTH + 21], black_white, 3e-5);
    assert_near((double)map[5 * WIDTH + 19], 0.0, 0.0);
}

static void it_is_between_0_and_1_and_symmetric(void **state)
{
    static struct sent_image x, r;
    static float there[COUNT], back[COUNT];
    (void)state;

    for (uint64_t seed = 1; seed < 6; seed++) {
        scatter(&x, seed);
        scatter(&r, seed + 100);
        const double mean = between(&x, &r, NULL, FLIP_PIXELS_PER_DEGREE / (double)seed, there);
        assert_near(between(&r, &x, NULL, FLIP_PIXELS_PER_DEGREE / (double)seed, back), mean, 0.0);
        double sum = 0.0;
        for (size_t i = 0; i < COUNT; i++) {
            assert_true(there[i] > 0.0f && there[i] <= 1.0f && there[i] == back[i]);
            sum += (double)there[i];
        }
        assert_near(sum / COUNT, mean, 1e-6);
    }
}

/* A checkerboard against the grey that it has in mean light: plain from near, next to nothing where 67 pixels make a
 * degree (within the image: at its border it goes on as its last pixels do). */
static void what_is_too_fine_to_see_counts_little(void **state)
{
    static struct sent_image board, grey;
    static uint8_t inner[COUNT];
    static float map[COUNT];
    (void)state;

    fill(&grey, 0.5f, 0.5f, 0.5f);
    for (size_t i = 0; i < COUNT; i++) {
        const size_t x = i % WIDTH, y = i / WIDTH;
        for (int k = 0; k < 3; k++)
            board.rgb[i][k] = (x + y) % 2 ? 1.0f : 0.0f;
        inner[i] = x >= 12 && x < WIDTH - 12 && y >= 12 && y < HEIGHT - 12;
    }
    assert_true(between(&board, &grey, inner, 5.0, map) > 0.5);
    assert_true(between(&board, &grey, inner, FLIP_PIXELS_PER_DEGREE, map) < 0.02);
}

static const double to_xyz[3][3] = {
    /* of IEC 61966-2-1's primaries, over D65 (0.95043, 1, 1.0889) as the sum of each row */
    { 0.4124564, 0.3575761, 0.1804375 },
    { 0.2126729, 0.7151522, 0.0721750 },
    { 0.0193339, 0.1191920, 0.9503041 },
};

static double root(double t)
{
    return t > 216.0 / 24389.0 ? cbrt(t) : (24389.0 / 27.0 * t + 16.0) / 116.0;
}

/* The colour pipeline at one pixel, straight from its definition: two-dimensional kernels, no clipping needed because
 * the colours are mild. Gaussians as sigma in degrees: b = 2 pi^2 sigma^2. */
static void colour_at(const struct sent_image *p, int x, int y, double ppd, double lab[3])
{
    static const double a[3][2] = { { 1.0, 0.0 }, { 1.0, 0.0 }, { 34.1, 13.5 } };
    static const double b[3][2] = { { 0.0047, 1.0 }, { 0.0053, 1.0 }, { 0.04, 0.025 } };
    const int radius = (int)ceil(3.0 * sqrt(0.04 / 2.0) / PI * ppd);
    double opponent[3] = { 0.0, 0.0, 0.0 }, whole[3] = { 0.0, 0.0, 0.0 };

    for (int dy = -radius; dy <= radius; dy++)
        for (int dx = -radius; dx <= radius; dx++) {
            const int sx = x + dx < 0 ? 0 : x + dx >= WIDTH ? WIDTH - 1 : x + dx;
            const int sy = y + dy < 0 ? 0 : y + dy >= HEIGHT ? HEIGHT - 1 : y + dy;
            const float *c = p->rgb[sy * WIDTH + sx];
            double xyz[3];
            for (int k = 0; k < 3; k++)
                xyz[k] = (to_xyz[k][0] * (double)c[0] + to_xyz[k][1] * (double)c[1] + to_xyz[k][2] * (double)c[2]) /
                         (to_xyz[k][0] + to_xyz[k][1] + to_xyz[k][2]);
            const double values[3] = { xyz[1], xyz[0] - xyz[1], xyz[1] - xyz[2] };
            const double d2 = (dx * dx + dy * dy) / (ppd * ppd);
            for (int k = 0; k < 3; k++) {
                const double w = a[k][0] * sqrt(PI / b[k][0]) * exp(-PI * PI * d2 / b[k][0]) +
                                 a[k][1] * sqrt(PI / b[k][1]) * exp(-PI * PI * d2 / b[k][1]);
                opponent[k] += w * values[k];
                whole[k] += w;
            }
        }
    for (int k = 0; k < 3; k++)
        opponent[k] /= whole[k];
    const double fx = root(opponent[0] + opponent[1]), fy = root(opponent[0]), fz = root(opponent[0] - opponent[2]);
    lab[0] = 116.0 * fy - 16.0;
    lab[1] = 0.01 * lab[0] * 500.0 * (fx - fy);
    lab[2] = 0.01 * lab[0] * 200.0 * (fy - fz);
}

/* The matrices differ in the fifth digit: 0.01 of L*a*b*'s units is far below what is seen. */
static void the_eyes_blur_is_its_definition(void **state)
{
    static struct sent_image p;
    static const int at[][2] = { { 0, 0 }, { 20, 14 }, { 40, 3 }, { 7, 28 } };
    struct flip_view v;
    (void)state;

    scatter(&p, 5);
    for (size_t i = 0; i < COUNT; i++)
        for (int k = 0; k < 3; k++)
            p.rgb[i][k] = 0.4f + 0.2f * p.rgb[i][k];
    assert_true(flip_view_init(&v, &p.rgb[0][0], WIDTH, HEIGHT, 30.0));
    for (size_t i = 0; i < sizeof(at) / sizeof(at[0]); i++) {
        double lab[3];
        colour_at(&p, at[i][0], at[i][1], 30.0, lab);
        for (int k = 0; k < 3; k++)
            assert_near(v.plane[FLIP_L + k][at[i][1] * WIDTH + at[i][0]], lab[k], 0.01);
    }
    flip_view_finish(&v);
}

static void the_mask_leaves_pixels_out(void **state)
{
    static struct sent_image x, r;
    static uint8_t mask[COUNT];
    static float map[COUNT];
    double mean;
    (void)state;

    scatter(&x, 1);
    scatter(&r, 2);
    assert_near(between(&x, &r, mask, FLIP_PIXELS_PER_DEGREE, map), 0.0, 0.0);
    assert_false(flip_compare(&x.rgb[0][0], &r.rgb[0][0], mask, WIDTH, HEIGHT, 67.0, NULL, &mean));
    mask[3] = 1;
    mean = between(&x, &r, mask, FLIP_PIXELS_PER_DEGREE, map);
    assert_near(mean, (double)map[3], 1e-7);
    assert_near((double)map[4], 0.0, 0.0);
    assert_true(mean > 0.0);
}

static void what_is_no_number_is_black_and_too_bright_is_white(void **state)
{
    static struct sent_image odd, plain;
    (void)state;

    scatter(&odd, 3);
    plain = odd;
    odd.rgb[5][0] = NAN;
    odd.rgb[6][1] = INFINITY;
    odd.rgb[7][2] = -3.0f;
    plain.rgb[5][0] = plain.rgb[7][2] = 0.0f;
    plain.rgb[6][1] = 1.0f;
    assert_near(between(&odd, &plain, NULL, FLIP_PIXELS_PER_DEGREE, NULL), 0.0, 0.0);
}

static void exposure_of_the_reference_is_that_of_both(void **state)
{
    static struct sent_image x, r;
    double alike, stops;
    (void)state;

    scatter(&x, 1);
    scatter(&r, 2);
    assert_true(flip_compare(&x.rgb[0][0], &r.rgb[0][0], NULL, WIDTH, HEIGHT, 67.0, NULL, &alike));
    for (size_t i = 0; i < COUNT; i++)
        for (int k = 0; k < 3; k++) {
            x.rgb[i][k] *= 1024.0f;
            r.rgb[i][k] *= 1024.0f;
        }
    assert_true(flip_compare(&x.rgb[0][0], &r.rgb[0][0], NULL, WIDTH, HEIGHT, 67.0, NULL, &stops));
    assert_near(stops, alike, 1e-6);
}

static void threads_do_not_change_a_bit(void **state)
{
    static struct sent_image x, r;
    const int threads = omp_get_max_threads();
    double one, five;
    (void)state;

    scatter(&x, 1);
    scatter(&r, 2);
    omp_set_num_threads(1);
    one = between(&x, &r, NULL, FLIP_PIXELS_PER_DEGREE, NULL);
    omp_set_num_threads(5);
    five = between(&x, &r, NULL, FLIP_PIXELS_PER_DEGREE, NULL);
    omp_set_num_threads(threads);
    assert_near(one, five, 0.0);
}

/* Narrower than every kernel. */
static void an_image_of_one_pixel_is_its_colour(void **state)
{
    const float white[3] = { 1.0f, 1.0f, 1.0f }, black[3] = { 0.0f, 0.0f, 0.0f };
    struct flip_view a, b;
    (void)state;

    assert_true(flip_view_init(&a, white, 1, 1, FLIP_PIXELS_PER_DEGREE_MAX));
    assert_true(flip_view_init(&b, black, 1, 1, FLIP_PIXELS_PER_DEGREE_MAX));
    assert_near(flip_mean(&a, &b, NULL, NULL), black_white, 3e-5);
    flip_view_finish(&a);
    flip_view_finish(&b);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(an_image_does_not_differ_from_itself),
    cmocka_unit_test(green_and_blue_differ_as_much_as_can_be),
    cmocka_unit_test(greys_are_the_formula),
    cmocka_unit_test(a_lone_pixel_that_comes_counts_all),
    cmocka_unit_test(an_edge_that_comes_counts_more_than_its_colour),
    cmocka_unit_test(it_is_between_0_and_1_and_symmetric),
    cmocka_unit_test(what_is_too_fine_to_see_counts_little),
    cmocka_unit_test(the_eyes_blur_is_its_definition),
    cmocka_unit_test(the_mask_leaves_pixels_out),
    cmocka_unit_test(what_is_no_number_is_black_and_too_bright_is_white),
    cmocka_unit_test(exposure_of_the_reference_is_that_of_both),
    cmocka_unit_test(threads_do_not_change_a_bit),
    cmocka_unit_test(an_image_of_one_pixel_is_its_colour),
};

UNIT_MAIN(tests)
