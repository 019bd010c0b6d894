/* Animation at one moment, against numbers worked out by hand. */
#include "gltf_make.h"

/* A triangle in z = 0 whose first corner is the origin, the second (1, 0, 0). */
static const float corners[] = { 0, 0, 0, 1, 0, 0, 0, 1, 0 };

/* Accessor 0: the triangle, 1: key times 1 and 3. */
static void begin(struct make *m)
{
    static const float times[] = { 1, 3 };

    make_begin(m);
    FLOATS(m, corners, "VEC3", 3);
    FLOATS(m, times, "SCALAR", 2);
}

#define TRIANGLE "\"attributes\":{\"POSITION\":0}"
#define MESH "\"meshes\":[{\"primitives\":[{" TRIANGLE "}]}]"
/* One channel whose keys are accessors 1 and 2. */
#define CHANNEL(node, path, kind)                                                                                      \
    "\"animations\":[{\"channels\":[{\"sampler\":0,\"target\":{\"node\":" node ",\"path\":\"" path "\"}}],"            \
    "\"samplers\":[{\"input\":1,\"output\":2,\"interpolation\":\"" kind "\"}]}]"

static struct scene *scene_at(struct make *m, const char *rest, double time)
{
    struct reason why = { "" };
    struct scene *s = NULL;

    if (load_at(make_gltf(m, rest), time, &s, &why))
        fail_msg("%s", why.text);
    return s;
}

/* Corner `corner` of the mesh at a time. */
static void assert_corner(struct make *m, const char *rest, double time, uint32_t corner, float x, float y, float z)
{
    struct scene *s = scene_at(m, rest, time);

    assert_near(vertex(&s->meshes[0], s->meshes[0].indices[corner]), x, y, z);
    scene_destroy(s);
}

/* ---- Interpolation ---- */

#define MOVED "\"nodes\":[{\"mesh\":0,\"translation\":[9,9,9]}]," MESH ","

static void linear_is_between_its_keys_and_stays_at_its_ends(void **state)
{
    static const float places[] = { 0, 2, 0, 4, 6, -8 };
    struct make m;

    (void)state;
    begin(&m);
    FLOATS(&m, places, "VEC3", 2);
    const char *rest = MOVED CHANNEL("0", "translation", "LINEAR");
    assert_corner(&m, rest, 0.0, 0, 0, 2, 0);
    assert_corner(&m, rest, 1.0, 0, 0, 2, 0);
    assert_corner(&m, rest, 1.5, 0, 1, 3, -2);
    assert_corner(&m, rest, 3.0, 0, 4, 6, -8);
    assert_corner(&m, rest, 1e6, 0, 4, 6, -8);
    make_end(&m);
}

static void a_step_holds_until_the_next_key(void **state)
{
    static const float places[] = { 0, 2, 0, 4, 6, -8 };
    struct make m;

    (void)state;
    begin(&m);
    FLOATS(&m, places, "VEC3", 2);
    const char *rest = MOVED CHANNEL("0", "translation", "STEP");
    assert_corner(&m, rest, 2.999, 0, 0, 2, 0);
    assert_corner(&m, rest, 3.0, 0, 4, 6, -8);
    make_end(&m);
}

/* In the middle of two seconds, from 0 with slope 1 to 4 with slope 3:
 * 0/2 + 2 * 1/8 + 4/2 - 2 * 3/8 = 1.5 [glTF 2.0, appendix C]. */
static void a_spline_follows_its_tangents(void **state)
{
    static const float places[] = { 7, 7, 7, 0, 0, 0, 1, 0, 0, 3, 0, 0, 4, 0, 0, 7, 7, 7 };
    struct make m;

    (void)state;
    begin(&m);
    FLOATS(&m, places, "VEC3", 6);
    const char *rest = MOVED CHANNEL("0", "translation", "CUBICSPLINE");
    assert_corner(&m, rest, 2.0, 0, 1.5f, 0, 0);
    assert_corner(&m, rest, 0.0, 0, 0, 0, 0);
    assert_corner(&m, rest, 4.0, 0, 4, 0, 0);
    make_end(&m);
}

/* By 120 degrees about z: a quarter of the way is 30 degrees, on the shorter arc also where the quaternion has the
 * other sign, and whatever their length. */
static void rotations_turn_at_an_even_rate(void **state)
{
    static const float sides[] = { 1.0f, -2.0f };

    (void)state;
    for (int i = 0; i < 2; i++) {
        const float k = sides[i], turns[] = { 0, 0, 0, 1, 0, 0, k * 0.8660254f, k * 0.5f };
        struct make m;
        begin(&m);
        FLOATS(&m, turns, "VEC4", 2);
        faults_intended = i == 1; /* not unit */
        assert_corner(&m, MOVED CHANNEL("0", "rotation", "LINEAR"), 1.5, 1, 9 + 0.8660254f, 9 + 0.5f, 9);
        faults_intended = false;
        make_end(&m);
    }
}

/* Signed shorts stand for -1 to 1. */
static void rotations_may_be_integers(void **state)
{
    static const int16_t turns[] = { 0, 0, 0, 32767, 0, 0, 23170, 23170 };
    struct make m;

    (void)state;
    begin(&m);
    const int view = make_view(&m, turns, sizeof(turns), "");
    make_accessor(&m, "\"bufferView\":%d,\"componentType\":5122,\"type\":\"VEC4\",\"count\":2,\"normalized\":true",
                  view);
    assert_corner(&m, MOVED CHANNEL("0", "rotation", "LINEAR"), 3.0, 1, 9, 10, 9);
    make_end(&m);
}

/* ---- What follows the nodes ---- */

/* Scale of the parent, and a camera below it. */
static void children_and_cameras_follow(void **state)
{
    static const float scales[] = { 1, 1, 1, 3, 5, 7 };
    struct make m;

    (void)state;
    begin(&m);
    FLOATS(&m, scales, "VEC3", 2);
    struct scene *s = scene_at(&m,
                               "\"nodes\":[{\"children\":[1,2]},{\"mesh\":0},{\"camera\":0,\"translation\":[1,1,1]}],"
                               "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1,\"znear\":1}}]," MESH
                               "," CHANNEL("0", "scale", "LINEAR"),
                               2.0);
    assert_near(vertex(&s->meshes[0], s->meshes[0].indices[1]), 2, 0, 0);
    assert_near(s->cameras[0].position, 2, 3, 4);
    scene_destroy(s);
    make_end(&m);
}

/* Keys hold a weight for each target: 0, 1 and then 1, 3. */
static void weights_are_animated(void **state)
{
    static const float weights[] = { 0, 1, 1, 3 }, along[] = { 4, 0, 0, 4, 0, 0, 4, 0, 0 },
                       up[] = { 0, 0, 2, 0, 0, 2, 0, 0, 2 };
    struct make m;

    (void)state;
    begin(&m);
    FLOATS(&m, weights, "SCALAR", 4);
    FLOATS(&m, along, "VEC3", 3);
    FLOATS(&m, up, "VEC3", 3);
    const char *rest = "\"nodes\":[{\"mesh\":0}],\"meshes\":[{\"weights\":[5,5],\"primitives\":[{" TRIANGLE
                       ",\"targets\":[{\"POSITION\":3},{\"POSITION\":4}]}]}]," CHANNEL("0", "weights", "LINEAR");
    assert_corner(&m, rest, 2.0, 0, 2, 0, 4);
    make_end(&m);
}

/* All corners follow a joint that rises by 10. */
static void skins_follow_their_joints(void **state)
{
    static const float places[] = { 0, 0, 0, 0, 10, 0 }, weights[] = { 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0 };
    static const uint8_t joints[12] = { 0 };
    struct make m;

    (void)state;
    begin(&m);
    FLOATS(&m, places, "VEC3", 2);
    make_array(&m, joints, sizeof(joints), 5121, "VEC4", 3);
    FLOATS(&m, weights, "VEC4", 3);
    const char *rest =
        "\"nodes\":[{\"mesh\":0,\"skin\":0},{}],\"skins\":[{\"joints\":[1]}],\"meshes\":[{\"primitives\":["
        "{\"attributes\":{\"POSITION\":0,\"JOINTS_0\":3,\"WEIGHTS_0\":4}}]}]," CHANNEL("1", "translation", "LINEAR");
    assert_corner(&m, rest, 2.0, 1, 1, 5, 0);
    make_end(&m);
}

/* ---- Which animation, and whether ---- */

static void at_rest_nothing_moves_and_the_flag_is_named(void **state)
{
    static const float places[] = { 0, 2, 0, 4, 6, -8 };
    struct make m;

    (void)state;
    begin(&m);
    FLOATS(&m, places, "VEC3", 2);
    log_begin();
    assert_corner(&m, MOVED CHANNEL("0", "translation", "LINEAR"), (double)NAN, 0, 9, 9, 9);
    assert_int_equal(count_of(log_end(), "made.gltf: is animated, but shown at rest; use --time SECONDS\n"), 1);
    make_end(&m);
}

static void only_the_first_animation_counts(void **state)
{
    static const float places[] = { 0, 2, 0, 4, 6, -8 };
    struct make m;

    (void)state;
    begin(&m);
    FLOATS(&m, places, "VEC3", 2);
    log_begin();
    assert_corner(&m,
                  MOVED
                  "\"animations\":[{\"name\":\"walk\",\"channels\":[{\"sampler\":1,\"target\":{\"path\":\"scale\"}},"
                  "{\"sampler\":0,\"target\":{\"node\":0,\"path\":\"translation\"}}],\"samplers\":["
                  "{\"input\":1,\"output\":2},{\"input\":1,\"output\":2}]},{\"channels\":[{\"sampler\":0,"
                  "\"target\":{\"node\":0,\"path\":\"scale\"}}],\"samplers\":[{\"input\":1,\"output\":2}]}]",
                  2.0, 1, 3, 4, -4);
    assert_int_equal(count_of(log_end(), "animations[0]: the first of 2 animations, 'walk', is used"), 1);
    make_end(&m);
}

/* A model's own time counts more than the program's. */
static void a_json_scene_sets_the_time_of_each_model(void **state)
{
    static const float places[] = { 0, 2, 0, 4, 6, -8 };
    struct reason why = { "" };
    struct scene *s = NULL;
    struct make m;

    (void)state;
    begin(&m);
    FLOATS(&m, places, "VEC3", 2);
    make_gltf(&m, MOVED CHANNEL("0", "translation", "LINEAR"));
    const char *path = folder_text(&m.folder, "a.json",
                                   "{\"models\":[{\"file\":\"made.gltf\",\"time\":1.5},{\"file\":\"made.gltf\"}]}");
    if (load_at(path, 3.0, &s, &why))
        fail_msg("%s", why.text);
    assert_near(vertex(&s->meshes[0], s->meshes[0].indices[0]), 1, 3, -2);
    assert_near(vertex(&s->meshes[1], s->meshes[1].indices[0]), 4, 6, -8);
    scene_destroy(s);
    path = folder_text(&m.folder, "b.json", "{\"models\":[{\"file\":\"made.gltf\",\"time\":-1}]}");
    assert_non_null(strstr(make_refused(path, ERR_RANGE), "models[0]: 'time' is -1, not within 0 to 1e+06"));
    make_end(&m);
}

/* ---- Faults ---- */

/* Accessor 3 has the same time twice, 4 a time that is none, 5 integers, 6 an infinite number. */
static void bad_animations_are_refused(void **state)
{
    static const float places[] = { 0, 2, 0, 4, 6, -8 }, same[] = { 0, 0 }, nan[] = { 1, NAN },
                       wild[] = { 0, 0, 0, 0, INFINITY, 0 };
#define NODE "\"nodes\":[{\"mesh\":0}]," MESH ","
#define FAULT(node, path, sampler)                                                                                     \
    NODE "\"animations\":[{\"channels\":[{\"sampler\":0,\"target\":{\"node\":" node ",\"path\":\"" path                \
         "\"}}],\"samplers\":[" sampler "]}]"
    static const struct {
        const char *rest, *said;
    } cases[] = {
        { FAULT("0", "translation", "{\"input\":3,\"output\":2}"),
          "animations[0].samplers[0].input: key times do not increase: key 1 is at 0 s" },
        { FAULT("0", "translation", "{\"input\":4,\"output\":2}"), "samplers[0].input: key times do not increase" },
        { FAULT("0", "translation", "{\"input\":5,\"output\":2}"),
          "samplers[0].input: accessors[5] holds no key times: expected floats" },
        { FAULT("0", "translation", "{\"input\":2,\"output\":2}"), "input: accessors[2] has 3 components; expected 1" },
        { FAULT("0", "translation", "{\"input\":1,\"output\":0}"),
          "samplers[0].output: accessors[0] has 3 elements for 2 keys; expected 2" },
        { FAULT("0", "translation", "{\"input\":1,\"output\":2,\"interpolation\":\"CUBICSPLINE\"}"),
          "samplers[0].output: accessors[2] has 2 elements for 2 keys; expected 6" },
        { FAULT("0", "rotation", "{\"input\":1,\"output\":2}"), "output: accessors[2] has 3 components; expected 4" },
        { FAULT("0", "translation", "{\"input\":1,\"output\":6}"), "accessors[6] holds a number that is not finite" },
        { FAULT("0", "translation", "{\"input\":1,\"output\":2,\"interpolation\":\"BEZIER\"}"),
          "samplers[0]: interpolation is 'BEZIER'; expected LINEAR, STEP or CUBICSPLINE" },
        { FAULT("0", "translation", "{\"output\":2}"), "samplers[0].input: " },
        { FAULT("0", "translation", "{\"input\":1,\"output\":99}"),
          "samplers[0].output: accessors[99] does not exist" },
        { FAULT("0", "translation", ""), "channels[0]: names a sampler that does not exist; the animation has 0" },
        { FAULT("7", "translation", "{\"input\":1,\"output\":2}"),
          "animations[0].channels[0].target.node: nodes[7] does not exist; the file has 1" },
        { FAULT("0", "weights", "{\"input\":1,\"output\":2}"),
          "channels[0].target: weights are animated of a node without morph targets" },
        { "\"nodes\":[{\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}]," MESH
          "," CHANNEL("0", "scale", "LINEAR"),
          "channels[0].target: nodes[0] has a matrix, which cannot be animated" },
    };
    struct make m;

    (void)state;
    begin(&m);
    FLOATS(&m, places, "VEC3", 2);
    FLOATS(&m, same, "SCALAR", 2);
    FLOATS(&m, nan, "SCALAR", 2);
    make_array(&m, (const uint8_t[]){ 1, 2 }, 2, 5121, "SCALAR", 2);
    const int view = make_view(&m, wild, sizeof(wild), ""); /* without its bounds, which JSON cannot hold */
    make_accessor(&m, "\"bufferView\":%d,\"componentType\":5126,\"type\":\"VEC3\",\"count\":2", view);
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        struct reason why = { "" };
        struct scene *s = NULL;
        const enum err e = load_at(make_gltf(&m, cases[i].rest), 2.0, &s, &why);
        if (e != ERR_FORMAT || !strstr(why.text, cases[i].said))
            fail_msg("%d: %s\nnot\n%s", (int)e, why.text, cases[i].said);
    }
    make_end(&m);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(linear_is_between_its_keys_and_stays_at_its_ends),
    cmocka_unit_test(a_step_holds_until_the_next_key),
    cmocka_unit_test(a_spline_follows_its_tangents),
    cmocka_unit_test(rotations_turn_at_an_even_rate),
    cmocka_unit_test(rotations_may_be_integers),
    cmocka_unit_test(children_and_cameras_follow),
    cmocka_unit_test(weights_are_animated),
    cmocka_unit_test(skins_follow_their_joints),
    cmocka_unit_test(at_rest_nothing_moves_and_the_flag_is_named),
    cmocka_unit_test(only_the_first_animation_counts),
    cmocka_unit_test(a_json_scene_sets_the_time_of_each_model),
    cmocka_unit_test(bad_animations_are_refused),
};

UNIT_MAIN(tests)
