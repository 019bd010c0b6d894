/* Layouts: what each keeps, which way each looks, and that all show the same sky. */
#include "layout.h"
#include "resample.h"

#include "skies.h"

static const struct {
    enum layout layout;
    uint32_t width, height, n;
} cases[] = {
    { LAYOUT_LATLONG, 64, 32, 16 },   { LAYOUT_LATLONG_BOTTOM_FIRST, 37, 19, 33 },
    { LAYOUT_CUBE, 16, 96, 16 },      { LAYOUT_CUBE, 1, 6, 7 },
    { LAYOUT_CUBE, 33, 198, 16 },     { LAYOUT_HCROSS, 64, 48, 9 },
    { LAYOUT_VCROSS, 63, 84, 16 },    { LAYOUT_VCROSS, 96, 128, 64 },
    { LAYOUT_BALL, 16, 16, 33 },      { LAYOUT_BALL, 101, 101, 16 },
    { LAYOUT_BALL, 200, 120, 64 },    { LAYOUT_BALL, 64, 65, 1 },
    { LAYOUT_FISHEYE, 16, 16, 33 },   { LAYOUT_FISHEYE, 101, 101, 17 },
    { LAYOUT_FISHEYE, 160, 200, 64 }, { LAYOUT_FISHEYE, 64, 64, 1 },
};
#define CASES (sizeof(cases) / sizeof(cases[0]))
static const double rotations[] = { 0.0, 0.5 * PI, 0.7, -2.5 };
#define ROTATIONS (sizeof(rotations) / sizeof(rotations[0]))

static double texel_solid_angle(uint32_t n, size_t t)
{
    const double s = 2.0 / n, u = -1.0 + s * (double)(t % n), v = -1.0 + s * (double)(t / n % n);
    return cube_solid_angle(u, v, u + s, v + s);
}

static struct resampler *make_resampler(size_t q, double rotation)
{
    struct resampler *r;
    assert_int_equal(resampler_create(cases[q].layout, cases[q].width, cases[q].height, cases[q].n, rotation, &r),
                     ERR_OK);
    return r;
}

static void every_layout_keeps_a_constant(void **state)
{
    (void)state;
    for (size_t q = 0; q < CASES * ROTATIONS; q++) {
        const uint32_t n = cases[q / ROTATIONS].n;
        struct resampler *r = make_resampler(q / ROTATIONS, rotations[q % ROTATIONS]);
        struct frame f = sky_constant(r->width, r->height, 3.0f);
        float *row = mem_alloc(n, 4 * sizeof(float));
        resampler_load(r, f.rgb);
        for (uint32_t i = 0; i < 6 * n; i++) {
            resampler_row(r, 2.0f, i, row);
            for (uint32_t j = 0; j < n; j++)
                assert_true(fabsf(row[4 * j] / 6.0f - 1.0f) < 1e-5f);
        }
        mem_free(row);
        frame_finish(&f);
        resampler_destroy(r);
    }
}

/* What each source texel brings to all cube texels, against its own solid angle; what is masked brings nothing. */
static void every_layout_keeps_every_texels_energy(void **state)
{
    (void)state;
    for (size_t q = 0; q < CASES * ROTATIONS; q++) {
        const uint32_t n = cases[q / ROTATIONS].n;
        struct resampler *r = make_resampler(q / ROTATIONS, rotations[q % ROTATIONS]);
        double *arrived = mem_alloc((size_t)r->width * r->height, sizeof(double)), sum = 0.0, worst = 0.0;
        assert_int_equal(r->factor, 1);
        for (size_t t = 0; t < 6 * (size_t)n * n; t++)
            for (uint32_t k = r->first[t]; k < r->first[t + 1]; k++)
                arrived[r->index[k]] += r->weight[k] * texel_solid_angle(n, t);
        for (uint32_t y = 0; y < r->height; y++)
            for (uint32_t x = 0; x < r->width; x++) {
                const double low[2] = { x, y }, high[2] = { x + 1, y + 1 }, got = arrived[(size_t)y * r->width + x];
                const double want = layout_solid_angle(r->layout, r->width, r->height, low, high);
                sum += want;
                worst = fmax(worst, want > 0.0 ? fabs(got / want - 1.0) : got);
            }
        assert_true(worst < 1e-5);
        assert_true(fabs(sum / layout_shown(r->layout) - 1.0) < 1e-9);
        mem_free(arrived);
        resampler_destroy(r);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_layout_keeps_a_constant),
    cmocka_unit_test(every_layout_keeps_every_texels_energy),
};
UNIT_MAIN(tests)
