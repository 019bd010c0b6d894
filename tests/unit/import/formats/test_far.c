/* Scenes far from the origin of their coordinates, or in small units. */
#include "gltf_make.h"

#include <math.h>

static const float corners[] = { 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0 };
static const uint8_t two_triangles[] = { 0, 1, 2, 0, 2, 3 };

/* Pitch -16.7 degrees, near the origin, in UTM coordinates, and in millimetres. */
static void a_camera_far_away_looks_where_its_node_does(void **state)
{
    static const double places[3][3] = { { 1, 2, 3 }, { 500000.25, 4500000.5, 100 }, { 600000, 0, 800000 } };
    (void)state;

    for (int i = 0; i < 3; i++) {
        char text[1000];
        struct make m;
        make_begin(&m);
        FLOATS(&m, corners, "VEC3", 4);
        make_array(&m, two_triangles, sizeof(two_triangles), 5121, "SCALAR", 6);
        snprintf(text, sizeof(text),
                 "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1}]}],\"nodes\":[{\"mesh\":"
                 "0,\"translation\":[%.9g,%.9g,%.9g]},{\"mesh\":0,\"translation\":[%.9g,0,0]},"
                 "{\"camera\":0,\"translation\":[%.9g,%.9g,%.9g],\"rotation\":[-0.145213,0,0,0.989400]}],"
                 "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":0.5,\"znear\":0.1}}]",
                 places[i][0], places[i][1], places[i][2], i == 2 ? 0.0 : places[i][0], places[i][0], places[i][1],
                 places[i][2]);
        struct scene *s = load_or_fail(make_gltf(&m, text));
        const struct camera *c = &s->cameras[0];
        const struct vec3 ahead = vec3_normalize(vec3_sub(c->look_at, c->position));
        const double pitch = asin((double)ahead.y) * 180.0 / 3.14159265358979;
        if (fabs(pitch + 16.7) > 1e-3)
            fail_msg("place %d: a pitch of %g degrees", i, pitch);
        assert_true((s->origin[1] != 0.0) == false || i == 1);
        scene_destroy(s);
        make_end(&m);
    }
}

/* A square in UTM coordinates, whose floats are half a metre apart. */
static void a_model_far_from_the_origin_keeps_its_shape(void **state)
{
    static const char utm[] = "v 500000.25 4000000.5 3\nv 500001.25 4000000.5 3\nv 500001.25 4000001.5 3\n"
                              "v 500000.25 4000001.5 3\nf 1 2 3 4\n";
    struct folder f;
    (void)state;

    folder_make(&f);
    struct scene *s = load_or_fail(folder_text(&f, "m.obj", utm));
    assert_true(s->origin[0] == 500001.0 && s->origin[1] == 4000001.0 && s->origin[2] == 3.0);
    assert_true(s->low.x == -0.75f && s->high.x == 0.25f && s->low.y == -0.5f && s->low.z == 0.0f);
    scene_destroy(s);
    /* the scene file's cameras, lamps and transforms have its coordinates, too */
    s = load_or_fail(folder_text(
        &f, "s.json",
        "{\"models\":[{\"file\":\"m.obj\"},{\"file\":\"m.obj\",\"transform\":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0.25,1]}],"
        "\"lights\":[{\"type\":\"point\",\"position\":[500000.5,4000000.25,7],\"intensity\":[1,1,1]}],"
        "\"camera\":{\"position\":[500000.75,4000001.5,9],\"look_at\":[500000.75,4000001.5,3],\"up\":[0,1,0],"
        "\"fov_y_degrees\":40}}"));
    assert_true(s->origin[1] == 4000001.0 && s->high.z == 0.25f);
    assert_true(s->cameras[0].position.x == -0.25f && s->cameras[0].look_at.y == 0.5f);
    assert_true(s->lights[0].position.x == -0.5f && s->lights[0].position.y == -0.75f);
    scene_destroy(s);
    /* what reaches from the origin to there stays */
    s = load_or_fail(folder_text(&f, "m.obj", "v 0 0 0\nv 400000 0 0\nv 0 400000 0\nf 1 2 3\n"));
    assert_true(s->origin[0] == 0.0 && s->high.x == 400000.0f);
    scene_destroy(s);
    folder_remove(&f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_model_far_from_the_origin_keeps_its_shape),
    cmocka_unit_test(a_camera_far_away_looks_where_its_node_does),
};
UNIT_MAIN(tests)
