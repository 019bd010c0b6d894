#include "import/reader/reader.h"
#include "scene/geometry/files.h"

#include "scene/geometry/rays.h"

#include <math.h>

static void cameras_and_materials_are_as_promised(void **state)
{
    struct scene *s = scene_create_builtin();

    (void)state;
    assert_non_null(s);
    assert_string_equal(scene_camera(s, NULL)->name, "main");
    assert_non_null(scene_camera(s, "sundial"));
    assert_non_null(scene_camera(s, "gallery"));
    assert_true(s->triangle_count > 20000 && s->triangle_count < 60000);
    bool glossy = false;
    for (size_t i = 0; i < s->material_count; i++) {
        const struct material *m = &s->materials[i];
        assert_true(m->kind == MATERIAL_LAMBERT || m->kind == MATERIAL_PHONG);
        assert_true(m->diffuse.x + m->specular.x <= 1.0f && m->diffuse.y + m->specular.y <= 1.0f &&
                    m->diffuse.z + m->specular.z <= 1.0f);
        assert_int_equal(m->texture, MATERIAL_NO_TEXTURE);
        glossy |= m->kind == MATERIAL_PHONG && m->exponent >= 100.0f;
    }
    assert_true(glossy);
    for (size_t i = 0; i < s->camera_count; i++)
        assert_int_equal(camera_check(&s->cameras[i], "built-in", NULL), ERR_OK);
    scene_destroy(s);
}

static struct vec3 vertex(const float *array, uint32_t index)
{
    return vec3_make(array[3 * (size_t)index], array[3 * (size_t)index + 1], array[3 * (size_t)index + 2]);
}

static void solids_are_closed_and_normals_point_outwards(void **state)
{
    struct scene *s = scene_create_builtin();

    (void)state;
    for (size_t i = 0; i < s->mesh_count; i++) {
        struct mesh *m = &s->meshes[i];
        double volume = 0.0, area[3] = { 0.0 }, size = 0.0;
        assert_int_equal(mesh_drop_degenerate(m), 0);
        for (uint32_t t = 0; t < m->triangle_count; t++) {
            const uint32_t *k = m->indices + 3 * (size_t)t;
            const struct vec3 a = vertex(m->positions, k[0]), b = vertex(m->positions, k[1]);
            const struct vec3 c = vertex(m->positions, k[2]);
            const struct vec3 n = vec3_cross(vec3_sub(b, a), vec3_sub(c, a));
            volume += (double)vec3_dot(a, n) / 6.0;
            area[0] += (double)n.x;
            area[1] += (double)n.y;
            area[2] += (double)n.z;
            size += (double)vec3_length(n);
            for (int corner = 0; corner < 3; corner++) {
                const struct vec3 shading = vertex(m->normals, k[corner]);
                assert_float_equal(vec3_length(shading), 1.0f, 1e-4f);
                if (vec3_dot(shading, n) <= 0.0f)
                    fail_msg("mesh %zu, triangle %u, corner %d: the normal points inwards", i, t, corner);
            }
        }
        assert_true(volume > 0.0);
        /* the areas of a closed surface cancel out; lathes are open at the foot, where they stand on something */
        for (int axis = 0; axis < 3; axis += 2)
            assert_true(fabs(area[axis]) < 1e-3 * size);
    }
    scene_destroy(s);
}

/* Towards the sun at an hour angle (from noon, afternoon positive), for the dial's latitude; south is -z, west +x. */
static struct vec3 sun_at(double hour, double declination_degrees)
{
    const double latitude = 45.0 * PI / 180.0, h = hour * PI / 12.0, d = declination_degrees * PI / 180.0;
    const double south = sin(latitude) * cos(d) * cos(h) - cos(latitude) * sin(d);
    return vec3_make((float)(cos(d) * sin(h)), (float)(sin(latitude) * sin(d) + cos(latitude) * cos(d) * cos(h)),
                     (float)-south);
}

static void hour_lines_lie_where_the_shadow_falls(void **state)
{
    struct scene *s = scene_create_builtin();
    struct rays *r = rays_create_for(s, cpu_best());

    (void)state;
    for (int hour = -6; hour <= 6; hour++) {
        const double h = hour * PI / 12.0;
        for (int beside = -1; beside <= 1; beside++) {
            const double a = atan2(sin(45.0 * PI / 180.0) * sin(h), cos(h)) + 0.07 * beside;
            const double reach = hour == 0 ? 3.5 : 2.1; /* behind the blade, whose foot is over the noon line */
            const struct vec3 above = { (float)(-reach * sin(a)), 0.6f, (float)(-1.1 + reach * cos(a)) };
            struct hit hit;
            assert_true(rays_intersect(r, above, vec3_make(0.0f, -1.0f, 0.0f), 0.0f, &hit));
            const char *what = s->materials[s->meshes[hit.mesh].material].name;
            assert_string_equal(what, beside == 0 ? "bronze" : "stone");
        }
    }
    rays_destroy(r);
    scene_destroy(s);
}

static void sundial_tells_the_hour(void **state)
{
    struct scene *s = scene_create_builtin();
    struct rays *r = rays_create_for(s, cpu_best());
    const struct vec3 foot = { 0.0f, 0.52f, -1.1f }; /* just above the plates of the dial */
    int asked = 0;

    (void)state;
    for (int hour = -4; hour <= 4; hour++) {
        for (int season = -1; season <= 1; season++) {
            const struct vec3 sun = sun_at(hour, 23.4 * season);
            if (sun.y < 0.5f)
                continue; /* shadows of the columns may lie there */
            const double h = hour * PI / 12.0;
            const double line = atan2(sin(45.0 * PI / 180.0) * sin(h), cos(h));
            for (int beside = -1; beside <= 1; beside++) {
                /* 0.9 m from the foot; the shadow falls away from the sun, in the afternoon to the east, -x */
                const double a = line + 0.2 * beside;
                const struct vec3 from_foot = { (float)(-0.9 * sin(a)), 0.0f, (float)(0.9 * cos(a)) };
                struct hit hit;
                const bool shaded = rays_intersect(r, vec3_add(foot, from_foot), sun, 0.0f, &hit);
                if (beside == 0)
                    assert_true(shaded);
                else if (hour * beside >= 0) /* before noon's side of the line lies the shadow of the blade itself */
                    assert_false(shaded);
                asked++;
            }
        }
    }
    assert_true(asked > 30);
    rays_destroy(r);
    scene_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(cameras_and_materials_are_as_promised),
    cmocka_unit_test(solids_are_closed_and_normals_point_outwards),
    cmocka_unit_test(hour_lines_lie_where_the_shadow_falls),
    cmocka_unit_test(sundial_tells_the_hour),
};

UNIT_MAIN(tests)
