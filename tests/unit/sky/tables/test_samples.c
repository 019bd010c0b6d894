/* Light samples: densities integrate to 1, samples follow them, and no light is left without density. */
#include "sky/tables/samples.h"

#include "sky/tables/sampling.h"

/* Midpoint rule on a grid much finer than the texels. */
static void densities_integrate_to_one(void **state)
{
    (void)state;
    for (int s = 0; s < SKY_COUNT; s++) {
        struct environment *e = make_sky(s);
        const uint32_t fine = e->n * (e->n > 4 ? 8 : 64);
        for (uint32_t face = 0; face < 6; face++) {
            double sum = 0.0;
            for (uint32_t i = 0; i < fine; i++)
                for (uint32_t j = 0; j < fine; j++) {
                    const double u = -1.0 + 2.0 * (j + 0.5) / fine, v = -1.0 + 2.0 * (i + 0.5) / fine;
                    double d[3];
                    float rgb[3], pdf;
                    cube_direction(face, u, v, d);
                    const float w[3] = { (float)d[0], (float)d[1], (float)d[2] };
                    assert_int_equal(environment_evaluate(e, w, rgb, &pdf), face);
                    sum += pdf / cube_jacobian((float)u, (float)v) * 4.0 / fine / fine;
                }
            if (e->energy[face] > 0.0)
                assert_true(fabs(sum - 1.0) < 1e-4);
            else
                assert_true(sum == 0.0);
        }
        environment_destroy(e);
    }
}

static void every_lit_texel_has_density(void **state)
{
    (void)state;
    for (int s = 0; s < SKY_COUNT; s++) {
        struct environment *e = make_sky(s);
        for (size_t t = 0; t < 6 * (size_t)e->n * e->n; t++) {
            const bool lit = e->texels[t].r > 0 || e->texels[t].g > 0 || e->texels[t].b > 0;
            assert_int_equal(lit, e->texels[t].density > 0);
        }
        environment_destroy(e);
    }
}

/* Counts of 2^17 pseudo-random inversions per texel against luminance x solid angle; texels of small expectation are
 * pooled. One test per lit face: the threshold of 1e-6 is passed by chance once in about 30000 runs of the suite, and a
 * table whose rows are off by 1 % fails (tried by scaling every other row). */
static void samples_follow_luminance_times_solid_angle(void **state)
{
    enum { N = 1 << 17 };
    (void)state;
    for (int s = 0; s < SKY_COUNT; s++) {
        struct environment *e = make_sky(s);
        const uint32_t n = e->n;
        uint32_t *count = mem_alloc((size_t)n * n, sizeof(*count));
        for (uint32_t face = 0; face < 6; face++) {
            struct rng r = { rng_mix(77, 6 * (uint64_t)s + face) };
            if (!(e->energy[face] > 0.0))
                continue;
            memset(count, 0, (size_t)n * n * sizeof(*count));
            for (int k = 0; k < N; k++) {
                const double x[2] = { rng_next(&r), rng_next(&r) };
                float w[3], u, v;
                samples_invert_face(e, face, x, w);
                assert_int_equal(cube_locate(w, &u, &v), face);
                const uint32_t i = (uint32_t)((v + 1.0f) * 0.5f * (float)n),
                               j = (uint32_t)((u + 1.0f) * 0.5f * (float)n);
                count[(i < n ? i : n - 1) * n + (j < n ? j : n - 1)]++;
            }
            double chi = 0.0, pooled_want = 0.0, pooled_got = 0.0;
            int cells = 0;
            for (uint32_t t = 0; t < n * n; t++) {
                const struct texel *texel = &e->texels[(size_t)face * n * n + t];
                const double want =
                    N * rgb_luminance(texel->r, texel->g, texel->b) * e->solid_angle[t] / e->energy[face];
                pooled_want += want;
                pooled_got += count[t];
                if (pooled_want >= 20.0 || t == n * n - 1) {
                    if (pooled_want > 0.0) {
                        chi += (pooled_got - pooled_want) * (pooled_got - pooled_want) / pooled_want;
                        cells++;
                    } else {
                        assert_true(pooled_got == 0.0);
                    }
                    pooled_want = pooled_got = 0.0;
                }
            }
            if (cells > 1)
                assert_true(chi_square_tail(chi, cells - 1) > 1e-6);
        }
        mem_free(count);
        environment_destroy(e);
    }
}

/* Where in the sun's texel and beside it the samples go is decided by numbers with more bits than float: with a sun of
 * 1e6 the dim texels of its face still get their share. */
static void the_dim_part_beside_a_sun_is_sampled_in_proportion(void **state)
{
    (void)state;
    struct environment *e = make_sky(SKY_SUN);
    uint32_t face = 0;
    for (uint32_t f = 1; f < 6; f++)
        face = e->energy[f] > e->energy[face] ? f : face;
    double dim = 0.0;
    const double mean = e->energy[face] / (4.0 * PI / 6.0);
    for (uint32_t t = 0; t < e->n * e->n; t++) {
        const struct texel *x = &e->texels[(size_t)face * e->n * e->n + t];
        const double l = rgb_luminance(x->r, x->g, x->b);
        dim += l < mean ? l * e->solid_angle[t] : 0.0;
    }
    const double share = dim / e->energy[face];
    enum { N = 1 << 21 };
    uint32_t got = 0;
    for (uint32_t k = 0; k < N; k++) {
        struct rng r = { rng_mix(5, k) };
        const double x[2] = { rng_next(&r), rng_next(&r) };
        float w[3], rgb[3], pdf;
        samples_invert_face(e, face, x, w);
        environment_evaluate(e, w, rgb, &pdf);
        got += rgb_luminance(rgb[0], rgb[1], rgb[2]) < mean;
    }
    assert_true(share * N > 30.0); /* else the test says nothing */
    assert_true(fabs(got - share * N) < 6.0 * sqrt(share * N));
    environment_destroy(e);
}

static void drawn_samples_are_unit_and_consistent(void **state)
{
    struct light_samples s = { 0 };
    (void)state;
    for (int which = 0; which < SKY_COUNT; which++) {
        struct environment *e = make_sky(which);
        for (int kind = STRATA_SPHERE; kind <= STRATA_FACES; kind++) {
            assert_int_equal(samples_draw(e, (enum strata_kind)kind, 64, 3, &s), ERR_OK);
            for (uint32_t k = 0; k < s.first[s.strata]; k++) {
                const float l = s.x[k] * s.x[k] + s.y[k] * s.y[k] + s.z[k] * s.z[k];
                assert_true(fabsf(l - 1.0f) < 1e-5f);
                assert_true(s.pdf[k] > 0.0f && isfinite(s.pdf[k]));
            }
        }
        environment_destroy(e);
    }
    samples_finish(&s);
}

static void black_faces_get_no_samples(void **state)
{
    struct light_samples s = { 0 };
    (void)state;
    struct environment *e = make_sky(SKY_SEAM);
    assert_int_equal(samples_draw(e, STRATA_FACES, 16, 0, &s), ERR_OK);
    for (uint32_t f = 0; f < 6; f++)
        assert_int_equal(s.first[f + 1] - s.first[f], e->energy[f] > 0.0 ? 16 : 0);
    samples_finish(&s);
    environment_destroy(e);
}

/* A sky of one colour: what luminance makes of it is known. */
static void texels_are_weighed_by_luminance(void **state)
{
    struct environment *e = environment_create(&(struct environment_desc){ .n = 8 });
    struct frame f = sky_constant(2, 1, 0.0f);
    struct reason why;
    (void)state;

    assert_non_null(e);
    for (uint32_t x = 0; x < 2; x++)
        sky_paint(&f, x, 0, 0.5f, 0.25f, 1.0f);
    assert_int_equal(environment_update(e, &f, &why), ERR_OK);
    assert_true(fabs(e->total_energy / (4.0 * PI) - (0.2126 * 0.5 + 0.7152 * 0.25 + 0.0722 * 1.0)) < 1e-6);
    frame_finish(&f);
    environment_destroy(e);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(densities_integrate_to_one),
    cmocka_unit_test(every_lit_texel_has_density),
    cmocka_unit_test(samples_follow_luminance_times_solid_angle),
    cmocka_unit_test(the_dim_part_beside_a_sun_is_sampled_in_proportion),
    cmocka_unit_test(drawn_samples_are_unit_and_consistent),
    cmocka_unit_test(black_faces_get_no_samples),
    cmocka_unit_test(texels_are_weighed_by_luminance),
};
UNIT_MAIN(tests)
