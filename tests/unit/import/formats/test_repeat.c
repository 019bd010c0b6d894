/* Models other than glTF that stand at several places: their meshes are shared where that saves memory. */
#include "scene/geometry/files.h"
#include "scene/geometry/load.h"

#include "scene/geometry/mesh_read.h"

#include <math.h>

#define SIDE 72 /* squares along each side of a sheet: 10368 triangles */
#define CAMERA "\"camera\":{\"position\":[0,1,5],\"look_at\":[0,0,0],\"fov_y_degrees\":40}"

/* Writes a bumpy sheet of 2 x SIDE^2 triangles as OBJ. */
static void write_sheet(struct folder *f, const char *name)
{
    const size_t room = 200000 + 100 * (size_t)(SIDE + 1) * (SIDE + 1);
    char *text = malloc(room);
    size_t n = 0;

    assert_non_null(text);
    for (int y = 0; y <= SIDE; y++)
        for (int x = 0; x <= SIDE; x++)
            n += (size_t)snprintf(text + n, room - n, "v %d %d %d\n", x, y, (3 * x + 5 * y) % 7);
    for (int y = 0; y < SIDE; y++) {
        for (int x = 0; x < SIDE; x++) {
            const int a = y * (SIDE + 1) + x + 1, b = a + SIDE + 1;
            n += (size_t)snprintf(text + n, room - n, "f %d %d %d\nf %d %d %d\n", a, a + 1, b + 1, a, b + 1, b);
            assert_true(n < room);
        }
    }
    folder_text(f, name, text);
    free(text);
}

/* Turned by 90 degrees about Z, twice as large in the first direction and mirrored; moved by index. */
static void matrix_of(int index, double m[16])
{
    const double turned[16] = { 0, 2, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 };
    const double plain[16] = { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 };

    memcpy(m, index % 2 ? turned : plain, sizeof(turned));
    m[12] = 100.0 * index + 7.0;
    m[13] = -3.0 * index;
    m[14] = 0.5;
}

/* A scene of `count` sheets; the first two are of a kind of their own. */
static struct scene *load_sheets(struct folder *f, int count, const char *kind)
{
    char *text = malloc(1000 + 300 * (size_t)count);
    size_t n = 0;

    assert_non_null(text);
    n += (size_t)sprintf(text, "{" CAMERA
                               ",\"materials\":{\"red\":{\"type\":\"lambert\",\"albedo\":[0.5,0,0]}},\"models\":[");
    for (int i = 0; i < count; i++) {
        double m[16];
        matrix_of(i, m);
        n += (size_t)sprintf(text + n, "%s{\"file\":\"sheet.obj\"%s,\"transform\":[", i ? "," : "", i < 2 ? kind : "");
        for (int k = 0; k < 16; k++)
            n += (size_t)sprintf(text + n, "%s%.17g", k ? "," : "", m[k]);
        n += (size_t)sprintf(text + n, "]}");
    }
    strcpy(text + n, "]}");
    struct scene *s = load_or_fail(folder_text(f, "scene.json", text));
    free(text);
    return s;
}

/* Each vertex of the mesh, at the place of its entry: those of an OBJ without doubles stay in order. */
static void check_place(const struct mesh *m, int index)
{
    double t[16];

    matrix_of(index, t);
    assert_int_equal(m->vertex_count, (SIDE + 1) * (SIDE + 1));
    assert_int_equal(m->triangle_count, 2 * SIDE * SIDE);
    for (uint32_t k = 0; k < m->triangle_count; k += 97) {
        double p[3][3], e1[3], e2[3], up = 0.0;
        mesh_corners(m, k, p);
        for (int c = 0; c < 3; c++) { /* back in the file's space, where coordinates are whole */
            const double x = p[c][0] - t[12], y = p[c][1] - t[13];
            const double fx = index % 2 ? y / 2.0 : x, fy = index % 2 ? x : y;
            assert_float_equal(fx, round(fx), 1e-3);
            assert_float_equal(fy, round(fy), 1e-3);
            assert_true(fx > -0.1 && fx < SIDE + 0.1 && fy > -0.1 && fy < SIDE + 0.1);
            assert_float_equal(p[c][2] - 0.5, (double)((3 * lround(fx) + 5 * lround(fy)) % 7), 1e-3);
        }
        for (int i = 0; i < 3; i++) {
            e1[i] = p[1][i] - p[0][i];
            e2[i] = p[2][i] - p[0][i];
        }
        up = mesh_side(m) * (e1[0] * e2[1] - e1[1] * e2[0]);
        assert_true(up > 0.0); /* the outside of the file's triangles, +Z, also where a matrix mirrors them */
    }
}

static void equal_models_of_a_scene_share_their_meshes(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    write_sheet(&f, "sheet.obj");
    struct scene *s = load_sheets(&f, 12, "");
    assert_int_equal(s->mesh_count, 12);
    assert_int_equal(s->material_count, 2);
    for (int i = 0; i < 12; i++) {
        assert_int_equal(s->meshes[i].source, i ? 1 : 0);
        assert_true(s->meshes[i].placed);
        check_place(&s->meshes[i], i);
    }
    scene_destroy(s);
    folder_remove(&f);
}

/* Ten more of 10368 triangles save 20 MB, nine more do not. */
static void few_models_are_copied(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    write_sheet(&f, "sheet.obj");
    struct scene *s = load_sheets(&f, 10, "");
    assert_int_equal(s->mesh_count, 10);
    for (int i = 0; i < 10; i++) {
        assert_int_equal(s->meshes[i].source, 0);
        assert_false(s->meshes[i].placed);
        check_place(&s->meshes[i], i);
    }
    scene_destroy(s);
    folder_remove(&f);
}

static void models_that_differ_are_not_shared(void **state)
{
    static const char *const kinds[] = { ",\"smooth\":true", ",\"material\":\"red\"" };
    struct folder f;

    (void)state;
    folder_make(&f);
    write_sheet(&f, "sheet.obj");
    for (size_t k = 0; k < sizeof(kinds) / sizeof(kinds[0]); k++) {
        struct scene *s = load_sheets(&f, 13, kinds[k]);
        assert_int_equal(s->mesh_count, 13);
        for (int i = 0; i < 13; i++) {
            assert_int_equal(s->meshes[i].source, i > 2 ? 3 : 0);
            assert_int_equal(s->meshes[i].placed, i >= 2);
            check_place(&s->meshes[i], i);
        }
        assert_true(k == 0 || s->meshes[0].material != s->meshes[2].material);
        assert_int_equal(s->meshes[0].normals != NULL, k == 0);
        scene_destroy(s);
    }
    folder_remove(&f);
}

/* COLLADA: one geometry of a strip of triangles, at the nodes of a row. */
static void write_row(struct folder *f, int nodes, int triangles)
{
    char *text = malloc(4000 + 40 * (size_t)triangles + 200 * (size_t)nodes);
    size_t n = 0;

    assert_non_null(text);
    n += (size_t)sprintf(text,
                         "<?xml version=\"1.0\"?><COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" "
                         "version=\"1.4.1\"><asset><unit meter=\"1\" name=\"m\"/><up_axis>Y_UP</up_axis></asset>"
                         "<library_geometries><geometry id=\"g\"><mesh><source id=\"p\"><float_array id=\"a\" "
                         "count=\"%d\">",
                         3 * (triangles + 2));
    for (int i = 0; i < triangles + 2; i++)
        n += (size_t)sprintf(text + n, "%d %d 0 ", i / 2, i % 2);
    n += (size_t)sprintf(
        text + n,
        "</float_array><technique_common><accessor source=\"#a\" count=\"%d\" stride=\"3\"><param name=\"X\" "
        "type=\"float\"/><param name=\"Y\" type=\"float\"/><param name=\"Z\" type=\"float\"/></accessor>"
        "</technique_common></source><vertices id=\"v\"><input semantic=\"POSITION\" source=\"#p\"/>"
        "</vertices><triangles count=\"%d\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/><p>",
        triangles + 2, triangles);
    for (int i = 0; i < triangles; i++)
        n += (size_t)sprintf(text + n, "%d %d %d ", i, i + 1 + i % 2, i + 2 - i % 2);
    n += (size_t)sprintf(text + n, "</p></triangles></mesh></geometry></library_geometries><library_visual_scenes>"
                                   "<visual_scene id=\"s\">");
    for (int i = 0; i < nodes; i++)
        n += (size_t)sprintf(
            text + n, "<node id=\"n%d\"><translate>0 0 %d</translate><instance_geometry url=\"#g\"/></node>", i, i);
    sprintf(text + n,
            "</visual_scene></library_visual_scenes><scene><instance_visual_scene url=\"#s\"/></scene></COLLADA>");
    folder_text(f, "row.dae", text);
    free(text);
}

static void nodes_of_other_formats_share_their_mesh(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    for (int shared = 0; shared < 2; shared++) {
        const int triangles = shared ? 10100 : 9900; /* ten more take 20 MB, or less */
        char path[sizeof(f.path) + 16];
        write_row(&f, 11, triangles);
        snprintf(path, sizeof(path), "%s/row.dae", f.path);
        struct scene *s = load_or_fail(path);
        assert_int_equal(s->mesh_count, 11);
        for (uint32_t i = 0; i < 11; i++) {
            double p[3];
            assert_int_equal(s->meshes[i].source, shared && i ? 1 : 0);
            mesh_position(&s->meshes[i], 0, p);
            assert_float_equal(p[2], (double)i, 1e-5);
            assert_int_equal(s->meshes[i].triangle_count, triangles);
        }
        scene_destroy(s);
    }
    folder_remove(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equal_models_of_a_scene_share_their_meshes),
        cmocka_unit_test(few_models_are_copied),
        cmocka_unit_test(models_that_differ_are_not_shared),
        cmocka_unit_test(nodes_of_other_formats_share_their_mesh),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
