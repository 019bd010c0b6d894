/* Tables and lookups against numbers worked out by hand: CDFs of a cube map with a few lit texels, what a second frame
 * leaves of the first, which way up a lat-long is, and what one texel of a pyramid's level gives off in all. */
#include "sky/tables/samples.h"
#include "sky/tables/pyramid.h"
#include "sky/tables/resample.h"
#include "sky/tables/sky_table.h"

#include "support/skies.h"

static void expect_near(double got, double want, double relative)
{
    if (!(fabs(got - want) <= relative * fabs(want)))
        printf("%.9g, by hand %.9g\n", got, want);
    assert_true(fabs(got - want) <= relative * fabs(want));
}

/* A cube map of 2 x 2 texels a face, which all have the same solid angle, 4 pi / 24. */
static struct frame cube_of_two(void)
{
    return sky_constant(2, 2 * CUBE_FACES, 0.0f);
}

/* Which texel of the image is which of the cube map, is found by lighting one after the other; then the four of each
 * face get radiances 1, 2, 3, 4 times the face's number. CDFs of rows are L, L + L'; of the face the sums of both. */
static void tables_are_running_sums(void **state)
{
    const double each = 4.0 * PI / 24.0;
    struct frame f = cube_of_two();
    uint32_t from[4 * CUBE_FACES];
    (void)state;
    for (uint32_t k = 0; k < 4 * CUBE_FACES; k++) {
        struct frame one = cube_of_two();
        sky_paint(&one, k % 2, k / 2, 1, 1, 1);
        struct environment *e = sky_environment_of(one, LAYOUT_CUBE, 2, 0.0);
        uint32_t lit = 0;
        for (uint32_t t = 0; t < 4 * CUBE_FACES; t++)
            if (e->texels[t].g > 0.5f) {
                from[t] = k;
                lit++;
            }
        assert_int_equal(lit, 1);
        environment_destroy(e);
    }
    for (uint32_t t = 0; t < 4 * CUBE_FACES; t++) {
        const float l = (float)((t / 4 + 1) * (t % 4 + 1));
        sky_paint(&f, from[t] % 2, from[t] / 2, l, l, l);
    }
    struct environment *e = sky_environment_of(f, LAYOUT_CUBE, 2, 0.0);
    for (uint32_t face = 0; face < CUBE_FACES; face++) {
        const double unit = (face + 1) * each, rows[] = { 1, 3, 3, 7 }, sides[] = { 3, 10 };
        for (int t = 0; t < 4; t++)
            expect_near(e->row_cdf[4 * face + (uint32_t)t], rows[t] * unit, 1e-6);
        for (int i = 0; i < 2; i++)
            expect_near(e->face_cdf[2 * face + (uint32_t)i], sides[i] * unit, 1e-6);
        expect_near(e->energy[face], 10.0 * unit, 1e-6);
        for (int t = 0; t < 4; t++) /* times n^2 / 4 = 1 */
            expect_near((double)e->texels[4 * face + (uint32_t)t].density, (t + 1) * unit, 1e-6);
    }
    environment_destroy(e);
}

/* The sample at x of a face of 1, 2, 3, 4 lies where the CDFs say: 0.3 splits the rows, 1/3 the first, 3/7 the second.
 */
static void samples_lie_where_the_sums_say(void **state)
{
    static const struct {
        double x[2], v, u;
    } cases[] = {
        { { 0.15, 1.0 / 6 }, -0.5, -0.5 }, /* half of the first row, half of its first texel */
        { { 0.15, 2.0 / 3 }, -0.5, 0.5 },  { { 0.65, 3.0 / 14 }, 0.5, -0.5 },
        { { 0.65, 5.0 / 7 }, 0.5, 0.5 },   { { 0.075, 0.25 }, -0.75, -0.25 }, /* quarters */
    };
    struct environment *e = sky_environment_of(cube_of_two(), LAYOUT_CUBE, 2, 0.0);
    (void)state;
    for (int i = 0; i < 4; i++) {
        e->row_cdf[i] = (const double[]){ 1, 3, 3, 7 }[i];
        e->face_cdf[i / 2] = (const double[]){ 3, 10 }[i / 2];
    }
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        float w[3], u, v;
        samples_invert_face(e, 0, cases[k].x, w);
        assert_int_equal(cube_locate(w, &u, &v), 0);
        assert_true(fabs((double)u - cases[k].u) < 1e-5 && fabs((double)v - cases[k].v) < 1e-5);
    }
    environment_destroy(e);
}

/* Within the lit texel of a sky of 64 x 32 and the texels of the cube map that it touches. */
static void expect_towards(struct vec3 to, const float w[3])
{
    assert_true((double)vec3_dot(to, vec3_make(w[0], w[1], w[2])) > cos(0.15));
}

/* All samplers of environment, table and source draw in the direction `to`, from whichever stratum. */
static void expect_all_towards(struct vec3 to, const struct environment *e, const struct sky_table *table,
                               const struct latlong *rows)
{
    for (int k = 0; k < 64; k++) {
        const double at[2] = { (k % 8 + 0.5) / 8, (k / 8 + 0.5) / 8 };
        float w[3], rgb[3], pdf;
        int strata = 0;
        assert_true(environment_sample(e, at, w, rgb, &pdf));
        expect_towards(to, w);
        latlong_sample(rows, at, w, rgb, &pdf);
        expect_towards(to, w);
        latlong_sample_rows(rows, at, w, rgb, &pdf);
        expect_towards(to, w);
        for (uint32_t f = 0; f < CUBE_FACES; f++)
            if (e->energy[f] > 0.0) {
                samples_invert_face(e, f, at, w);
                expect_towards(to, w);
                strata++;
            }
        for (uint32_t s = 0; s < table->strata; s++)
            if (table->energy[s] > 0.0) {
                sky_table_invert(table, s, at, w);
                expect_towards(to, w);
                strata++;
            }
        assert_int_equal(strata, 2);
    }
}

/* Frames of one lit texel each through the same memory: in one cell of 2 x 2 on a face, beside, above, and opposite. Of
 * the one before nothing is left to sample, whether by faces, cells, the whole sky or the source's own texels. */
static void a_frame_leaves_nothing_to_the_next(void **state)
{
    static const uint32_t lit[][2] = { { 30, 14 }, { 25, 14 }, { 30, 10 }, { 25, 10 }, { 60, 20 }, { 30, 14 } };
    struct environment *e = environment_create(&(struct environment_desc){ .n = 32 });
    struct sky_table table = { 0 };
    struct latlong rows = { 0 };
    struct reason why;
    (void)state;
    for (size_t k = 0; k < sizeof(lit) / sizeof(lit[0]); k++) {
        struct frame f = sky_constant(64, 32, 0.0f);
        const double theta = PI * (lit[k][1] + 0.5) / 32, phi = PI - 2.0 * PI * (lit[k][0] + 0.5) / 64;
        sky_paint(&f, lit[k][0], lit[k][1], 1, 1, 1);
        assert_int_equal(environment_update(e, &f, &why), ERR_OK);
        assert_int_equal(sky_table_build(&table, e, &(struct sky_table_desc){ .cells = 2 }), ERR_OK);
        assert_int_equal(latlong_build(&rows, e, &why), ERR_OK);
        expect_all_towards(vec3_make((float)(sin(theta) * sin(phi)), (float)cos(theta), (float)(sin(theta) * cos(phi))),
                           e, &table, &rows);
        frame_finish(&f);
    }
    sky_table_finish(&table);
    latlong_finish(&rows);
    environment_destroy(e);
}

/* 4 x 2 texels, 5 in the first row and 1 in the second. Up is 5 if the top comes first and 1 if the bottom does, in the
 * cube map and in the source's own texels; both rows have the same solid angle, 2 pi: densities of 5/6 and 1/6 over it.
 */
static void the_first_row_is_the_top_or_the_bottom(void **state)
{
    (void)state;
    for (int bottom = 0; bottom < 2; bottom++) {
        struct frame f = sky_constant(4, 2, 1.0f);
        struct latlong t = { 0 };
        struct reason why;
        for (uint32_t x = 0; x < 4; x++)
            sky_paint(&f, x, 0, 5, 5, 5);
        struct environment *e = sky_environment_of(f, bottom ? LAYOUT_LATLONG_BOTTOM_FIRST : LAYOUT_LATLONG, 8, 0.0);
        assert_int_equal(latlong_build(&t, e, &why), ERR_OK);
        for (int down = 0; down < 2; down++) {
            const float w[3] = { 0.36f, down ? -0.8f : 0.8f, 0.48f };
            const double want = down == bottom ? 5.0 : 1.0;
            float rgb[3], pdf;
            environment_lookup(e, vec3_make(w[0], w[1], w[2]), rgb);
            expect_near((double)rgb[1], want, 1e-5);
            (void)environment_evaluate(e, w, rgb, &pdf);
            expect_near((double)rgb[1], want, 1e-5);
            latlong_evaluate(&t, w, rgb, &pdf);
            expect_near((double)rgb[1], want, 1e-5);
            expect_near((double)pdf, want / 6.0 / (2.0 * PI), 1e-5);
        }
        latlong_finish(&t);
        environment_destroy(e);
    }
}

/* Columns of 1, 2, 4, 8. Between the centres of the last and the first, which meet at the seam, light is linear in
 * azimuth, as anywhere: at columns -0.5, -0.25, 0, 0.25 and 0.5 of 4. */
static void light_is_linear_across_the_seam(void **state)
{
    static const double want[] = { 8.0, 6.25, 4.5, 2.75, 1.0 };
    struct frame f = sky_constant(4, 2, 1.0f);
    (void)state;
    for (uint32_t k = 0; k < 8; k++)
        sky_paint(&f, k % 4, k / 4, (float)(1u << k % 4), (float)(1u << k % 4), (float)(1u << k % 4));
    struct environment *e = sky_environment_of(f, LAYOUT_LATLONG, 8, 0.0);
    for (int k = 0; k < 5; k++) {
        const double phi = PI - 2.0 * PI * (0.25 * k - 0.5) / 4.0;
        float rgb[3];
        environment_lookup(e, vec3_make((float)sin(phi), 0.0f, (float)cos(phi)), rgb);
        expect_near((double)rgb[1], want[k], 1e-5);
    }
    environment_destroy(e);
}

/* Of 60 samples by the source's own texels, 50 are drawn in the row of 5. */
static void samples_prefer_the_bright_row_whichever_it_is(void **state)
{
    (void)state;
    for (int bottom = 0; bottom < 2; bottom++) {
        struct frame f = sky_constant(4, 2, 1.0f);
        struct latlong t = { 0 };
        struct reason why;
        int above = 0;
        for (uint32_t x = 0; x < 4; x++)
            sky_paint(&f, x, 0, 5, 5, 5);
        struct environment *e = sky_environment_of(f, bottom ? LAYOUT_LATLONG_BOTTOM_FIRST : LAYOUT_LATLONG, 8, 0.0);
        assert_int_equal(latlong_build(&t, e, &why), ERR_OK);
        for (int k = 0; k < 60; k++) {
            const double x[2] = { (k + 0.5) / 60, 0.3 };
            float w[3], rgb[3], pdf;
            latlong_sample(&t, x, w, rgb, &pdf);
            above += w[1] > 0.0f;
        }
        assert_int_equal(above, bottom ? 10 : 50);
        latlong_finish(&t);
        environment_destroy(e);
    }
}

/* The integral of a level's lookup over the sphere, one texel lit, by the midpoint rule on a grid of its own. */
static double given_off(const struct pyramid *p, uint32_t level)
{
    enum { FINE = 250 };
    static double solid_angle[FINE * FINE];
    double sum = 0.0;

    if (!(solid_angle[0] > 0.0))
        cube_solid_angles(FINE, solid_angle);
    for (uint32_t face = 0; face < CUBE_FACES; face++)
        for (uint32_t k = 0; k < FINE * FINE; k++) {
            const double u = -1.0 + 2.0 * (k % FINE + 0.5) / FINE, v = -1.0 + 2.0 * (k / FINE + 0.5) / FINE;
            float rgb[3];
            pyramid_lookup_at(p, level, face, (float)u, (float)v, rgb);
            sum += solid_angle[k] * (double)rgb[1];
        }
    return sum;
}

/* Each texel of a level gives off its radiance times its own solid angle, wherever it lies: at a corner of the cube, an
 * edge or within. Plain bilinear weights miss it by up to 8 % here. */
static void a_texel_gives_off_its_own_solid_angle(void **state)
{
    static const uint32_t sizes[] = { 2, 3, 4, 5, 9 };
    double worst = 0.0;
    (void)state;
    for (size_t s = 0; s < sizeof(sizes) / sizeof(sizes[0]); s++) {
        const uint32_t n = sizes[s], half = (n + 1) / 2;
        double *solid_angle = mem_alloc((size_t)n * n, sizeof(*solid_angle));
        float *texels = mem_alloc((size_t)CUBE_FACES * n * n, 4 * sizeof(*texels));
        cube_solid_angles(n, solid_angle);
        struct pyramid *p = pyramid_create(n, solid_angle);
        for (uint32_t i = 0; i < half; i++)
            for (uint32_t j = i; j < half; j++) {
                float *t = texels + 4 * ((size_t)(i + j) % CUBE_FACES * n * n + i * n + j);
                t[0] = t[1] = t[2] = 3.0f;
                pyramid_begin(p, texels);
                pyramid_end(p);
                const double off = given_off(p, 0) / (3.0 * solid_angle[i * n + j]) - 1.0;
                worst = fmax(worst, fabs(off));
                t[0] = t[1] = t[2] = 0.0f;
            }
        pyramid_destroy(p);
        mem_free(texels);
        mem_free(solid_angle);
    }
    if (worst > 0.005)
        printf("off by %.2g\n", worst);
    assert_true(worst < 0.005);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(tables_are_running_sums),
    cmocka_unit_test(samples_lie_where_the_sums_say),
    cmocka_unit_test(a_frame_leaves_nothing_to_the_next),
    cmocka_unit_test(the_first_row_is_the_top_or_the_bottom),
    cmocka_unit_test(samples_prefer_the_bright_row_whichever_it_is),
    cmocka_unit_test(light_is_linear_across_the_seam),
    cmocka_unit_test(a_texel_gives_off_its_own_solid_angle),
};
UNIT_MAIN(tests)
