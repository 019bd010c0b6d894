/* The shares of [LPG13, Eq. 3], mu_f(n) = F_f(n) I_f / sum, against numbers worked out by hand: F_f is the sum of the
 * clamped cosines of a cell's four corners, I_f its light. Skies of one radiance per face; the corners of a face lie
 * along (+-1, +-1, +-1) / sqrt 3. */
#include "light/estimators/direct.h"
#include "light/estimators/levels.h"
#include "light/estimators/points.h"

#define DIAGONAL 0.57735026918962576 /* 1 / sqrt 3, the cosine between a face's normal and its corners */
#define HALFWAY 0.70710678118654752  /* 1 / sqrt 2, the cosine to the middles of its edges */

/* face[f]: radiance of a face, in the order of cube.h. */
static struct environment *fine_faces_of(const float face[CUBE_FACES], uint32_t n)
{
    struct frame f = sky_constant(2, 2 * CUBE_FACES, 0.0f);

    for (uint32_t k = 0; k < 4 * CUBE_FACES; k++)
        sky_paint(&f, k % 2, k / 2, face[k / 4], face[k / 4], face[k / 4]);
    return sky_environment_of(f, LAYOUT_CUBE, n, 0.0);
}

static struct environment *faces_of(const float face[CUBE_FACES])
{
    return fine_faces_of(face, 8);
}

/* The shares that lane 5 of a packet gives its strata. Of faces each lane has its own: the others look down. Cells have
 * one share for the packet, the mean over its lanes: all have normal n. */
static struct direct_stats record_samples(const struct kernels *k, const struct environment *e, struct vec3 n,
                                          uint32_t cells, enum method method, uint32_t samples, struct direct_log *log)
{
    static float lo[3 * PACKET];
    struct gbuffer g = points_make(1, LOBE_LAMBERT, 0.5f, 0.0f, 0.0f);
    struct direct *d = direct_create(k);
    struct direct_stats stats;
    const struct direct_desc desc = {
        .method = method, .samples = samples, .cells = cells, .no_visibility = true, .log = log
    };

    for (int l = 0; l < PACKET; l++) {
        g.packets->ns_x[l] = g.packets->ng_x[l] = l == 5 || cells > 1 ? n.x : 0.0f;
        g.packets->ns_y[l] = g.packets->ng_y[l] = l == 5 || cells > 1 ? n.y : -1.0f;
        g.packets->ns_z[l] = g.packets->ng_z[l] = l == 5 || cells > 1 ? n.z : 0.0f;
    }
    log->lane = 5;
    assert_int_equal(direct_shade(d, &g, NULL, e, &desc, lo, &stats), ERR_OK);
    direct_destroy(d);
    points_free(&g);
    return stats;
}

static void record(const struct kernels *k, const struct environment *e, struct vec3 n, uint32_t cells,
                   enum method method, struct direct_log *log)
{
    record_samples(k, e, n, cells, method, 60, log);
}

/* want[f]: mu_f of face f, with one cell or with `cells` x cells of them together. */
static void expect_faces(const float face[CUBE_FACES], struct vec3 n, uint32_t cells, enum method method,
                         const double want[CUBE_FACES])
{
    struct environment *e = faces_of(face);

    for (const struct kernels *const *k = kernels_all(); *k; k++) {
        struct direct_log log = { 0 };
        record(*k, e, n, cells, method, &log);
        assert_int_equal(log.strata, CUBE_FACES * cells * cells);
        for (uint32_t f = 0; f < CUBE_FACES; f++) {
            double got = 0.0;
            for (uint32_t c = 0; c < cells * cells; c++)
                got += (double)log.share[f * cells * cells + c];
            if (!(fabs(got - want[f]) < 1e-6))
                printf("face %u: %.7f, by hand %.7f\n", f, got, want[f]);
            assert_true(fabs(got - want[f]) < 1e-6);
        }
        direct_log_finish(&log);
    }
    environment_destroy(e);
}

static const float even_sky[CUBE_FACES] = { 1, 1, 1, 1, 1, 1 };

/* Upright: the top has four corners in front, the sides two each: 4, 2, 2, 2, 2, 0 of 12. The largest corner instead of
 * the sum would give a fifth each. */
static void upright_under_an_even_sky(void **state)
{
    (void)state;
    expect_faces(even_sky, vec3_make(0, 1, 0), 1, METHOD_FACES,
                 (const double[]){ 1.0 / 6, 1.0 / 6, 1.0 / 3, 0.0, 1.0 / 6, 1.0 / 6 });
}

/* Along (1, 1, 1): the cosines of a near face's corners are 1, 1/3, 1/3, -1/3, of a far one's 1/3 and three at or below
 * -1/3: 5/3 and 1/3 of 6 in all. */
static void towards_a_corner_of_the_cube(void **state)
{
    const float d = (float)DIAGONAL;
    (void)state;
    expect_faces(even_sky, vec3_make(d, d, d), 1, METHOD_FACES,
                 (const double[]){ 5.0 / 18, 1.0 / 18, 5.0 / 18, 1.0 / 18, 5.0 / 18, 1.0 / 18 });
}

/* Light of 6, 2, 3, 7, 1 and 0 times the same solid angle: 2 * 6, 2 * 2, 4 * 3, 0, 2 * 1 and 0 of 30. */
static void light_multiplies_the_cosines(void **state)
{
    (void)state;
    expect_faces((const float[]){ 6, 2, 3, 7, 1, 0 }, vec3_make(0, 1, 0), 1, METHOD_FACES,
                 (const double[]){ 12.0 / 30, 4.0 / 30, 12.0 / 30, 0.0, 2.0 / 30, 0.0 });
}

static void uniform_shares_are_a_sixth(void **state)
{
    const double sixth = 1.0 / 6;
    (void)state;
    expect_faces((const float[]){ 6, 2, 3, 7, 1, 1 }, vec3_make(0, 1, 0), 1, METHOD_FACES_UNIFORM,
                 (const double[]){ sixth, sixth, sixth, sixth, sixth, sixth });
}

/* 2 x 2 cells, all of the same solid angle. Upright, a cell of the top has corners at the middle of the face, of two
 * edges, and at a corner of the cube; the upper two of a side have one at a corner of the cube and one at the middle of
 * the upper edge in front of the point, two at its horizon; the lower two have none. */
static void cells_have_corners_of_their_own(void **state)
{
    const double top = 1.0 + 2.0 * HALFWAY + DIAGONAL, side = DIAGONAL + HALFWAY, all = 4.0 * top + 8.0 * side;
    struct environment *e = faces_of(even_sky);
    uint32_t dark = 0;
    (void)state;
    expect_faces(
        even_sky, vec3_make(0, 1, 0), 2, METHOD_FACES,
        (const double[]){ 2 * side / all, 2 * side / all, 4 * top / all, 0.0, 2 * side / all, 2 * side / all });
    for (const struct kernels *const *k = kernels_all(); *k; k++) {
        struct direct_log log = { 0 };
        record(*k, e, vec3_make(0, 1, 0), 2, METHOD_FACES, &log);
        for (uint32_t c = 8; c < 12; c++)
            assert_true(fabs((double)log.share[c] - top / all) < 1e-6);
        for (uint32_t c = 0; c < 8; c++) {
            dark += log.share[c] < 1e-6f;
            assert_true(log.share[c] < 1e-6f || fabs((double)log.share[c] - side / all) < 1e-6);
        }
        assert_int_equal(dark, 4);
        dark = 0;
        direct_log_finish(&log);
    }
    environment_destroy(e);
}

/* N_f = mu_f N_s of 60 samples: 10, 10, 20, none, 10 and 10. */
static void counts_are_shares_of_the_samples(void **state)
{
    static const double want[] = { 10, 10, 20, 0, 10, 10 };
    struct environment *e = faces_of(even_sky);
    struct direct_log log = { 0 };
    (void)state;
    record(best_kernels(), e, vec3_make(0, 1, 0), 1, METHOD_FACES, &log);
    for (uint32_t f = 0; f < CUBE_FACES; f++)
        assert_true(fabs((double)log.count[f] - want[f]) < 1e-4);
    direct_log_finish(&log);
    environment_destroy(e);
}

/* A sixth of six samples is one sample for each face and point, not one more that would weigh nothing. */
static void whole_counts_have_no_further_sample(void **state)
{
    struct environment *e = faces_of(even_sky);
    (void)state;
    for (const struct kernels *const *k = kernels_all(); *k; k++) {
        struct direct_log log = { 0 };
        const struct direct_stats stats = record_samples(*k, e, vec3_make(0, 1, 0), 1, METHOD_FACES_UNIFORM, 6, &log);
        assert_int_equal(stats.chosen, PACKET * CUBE_FACES);
        direct_log_finish(&log);
    }
    environment_destroy(e);
}

/* Upright under an even sky, half of the samples each: a face's light samples have the density share * 6 / (4 pi), to a
 * few percent, lobes cos / pi. So light samples of the top, whose share is a third, weigh
 * 1/2 / (1/2 + cos), those of a side, a sixth, 1/4 / (1/4 + cos), and a lobe's samples the rest of 1. */
static void logged_weights_are_those_of_the_balance_heuristic(void **state)
{
    struct environment *e = fine_faces_of(even_sky, 128);
    uint32_t weighed = 0;
    (void)state;
    for (const struct kernels *const *k = kernels_all(); *k; k++) {
        struct direct_log log = { 0 };
        record_samples(*k, e, vec3_make(0, 1, 0), 1, METHOD_MIS, 64, &log);
        for (uint32_t i = 0; i < log.light_count + log.lobe_count; i++) {
            const bool by_light = i < log.light_count;
            const struct direct_log_sample *s = by_light ? &log.light[i] : &log.lobes[i - log.light_count];
            const double x = fabs((double)s->w[0]), y = (double)s->w[1], z = fabs((double)s->w[2]);
            const double light = y > fmax(x, z) ? 0.5 : 0.25, part = light / (light + y);
            if (!s->effective)
                continue;
            assert_true(fabs((double)s->mis - (by_light ? part : 1.0 - part)) < 0.01);
            weighed++;
        }
        direct_log_finish(&log);
    }
    assert_true(weighed > 40);
    environment_destroy(e);
}

/* A matte lobe's first sixteen samples lie one in each sixteenth of sin^2, and one in each of the azimuth: they are a
 * net, which all others but the first sixteen numbers are not. */
static void lobe_samples_are_the_first_of_their_sequence(void **state)
{
    struct environment *e = faces_of(even_sky);
    (void)state;
    for (const struct kernels *const *k = kernels_all(); *k; k++) {
        struct direct_log log = { 0 };
        uint32_t heights = 0, azimuths = 0;
        record_samples(*k, e, vec3_make(0, 1, 0), 1, METHOD_BRDF, 16, &log);
        assert_int_equal(log.lobe_count, 16);
        for (uint32_t i = 0; i < 16; i++) {
            const float *w = log.lobes[i].w;
            const double turn = atan2((double)w[2], (double)w[0]) / (2.0 * PI);
            heights |= 1u << (uint32_t)(16.0 * (1.0 - (double)w[1] * (double)w[1]));
            azimuths |= 1u << (uint32_t)(16.0 * (turn - floor(turn)));
        }
        assert_int_equal(heights, 0xffff);
        assert_int_equal(azimuths, 0xffff);
        direct_log_finish(&log);
    }
    environment_destroy(e);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(whole_counts_have_no_further_sample),
    cmocka_unit_test(logged_weights_are_those_of_the_balance_heuristic),
    cmocka_unit_test(lobe_samples_are_the_first_of_their_sequence),
    cmocka_unit_test(upright_under_an_even_sky),
    cmocka_unit_test(towards_a_corner_of_the_cube),
    cmocka_unit_test(light_multiplies_the_cosines),
    cmocka_unit_test(uniform_shares_are_a_sixth),
    cmocka_unit_test(cells_have_corners_of_their_own),
    cmocka_unit_test(counts_are_shares_of_the_samples),
};

UNIT_MAIN(tests)
