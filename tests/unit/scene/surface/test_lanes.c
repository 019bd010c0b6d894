/* The functions of lanes against the library's in double precision, colours one by one, and where sampled mirror
 * directions lie: what coarser tests of lobes average away. */
#include "light/estimators/points.h"

#include "scene/surface/lobe.h"
#include "scene/surface/lobes.h"

/* 400,000 numbers over all exponents, and many next to 1, where a sharp lobe lives: both within 4e-7, which a
 * coefficient of any term but the last would break by 1e-6 and more; the last one is held by the numbers farthest
 * from 1. */
static void logarithms_and_powers_are_the_librarys(void **state)
{
    struct rng r = { 3 };
    double log_worst = 0.0, power_worst = 0.0, turn_worst = 0.0;
    (void)state;

    for (int k = 0; k < 200000; k++) {
        const float wide = (float)exp2(250.0 * rng_next(&r) - 125.0), close = (float)(0.6 + 0.9 * rng_next(&r));
        const float x = k % 2 ? wide : close, y = (float)(250.0 * rng_next(&r) - 125.0), turn = (float)rng_next(&r);
        float sine, cosine;
        const double log = log2((double)x), power = exp2((double)y);
        log_worst = fmax(log_worst, fabs((double)lane_log2(x) - log) / fmax(fabs(log), 1e-30));
        power_worst = fmax(power_worst, fabs((double)lane_exp2(y) - power) / power);
        lane_sincos(turn, &sine, &cosine);
        turn_worst = fmax(turn_worst, fabs((double)sine - sin(2.0 * PI * (double)turn)));
        turn_worst = fmax(turn_worst, fabs((double)cosine - cos(2.0 * PI * (double)turn)));
    }
    printf("log2 %.2g, exp2 %.2g, sine and cosine %.2g\n", log_worst, power_worst, turn_worst);
    assert_true(log_worst < 3e-7 && power_worst < 3e-7 && turn_worst < 2e-7);
    assert_true(lane_exp2(-127.0f) == 0.0f && lane_power(0.0f, 2.0f) == 0.0f && lane_power(-1.0f, 2.0f) == 0.0f);
}

/* A matte surface scatters each colour by its own share of 1 / pi, times the cosine. */
static void matte_colours_are_their_own(void **state)
{
    static const float colours[3] = { 0.8f, 0.3f, 0.05f };
    struct shade_packet p = { .kind = LOBE_LAMBERT, .count = PACKET };
    struct lanes d[3] = { { { 0.0f } } }, cosine, brdf[3], pdf;
    struct lobes s;
    (void)state;

    for (int l = 0; l < PACKET; l++) {
        p.ns_y[l] = p.ng_y[l] = p.wo_y[l] = 1.0f;
        d[1].v[l] = 1.0f - 0.05f * (float)l;
        d[0].v[l] = sqrtf(1.0f - d[1].v[l] * d[1].v[l]);
        cosine.v[l] = d[1].v[l];
        for (int c = 0; c < 3; c++)
            p.diffuse[c][l] = colours[c];
    }
    lobes_set_up(&p, &s);
    lobes_evaluate(&s, &p, d, &cosine, brdf, &pdf);
    for (int l = 0; l < PACKET; l++)
        for (int c = 0; c < 3; c++)
            assert_true(fabs((double)brdf[c].v[l] - (double)colours[c] * (double)d[1].v[l] / PI) < 1e-6);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(logarithms_and_powers_are_the_librarys),
    cmocka_unit_test(matte_colours_are_their_own),
};
UNIT_MAIN(tests)
