/* Daylight measures against closed forms. */
#include "sky/daylight/measures.h"
#include "support/unit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.14159265358979323846

/* Sensor 0 has 299, 300 or 3001 lx by the hour, sensor 1 always 50, sensor 2 exactly half of the time 300. Sensor 0 has
 * the sun in 250 hours, sensor 1 in 251. */
static void a_year_is_summed_up(void **state)
{
    struct sensor_year s[3];
    struct measures_summary m;
    double occupied = 0.0;
    int hours = 0;

    (void)state;
    memset(s, 0, sizeof(s));
    for (int day = 0; day < 365; day++)
        for (int h = 0; h < 24; h++) {
            const double clock = h + 0.5;
            const bool inside = measures_occupied(&measures_lm83, clock);
            const int n = inside ? hours++ : 0;
            const float lux[3] = { day < 73 ? 299.0f : day < 146 ? 3001.0f : 300.0f, 50.0f, n % 2 ? 300.0f : 299.9f };
            const float sun[3] = { n < 250 ? 1000.0f : 999.0f, n < 251 ? 1500.0f : 0.0f, 999.9f };
            const bool night = h < 4;
            measures_add(&measures_lm83, clock, 1.0, night ? NULL : lux, night ? NULL : inside ? sun : lux, 3, s);
            occupied += inside ? 1.0 : 0.0;
        }
    assert_true(occupied == 3650.0);
    assert_true(s[0].autonomous == 3650.0 * 0.8 && s[1].autonomous == 0.0 && s[2].autonomous == 1825.0);
    assert_true(s[0].udi[1] == 730.0 && s[0].udi[2] == 2190.0 && s[0].udi[3] == 730.0 && s[1].udi[0] == 3650.0);
    assert_true(s[0].sunlit == 250.0 && s[1].sunlit == 251.0 && s[2].sunlit == 0.0);
    assert_true(fabs(s[1].lux_hours - 50.0 * 365 * 20) < 1e-6 && s[0].lux_max == 3001.0);
    measures_summarise(&measures_lm83, s, 3, occupied, &m);
    assert_true(fabs(m.sda - 2.0 / 3.0) < 1e-12); /* sensors 0 and 2: 50 % counts */
    assert_true(fabs(m.ase - 1.0 / 3.0) < 1e-12); /* sensor 1: more than 250 hours */
    assert_true(fabs(m.udi[0] - 1.0 / 3.0) < 1e-12 && fabs(m.autonomy - (0.8 + 0.5) / 3.0) < 1e-12);

    const struct sensor_year night = { .lux_hours = 50.0 };
    measures_summarise(&measures_lm83, &night, 1, 1e-9, &m); /* no occupied hour: nothing is autonomous */
    assert_true(m.sda == 0.0 && m.ase == 0.0);
}

/* ---- Glare ---- */

#define SIDE 256

struct view {
    float luminance[SIDE * SIDE], solid_angle[SIDE * SIDE];
    float direction[SIDE * SIDE][3];
};

/* An equidistant fisheye along +X, up +Y, with a background and a disc of `radius` rad that is `high` rad above. */
static void fill(struct view *v, double background, double disc, double radius, double high)
{
    const double step = PI / SIDE, up[3] = { sin(high), cos(high), 0.0 };

    memset(v, 0, sizeof(*v));
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            const double dx = (x + 0.5 - SIDE / 2) * step, dy = (SIDE / 2 - y - 0.5) * step;
            const double angle = sqrt(dx * dx + dy * dy), s = sin(angle) / angle;
            const int i = y * SIDE + x;
            if (angle > 0.5 * PI)
                continue;
            v->direction[i][0] = (float)cos(angle);
            v->direction[i][1] = (float)(s * dy);
            v->direction[i][2] = (float)(s * dx);
            v->solid_angle[i] = (float)(step * step * s);
            const double to = cos(angle) * cos(high) + s * dy * up[0];
            v->luminance[i] = (float)(acos(fmin(1.0, to)) < radius ? disc : background);
        }
}

static void glare_of(const struct view *v, struct glare *g)
{
    const struct glare_desc d = { .width = SIDE,
                                  .height = SIDE,
                                  .luminance = v->luminance,
                                  .solid_angle = v->solid_angle,
                                  .direction = v->direction,
                                  .ahead = { 1.0, 0.0, 0.0 },
                                  .up = { 0.0, 1.0, 0.0 } };
    assert_int_equal(glare_measure(&d, g), ERR_OK);
}

/* A hemisphere of 500 cd/m2 without a source: Ev = 500 pi, DGP = 5.87e-5 Ev + 0.16. */
static void a_uniform_view_has_no_source(void **state)
{
    struct view *v = malloc(sizeof(*v));
    struct glare g;

    (void)state;
    fill(v, 500.0, 0.0, 0.0, 0.0);
    glare_of(v, &g);
    assert_int_equal(g.sources, 0);
    assert_true(fabs(g.vertical_lux / (500.0 * PI) - 1.0) < 2e-3);
    assert_true(fabs(g.dgp - (5.87e-5 * 500.0 * PI + 0.16)) < 5e-4);
    free(v);
}

/* A disc of 20,000 cd/m2 and 0.2 rad around a direction 0.5 rad above the line of sight. Its solid angle is
 * 2 pi (1 - cos 0.2), it adds L pi sin^2(0.2) cos(0.5) to Ev, and Guth's index is that of tau = 0. */
static void a_disc_has_the_probability_of_the_formula(void **state)
{
    struct view *v = malloc(sizeof(*v));
    struct glare g;
    const double lum = 20000.0, sr = 2.0 * PI * (1.0 - cos(0.2)), sigma = 0.5 * 180.0 / PI;
    const double p = exp((35.2 - 1.22) * 1e-3 * sigma + 21e-5 * sigma * sigma);
    const double ev = 300.0 * PI + (lum - 300.0) * PI * sin(0.2) * sin(0.2) * cos(0.5);
    const double want = 5.87e-5 * ev + 9.18e-2 * log10(1.0 + lum * lum * sr / (pow(ev, 1.87) * p * p)) + 0.16;

    (void)state;
    fill(v, 300.0, lum, 0.2, 0.5);
    glare_of(v, &g);
    assert_int_equal(g.sources, 1);
    assert_true(fabs(g.source_sr / sr - 1.0) < 0.01 && fabs(g.source_lum - lum) < 1.0);
    assert_true(fabs(g.vertical_lux / ev - 1.0) < 0.01);
    assert_true(fabs(g.dgp - want) < 3e-3);
    fill(v, 300.0, lum, 0.2, -0.5); /* below the line of sight: Iwata's index */
    glare_of(v, &g);
    const double below = 1.0 + 0.8 * tan(0.5);
    const double sum = lum * lum * sr / (below * below);
    assert_true(g.sources == 1 && fabs(g.dgp - glare_probability(ev, sum)) < 3e-3);
    free(v);
}

static void position_indices_are_those_of_the_papers(void **state)
{
    const double ahead[3] = { 1.0, 0.0, 0.0 }, up[3] = { 0.0, 1.0, 0.0 };
    const double on[3] = { 1.0, 0.0, 0.0 }, side[3] = { cos(0.6), 0.0, sin(0.6) };
    const double below[3] = { cos(0.3), -sin(0.3), 0.0 };
    const double sigma = 0.6 * 180.0 / PI, tau = 90.0;

    (void)state;
    assert_true(glare_position_index(on, ahead, up) == 1.0);
    const double guth = exp((35.2 - 0.31889 * tau - 1.22 * exp(-20.0)) * 1e-3 * sigma +
                            (21.0 + 0.26667 * tau - 0.002963 * tau * tau) * 1e-5 * sigma * sigma);
    assert_true(fabs(glare_position_index(side, ahead, up) - guth) < 1e-9);
    assert_true(fabs(glare_position_index(below, ahead, up) - (1.0 + 0.8 * tan(0.3))) < 1e-9);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_year_is_summed_up),
    cmocka_unit_test(a_uniform_view_has_no_source),
    cmocka_unit_test(a_disc_has_the_probability_of_the_formula),
    cmocka_unit_test(position_indices_are_those_of_the_papers),
};

UNIT_MAIN(tests)
