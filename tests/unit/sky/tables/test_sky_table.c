/* The table for balanced sampling: its cells, its sun, its mean, and what it is on real skies. That each of its
 * densities integrates to 1, is followed and covers the light is in test_sampler_pdfs.c. */
#include "sky/source/source.h"
#include "sky/tables/samples.h"
#include "sky/tables/sky_table.h"

#include "sky/tables/sampling.h"

#include <omp.h>

#define DEGREE (PI / 180.0)

static void build(struct sky_table *t, const struct environment *e, uint32_t cells, bool sun, bool compensate)
{
    const struct sky_table_desc desc = { .cells = cells, .sun = sun, .compensate = compensate };
    assert_int_equal(sky_table_build(t, e, &desc), ERR_OK);
}

/* An overcast sky with a bright disc about a direction, which need not be of unit length. */
static struct environment *make_disc(uint32_t n, const double towards[3], double radius_degrees, float ratio)
{
    struct frame f = sky_overcast(512, 256);
    const double length = sqrt(towards[0] * towards[0] + towards[1] * towards[1] + towards[2] * towards[2]);

    for (uint32_t y = 0; y < f.height; y++)
        for (uint32_t x = 0; x < f.width; x++) {
            const double theta = PI * (y + 0.5) / f.height, phi = PI - 2.0 * PI * (x + 0.5) / f.width;
            const double w[3] = { sin(theta) * sin(phi), cos(theta), sin(theta) * cos(phi) };
            const double cosine = (w[0] * towards[0] + w[1] * towards[1] + w[2] * towards[2]) / length;
            if (acos(fmin(1.0, cosine)) < radius_degrees * DEGREE)
                sky_paint(&f, x, y, ratio, 0.9f * ratio, 0.7f * ratio);
        }
    return sky_environment(f, n, 0.0);
}

static void cells_that_do_not_fit_are_refused(void **state)
{
    static const struct {
        uint32_t n, cells;
        enum err want;
    } rows[] = {
        { 16, 0, ERR_USAGE }, { 16, 3, ERR_USAGE }, { 16, 16, ERR_USAGE }, { 12, 8, ERR_USAGE }, { 1, 2, ERR_USAGE },
        { 7, 1, ERR_OK },     { 12, 4, ERR_OK },    { 8, 8, ERR_OK },      { 1, 1, ERR_OK },
    };
    (void)state;
    for (size_t k = 0; k < sizeof(rows) / sizeof(rows[0]); k++) {
        struct sky_table t = { 0 };
        struct environment *e = sky_environment(sky_overcast(8, 4), rows[k].n, 0.0);
        assert_int_equal(sky_table_build(&t, e, &(struct sky_table_desc){ .cells = rows[k].cells }), rows[k].want);
        sky_table_finish(&t);
        sky_table_finish(&t); /* twice is allowed */
        environment_destroy(e);
    }
}

static void one_plain_cell_is_the_face_itself(void **state)
{
    struct sky_table t = { 0 };
    (void)state;
    for (int sky = 0; sky < SKY_COUNT; sky++) {
        struct environment *e = make_sky(sky);
        struct rng r = { 5 };
        build(&t, e, 1, false, false);
        assert_int_equal(t.strata, CUBE_FACES);
        for (uint32_t f = 0; f < CUBE_FACES; f++) {
            float corner[4][3];
            cube_corners(f, corner);
            assert_memory_equal(corner, t.corner[f], sizeof(corner));
            assert_true(fabs(t.energy[f] - e->energy[f]) <= 1e-12 * e->energy[f]);
        }
        for (int k = 0; k < 500; k++) {
            const float w[3] = { (float)(rng_next(&r) - 0.5), (float)(rng_next(&r) - 0.5),
                                 (float)(rng_next(&r) - 0.5) };
            float a[3], b[3], pdf[2], sun;
            const uint32_t face = environment_evaluate(e, w, a, &pdf[0]);
            assert_int_equal(sky_table_evaluate(&t, w, b, &pdf[1], &sun), face);
            assert_memory_equal(a, b, sizeof(a));
            assert_true(fabsf(pdf[0] - pdf[1]) <= 1e-6f * pdf[0] && sun == 0.0f);
        }
        environment_destroy(e);
    }
    sky_table_finish(&t);
}

/* What the strata draw in all is what there is: sum of energy x density = luminance, texel by texel, sun or not. */
static void strata_share_out_the_whole_luminance(void **state)
{
    struct sky_table t = { 0 };
    (void)state;
    for (int k = 0; k < 8 * SKY_COUNT; k++) {
        struct environment *e = make_sky(k / 8);
        const uint32_t n = e->n, cells = 1u << (k >> 1 & 3);
        build(&t, e, n % cells ? 1 : cells, k & 1, false);
        for (uint32_t at = 0; at < CUBE_FACES * n * n; at++) {
            float w[3], rgb[3], pdf, sun;
            grid_direction(n, at / (n * n), at / n % n, at % n, w);
            const uint32_t s = sky_table_evaluate(&t, w, rgb, &pdf, &sun);
            const double whole = environment_sample_density(e, w, rgb) * e->total_energy;
            assert_true(fabs(pdf * t.energy[s] + sun * t.sun_energy - whole) <= 1e-6 * whole);
        }
        environment_destroy(e);
    }
    sky_table_finish(&t);
}

/* Every direction of a cell lies within the pyramid of its corners, which the bound on its cosines rests on. */
static void corners_enclose_their_cell(void **state)
{
    struct sky_table t = { 0 };
    struct rng r = { 2 };
    (void)state;
    struct environment *e = make_sky(SKY_OVERCAST);
    for (uint32_t cells = 1; cells <= CELLS_MAX; cells *= 2) {
        build(&t, e, cells, false, false);
        for (uint32_t s = 0; s < t.strata; s++)
            for (int k = 0; k < 50; k++) {
                static const int around[4] = { 0, 1, 3, 2 };
                const double x[2] = { rng_next(&r), rng_next(&r) };
                float w[3];
                int left = 0, right = 0;
                sky_table_invert(&t, s, x, w);
                for (int c = 0; c < 4; c++) {
                    const float *a = t.corner[s][around[c]], *b = t.corner[s][around[(c + 1) % 4]];
                    const double side = w[0] * ((double)a[1] * b[2] - (double)a[2] * b[1]) +
                                        w[1] * ((double)a[2] * b[0] - (double)a[0] * b[2]) +
                                        w[2] * ((double)a[0] * b[1] - (double)a[1] * b[0]);
                    left += side > -1e-6;
                    right += side < 1e-6;
                }
                assert_true(left == 4 || right == 4);
            }
    }
    sky_table_finish(&t);
    environment_destroy(e);
}

/* c = 16 times the mean of what is cut at c, to the 3 % of the histogram's bins (4 % here). */
static void the_level_is_sixteen_times_the_mean_cut_there(void **state)
{
    static const int skies[] = { SKY_OVERCAST, SKY_SUN, SKY_SUN_TURNED, SKY_BLACK_ROWS, SKY_ONE,
                                 SKY_SEVEN,    SKY_TWO, SKY_UPSIDE,     SKY_CONTRAST };
    struct sky_table t = { 0 };
    (void)state;
    for (size_t k = 0; k < sizeof(skies) / sizeof(skies[0]); k++) {
        struct environment *e = make_sky(skies[k]);
        double mean = 0.0;
        build(&t, e, 1, true, false);
        for (uint32_t at = 0; at < CUBE_FACES * e->n * e->n; at++)
            mean += fmin(luminance_at(e, at), t.level) * e->solid_angle[at % (e->n * e->n)] / (4.0 * PI);
        assert_true(mean > 0.0);
        assert_true(fabs(t.level / (16.0 * mean) - 1.0) < 0.04);
        assert_true(t.mean == (float)(t.level / 16.0f));
        environment_destroy(e);
    }
    sky_table_finish(&t);
}

/* A sun, and one 100 times as strong, move the level by no more than 16 times the part of the sphere that they fill. */
static void the_level_does_not_rise_with_the_sun(void **state)
{
    static const double up[3] = { 0.3, 1, 0.2 };
    float level[3];
    (void)state;
    for (int k = 0; k < 3; k++) {
        struct sky_table t = { 0 };
        struct environment *e = make_disc(64, up, 1.0, k ? k == 1 ? 1e4f : 1e6f : 1.0f);
        build(&t, e, 1, true, true);
        assert_int_equal(t.has_sun, k > 0);
        level[k] = t.level;
        sky_table_finish(&t);
        environment_destroy(e);
    }
    assert_true(fabsf(level[1] / level[0] - 1.0f) < 0.02f && fabsf(level[2] / level[1] - 1.0f) < 0.02f);
}

/* Wherever it stands: in the middle of a face, on an edge, on a corner, at a pole, on the seam. Its axis is found to
 * half a texel's edge, its spread holds every texel of it and is not much larger than the disc. */
static void a_sun_is_found_wherever_it_stands(void **state)
{
    static const double towards[][3] = { { 0, 0, 1 },    { 1, 1, 0 },  { 1, 1, 1 },        { 0, 1, 0 },   { 0, -1, 0 },
                                         { 0, 0.3, -1 }, { -1, 0, 1 }, { 0.2, 0.7, -0.4 }, { -1, -1, -1 } };
    struct sky_table t = { 0 };
    (void)state;
    for (size_t k = 0; k < sizeof(towards) / sizeof(towards[0]); k++) {
        struct environment *e = make_disc(128, towards[k], 1.0, 1e5f);
        const double *d = towards[k], length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        build(&t, e, 4, true, false);
        assert_true(t.has_sun && t.sun_count >= 4);
        assert_true(t.sun_energy / e->total_energy > 0.88);
        const double cosine = (t.sun_axis[0] * d[0] + t.sun_axis[1] * d[1] + t.sun_axis[2] * d[2]) / length;
        assert_true(acos(fmin(1.0, cosine)) < 0.45 * DEGREE);
        assert_true(t.sun_spread < 3.0 * DEGREE);
        for (uint32_t s = 0; s < t.sun_count; s++) {
            const uint32_t at = t.sun_texels[s], n = e->n;
            assert_true(s == 0 || at > t.sun_texels[s - 1]);
            for (int c = 0; c < 4; c++) {
                double w[3];
                cube_direction(at / (n * n), -1.0 + 2.0 * (at % n + (c & 1)) / n,
                               -1.0 + 2.0 * (at / n % n + (c >> 1)) / n, w);
                const double l = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
                const double reach = (w[0] * t.sun_axis[0] + w[1] * t.sun_axis[1] + w[2] * t.sun_axis[2]) / l;
                assert_true(acos(fmin(1.0, reach)) <= t.sun_spread);
            }
        }
        environment_destroy(e);
    }
    sky_table_finish(&t);
}

static void what_is_no_sun_stays_in_the_cells(void **state)
{
    static const double up[3] = { 0.3, 1, 0.2 };
    static const int skies[] = { SKY_OVERCAST, SKY_BLACK_ROWS, SKY_ONE, SKY_SEVEN, SKY_TWO, SKY_BLACK };
    struct sky_table t = { 0 };
    (void)state;
    for (size_t k = 0; k < sizeof(skies) / sizeof(skies[0]); k++) {
        struct environment *e = make_sky(skies[k]);
        build(&t, e, 1, true, false);
        assert_true(!t.has_sun && t.sun_count == 0 && t.sun_energy == 0.0);
        environment_destroy(e);
    }
    for (int k = 0; k < 2; k++) { /* a small lamp, and a bright quarter of the sky */
        struct environment *e = make_disc(64, up, k ? 45.0 : 0.8, k ? 1000.0f : 100.0f);
        build(&t, e, 1, true, false);
        assert_false(t.has_sun);
        environment_destroy(e);
    }
    struct environment *e = make_disc(64, up, 1.0, 1e5f); /* a sun that nobody asked for */
    build(&t, e, 1, false, true);
    assert_false(t.has_sun);
    environment_destroy(e);
    sky_table_finish(&t);
}

/* All light in one texel: that is a sun beside a black sky, the level is 0, and no cell has anything left. */
static void a_single_lit_texel_is_a_sun(void **state)
{
    struct sky_table t = { 0 };
    (void)state;
    struct frame f = sky_constant(512, 256, 0.0f);
    sky_paint(&f, 100, 80, 7, 7, 7);
    struct environment *e = sky_environment(f, 64, 0.0);
    build(&t, e, 2, true, true);
    assert_true(t.has_sun && t.level == 0.0f && t.mean == 0.0f && !t.compensated);
    assert_true(fabs(t.sun_energy / e->total_energy - 1.0) < 1e-12);
    for (uint32_t s = 0; s < t.strata; s++)
        assert_true(t.energy[s] == 0.0);
    sky_table_finish(&t);
    environment_destroy(e);
}

/* A constant sky loses half of itself everywhere, so that the densities stand; a black one has nothing to lose; under
 * an uneven one the energies are those of max(0, g - half of the mean). */
static void compensation_takes_half_of_the_mean(void **state)
{
    struct sky_table t = { 0 }, plain = { 0 };
    (void)state;
    for (int k = 0; k < 3; k++) {
        struct environment *e = k == 0   ? sky_environment(sky_constant(8, 4, 3.0f), 16, 0.0)
                                : k == 1 ? make_sky(SKY_BLACK)
                                         : make_sky(SKY_SUN);
        double want = 0.0, got = 0.0;
        build(&t, e, 2, false, true);
        build(&plain, e, 2, false, false);
        assert_int_equal(t.compensated, k != 1);
        assert_true(!plain.compensated && plain.mean == 0.0f);
        for (uint32_t at = 0; at < CUBE_FACES * e->n * e->n; at++)
            want += fmax(0.0, luminance_at(e, at) - 0.5 * t.mean) * e->solid_angle[at % (e->n * e->n)];
        for (uint32_t s = 0; s < t.strata; s++) {
            got += t.energy[s];
            if (k == 0)
                assert_true(fabs(t.energy[s] / plain.energy[s] - 0.5) < 0.04);
        }
        assert_true(fabs(got - want) <= 1e-9 * want);
        environment_destroy(e);
    }
    sky_table_finish(&t);
    sky_table_finish(&plain);
}

static uint64_t hash_bytes(uint64_t h, const void *p, size_t size)
{
    for (size_t k = 0; k < size; k++)
        h = rng_mix(h, ((const uint8_t *)p)[k]);
    return h;
}

static uint64_t hash_table(const struct sky_table *t)
{
    const size_t texels = (size_t)CUBE_FACES * t->n * t->n;
    uint64_t h = hash_bytes(0, t->energy, t->strata * sizeof(*t->energy));

    h = hash_bytes(h, t->density, texels * sizeof(*t->density));
    h = hash_bytes(h, t->row_cdf, texels * sizeof(*t->row_cdf));
    h = hash_bytes(h, t->cell_cdf, (size_t)CUBE_FACES * t->cells * t->n * sizeof(*t->cell_cdf));
    h = hash_bytes(h, t->sun_cdf, t->sun_count * sizeof(*t->sun_cdf));
    return hash_bytes(h, &t->level, sizeof(t->level));
}

static void the_same_bits_at_any_number_of_threads_and_in_used_memory(void **state)
{
    const int before = omp_get_max_threads();
    struct sky_table used = { 0 };
    (void)state;
    for (int sky = 0; sky < SKY_COUNT; sky++) {
        struct environment *e = make_sky(sky);
        const uint32_t cells = e->n % 4 ? 1 : 4;
        uint64_t want = 0;
        for (int threads = 1; threads <= 5; threads++) {
            struct sky_table t = { 0 };
            omp_set_num_threads(threads);
            build(&t, e, cells, true, true);
            want = threads == 1 ? hash_table(&t) : want;
            assert_true(hash_table(&t) == want);
            sky_table_finish(&t);
        }
        build(&used, e, cells, true, true); /* that a sky of another size has left */
        assert_true(hash_table(&used) == want);
        environment_destroy(e);
    }
    sky_table_finish(&used);
    omp_set_num_threads(before);
}

struct real_sky {
    const char *spec;
    double least, most; /* the sun's share, 0: there is none */
};

/* The first frame of a source into e, and what the table makes of it. */
static void check_real(const struct real_sky *r, const char *spec, struct environment *e)
{
    struct sky_table t = { 0 };
    struct frame f = { 0 };
    struct source *s;
    struct reason why;

    assert_int_equal(source_open(&(struct source_desc){ .spec = spec }, &s, &why), ERR_OK);
    assert_int_equal(source_next(s, &f, &why), ERR_OK);
    assert_int_equal(environment_update(e, &f, &why), ERR_OK);
    source_close(s);
    frame_finish(&f);
    build(&t, e, 8, true, true);
    const double share = t.sun_energy / e->total_energy;
    if (t.has_sun != (r->most > 0.0) || share < r->least || share > r->most || t.sun_spread > 3.5 * DEGREE)
        fail_msg("%s: share %.4f, spread %.2f degrees", r->spec, share, t.sun_spread / DEGREE);
    sky_table_finish(&t);
}

static void the_skies_of_the_project_have_the_suns_that_are_seen(void **state)
{
    static const struct real_sky skies[] = {
        { "sky:", 0.58, 0.62 },       { "sky:sun_ratio=1000000", 0.78, 0.83 }, { "sky:sun_ratio=1000", 0.0, 0.0 },
        { "sky:hour=5", 0.38, 0.42 }, { "sky:turbidity=9", 0.12, 0.14 },       { "sky:hour=0", 0.0, 0.0 },
    };
    struct environment *e = environment_create(&(struct environment_desc){ .n = 256 });
    (void)state;
    assert_non_null(e);
    for (size_t k = 0; k < sizeof(skies) / sizeof(skies[0]); k++)
        check_real(&skies[k], skies[k].spec, e);
    environment_destroy(e);
}

static void captured_skies_have_the_suns_that_are_seen(void **state)
{
    static const struct real_sky skies[] = {
        { "env/clear_StinsonBeach_1k.hdr", 0.55, 0.60 },
        { "env/clear_noon_grass_1k.hdr", 0.57, 0.62 },
        { "env/extreme_sunrise_1k.hdr", 0.75, 0.80 },
        { "env/partlycloudy_kloppenheim_05_1k.hdr", 0.64, 0.68 },
        { "sky/sky.0033.exr", 0.84, 0.86 },
        { "sky/sky.0063.exr", 0.69, 0.73 },
        { "sky/sky.0000.exr", 0.0, 0.0 }, /* before sunrise */
        { "env/overcast_city_1k.hdr", 0.0, 0.0 },
        { "env/dawn_1k.hdr", 0.0, 0.0 },
        { "env/brokencloud_aristea_puresky_1k.hdr", 0.0, 0.0 },
        { "env/studio_small_05_1k.hdr", 0.0, 0.0 },
        { "env/night_1k.hdr", 0.0, 0.0 },
        { "env/interior_dancing_hall_1k.hdr", 0.0, 0.0 },
    };
    struct environment *e = environment_create(&(struct environment_desc){ .n = 256 });
    (void)state;
    assert_non_null(e);
    for (size_t k = 0; k < sizeof(skies) / sizeof(skies[0]); k++)
        check_real(&skies[k], unit_data(skies[k].spec), e);
    environment_destroy(e);
}

/* Azimuths from north (+Z) over east (-X). */
static void a_maps_sun_is_found_and_turned_where_it_is_wanted(void **state)
{
    const double azimuth = 120.0 * DEGREE, high = 30.0 * DEGREE;
    const double towards[3] = { -sin(azimuth) * cos(high), sin(high), cos(azimuth) * cos(high) };
    struct environment *e = make_disc(128, towards, 1.0, 1e5f), *dull = sky_environment(sky_overcast(64, 32), 64, 0.0);
    struct environment_desc d = { .sun_azimuth = 200.0 };
    struct frame f = { .kind = FRAME_TEXELS, .rgb = e->image.rgb, .width = 512, .height = 256, .turn = 10.0 };
    struct sun_place sun;
    struct reason why;
    (void)state;

    assert_false(sky_find_sun(dull, &sun));
    assert_true(sky_find_sun(e, &sun));
    assert_true(fabs(sun.azimuth - 120.0) < 0.2 && fabs(sun.elevation - 30.0) < 0.2);
    struct environment *turned = environment_create(&(struct environment_desc){ .n = 128, .rotation_degrees = 20.0 });
    assert_int_equal(environment_update(turned, &f, &why), ERR_OK);
    assert_true(sky_find_sun(turned, &sun)); /* positive angles turn north to west */
    assert_true(fabs(sun.azimuth - 90.0) < 0.2);
    environment_configure(turned, &d);
    assert_int_equal(environment_update(turned, &f, &why), ERR_OK);
    assert_true(sky_find_sun(turned, &sun));
    assert_true(fabs(sun.azimuth - 200.0) < 0.2 && fabs(sun.elevation - 30.0) < 0.2);
    environment_destroy(turned);
    environment_destroy(dull);
    environment_destroy(e);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_maps_sun_is_found_and_turned_where_it_is_wanted),
    cmocka_unit_test(cells_that_do_not_fit_are_refused),
    cmocka_unit_test(one_plain_cell_is_the_face_itself),
    cmocka_unit_test(strata_share_out_the_whole_luminance),
    cmocka_unit_test(corners_enclose_their_cell),
    cmocka_unit_test(the_level_is_sixteen_times_the_mean_cut_there),
    cmocka_unit_test(the_level_does_not_rise_with_the_sun),
    cmocka_unit_test(a_sun_is_found_wherever_it_stands),
    cmocka_unit_test(what_is_no_sun_stays_in_the_cells),
    cmocka_unit_test(a_single_lit_texel_is_a_sun),
    cmocka_unit_test(compensation_takes_half_of_the_mean),
    cmocka_unit_test(the_same_bits_at_any_number_of_threads_and_in_used_memory),
    cmocka_unit_test(the_skies_of_the_project_have_the_suns_that_are_seen),
    cmocka_unit_test(captured_skies_have_the_suns_that_are_seen),
};
UNIT_MAIN(tests)
