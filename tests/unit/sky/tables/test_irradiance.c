/* The irradiance of an open horizontal plane: closed forms against quadrature and against skies whose irradiance is
 * known. */
#include "sky/tables/environment.h"
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

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(weights_are_integrals_of_the_cosine),
    cmocka_unit_test(each_texel_counts_on_its_face),
};

UNIT_MAIN(tests)
