/* The geometry of OBJ files as exporters write them. */
#include "scene/geometry/files.h"
#include "scene/geometry/load.h"

#include <math.h>

static struct scene *scene_of(const char *obj)
{
    struct folder f;

    folder_make(&f);
    struct scene *s = load_or_fail(folder_text(&f, "m.obj", obj));
    folder_remove(&f);
    return s;
}

/* The area of all triangles, and the extent of their box. */
static double area_of(const struct scene *s)
{
    double area = 0.0;

    for (size_t m = 0; m < s->mesh_count; m++)
        for (size_t t = 0; t < s->meshes[m].triangle_count; t++) {
            const float *p[3];
            for (int k = 0; k < 3; k++)
                p[k] = s->meshes[m].positions + 3 * (size_t)s->meshes[m].indices[3 * t + (size_t)k];
            const struct vec3 a = vec3_make(p[1][0] - p[0][0], p[1][1] - p[0][1], p[1][2] - p[0][2]);
            const struct vec3 b = vec3_make(p[2][0] - p[0][0], p[2][1] - p[0][1], p[2][2] - p[0][2]);
            area += 0.5 * (double)vec3_length(vec3_cross(a, b));
        }
    return area;
}

static void an_obj_is_a_square_however_it_is_written(void **state)
{
    static const char *const squares[] = {
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n",
        "v -.5 -.5 0\nv .5 -.5 0\nv .5 .5 0\nv -.5 .5 0\nv 9 9 9\nv 8 8 8\nf 1 2 3 4\n",
        "v 0 0 0 # one\nv +1 0 0\nv 1. 1 0\nv 0 1 0\n# all\nf 1 2 3 4 # the square\n",
        "  v 0 0 0\n\tv 1 0 0\n  v 1 1 0\n  v 0 1 0\n\t f\t1 2  3 4  \n",
        "\xef\xbb\xbfv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n",
        "v 0 0 0\r\nv 1 0 0\r\nv 1 1 0\r\nv 0 1 0\r\nf 1// 2// 3// 4//\r\n",
        "v 0 0 0\rv 1 0 0\rv 1 1 0\rv 0 1 0\rf -4 -3 -2 -1\r",
        "v 0 0 \\\n 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 \\\r\n 3 4",
        "vn 0 0 1\ns 1\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1//1 2//1 3//-1\nf 1 3 4\n",
        "cstype bezier\ndeg 3\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nlod 1\nl 1 2\np 3\nbevel on\nf 1.0 2.0 3 4\n",
        "v 500000.25 4000000.5 3\nv 500001.25 4000000.5 3\nv 500001.25 4000001.5 3\nv 500000.25 4000001.5 3\nf 1 2 3 "
        "4\n",
    };
    (void)state;

    for (size_t i = 0; i < sizeof(squares) / sizeof(squares[0]); i++) {
        struct scene *s = scene_of(squares[i]);
        const double area = area_of(s);
        if (fabs(area - 1.0) > 1e-6)
            fail_msg("square %zu has an area of %g", i, area);
        scene_destroy(s);
    }
}

static void an_obj_in_utf_16_is_the_same_square(void **state)
{
    static const char square[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n# \xdc\nf 1 2 3 4\n";
    uint8_t wide[2 * sizeof(square)];
    struct folder f;
    (void)state;

    for (int big = 0; big < 2; big++) {
        wide[!big] = 0xfe;
        wide[big] = 0xff;
        for (size_t i = 0; i + 1 < sizeof(square); i++) {
            wide[2 + 2 * i + (size_t)big] = (uint8_t)square[i];
            wide[2 + 2 * i + (size_t)!big] = 0;
        }
        folder_make(&f);
        struct scene *s = load_or_fail(folder_write(&f, "m.obj", wide, sizeof(wide)));
        assert_float_equal(area_of(s), 1.0, 1e-6);
        scene_destroy(s);
        folder_remove(&f);
    }
}

static void a_corner_that_is_no_vertex_is_refused_with_its_line(void **state)
{
#define CORNERS "v 0 0 0\nv 1 0 0\n\nv 1 1 0\r\n"
    static const struct {
        const char *obj, *said;
    } rows[] = { { CORNERS "f 1 2 3\nf 1 2 4\n",
                   "line 6: '4' is no corner of a face: expected the number of a vertex, 1 to 3" },
                 { CORNERS "f 0/1 1/1 2/1\n", "line 5: '0/1' is no" },
                 { CORNERS "f 1 2 -4\n", "line 5: '-4' is no" },
                 { CORNERS "f 1 2 2.5\n", "line 5: '2.5' is no" },
                 { CORNERS "f 1 2 x\nf 1 2 9\n", "line 5: 'x' is no" } };
    struct folder f;
    (void)state;

    folder_make(&f);
    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        struct reason why = { "" };
        struct scene *s;
        assert_int_equal(load_here(folder_text(&f, "m.obj", rows[i].obj), &s, &why), ERR_FORMAT);
        if (!strstr(why.text, rows[i].said))
            fail_msg("'%s' does not say '%s'", why.text, rows[i].said);
    }
    folder_remove(&f);
}

static void curves_and_surfaces_are_named(void **state)
{
    (void)state;
    log_begin();
    scene_destroy(scene_of("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\ncstype bezier\ncurv 0 1 1 2 3\nparm u 0 1\nend\n"));
    assert_non_null(strstr(log_end(), "m.obj: 1 free-form curves or surfaces and 0 lines or points are left out"));
    log_begin();
    scene_destroy(scene_of("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\nl 1 2\np 1\n"));
    assert_non_null(strstr(log_end(), "m.obj: 0 free-form curves or surfaces and 2 lines or points are left out"));
}

/* Capitals, and the face of old files. */
static void other_spellings_of_statements_are_read(void **state)
{
    static const char *const texts[] = { "V 0 0 0\nV 1 0 0\nV 1 1 0\nVT 0 0\nVN 0 0 1\nF 1/1/1 2/1/1 3/1/1\n",
                                         "v 0 0 0\nv 1 0 0\nv 1 1 0\nfo 1 2 3\n",
                                         "v 0 0 0\nv 1 0 0\nv 1 1 0\nO a\nG b\nUSEMTL c\nfo 1 2 3\n" };
    (void)state;

    for (size_t i = 0; i < sizeof(texts) / sizeof(texts[0]); i++) {
        struct scene *s = scene_of(texts[i]);
        assert_int_equal(s->triangle_count, 1);
        scene_destroy(s);
    }
}

/* A roof of two faces: in one group they share normals at the ridge, in two or in none they have their own. */
static void smoothing_groups_are_normals(void **state)
{
#define ROOF "v 0 0 0\nv 0 0 1\nv 1 1 0\nv 1 1 1\nv 2 0 0\nv 2 0 1\n"
    static const struct {
        const char *obj;
        bool normals, shared;
    } rows[] = { { ROOF "s 1\nf 1 2 4 3\nf 3 4 6 5\n", true, true },
                 { ROOF "s on\nf 1 2 4 3\nf 3 4 6 5\n", true, true },
                 { ROOF "s 1\nf 1 2 4 3\ns 2\nf 3 4 6 5\n", true, false },
                 { ROOF "s off\nf 1 2 4 3\nf 3 4 6 5\n", false, false },
                 { ROOF "s 0\nf 1 2 4 3\nf 3 4 6 5\n", false, false },
                 { ROOF "f 1 2 4 3\nf 3 4 6 5\n", false, false } };
    (void)state;

    for (size_t i = 0; i < 6; i++) {
        struct scene *s = scene_of(rows[i].obj);
        const struct mesh *m = &s->meshes[0];
        assert_int_equal(m->normals != NULL, rows[i].normals);
        for (size_t v = 0; m->normals && v < m->vertex_count; v++) {
            const float *p = m->positions + 3 * v, *n = m->normals + 3 * v;
            if (p[1] == 1.0f && (fabsf(n[0]) < 1e-6f) != rows[i].shared) /* at the ridge: straight up */
                fail_msg("row %zu: a normal of %g %g %g", i, (double)n[0], (double)n[1], (double)n[2]);
        }
        scene_destroy(s);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(an_obj_is_a_square_however_it_is_written),
    cmocka_unit_test(an_obj_in_utf_16_is_the_same_square),
    cmocka_unit_test(a_corner_that_is_no_vertex_is_refused_with_its_line),
    cmocka_unit_test(curves_and_surfaces_are_named),
    cmocka_unit_test(other_spellings_of_statements_are_read),
    cmocka_unit_test(smoothing_groups_are_normals),
};

UNIT_MAIN(tests)
