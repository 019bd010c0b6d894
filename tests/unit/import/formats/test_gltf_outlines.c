/* Outlines of glTF models: shells turned inside out are left out, rooms and wrongly wound models are not. */
#include "gltf_make.h"

#include "scene/geometry/rays.h"

/* A cube of side 1 around the origin, seen from outside; the second list is inside out. */
static const float corners[] = { -0.5f, -0.5f, -0.5f, 0.5f, -0.5f, -0.5f, 0.5f, 0.5f, -0.5f, -0.5f, 0.5f, -0.5f,
                                 -0.5f, -0.5f, 0.5f,  0.5f, -0.5f, 0.5f,  0.5f, 0.5f, 0.5f,  -0.5f, 0.5f, 0.5f };
static const uint8_t outwards[36] = { 0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7, 0, 1, 5, 0, 5, 4,
                                      1, 2, 6, 1, 6, 5, 2, 3, 7, 2, 7, 6, 3, 0, 4, 3, 4, 7 };

#define CUBE(positions, indices, material)                                                                             \
    "{\"primitives\":[{\"material\":" material ",\"indices\":" indices ",\"attributes\":{\"POSITION\":" positions "}}" \
                                                                                                                  "]}"
#define INSIDE "{\"mesh\":0}"
#define SCALED(mesh, scale) "{\"mesh\":" mesh ",\"scale\":[" scale "]}"
#define AT(x) "{\"mesh\":0,\"translation\":[" x ",0,0]}"
#define CAMERA_AT(z) "{\"camera\":0,\"translation\":[0,0," z "]}"

struct outcome {
    const char *nodes, *outline; /* members of its material */
    uint64_t triangles;
    bool left_out;
    int seen; /* material of the first surface on a ray from z = 20 towards -z: 0 the cube's, 1 the outline's */
    float z;  /* where it is hit, m */
};

/* Meshes: 0 a cube, 1 the same inside out and of the outline's material, 2 the first one of the outline's material, 3
 * the second one of the cube's, 4 two shells. */
static struct scene *load_nodes(struct make *m, const struct outcome *o)
{
    uint8_t inwards[36], twice[72];
    float two[48]; /* cubes of side 1.1, at x = -2 and 2 */
    char text[2048];

    for (int i = 0; i < 36; i++)
        twice[i] = inwards[i] = outwards[35 - i];
    for (int i = 0; i < 36; i++)
        twice[36 + i] = (uint8_t)(inwards[i] + 8);
    for (int i = 0; i < 48; i++)
        two[i] = 1.1f * corners[i % 24] + (i % 3 == 0 ? i < 24 ? -2.0f : 2.0f : 0.0f);
    FLOATS(m, corners, "VEC3", 8);
    make_array(m, outwards, sizeof(outwards), 5121, "SCALAR", 36);
    make_array(m, inwards, sizeof(inwards), 5121, "SCALAR", 36);
    FLOATS(m, two, "VEC3", 16);
    make_array(m, twice, sizeof(twice), 5121, "SCALAR", 72);
    snprintf(
        text, sizeof(text),
        "\"nodes\":[%s],\"meshes\":[" CUBE("0", "1", "0") "," CUBE("0", "2", "1") "," CUBE("0", "1", "1") "," CUBE(
            "0", "2",
            "0") "," CUBE("3", "4",
                          "1") "],\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1,\"znear\":0.1}}],"
                               "\"materials\":[{\"name\":\"Paint\"},{\"name\":\"Outline\","
                               "\"pbrMetallicRoughness\":{\"baseColorFactor\":[0,0,0,1]}%s}]",
        o->nodes, o->outline);
    return make_scene(m, text);
}

static void check(const struct outcome *o)
{
    struct make m;
    struct hit h;

    make_begin(&m);
    log_begin();
    struct scene *s = load_nodes(&m, o);
    const char *said = log_end();
    if (s->triangle_count != o->triangles)
        fail_msg("%d triangles, not %d, of %s", (int)s->triangle_count, (int)o->triangles, o->nodes);
    assert_int_equal(count_of(said, "made.gltf: material \"Outline\": left out 12 triangles of an outline"),
                     o->left_out);
    assert_int_equal(count_of(said, "left out"), o->left_out);
    struct rays *r = rays_create_for(s, cpu_best());
    assert_non_null(r);
    assert_true(rays_intersect(r, vec3_make(0.1f, 0.2f, 20.0f), vec3_make(0, 0, -1), 0.0f, &h));
    assert_int_equal(s->meshes[h.mesh].material, o->seen);
    assert_float_equal(20.0f - h.t, o->z, 1e-5f);
    rays_destroy(r);
    scene_destroy(s);
    make_end(&m);
}

static void check_all(const struct outcome *list, size_t count)
{
    for (size_t i = 0; i < count; i++)
        check(&list[i]);
}

#define SHELL SCALED("1", "1.1,1.1,1.1")
#define CHECK(...)                                                                                                     \
    check_all((const struct outcome[]){ __VA_ARGS__ },                                                                 \
              sizeof((const struct outcome[]){ __VA_ARGS__ }) / sizeof(struct outcome))

static void outlines_are_left_out(void **state)
{
    (void)state;
    CHECK({ INSIDE "," SHELL, "", 12, true, 0, 0.5f }, { SHELL "," INSIDE, "", 12, true, 0, 0.5f },
          { INSIDE "," SHELL "," CAMERA_AT("9"), "", 12, true, 0, 0.5f });
}

/* One mesh around two that are apart, as exporters merge what has one material. */
static void shells_of_several_things_may_be_one_mesh(void **state)
{
    struct make m;
    const struct outcome o = { AT("-2") "," AT("2") ",{\"mesh\":4}", "", 24, true, 0, 0.5f };

    (void)state;
    make_begin(&m);
    struct scene *s = load_nodes(&m, &o);
    assert_int_equal(s->mesh_count, 2);
    assert_int_equal(s->triangle_count, 24);
    assert_true(s->meshes[0].material == 0 && s->meshes[1].material == 0);
    scene_destroy(s);
    make_end(&m);
}

/* A viewer shows these, too, from some side, or lets light through. */
static void what_viewers_do_not_cull_stays(void **state)
{
    (void)state;
    CHECK({ INSIDE "," SHELL, ",\"doubleSided\":true", 24, false, 1, 0.55f },
          { INSIDE "," SHELL, ",\"alphaMode\":\"BLEND\"", 24, false, 1, 0.55f },
          { INSIDE "," SCALED("2", "1.1,1.1,1.1"), "", 24, false, 1, 0.55f });
}

/* With a camera in it, with space around its things, or with walls inside but no more. */
static void rooms_stay(void **state)
{
    (void)state;
    CHECK({ INSIDE "," SHELL "," CAMERA_AT("0.52"), "", 24, false, 1, 0.55f },
          { INSIDE "," SCALED("1", "4,4,4") "," CAMERA_AT("1.5"), "", 24, false, 1, 2.0f },
          { INSIDE "," SCALED("1", "4,4,4"), "", 24, false, 1, 2.0f },
          { INSIDE "," SCALED("1", "1.1,1.5,1.1"), "", 24, false, 1, 0.55f },
          { SHELL "," SCALED("0", "1,0.02,1") "," SCALED("0", "0.02,1,1"), "", 36, false, 1, 0.55f });
}

static void reflections_keep_the_sides(void **state)
{
    (void)state;
    CHECK({ INSIDE "," SCALED("1", "-1.1,1.1,1.1"), "", 12, true, 0, 0.5f },
          { SCALED("0", "-1,1,1") "," SCALED("1", "1.1,-1.1,1.1"), "", 12, true, 0, 0.5f },
          { INSIDE "," SCALED("2", "-1.1,1.1,1.1"), "", 24, false, 1, 0.55f });
}

static void models_that_are_inside_out_stay(void **state)
{
    (void)state;
    CHECK({ SHELL, "", 12, false, 1, 0.55f }, { "{\"mesh\":3}," SHELL, "", 24, false, 1, 0.55f });
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(outlines_are_left_out),          cmocka_unit_test(shells_of_several_things_may_be_one_mesh),
    cmocka_unit_test(what_viewers_do_not_cull_stays), cmocka_unit_test(rooms_stay),
    cmocka_unit_test(reflections_keep_the_sides),     cmocka_unit_test(models_that_are_inside_out_stay),
};
UNIT_MAIN(tests)
