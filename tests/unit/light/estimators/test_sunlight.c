/* The sun's disc and the hours in which points see it, against closed forms: the length of a day in the open is
 * 24 / pi acos(-tan latitude tan declination), a wall along the meridian takes half of it, and an edge through the
 * disc's middle half of the disc. */
#include "light/estimators/sunlight.h"

#include "light/estimators/worlds.h"
#include "sky/daylight/sun.h"
#include "support/gbuffers.h"

enum { STEPS = 288, PICTURE = 24 };

/* A floor, and to the east of it (-X) a wall that reaches far in all directions. */
static struct scene *yard(bool wall)
{
    static const float sides[2][4][3] = { { { -900, 0, -900 }, { -900, 0, 900 }, { 900, 0, 900 }, { 900, 0, -900 } },
                                          { { -3, 0, 900 }, { -3, 0, -900 }, { -3, 900, -900 }, { -3, 900, 900 } } };
    struct scene *s = scene_create();

    add_quads(s, add_lambert(s, 0.5f), sides[0], wall ? 2 : 1);
    return s;
}

/* Mean and largest difference of the hours from `want` at latitude 45 on a day. */
static void hours_of(bool wall, int day, double want, double *mean, double *most)
{
    static const struct camera above = { "above", { 4.0f, 6.0f, 0.5f }, { 4.0f, 0, 0 }, { 0, 1, 0 }, 0.3f };
    const struct sun_day at = { .latitude = 0.25 * PI, .day = day, .solar = true };
    struct sun_step steps[STEPS];
    size_t count = 0, points = 0;
    struct world w;

    world_make(&w, yard(wall), &above, PICTURE, PICTURE, sky_environment(sky_constant(32, 16, 1.0f), 16, 0.0));
    struct gbuffer *g = gbuffer_of(w.scene, w.rays, &(struct gbuffer_desc){ &above, PICTURE, PICTURE });
    for (int k = 0; k < STEPS; k++) {
        double a[3], b[3];
        sun_day_at(&at, 24.0 * k / STEPS, a);
        sun_day_at(&at, 24.0 * (k + 1) / STEPS, b);
        struct sun_step *s = &steps[count++];
        for (int i = 0; i < 3; i++) {
            s->from[i] = (float)a[i];
            s->to[i] = (float)b[i];
        }
        s->hours = 24.0f / STEPS;
    }
    float *hours = calloc((size_t)g->packet_count * PACKET, sizeof(*hours));
    sunlight_hours(g, w.rays, steps, count, NULL, hours);
    *mean = *most = 0.0;
    for (size_t i = 0; i < (size_t)g->packet_count * PACKET; i++)
        if (g->packets[i / PACKET].valid[i % PACKET]) {
            *mean += hours[i] - want;
            *most = fmax(*most, fabs(hours[i] - want));
            points++;
        }
    *mean /= (double)points;
    assert_true(points >= PICTURE * PICTURE);
    free(hours);
    gbuffer_destroy(g);
    world_finish(&w);
}

/* The light begins and ends within a step of five minutes, or two by the width of the disc: so much may a point be off,
 * and the mean of 576 points far less. Next to the wall the sun is half a degree late, two minutes. */
static void days_have_the_length_of_the_closed_form(void **state)
{
    static const int days[] = { 79, 172, 355 };

    (void)state;
    for (size_t k = 0; k < 3; k++) {
        double noon[3], mean, most;
        sky_sun_place(0.25 * PI, days[k], 12.0, noon);
        const double declination = asin(noon[1]) - 0.25 * PI, day = 24.0 / PI * acos(-tan(declination));
        hours_of(false, days[k], day, &mean, &most);
        printf("day %d: %.2f hours, %.3f off, %.3f at most\n", days[k], day, mean, most);
        assert_true(fabs(mean) < 0.04 && most < 0.34);
        hours_of(true, days[k], 0.5 * day, &mean, &most);
        printf("     a wall: %.3f off, %.3f at most\n", mean, most);
        assert_true(fabs(mean) < 0.04 && most < 0.34);
    }
}

static void an_edge_through_the_middle_leaves_half_of_the_disc(void **state)
{
    const struct sensor at = { { 0.0f, 1.0f, 0.0f }, { 0.0f, 1.0f, 0.0f } };
    const double edge = asin(3.0 / sqrt(9.0 + 899.0 * 899.0)); /* of the wall's top, from the zenith */
    struct world w;

    (void)state;
    world_make(&w, yard(true), &corner_camera, 8, 8, sky_environment(sky_constant(32, 16, 1.0f), 16, 0.0));
    for (int k = -2; k <= 2; k++) { /* in radii of the disc */
        const double beyond = edge + 0.6 * k * SUN_RADIUS, sun[3] = { -sin(beyond), cos(beyond), 0.0 };
        const double x = fmin(1.0, fmax(-1.0, 0.6 * k)), want = (acos(x) - x * sqrt(1.0 - x * x)) / PI;
        const double share = sunlight_share(w.scene, w.rays, &at, sun);
        printf("%.1f radii beyond the edge: %.3f seen, %.3f by the closed form\n", 0.6 * k, share, want);
        assert_true(fabs(share - want) < 0.09); /* sixteen rays */
    }
    const double below[3] = { 0.6, -0.8, 0.0 };
    assert_true(sunlight_share(w.scene, w.rays, &at, below) == 0.0);
    world_finish(&w);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(days_have_the_length_of_the_closed_form),
    cmocka_unit_test(an_edge_through_the_middle_leaves_half_of_the_disc),
};
UNIT_MAIN(tests)
