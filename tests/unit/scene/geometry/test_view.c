/* Fisheye views: directions, projections back and solid angles. */
#include "scene/geometry/view.h"
#include "support/unit.h"

#define PI 3.14159265358979323846
#define SIDE 200

static struct view fisheye(enum camera_projection p, double degrees)
{
    const struct camera c = { .name = "",
                              .position = { 1.0f, 2.0f, 3.0f },
                              .look_at = { 1.0f, 2.0f, 0.0f },
                              .up = { 0.0f, 1.0f, 0.0f },
                              .fov_y = (float)(degrees * PI / 180.0),
                              .projection = p };
    struct view v;

    view_init(&v, &c, SIDE, SIDE);
    return v;
}

/* The angle to -Z at a share of the circle's radius, to the right. */
static double angle_at(const struct view *v, double share)
{
    const struct vec3 w = view_direction(v, 0.5 * SIDE * (1.0 + share), 0.5 * SIDE);
    assert_true(fabs((double)w.y) < 1e-6 && w.x >= 0.0f);
    return atan2((double)w.x, -(double)w.z);
}

static void angles_follow_the_projection(void **state)
{
    const struct view even = fisheye(PROJECTION_EQUIDISTANT, 180.0), solid = fisheye(PROJECTION_EQUISOLID, 180.0);

    (void)state;
    assert_true(fabs(angle_at(&even, 0.5) - 0.25 * PI) < 1e-6 && fabs(angle_at(&even, 1.0) - 0.5 * PI) < 1e-6);
    /* sin(t / 2) in proportion: half of sin(45 degrees) */
    assert_true(fabs(angle_at(&solid, 0.5) - 2.0 * asin(0.5 * sin(0.25 * PI))) < 1e-6);
    assert_true(fabs(angle_at(&solid, 1.0) - 0.5 * PI) < 1e-6);
    assert_true(view_sees(&even, 1.0, 0.5 * SIDE) && !view_sees(&even, 5.0, 5.0) && !view_sees(&solid, 199.0, 199.0));
}

/* Solid angles of the pixels within the circle: 2 pi (1 - cos(half the angle)). */
static void solid_angles_sum_to_the_circles(void **state)
{
    static const double degrees[] = { 60.0, 180.0, 300.0 };

    (void)state;
    for (int k = 0; k < 6; k++) {
        const struct view v = fisheye(k % 2 ? PROJECTION_EQUIDISTANT : PROJECTION_EQUISOLID, degrees[k / 2]);
        const double want = 2.0 * PI * (1.0 - cos(0.5 * degrees[k / 2] * PI / 180.0));
        double sum = 0.0;
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++)
                if (view_sees(&v, x + 0.5, y + 0.5))
                    sum += view_solid_angle(&v, view_direction(&v, x + 0.5, y + 0.5));
        assert_true(fabs(sum / want - 1.0) < 2e-3);
    }
}

/* A pixel's point projects to the pixel, with the response 1 / (d^2 W). */
static void projections_return_to_the_pixel(void **state)
{
    (void)state;
    for (int k = 0; k < 200; k++) {
        const struct view v = fisheye(k % 2 ? PROJECTION_EQUIDISTANT : PROJECTION_EQUISOLID, k % 4 < 2 ? 180.0 : 250.0);
        const double x = 30.0 + 0.7 * k, y = 160.0 - 0.6 * k, distance = 0.5 + 0.1 * k;
        const struct vec3 w = view_direction(&v, x, y);
        const struct vec3 p = { (float)(1.0 + distance * w.x), (float)(2.0 + distance * w.y),
                                (float)(3.0 + distance * w.z) };
        struct projection to;
        assert_true(view_project(&v, p, &to));
        assert_true(fabs(to.x - x) < 1e-3 && fabs(to.y - y) < 1e-3 && fabs(to.distance - distance) < 1e-5);
        assert_true(fabs(to.response * distance * distance * view_solid_angle(&v, w) - 1.0) < 1e-4);
    }
}

static void free_views_name_their_projection(void **state)
{
    char text[FREE_VIEW_TEXT];
    struct camera c;
    struct reason why;

    (void)state;
    assert_int_equal(free_view_read("@1,2,3;4,5,6;180;equidistant", &c, &why), ERR_OK);
    assert_int_equal(c.projection, PROJECTION_EQUIDISTANT);
    free_view_write(&c, text);
    assert_string_equal(text, "@1,2,3;4,5,6;180;equidistant");
    assert_int_equal(free_view_read("@1,2,3;4,5,6;180", &c, &why), ERR_USAGE);
    assert_int_equal(free_view_read("@1,2,3;4,5,6;180;round", &c, &why), ERR_USAGE);
    assert_int_equal(free_view_read("@1,2,3;4,5,6;361;equisolid", &c, &why), ERR_USAGE);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(angles_follow_the_projection),
    cmocka_unit_test(solid_angles_sum_to_the_circles),
    cmocka_unit_test(projections_return_to_the_pixel),
    cmocka_unit_test(free_views_name_their_projection),
};

UNIT_MAIN(tests)
