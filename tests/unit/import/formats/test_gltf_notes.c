/* Warnings about glTF files say what they are about. */
#include "gltf_make.h"

static const float corners[] = { 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0 };
static const uint8_t two_triangles[] = { 0, 1, 2, 0, 2, 3 };

#define SOME_PASSES "\"KHR_materials_transmission\":{\"transmissionFactor\":0.75}"
#define COLOURED "\"ACME_colour\":{}"
#define SMOOTH "\"pbrMetallicRoughness\":{\"roughnessFactor\":0}"
#define LINES "{\"mode\":1,\"attributes\":{\"POSITION\":0}}"

/* Extensions may stand deep within an element; what occurs twice in one counts once. */
static void first_place_is_named_and_others_are_counted(void **state)
{
    struct make m;

    (void)state;
    make_begin(&m);
    FLOATS(&m, corners, "VEC3", 4);
    make_array(&m, two_triangles, sizeof(two_triangles), 5121, "SCALAR", 6);
    const char *path = make_gltf(
        &m, "\"nodes\":[{\"mesh\":0},{\"mesh\":1},{\"mesh\":2},{\"mesh\":1},{\"extensions\":{\"ACME_node\":{}}}],"
            "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1,\"material\":1}]},"
            "{\"name\":\"Wire\",\"primitives\":[" LINES "," LINES "]},{\"primitives\":[" LINES "]}],"
            "\"materials\":[{},{\"name\":\"Pane\"," SMOOTH ",\"extensions\":{" SOME_PASSES "," COLOURED "}},"
            "{\"name\":\"Sign\",\"extensions\":{\"KHR_materials_unlit\":{}}},{" SMOOTH ",\"extensions\":{" SOME_PASSES
            "}},{\"pbrMetallicRoughness\":{\"extensions\":{" COLOURED "}},"
            "\"extensions\":{\"KHR_materials_unlit\":{}," COLOURED "}},{\"extensions\":{" COLOURED "}}],"
            "\"extensionsUsed\":[\"ACME_shape\",\"ACME_colour\",\"ACME_node\",\"KHR_materials_transmission\","
            "\"KHR_materials_unlit\"]");
    log_begin();
    struct scene *s = load_or_fail(path);
    const char *said = log_end();
    assert_int_equal(count_of(said, "made.gltf: material \"Pane\" and 1 more: not supported: partial transmission"), 1);
    assert_int_equal(count_of(said, "made.gltf: material \"Sign\" and 1 more: unlit: approximated by a matte"), 1);
    assert_int_equal(count_of(said, "made.gltf: material \"Pane\" and 2 more: ACME_colour is ignored\n"), 1);
    assert_int_equal(count_of(said, "made.gltf: nodes[4]: ACME_node is ignored\n"), 1);
    assert_int_equal(count_of(said, "made.gltf: ignored extensions: ACME_shape\n"), 1);
    assert_int_equal(count_of(said, "made.gltf: mesh \"Wire\" and 1 more: left out points and lines\n"), 1);
    assert_int_equal(count_of(said, "\n"), 6);
    assert_int_equal(s->unmodelled, 1u << FEATURE_PARTIAL_GLASS);
    scene_destroy(s);
    make_end(&m);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(first_place_is_named_and_others_are_counted),
};
UNIT_MAIN(tests)
