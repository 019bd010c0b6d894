/* Sensors: grids over surfaces, files, their light and the sun's disc alone. */
#include "base/luminance.h"
#include "base/mem.h"
#include "scene/geometry/gbuffer.h"
#include "scene/surface/scatter.h"
#include "support/unit.h"
#include "light/estimators/sunlight.h"
#include "year/points.h"

#include <unistd.h>

/* A slab of 4 m x 2 m, 0.1 m thick, with its top at height 1, in the built-in scene's way: two triangles each side. */
static struct scene *slab(void)
{
    static const float corners[8][3] = { { -2, 1, -1 },    { 2, 1, -1 },    { 2, 1, 1 },    { -2, 1, 1 },
                                         { -2, 0.9f, -1 }, { 2, 0.9f, -1 }, { 2, 0.9f, 1 }, { -2, 0.9f, 1 } };
    static const uint32_t triangles[4][3] = { { 0, 2, 1 }, { 0, 3, 2 }, { 4, 5, 6 }, { 4, 6, 7 } };
    struct scene *s = calloc(1, sizeof(*s));

    s->mesh_count = s->material_count = 1;
    s->meshes = calloc(1, sizeof(*s->meshes));
    s->materials = calloc(1, sizeof(*s->materials));
    strcpy(s->meshes[0].name, "table");
    strcpy(s->materials[0].name, "wood");
    s->meshes[0].vertex_count = 8;
    s->meshes[0].triangle_count = 4;
    s->meshes[0].positions = calloc(8 * 3 + 1, sizeof(float));
    s->meshes[0].indices = calloc(4 * 3, sizeof(uint32_t));
    memcpy(s->meshes[0].positions, corners, sizeof(corners));
    memcpy(s->meshes[0].indices, triangles, sizeof(triangles));
    return s;
}

static void discard(struct scene *s)
{
    free(s->meshes[0].positions);
    free(s->meshes[0].indices);
    free(s->meshes);
    free(s->materials);
    free(s);
}

static void a_grid_lies_over_the_upper_side(void **state)
{
    struct scene *s = slab();
    struct points p;
    struct reason why = { "" };

    (void)state;
    assert_int_equal(points_read("grid:table,spacing=0.5,height=0.25", s, &p, &why), ERR_OK);
    assert_int_equal(p.count, 8 * 4);
    for (size_t i = 0; i < p.count; i++) {
        assert_true(fabsf(p.at[i].position.y - 1.25f) < 1e-6f && p.at[i].normal.y > 0.9999f);
        assert_true(fabsf(p.at[i].position.x) < 1.76f && fabsf(p.at[i].position.z) < 0.76f);
    }
    assert_true(fabsf(p.at[0].position.x + 1.75f) < 1e-6f && fabsf(p.at[0].position.z + 0.75f) < 1e-6f);
    points_finish(&p);
    assert_int_equal(points_read("grid:wood,margin=0.5,spacing=1,height=0", s, &p, &why), ERR_OK); /* by its material */
    assert_int_equal(p.count, 3);
    points_finish(&p);
    discard(s);
}

static void bad_grids_are_refused(void **state)
{
    static const struct {
        const char *spec, *expected;
    } cases[] = { { "grid:", "the surface's name is missing" },
                  { "grid:roof", "no surface 'roof'; it has table, wood" },
                  { "grid:table,spacing=0", "spacing=0 is not a number from 0.01" },
                  { "grid:table,size=3", "unknown key 'size=3'" },
                  { "grid:table,margin=3", "no point of the grid lies over the surface, which is 4 m x 2 m" },
                  { "/nowhere/s.txt", "No such file" } };
    struct scene *s = slab();

    (void)state;
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        struct reason why = { "" };
        struct points p;
        assert_int_not_equal(points_read(cases[k].spec, s, &p, &why), ERR_OK);
        if (!strstr(why.text, cases[k].expected))
            fail_msg("%s: '%s'; expected '%s'", cases[k].spec, why.text, cases[k].expected);
    }
    discard(s);
}

static void files_are_read_line_by_line(void **state)
{
    static const char text[] = "# a comment\n1 2 3 0 0 -2\n\n1.5,2 , 3,\t0,1,0 # above\n";
    char path[] = "/tmp/points.XXXXXX";
    const int fd = mkstemp(path);
    struct scene *scene = slab();
    struct points p;
    struct reason why;

    (void)state;
    scene->origin[0] = 0.5; /* what the scene was moved by: files keep their own coordinates */
    assert_true(write(fd, text, sizeof(text) - 1) == (ssize_t)sizeof(text) - 1);
    close(fd);
    assert_int_equal(points_read(path, scene, &p, &why), ERR_OK);
    assert_int_equal(p.count, 2);
    assert_true(p.at[0].normal.z == -1.0f && p.at[1].position.x == 1.0f && p.at[1].normal.y == 1.0f);
    assert_true(fabs(p.spacing - 0.5) < 1e-6);
    points_finish(&p);
    discard(scene);
    unlink(path);
}

static void bad_lines_are_refused(void **state)
{
    static const struct {
        const char *text, *expected;
    } cases[] = { { "1 2 3 0 1 0\n1,,2 3 0 1 0\n", "line 2: number 2 of" },
                  { "1 2 3 0 1 0,\n", "line 1: more than the six numbers" },
                  { "1 2 3 0 1\n", "line 1: number 6 of" },
                  { "1 2 3 0 0 0\n", "line 1: the normal has zero length" } };

    struct scene *scene = slab();
    (void)state;
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        char path[] = "/tmp/points.XXXXXX";
        const int fd = mkstemp(path);
        struct points p;
        struct reason why = { "" };
        assert_true(write(fd, cases[k].text, strlen(cases[k].text)) == (ssize_t)strlen(cases[k].text));
        close(fd);
        assert_int_equal(points_read(path, scene, &p, &why), ERR_FORMAT);
        unlink(path);
        if (!strstr(why.text, cases[k].expected))
            fail_msg("'%s'; expected '%s'", why.text, cases[k].expected);
    }
    discard(scene);
}

/* Above the slab: all of the sun, times the cosine; below it, nothing; on its edge, about half; facing away, nothing.
 */
static void the_suns_disc_is_seen_or_not(void **state)
{
    const double sun[3] = { 0.6, 0.8, 0.0 };
    const struct vec3 up = { 0.0f, 1.0f, 0.0f }, down = { 0.0f, -1.0f, 0.0f };
    /* the last one sees the edge x = -2, y = 1 in the disc's middle, from 4 m away */
    const struct sensor at[4] = { { { 0.0f, 2.0f, 0.0f }, up },
                                  { { 0.0f, 0.5f, 0.0f }, up },
                                  { { 0.0f, 2.0f, 0.0f }, down },
                                  { { -2.0f - 0.6f * 4.0f, 1.0f - 0.8f * 4.0f, 0.0f }, up } };
    struct scene *s = slab();
    float lux[4];

    (void)state;
    struct rays *rays = rays_create_for(s, cpu_best());
    sunlight_lux(s, rays, at, 4, sun, 50000.0, lux);
    assert_true(fabsf(lux[0] - 40000.0f) < 0.1f && lux[1] == 0.0f && lux[2] == 0.0f);
    assert_true(lux[3] > 40000.0f * 0.3f && lux[3] < 40000.0f * 0.7f);
    rays_destroy(rays);
    discard(s);
}

static void a_sensor_within_a_solid_is_found(void **state)
{
    const struct vec3 up = { 0.0f, 1.0f, 0.0f };
    struct sensor at[3] = { { { 0.0f, 1.5f, 0.0f }, up }, { { 0.0f, 0.5f, 0.0f }, up }, { { 0.0f, 0.95f, 0.0f }, up } };
    const struct points p = { .at = at, .count = 3 };
    struct scene *s = slab();
    size_t first = 0;

    (void)state;
    struct rays *rays = rays_create_for(s, cpu_best());
    assert_int_equal(points_enclosed(&p, s, rays, &first), 1);
    assert_int_equal(first, 2);
    at[2].normal.y = -1.0f;  /* the lower side's back */
    at[0].position.y = 1.0f; /* on the upper side */
    assert_int_equal(points_enclosed(&p, s, rays, &first), 1);
    s->materials[0].kind = MATERIAL_GLASS;
    assert_int_equal(points_enclosed(&p, s, rays, &first), 0);
    rays_destroy(rays);
    discard(s);
}

/* Below a slab of tinted thin glass, whose two sides the sun crosses: its light times their transmittance, twice. */
static void the_sun_behind_a_tinted_pane_is_weighted_by_its_transmittance(void **state)
{
    static const float tints[3] = { 0.05f, 0.5f, 0.97f };
    const double sun[3] = { 0.6, 0.8, 0.0 };
    const struct sensor at = { { 0.0f, 0.5f, 0.0f }, { 0.0f, 1.0f, 0.0f } };
    struct scene *s = slab();

    (void)state;
    for (int k = 0; k < 3; k++) {
        const struct vec3 tint = vec3_make(tints[k], 0.8f * tints[k], 0.5f * tints[k]);
        float lux;
        s->materials[0] = (struct material){ .kind = MATERIAL_GLASS, .diffuse = tint, .ior = 1.5f, .thin = 1 };
        s->materials[0].texture = s->materials[0].alpha_texture = MATERIAL_NO_TEXTURE;
        const struct vec3 once = thin_glass_at(1.5f, tint, 0.8f).passed;
        const double twice[3] = { once.x * once.x, once.y * once.y, once.z * once.z };
        struct rays *rays = rays_create_for(s, cpu_best());
        sunlight_lux(s, rays, &at, 1, sun, 50000.0, &lux);
        const double want = 40000.0 * luminance_of(LUMINANCE_REC709, twice);
        if (!(fabs(lux - want) < 2e-3 * want)) /* the disc is not a point */
            fail_msg("a tint of %g: %g lx; expected %g", (double)tints[k], (double)lux, want);
        rays_destroy(rays);
    }
    discard(s);
}

static void sensors_follow_the_cameras_packets(void **state)
{
    struct gbuffer g = { .packets = mem_alloc(3, sizeof(struct shade_packet)), .packet_count = 3, .point_count = 40 };
    const struct sensor at[2] = { { { 1.0f, 2.0f, 3.0f }, { 0.0f, 1.0f, 0.0f } },
                                  { { 4.0f, 5.0f, 6.0f }, { 1.0f, 0.0f, 0.0f } } };
    static float lo[5 * 3 * PACKET];
    uint32_t first;
    double rgb[3];

    (void)state;
    g.packets[1].x[3] = 7.0f;
    assert_int_equal(gbuffer_add_sensors(&g, at, 2, &first), ERR_OK);
    assert_int_equal(first, 3);
    assert_int_equal(g.packet_count, 5);
    assert_int_equal(g.point_count, 40 + 32);
    assert_true(g.packets[1].x[3] == 7.0f && g.packets[4].x[15] == 4.0f && g.packets[4].ns_x[0] == 1.0f);
    for (int l = 0; l < PACKET; l++) { /* all at places of their own, across the normal */
        const float y = g.packets[4].y[l] - 5.0f, z = g.packets[4].z[l] - 6.0f;
        assert_true(y * y + z * z <= SENSOR_RADIUS * SENSOR_RADIUS * 1.001f);
        for (int k = 0; k < l; k++)
            assert_true(g.packets[4].y[k] != g.packets[4].y[l] || g.packets[4].z[k] != g.packets[4].z[l]);
    }
    for (int l = 0; l < PACKET; l++)
        lo[(4 * 3 + 1) * PACKET + l] = (float)l;
    sensor_radiance(lo, 4, rgb);
    assert_true(rgb[0] == 0.0 && fabs(rgb[1] - 7.5) < 1e-9);
    mem_free(g.packets);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_grid_lies_over_the_upper_side),
    cmocka_unit_test(bad_grids_are_refused),
    cmocka_unit_test(files_are_read_line_by_line),
    cmocka_unit_test(bad_lines_are_refused),
    cmocka_unit_test(the_sun_behind_a_tinted_pane_is_weighted_by_its_transmittance),
    cmocka_unit_test(the_suns_disc_is_seen_or_not),
    cmocka_unit_test(a_sensor_within_a_solid_is_found),
    cmocka_unit_test(sensors_follow_the_cameras_packets),
};

UNIT_MAIN(tests)
