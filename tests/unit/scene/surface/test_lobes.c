/* Materials against quadrature: under a sky of 1 without shadows, what a point sends to the viewer is its directional
 * albedo. The quadrature is written from the formulas, in double and without the project's code. */
#include "light/estimators/points.h"

struct lobe {
    enum lobe_kind kind;
    double diffuse, specular, gloss;
};

static double brdf(const struct lobe *m, double in, double out, const double w[3], const double o[3])
{
    const double pi = 3.14159265358979323846;

    if (m->kind == LOBE_PHONG) {
        const double r = -w[0] * o[0] - w[1] * o[1] + w[2] * o[2]; /* the normal is z */
        return m->diffuse / pi + (r > 0.0 ? m->specular * (m->gloss + 2.0) / (2.0 * pi) * pow(r, m->gloss) : 0.0);
    }
    double h[3] = { w[0] + o[0], w[1] + o[1], w[2] + o[2] };
    const double l = sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2]);
    for (int c = 0; c < 3; c++)
        h[c] /= l;
    const double a2 = m->gloss * m->gloss, oh = o[0] * h[0] + o[1] * h[1] + o[2] * h[2];
    const double sine2 = h[0] * h[0] + h[1] * h[1], q = a2 * h[2] * h[2] + sine2, d = a2 / (pi * q * q);
    const double lambda_in = 0.5 * (sqrt(1.0 + a2 * (1.0 / (in * in) - 1.0)) - 1.0);
    const double lambda_out = 0.5 * (sqrt(1.0 + a2 * (1.0 / (out * out) - 1.0)) - 1.0);
    const double f = m->specular + (1.0 - m->specular) * pow(1.0 - oh, 5.0);
    const double through = (1.0 - pow(1.0 - in, 5.0)) * (1.0 - pow(1.0 - out, 5.0));
    return through * m->diffuse / pi + f * d / ((1.0 + lambda_in + lambda_out) * 4.0 * in * out);
}

/* Polar coordinates about the mirror direction, their angle gamma = pi t^3: dense where a sharp lobe stands. */
static double albedo(const struct lobe *m, double cosine_out)
{
    enum { RINGS = 600, SPOKES = 180 };
    const double pi = 3.14159265358979323846;
    const double s = sqrt(1.0 - cosine_out * cosine_out);
    const double o[3] = { s, 0.0, cosine_out }, r[3] = { -s, 0.0, cosine_out };
    const double t[3] = { cosine_out, 0.0, s }, u[3] = { 0.0, 1.0, 0.0 };
    double sum = 0.0;

    for (int i = 0; i < RINGS; i++) {
        const double x = (i + 0.5) / RINGS, gamma = pi * x * x * x, ring = sin(gamma) * 3.0 * pi * x * x / RINGS;
        for (int k = 0; k < SPOKES; k++) {
            const double phi = 2.0 * pi * (k + 0.5) / SPOKES;
            double w[3];
            for (int c = 0; c < 3; c++)
                w[c] = cos(gamma) * r[c] + sin(gamma) * (cos(phi) * t[c] + sin(phi) * u[c]);
            if (w[2] > 1e-9)
                sum += brdf(m, w[2], cosine_out, w, o) * w[2] * ring * 2.0 * pi / SPOKES;
        }
    }
    return sum;
}

/* All 16 points of a packet see the same, by different numbers: their mean over a few seeds. */
static double rendered(const struct lobe *m, double cosine_out, enum method method, uint32_t samples, uint32_t seeds)
{
    static float lo[3 * PACKET];
    struct environment *e = sky_environment(sky_constant(32, 16, 1.0f), 64, 0.0);
    struct gbuffer g = points_make(1, m->kind, (float)m->diffuse, (float)m->specular, (float)m->gloss);
    struct direct *d = direct_create(best_kernels());
    double sum = 0.0;

    for (int l = 0; l < PACKET; l++) {
        g.packets[0].wo_y[l] = (float)cosine_out;
        g.packets[0].wo_x[l] = (float)sqrt(1.0 - cosine_out * cosine_out);
    }
    for (uint64_t seed = 0; seed < seeds; seed++) {
        shade(d, &g, e, method, samples, seed, lo);
        for (int l = 0; l < PACKET; l++)
            sum += lo[l] / (PACKET * (double)seeds);
    }
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
    return sum;
}

static void check(const struct lobe *m)
{
    static const double cosines[] = { 1.0, 0.8, 0.45, 0.12 };

    for (int k = 0; k < 4; k++) {
        const double want = albedo(m, cosines[k]), got = rendered(m, cosines[k], METHOD_BRDF, 1 << 14, 4);
        if (!(fabs(got / want - 1.0) < 2e-3) || want > 1.0 + 1e-3)
            printf("gloss %g, cosine %g: %.5f, quadrature %.5f\n", m->gloss, cosines[k], got, want);
        assert_true(fabs(got / want - 1.0) < 2e-3);
        assert_true(got <= 1.0 + 1e-3);
    }
}

static void phong_albedo_is_that_of_quadrature_at_every_exponent(void **state)
{
    static const double exponents[] = { 0.0, 1.0, 5.0, 20.0, 150.0, 1000.0, 1e4 };
    (void)state;
    for (size_t i = 0; i < sizeof(exponents) / sizeof(exponents[0]); i++)
        check(&(struct lobe){ LOBE_PHONG, 0.3, 0.7, exponents[i] });
}

/* In each commit at four of the ten, both ends among them. */
static void ggx_albedo_is_that_of_quadrature_at_every_roughness(void **state)
{
    (void)state;
    for (int i = 0; i < 10; i += (int)seeds_count(3, 1)) {
        static const double roughness[] = { 0.035, 0.06, 0.1, 0.2, 0.3, 0.4, 0.55, 0.7, 0.85, 1.0 };
        check(&(struct lobe){ LOBE_GGX, 0.8, 0.04, roughness[i] * roughness[i] });
        check(&(struct lobe){ LOBE_GGX, 0.0, 0.95, roughness[i] * roughness[i] });
    }
}

/* Below alpha = 1e-3 the specular lobe is a mirror's, of another estimator; beside it stands the diffuse part alone,
 * which must leave to it what that reflects. */
static void a_sharp_surface_gives_back_no_more_than_it_gets(void **state)
{
    (void)state;
    for (int i = 0; i < 4; i++) {
        static const double f0[] = { 0.02, 0.04, 0.3, 1.0 };
        const struct lobe m = { LOBE_GGX, 1.0485 * (1.0 - f0[i]), f0[i], 0.0 };
        check(&(struct lobe){ LOBE_GGX, 0.8, fmin(f0[i], 0.9), 0.0 });
        for (int k = 1; k <= 20; k++) {
            const double mirror = f0[i] + (1.0 - f0[i]) * pow(1.0 - k / 20.0, 5.0);
            assert_true(albedo(&m, k / 20.0) + mirror <= 1.0 + 1e-6);
        }
    }
}

static struct lobe white(float metallic, float roughness)
{
    const struct vec3 one = { 1.0f, 1.0f, 1.0f };
    return (struct lobe){ LOBE_GGX, (double)ggx_matte(one, metallic, roughness, (struct vec3){ 0 }).x,
                          (double)ggx_f0(one, metallic, (struct vec3){ 0 }).x, (double)roughness * (double)roughness };
}

/* Under a sky of 1 a white surface should vanish. The lobe alone, one reflection, returns 0.41 on average from the
 * roughest metal. With the matte part it returns at most 1, and a rough metal touches 1 somewhere: 1 % more or less of
 * the table of matte parts is noticed. Each commit looks at every third roughness. */
static void white_surfaces_return_nearly_everything_and_no_more(void **state)
{
    (void)state;
    for (int i = 3; i <= 20; i += (int)seeds_count(3, 1)) {
        const struct lobe metal = white(1.0f, 0.05f * (float)i), plastic = white(0.0f, 0.05f * (float)i),
                          half = white(0.5f, 0.05f * (float)i);
        double most = 0.0, mean = 0.0, weights = 0.0;
        for (int k = (int)seeds_count(2, 1); k <= 24; k += (int)seeds_count(2, 1)) {
            const double cosine = k / 24.0, returned = albedo(&metal, cosine);
            most = fmax(most, returned);
            mean += returned * cosine;
            weights += cosine;
            assert_true(albedo(&plastic, cosine) <= 1.001);
            assert_true(albedo(&half, cosine) <= 1.001);
        }
        printf("roughness %.2f: %.4f on average, %.4f at most\n", 0.05 * i, mean / weights, most);
        assert_true(most <= 1.001);
        assert_true(most >= 0.998);
        assert_true(mean / weights > 0.9);
    }
}

/* The mean loss enters the colour: each further reflection is coloured once more. f is the mean of F over a hemisphere,
 * the loss that of the lobe by quadrature. */
static void further_reflections_saturate_the_colour(void **state)
{
    (void)state;
    for (int i = 6; i <= 20; i += (int)seeds_count(4, 2)) {
        const float roughness = 0.05f * (float)i;
        const struct lobe lobe = { LOBE_GGX, 0.0, 1.0, (double)roughness * (double)roughness };
        double loss = 0.0;
        for (int k = 0; k < 40; k++)
            loss += (1.0 - albedo(&lobe, (k + 0.5) / 40.0)) * 2.0 * (k + 0.5) / 1600.0;
        const double f = 0.5 + 0.5 / 21.0, want = f * f * (1.0 - loss) / (1.0 - f * loss);
        const struct vec3 grey = ggx_matte(vec3_make(0.5f, 0.5f, 0.5f), 1.0f, roughness, (struct vec3){ 0 }),
                          one = ggx_matte(vec3_make(1.0f, 1.0f, 1.0f), 1.0f, roughness, (struct vec3){ 0 });
        assert_float_equal((double)grey.x / (double)one.x, want, 0.003);
    }
}

/* Light sampling never draws from the lobes: where it agrees with them, sampling, density and evaluation fit together.
 * Seen are differences of 1e-4. */
static void lobes_and_light_sampling_agree(void **state)
{
    static const struct lobe lobes[] = {
        { LOBE_PHONG, 0.2, 0.6, 30.0 },
        { LOBE_GGX, 0.5, 0.04, 0.2 },
        { LOBE_GGX, 0.0, 0.9, 0.36 },
    };
    (void)state;
    for (int i = 0; i < 3; i++) {
        const double by_lobes = rendered(&lobes[i], 0.6, METHOD_BRDF, 1 << 14, 4);
        const double by_light = rendered(&lobes[i], 0.6, METHOD_FACES, 1 << 15, seeds_count(4, 16));
        const double by_both = rendered(&lobes[i], 0.6, METHOD_MIS, 1 << 14, seeds_count(4, 8));
        printf("%.5f %.5f %.5f\n", by_lobes, by_light, by_both);
        assert_true(fabs(by_light / by_lobes - 1.0) < 3e-3);
        assert_true(fabs(by_both / by_lobes - 1.0) < 2e-3);
    }
}

/* A shading normal that turns away from the viewer: the viewer is taken to stand just above the surface, and what is
 * evaluated is still what is sampled. */
static void a_viewer_below_the_shading_normal_counts_as_grazing(void **state)
{
    static const double alphas[] = { 0.05, 0.2, 0.5, 1.0 }, cosines[] = { -0.3, -0.1, -0.02 };
    const double least = 1e-3;
    (void)state;
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++) {
            const struct lobe m = { LOBE_GGX, 0.4, 0.3, alphas[i] };
            const double bent = least / sqrt(1.0 - cosines[k] * cosines[k] + least * least);
            const double got = rendered(&m, cosines[k], METHOD_BRDF, 1 << 14, 4), want = albedo(&m, bent);
            if (fabs(got / want - 1.0) >= 2e-3)
                printf("alpha %g, cosine %g: %.5f, quadrature %.5f\n", alphas[i], cosines[k], got, want);
            assert_true(fabs(got / want - 1.0) < 2e-3);
        }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(phong_albedo_is_that_of_quadrature_at_every_exponent),
    cmocka_unit_test(ggx_albedo_is_that_of_quadrature_at_every_roughness),
    cmocka_unit_test(a_sharp_surface_gives_back_no_more_than_it_gets),
    cmocka_unit_test(white_surfaces_return_nearly_everything_and_no_more),
    cmocka_unit_test(further_reflections_saturate_the_colour),
    cmocka_unit_test(lobes_and_light_sampling_agree),
    cmocka_unit_test(a_viewer_below_the_shading_normal_counts_as_grazing),
};
UNIT_MAIN(tests)
