/* The irradiance of open planes: closed forms against quadrature and against skies whose irradiance is known; of any
 * normal, against closed forms and the horizontal plane's. */
#include "sky/tables/irradiance.h"
#include "base/rng.h"
#include "support/skies.h"

#include "sky/tables/cube.h"

enum { N = 16 };

/* max(0, w.y) over part of a face by the midpoint rule. */
static double by_quadrature(uint32_t face, double u0, double v0, double step)
{
    enum { POINTS = 64 };
    double sum = 0.0;

    for (int k = 0; k < POINTS * POINTS; k++) {
        const double u = u0 + step * (k % POINTS + 0.5) / POINTS, v = v0 + step * (k / POINTS + 0.5) / POINTS;
        double w[3];
        cube_direction(face, u, v, w);
        sum += fmax(0.0, w[1]) / pow(1.0 + u * u + v * v, 2.0);
    }
    return sum * step * step / (POINTS * POINTS);
}

static void weights_are_integrals_of_the_cosine(void **state)
{
    static double weights[2 * N * N];
    double all = 0.0, worst = 0.0;
    (void)state;

    irradiance_weights(N, weights);
    for (uint32_t k = 0; k < N * N; k++) {
        const double u = -1.0 + 2.0 * (k % N) / N, v = -1.0 + 2.0 * (k / N) / N;
        all += weights[k] + 4.0 * weights[N * N + k];
        worst = fmax(worst, fabs(weights[k] / by_quadrature(2, u, v, 2.0 / N) - 1.0));
        if (v >= 0.0) /* face +Z has rows along +Y */
            worst = fmax(worst, fabs(weights[N * N + k] / by_quadrature(4, u, v, 2.0 / N) - 1.0));
        else
            assert_true(weights[N * N + k] == 0.0);
    }
    printf("worst texel %.2g, sum %.2g off pi\n", worst, all / PI - 1.0);
    assert_true(worst < 1e-5 && fabs(all / PI - 1.0) < 1e-12);
    irradiance_weights(1, weights);
    assert_true(fabs((weights[0] + 4.0 * weights[1]) / PI - 1.0) < 1e-12);
}

/* Every texel of the cube map lit alone, on the face where it is. */
static void each_texel_counts_on_its_face(void **state)
{
    struct environment *e = sky_environment(sky_constant(64, 32, 1.0f), N, 0.0);
    static double weights[2 * N * N];
    double worst = 0.0;
    (void)state;

    irradiance_weights(N, weights);
    for (uint32_t k = 0; k < CUBE_FACES * N * N; k++) {
        const uint32_t face = k / (N * N);
        const double u = -1.0 + 2.0 * (k % N) / N, v = -1.0 + 2.0 * (k / N % N) / N;
        double rgb[3];
        for (uint32_t i = 0; i < CUBE_FACES * N * N; i++)
            e->texels[i] = (struct texel){ i == k ? 1.0f : 0.0f, i == k ? 2.0f : 0.0f, 0.0f, 0.0f };
        irradiance_upward(e, weights, rgb);
        worst = fmax(worst, fabs(rgb[0] - by_quadrature(face, u, v, 2.0 / N)));
        assert_true(rgb[1] == 2.0 * rgb[0] && rgb[2] == 0.0);
    }
    printf("worst %.2g\n", worst);
    assert_true(worst < 1e-7);
    environment_destroy(e);
}

/* Under an even sky of 1 the integrals of c and c (1 - (1 - c)^5) over the hemisphere are pi and 20/21 pi. */
static void an_even_sky_lights_all_normals_alike(void **state)
{
    static struct irradiance r;
    struct environment *e = sky_environment(sky_constant(64, 32, 1.0f), 64, 0.0);
    const double want[IRRADIANCE_KINDS] = { PI, PI * 20.0 / 21.0 };
    double worst[IRRADIANCE_KINDS] = { 0.0 }, mean[IRRADIANCE_KINDS] = { 0.0 };
    struct rng rng = { 5 };
    (void)state;

    irradiance_build(&r, e, NULL);
    for (int i = 0; i < 4000; i++) {
        const double y = 2.0 * rng_next(&rng) - 1.0, phi = 2.0 * PI * rng_next(&rng), s = sqrt(1.0 - y * y);
        const float n[3] = { (float)(s * sin(phi)), (float)y, (float)(s * cos(phi)) };
        for (int k = 0; k < IRRADIANCE_KINDS; k++) {
            float rgb[3];
            irradiance_at(&r, (enum irradiance_kind)k, n, rgb);
            worst[k] = fmax(worst[k], fabs((double)rgb[1] / want[k] - 1.0));
            mean[k] += ((double)rgb[1] / want[k] - 1.0) / 4000.0;
        }
    }
    printf("worst %.2g, %.2g; mean %.2g, %.2g\n", worst[0], worst[1], mean[0], mean[1]);
    assert_true(worst[0] < 1e-3 && worst[1] < 2e-3);
    assert_true(fabs(mean[0]) < 2e-4 && fabs(mean[1]) < 1e-3);
    environment_destroy(e);
}

/* A soft sun anywhere, turned above the plane that faces upward; and one small light, of which a normal takes its
 * cosine. */
static void any_normal_takes_a_skys_light_by_its_cosine(void **state)
{
    static struct irradiance r;
    static double weights[2 * 64 * 64];
    double worst = 0.0, alone = 0.0;
    (void)state;

    irradiance_weights(64, weights);
    for (uint32_t k = 0; k < 64; k++) {
        struct frame f = sky_constant(64, 32, 0.2f);
        for (uint32_t x = 0; x < 8; x++)
            for (uint32_t y = 0; y < 6; y++)
                sky_paint(&f, (11 * k + x) % 64, (5 * k) % 20 + y, 20.0f, 10.0f, 5.0f);
        struct environment *e = sky_environment(f, 64, 0.0);
        double up[3];
        float rgb[3];
        irradiance_upward(e, weights, up);
        irradiance_build(&r, e, NULL);
        irradiance_at(&r, IRRADIANCE_COSINE, (float[]){ 0.0f, 1.0f, 0.0f }, rgb);
        for (int c = 0; c < 3; c++)
            worst = fmax(worst, fabs((double)rgb[c] / up[c] - 1.0));
        environment_destroy(e);
    }
    struct frame f = sky_constant(64, 32, 0.0f);
    sky_paint(&f, 21, 9, 1000.0f, 1000.0f, 1000.0f);
    struct environment *e = sky_environment(f, 64, 0.0);
    double flux = 0.0, place[3] = { 0.0 };
    for (uint32_t k = 0; k < CUBE_FACES * 64 * 64; k++) {
        double d[3];
        const double g = (double)e->texels[k].g * e->solid_angle[k % (64 * 64)];
        cube_direction(k / (64 * 64), -1.0 + (k % 64 + 0.5) / 32.0, -1.0 + (k / 64 % 64 + 0.5) / 32.0, d);
        const double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        flux += g;
        for (int c = 0; c < 3; c++)
            place[c] += g * d[c] / length;
    }
    irradiance_build(&r, e, NULL);
    struct rng rng = { 6 };
    for (int i = 0; i < 4000; i++) {
        const double y = 2.0 * rng_next(&rng) - 1.0, phi = 2.0 * PI * rng_next(&rng), s = sqrt(1.0 - y * y);
        const double n[3] = { s * sin(phi), y, s * cos(phi) };
        const double want = fmax(0.0, n[0] * place[0] + n[1] * place[1] + n[2] * place[2]) / flux;
        float rgb[3];
        irradiance_at(&r, IRRADIANCE_COSINE, (float[]){ (float)n[0], (float)n[1], (float)n[2] }, rgb);
        alone = fmax(alone, fabs((double)rgb[1] / flux - want));
    }
    printf("a soft sun: worst %.2g; one light: worst %.2g of its own\n", worst, alone);
    assert_true(worst < 2e-3 && alone < 0.03);
    environment_destroy(e);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(an_even_sky_lights_all_normals_alike),
    cmocka_unit_test(any_normal_takes_a_skys_light_by_its_cosine),
    cmocka_unit_test(weights_are_integrals_of_the_cosine),
    cmocka_unit_test(each_texel_counts_on_its_face),
};

UNIT_MAIN(tests)
