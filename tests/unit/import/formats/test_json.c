#include "scene/geometry/files.h"
#include "scene/geometry/load.h"

#include <math.h>

#define CAMERA "\"camera\":{\"position\":[0,1,5],\"look_at\":[0,0,0],\"fov_y_degrees\":40}"
#define GREY "\"materials\":{\"grey\":{\"type\":\"lambert\",\"albedo\":[0.5,0.4,0.3]}}"
#define MODEL "\"models\":[{\"file\":\"quad.obj\"}]"

static const char quad[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl grey\nf 1 2 3 4\n";

static struct scene *load_text(struct folder *f, const char *json)
{
    return load_or_fail(folder_text(f, "scene.json", json));
}

static void obj_groups_take_materials_by_name(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "two.obj",
                "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\n"
                "usemtl red\nf 1 2 3\nusemtl grey\nf 5 6 7\nf 1 3 4\n");
    struct scene *s = load_text(
        &f, "{" CAMERA ",\"models\":[{\"file\":\"two.obj\"}],\"materials\":{"
            "\"grey\":{\"type\":\"lambert\",\"albedo\":[0.5,0.5,0.5]},"
            "\"red\":{\"type\":\"phong\",\"diffuse\":[0.5,0.1,0.1],\"specular\":[0.5,0.5,0.5],\"exponent\":20}}}");
    uint32_t of[2] = { 0, 0 };
    for (size_t i = 0; i < s->mesh_count; i++)
        of[strcmp(s->materials[s->meshes[i].material].name, "red") == 0] += s->meshes[i].triangle_count;
    assert_int_equal(of[1], 1);
    assert_int_equal(of[0], 2);
    assert_int_equal(s->triangle_count, 3);
    const struct material *red = &s->materials[scene_find_material(s, "red", 0)];
    assert_int_equal(red->kind, MATERIAL_PHONG);
    assert_float_equal(red->exponent, 20.0f, 0.0f);
    assert_float_equal(red->diffuse.x, 0.5f, 0.0f);
    scene_destroy(s);
    folder_remove(&f);
}

static void material_of_the_model_overrides_all(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl nobody\nf 1 2 3\n");
    struct scene *s = load_text(&f, "{" CAMERA ",\"models\":[{\"file\":\"quad.obj\",\"material\":\"grey\"}]," GREY "}");
    assert_string_equal(s->materials[s->meshes[0].material].name, "grey");
    assert_float_equal(s->materials[s->meshes[0].material].diffuse.z, 0.3f, 0.0f);
    scene_destroy(s);
    folder_remove(&f);
}

static void transform_is_column_major(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", quad);
    /* x goes to 2 y, y goes to 3 z, z goes to x; then moved by (10, 20, 30) */
    struct scene *s = load_text(&f, "{" CAMERA ",\"models\":[{\"file\":\"quad.obj\",\"transform\":"
                                    "[0,2,0,0, 0,0,3,0, 1,0,0,0, 10,20,30,1]}]," GREY "}");
    assert_float_equal(s->low.x, 10.0f, 0.0f);
    assert_float_equal(s->high.x, 10.0f, 0.0f);
    assert_float_equal(s->low.y, 20.0f, 0.0f);
    assert_float_equal(s->high.y, 22.0f, 0.0f);
    assert_float_equal(s->low.z, 30.0f, 0.0f);
    assert_float_equal(s->high.z, 33.0f, 0.0f);
    scene_destroy(s);
    folder_remove(&f);
}

static void alpha_is_the_fraction_that_is_there(void **state)
{
    static const struct {
        const char *text;
        enum alpha_mode mode;
        float alpha;
    } cases[] = {
        { "", ALPHA_OPAQUE, 1.0f },
        { ",\"alpha\":1", ALPHA_OPAQUE, 1.0f },
        { ",\"alpha\":0.3", ALPHA_BLEND, 0.3f },
        { ",\"alpha\":0", ALPHA_BLEND, 0.0f },
    };
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", quad);
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        char text[1000];
        snprintf(text, sizeof(text), "{" CAMERA "," MODEL ",\"materials\":{\"grey\":{\"type\":\"glass\"%s}}}",
                 cases[i].text);
        struct scene *s = load_text(&f, text);
        assert_int_equal(s->materials[0].alpha_mode, cases[i].mode);
        assert_float_equal(s->materials[0].alpha, cases[i].alpha, 1e-6f);
        assert_int_equal(s->materials[0].alpha_texture, MATERIAL_NO_TEXTURE);
        scene_destroy(s);
    }
    folder_remove(&f);
}

static struct vec3 triangle_normal(const struct mesh *m, uint32_t triangle)
{
    struct vec3 p[3];

    for (int k = 0; k < 3; k++) {
        const float *v = m->positions + 3 * (size_t)m->indices[3 * (size_t)triangle + (size_t)k];
        p[k] = vec3_make(v[0], v[1], v[2]);
    }
    return vec3_normalize(vec3_cross(vec3_sub(p[1], p[0]), vec3_sub(p[2], p[0])));
}

static void reflected_models_keep_their_outside(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", quad); /* faces +z */
    struct scene *s = load_text(&f, "{" CAMERA ",\"models\":[{\"file\":\"quad.obj\",\"smooth\":true,\"transform\":"
                                    "[-1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]}]," GREY "}");
    assert_float_equal(triangle_normal(&s->meshes[0], 0).z, 1.0f, 1e-6f);
    assert_float_equal(s->meshes[0].normals[2], 1.0f, 1e-6f);
    scene_destroy(s);
    folder_remove(&f);
}

/* A ridge: two quads that meet at a right angle along the z axis. */
static const char ridge[] = "v 0 1 0\nv 0 1 1\nv -1 0 0\nv -1 0 1\nv 1 0 0\nv 1 0 1\n"
                            "usemtl grey\nf 1 3 4 2\nf 1 2 6 5\n";

static void flat_unless_smooth_is_asked_for(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "ridge.obj", ridge);
    struct scene *s = load_text(&f, "{" CAMERA ",\"models\":[{\"file\":\"ridge.obj\"}]," GREY "}");
    assert_null(s->meshes[0].normals);
    scene_destroy(s);
    s = load_text(&f, "{" CAMERA ",\"models\":[{\"file\":\"ridge.obj\",\"smooth\":true}]," GREY "}");
    assert_non_null(s->meshes[0].normals);
    for (uint32_t i = 0; i < s->meshes[0].vertex_count; i++) {
        const float *p = s->meshes[0].positions + 3 * i, *n = s->meshes[0].normals + 3 * i;
        const float at_ridge = p[1] > 0.5f ? 0.0f : p[0] / sqrtf(2.0f); /* both sides' mean at the ridge */
        assert_float_equal(n[0], at_ridge, 1e-6f);
        assert_float_equal(n[1], p[1] > 0.5f ? 1.0f : 1.0f / sqrtf(2.0f), 1e-6f);
    }
    scene_destroy(s);
    folder_remove(&f);
}

static void made_normals_do_not_depend_on_how_faces_are_cut(void **state)
{
    /* three sides of a cube about the corner 0 0 0, which two of the triangles of one side share */
    static const char corner[] = "v 0 0 0\nv -1 0 0\nv 0 -1 0\nv 0 0 -1\nv -1 -1 0\nusemtl grey\n"
                                 "f 1 2 5\nf 1 5 3\nf 1 3 4\nf 1 4 2\n";
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", corner);
    struct scene *s = load_text(&f, "{" CAMERA ",\"models\":[{\"file\":\"quad.obj\",\"smooth\":true}]," GREY "}");
    const struct mesh *m = &s->meshes[0];
    for (uint32_t i = 0; i < m->vertex_count; i++) {
        const float *p = m->positions + 3 * i, *n = m->normals + 3 * i;
        for (int k = 0; k < 3 && p[0] == 0.0f && p[1] == 0.0f && p[2] == 0.0f; k++)
            assert_float_equal(n[k], 1.0f / sqrtf(3.0f), 1e-6f);
    }
    scene_destroy(s);
    folder_remove(&f);
}

static void normals_of_the_file_are_used_where_smooth(void **state)
{
    static const char tilted[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvn 0.6 0 0.8\nusemtl grey\nf 1//1 2//1 3//1\n";
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", tilted);
    /* twice as high: the normal, being a plane's, turns the other way than a direction in it */
    struct scene *s = load_text(&f, "{" CAMERA ",\"models\":[{\"file\":\"quad.obj\",\"smooth\":true,\"transform\":"
                                    "[2,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]}]," GREY "}");
    const float l = sqrtf(0.3f * 0.3f + 0.8f * 0.8f);
    assert_float_equal(s->meshes[0].normals[0], 0.3f / l, 1e-6f);
    assert_float_equal(s->meshes[0].normals[2], 0.8f / l, 1e-6f);
    scene_destroy(s);
    s = load_text(&f, "{" CAMERA "," MODEL "," GREY "}");
    assert_null(s->meshes[0].normals);
    scene_destroy(s);
    folder_remove(&f);
}

static void what_is_no_triangle_is_left_out_with_one_warning(void **state)
{
    static const char bad[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv nan 0 0\nv 2 0 0\nv 1e30 0 0\nusemtl grey\n"
                              "f 1 2 3\nf 1 1 2\nf 1 2 5\nf 1 2 4\nf 6 2 3\nl 1 2\np 3\n";
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", bad);
    const char *path = folder_text(&f, "scene.json", "{" CAMERA "," MODEL "," GREY "}");
    log_begin();
    struct scene *s = NULL;
    struct reason why = { "" };
    const enum err e = load_here(path, &s, &why);
    const char *said = log_end();
    assert_int_equal(e, ERR_OK);
    assert_int_equal(s->triangle_count, 1);
    assert_float_equal(s->high.x, 1.0f, 0.0f); /* what was left out does not stretch the box */
    assert_int_equal(count_of(said, "dropped"), 1);
    assert_int_equal(count_of(said, "quad.obj"), 2); /* lines and points have a warning of their own */
    scene_destroy(s);
    folder_remove(&f);
}

static void cameras_have_names(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", quad);
    struct scene *s =
        load_text(&f, "{\"cameras\":{\"near\":{\"position\":[0,0,1],\"look_at\":[0,0,0],\"fov_y_degrees\":90},"
                      "\"far\":{\"position\":[0,0,9],\"look_at\":[0,0,0],\"up\":[1,0,0],\"fov_y_degrees\":20}}," MODEL
                      "," GREY "}");
    assert_int_equal(s->camera_count, 2);
    assert_string_equal(scene_camera(s, NULL)->name, "near");
    assert_float_equal(scene_camera(s, "far")->position.z, 9.0f, 0.0f);
    assert_float_equal(scene_camera(s, "far")->up.x, 1.0f, 0.0f);
    assert_float_equal(scene_camera(s, "near")->up.y, 1.0f, 0.0f);
    assert_float_equal(scene_camera(s, "near")->fov_y, (float)PI / 2.0f, 1e-6f);
    assert_null(scene_camera(s, "nowhere"));
    scene_destroy(s);
    s = load_text(&f, "{\"cameras\":[{\"name\":\"a\",\"position\":[0,0,1],\"look_at\":[0,0,0],"
                      "\"fov_y_degrees\":90}]," MODEL "," GREY "}");
    assert_string_equal(scene_camera(s, NULL)->name, "a");
    scene_destroy(s);
    s = load_text(&f, "{" CAMERA "," MODEL "," GREY "}");
    assert_string_equal(scene_camera(s, NULL)->name, "main");
    scene_destroy(s);
    folder_remove(&f);
}

static void unknown_keys_are_warned_about(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", quad);
    const char *path = folder_text(&f, "scene.json",
                                   "{" CAMERA ",\"models\":[{\"file\":\"quad.obj\",\"smoth\":true}],\"materials\":"
                                   "{\"grey\":{\"type\":\"lambert\",\"albedo\":[0,0,0],\"colour\":3}},\"light\":1}");
    log_begin();
    struct scene *s = load_or_fail(path);
    const char *said = log_end();
    assert_int_equal(count_of(said, "models[0]: unknown key 'smoth'"), 1);
    assert_int_equal(count_of(said, "materials 'grey': unknown key 'colour'"), 1);
    assert_int_equal(count_of(said, "scene.json: unknown key 'light'"), 1);
    assert_int_equal(count_of(said, "\n"), 3);
    scene_destroy(s);
    folder_remove(&f);
}

#define LAMBERT(albedo) "{" CAMERA "," MODEL ",\"materials\":{\"grey\":{\"type\":\"lambert\",\"albedo\":" albedo "}}}"
#define PHONG(d, s, n)                                                                                                 \
    "{" CAMERA "," MODEL ",\"materials\":{\"grey\":{\"type\":\"phong\",\"diffuse\":" d ",\"specular\":" s              \
    ",\"exponent\":" n "}}}"
#define LIT(light) "{" CAMERA "," MODEL "," GREY ",\"lights\":[" light "]}"
#define OTHER(body) "{" CAMERA "," MODEL ",\"materials\":{\"grey\":{" body "}}}"
#define SEEN_FROM(camera) "{\"camera\":{" camera "}," MODEL "," GREY "}"
#define MODELS(models) "{" CAMERA ",\"models\":" models "," GREY "}"

static const struct {
    const char *json;
    enum err expected;
    const char *place, *fault; /* parts of the message, besides the file */
} bad_scenes[] = {
    { "", ERR_FORMAT, "line 1", "" },
    { "{\n \"camera\": {\n", ERR_FORMAT, "line 3", "" },
    { "{\"camera\":1,\"camera\":2}", ERR_FORMAT, "line 1", "duplicate" },
    { "[]", ERR_FORMAT, "", "not a JSON object" },
    { "{" CAMERA "," GREY "}", ERR_FORMAT, "", "no models" },
    { MODELS("[]"), ERR_FORMAT, "", "no models" },
    { MODELS("{}"), ERR_FORMAT, "models", "not an array" },
    { MODELS("[3]"), ERR_FORMAT, "models[0]", "not an object" },
    { MODELS("[{}]"), ERR_FORMAT, "models[0]", "'file' is missing" },
    { MODELS("[{\"file\":7}]"), ERR_FORMAT, "models[0]", "'file'" },
    { MODELS("[{\"file\":\"none.obj\"}]"), ERR_IO, "models[0]", "none.obj: No such file" },
    { MODELS("[{\"file\":\"quad.obj\"},{\"file\":\"quad.obj\",\"material\":\"blue\"}]"), ERR_FORMAT, "models[1]",
      "unknown material 'blue'" },
    { MODELS("[{\"file\":\"other.obj\"}]"), ERR_FORMAT, "other.obj", "unknown material 'violet'" },
    { MODELS("[{\"file\":\"empty.obj\"}]"), ERR_FORMAT, "empty.obj", "" },
    { MODELS("[{\"file\":\"lines.obj\"}]"), ERR_FORMAT, "lines.obj", "no triangles" },
    { MODELS("[{\"file\":\"broken.ply\"}]"), ERR_FORMAT, "broken.ply", "" },
    { MODELS("[{\"file\":\"ended.ply\"}]"), ERR_FORMAT, "ended.ply: line 9", "not part of a PLY header" },
    { MODELS("[{\"file\":\"far.ply\",\"material\":\"grey\"}]"), ERR_FORMAT, "far.ply", "refers to vertex 7 of 3" },
    { MODELS("[{\"file\":\"none.ply\",\"material\":\"grey\"}]"), ERR_FORMAT, "none.ply", "has no vertices" },
    { MODELS("[{\"file\":\"model.xyz\"}]"), ERR_UNSUPPORTED, "models[0]", "model.xyz: unknown format" },
    { MODELS("[{\"file\":\"quad.obj\",\"smooth\":1}]"), ERR_FORMAT, "models[0]", "'smooth'" },
    { MODELS("[{\"file\":\"quad.obj\",\"transform\":[1,2]}]"), ERR_FORMAT, "models[0]", "16 numbers" },
    { MODELS("[{\"file\":\"quad.obj\",\"transform\":[1,0,0,1, 0,1,0,0, 0,0,1,0, 0,0,0,1]}]"), ERR_RANGE, "models[0]",
      "affine" },
    { MODELS("[{\"file\":\"quad.obj\",\"transform\":[1,0,0,0, 0,1,0,0, 0,0,0,0, 0,0,0,1]}]"), ERR_RANGE, "models[0]",
      "determinant" },
    { LAMBERT("[0.5,0.5]"), ERR_FORMAT, "materials 'grey'", "'albedo' is not an array of three" },
    { LAMBERT("[0.5,0.5,\"x\"]"), ERR_FORMAT, "materials 'grey'", "'albedo' is not an array of three" },
    { LAMBERT("[0.5,0.5,1.5]"), ERR_RANGE, "materials 'grey'", "'albedo' holds 1.5" },
    { LAMBERT("[-0.5,0.5,0.5]"), ERR_RANGE, "materials 'grey'", "'albedo' holds -0.5" },
    { LAMBERT("[1e400,0,0]"), ERR_FORMAT, "line 1", "" },
    { PHONG("[0.5,0.5,0.5]", "[0.5,0.6,0.5]", "10"), ERR_RANGE, "materials 'grey'", "diffuse + specular is 1.1" },
    { PHONG("[0.5,0.5,0.5]", "[0.5,0.5,0.5]", "-1"), ERR_RANGE, "materials 'grey'", "'exponent' is -1" },
    { PHONG("[0.5,0.5,0.5]", "[0.5,0.5,0.5]", "2e6"), ERR_RANGE, "materials 'grey'", "'exponent' is 2e+06" },
    { OTHER("\"albedo\":[0,0,0]"), ERR_FORMAT, "materials 'grey'", "'type' is missing" },
    { OTHER("\"type\":\"velvet\""), ERR_FORMAT, "materials 'grey'", "unknown type 'velvet'" },
    { OTHER("\"type\":\"lambert\""), ERR_FORMAT, "materials 'grey'", "'albedo' is missing" },
    { OTHER("\"type\":\"mirror\",\"reflectance\":[1,1,1],\"alpha\":1.5"), ERR_RANGE, "materials 'grey'",
      "'alpha' is 1.5" },
    { OTHER("\"type\":\"ggx\",\"roughness\":1.2"), ERR_RANGE, "materials 'grey'", "'roughness' is 1.2" },
    { OTHER("\"type\":\"glass\",\"ior\":9"), ERR_RANGE, "materials 'grey'", "'ior' is 9" },
    { OTHER("\"type\":\"mirror\",\"reflectance\":[2,0,0]"), ERR_RANGE, "materials 'grey'", "'reflectance' holds 2" },
    { OTHER("\"type\":\"mirror\",\"emission\":[0,-1,0]"), ERR_RANGE, "materials 'grey'", "'emission' holds -1" },
    { LIT("{\"type\":\"lantern\"}"), ERR_FORMAT, "lights[0]", "unknown type 'lantern'" },
    { LIT("{\"type\":\"point\",\"intensity\":[1,1,1]}"), ERR_FORMAT, "lights[0]", "'position' is missing" },
    { LIT("{\"type\":\"directional\",\"direction\":[0,0,0],\"illuminance\":[1,1,1]}"), ERR_RANGE, "lights[0]",
      "'direction' is zero" },
    { LIT("{\"type\":\"spot\",\"position\":[0,0,0],\"direction\":[0,1,0],\"intensity\":[1,1,1],\"inner_degrees\":50}"),
      ERR_RANGE, "lights[0]", "'inner_degrees' is 50, more than 'outer_degrees', 45" },
    { SEEN_FROM("\"position\":[0,0,1],\"look_at\":[0,0,0],\"fov_y_degrees\":0"), ERR_RANGE, "camera",
      "fov_y_degrees is 0" },
    { SEEN_FROM("\"position\":[0,0,1],\"look_at\":[0,0,0],\"fov_y_degrees\":180"), ERR_RANGE, "camera",
      "fov_y_degrees is 180" },
    { SEEN_FROM("\"position\":[0,0,1],\"look_at\":[0,0,1],\"fov_y_degrees\":40"), ERR_RANGE, "camera", "are equal" },
    { SEEN_FROM("\"position\":[0,2,0],\"look_at\":[0,0,0],\"fov_y_degrees\":40"), ERR_RANGE, "camera", "parallel" },
    { SEEN_FROM("\"position\":[0,0,1e300],\"look_at\":[0,0,0],\"fov_y_degrees\":40"), ERR_RANGE, "camera",
      "'position' holds" },
    { SEEN_FROM("\"position\":[0,0,1],\"look_at\":[0,0,0]"), ERR_FORMAT, "camera", "'fov_y_degrees' is missing" },
};

#define PLY_HEADER                                                                                                     \
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"  \
    "property list uchar int vertex_indices\n"
#define PLY_POINTS "0 0 0\n1 0 0\n1 1 0\n"

static void bad_scenes_are_refused_by_file_place_and_reason(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", quad);
    folder_text(&f, "other.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl violet\nf 1 2 3\n");
    folder_text(&f, "empty.obj", "");
    folder_text(&f, "lines.obj", "v 0 0 0\nv 1 0 0\nusemtl grey\nl 1 2\n");
    folder_text(&f, "broken.ply", "ply\nformat binary_little_endian 1.0\nelement vertex 90\nproperty float x\n");
    folder_text(&f, "ended.ply", PLY_HEADER "xend_header\n" PLY_POINTS "3 0 1 2\n");
    folder_text(&f, "far.ply", PLY_HEADER "end_header\n" PLY_POINTS "3 0 1 7\n");
    folder_text(&f, "none.ply", PLY_HEADER "end_header\n" PLY_POINTS "0\n");
    for (size_t i = 0; i < sizeof(bad_scenes) / sizeof(bad_scenes[0]); i++) {
        struct reason why = { "" };
        struct scene *s = (struct scene *)&why;
        const char *path = folder_text(&f, "bad.json", bad_scenes[i].json);
        const enum err e = load_here(path, &s, &why);
        const bool told = strstr(why.text, "bad.json") && strstr(why.text, bad_scenes[i].place) &&
                          strstr(why.text, bad_scenes[i].fault) && !strchr(why.text, '\n');
        if (e != bad_scenes[i].expected || !told || s)
            fail_msg("%s\n gave %d: %s", bad_scenes[i].json, (int)e, why.text);
    }
    folder_remove(&f);
}

static void missing_and_foreign_files_are_named(void **state)
{
    struct reason why;
    struct scene *s;

    (void)state;
    assert_int_equal(load_here("/nowhere/at-all.json", &s, &why), ERR_IO);
    assert_non_null(strstr(why.text, "/nowhere/at-all.json"));
    assert_int_equal(load_here("/nowhere/at-all.glb", &s, &why), ERR_IO);
    assert_non_null(strstr(why.text, "/nowhere/at-all.glb"));
    assert_int_equal(load_here("/nowhere/at-all.blend", &s, &why), ERR_UNSUPPORTED);
    assert_null(s);
}

static void phong_may_be_exactly_white(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", quad);
    struct scene *s = load_text(&f, PHONG("[0.45,0.35,0.15]", "[0.55,0.65,0.85]", "0"));
    assert_float_equal(s->materials[0].exponent, 0.0f, 0.0f);
    scene_destroy(s);
    folder_remove(&f);
}

static void other_materials_are_read_with_their_defaults(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", quad);
    struct scene *s =
        load_text(&f, "{" CAMERA "," MODEL ",\"materials\":{\"grey\":{\"type\":\"mirror\"},"
                      "\"g\":{\"type\":\"glass\",\"attenuation_color\":[0.5,1,1],"
                      "\"attenuation_distance\":2},\"t\":{\"type\":\"glass\",\"tint\":[0.2,0.5,0.8],\"thin\":true},"
                      "\"l\":{\"type\":\"lambert\",\"albedo\":[0.5,0.5,0.5],\"transmission\":0.25,"
                      "\"transmission_color\":[0.1,0.2,0.3]},"
                      "\"m\":{\"type\":\"ggx\",\"base_color\":[0.1,0.2,0.3],"
                      "\"metallic\":0.25,\"roughness\":0.5}}}");
    const struct material *glass = &s->materials[scene_find_material(s, "g", 0)];
    const struct material *ggx = &s->materials[scene_find_material(s, "m", 0)];
    assert_int_equal(s->materials[scene_find_material(s, "grey", 0)].kind, MATERIAL_MIRROR);
    assert_float_equal(s->materials[scene_find_material(s, "grey", 0)].diffuse.x, 1.0f, 0.0f);
    const struct material *leaf = &s->materials[scene_find_material(s, "l", 0)];
    assert_float_equal(leaf->transmits, 0.25f, 0.0f);
    assert_float_equal(leaf->through.z, 0.3f, 0.0f);
    assert_int_equal(leaf->through_texture, MATERIAL_NO_TEXTURE);
    assert_int_equal(glass->kind, MATERIAL_GLASS);
    assert_float_equal(glass->ior, 1.5f, 0.0f);
    assert_float_equal(glass->diffuse.z, 1.0f, 0.0f);
    assert_int_equal(glass->thin, 0);
    assert_int_equal(s->materials[scene_find_material(s, "t", 0)].thin, 1);
    assert_float_equal(glass->attenuation.x, 0.5f * logf(2.0f), 1e-6f);
    assert_float_equal(glass->attenuation.y, 0.0f, 0.0f);
    assert_float_equal(s->materials[scene_find_material(s, "t", 0)].diffuse.z, 0.8f, 0.0f);
    assert_float_equal(s->materials[scene_find_material(s, "t", 0)].attenuation.x, 0.0f, 0.0f);
    assert_int_equal(ggx->kind, MATERIAL_GGX);
    assert_float_equal(ggx->diffuse.y, 0.2f, 0.0f);
    assert_float_equal(ggx->metallic, 0.25f, 0.0f);
    assert_float_equal(ggx->roughness, 0.5f, 0.0f);
    scene_destroy(s);
    folder_remove(&f);
}

static void lamps_are_read_with_their_defaults(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "quad.obj", quad);
    struct scene *s = load_text(
        &f, "{" CAMERA "," MODEL ",\"materials\":{\"grey\":{\"type\":\"mirror\",\"emission\":[12,0,1e6]}},\"lights\":["
            "{\"type\":\"point\",\"position\":[1,2,3],\"intensity\":[4,5,6]},"
            "{\"type\":\"spot\",\"position\":[1,2,3],\"direction\":[0,0,-7],\"intensity\":[4,5,6]},"
            "{\"type\":\"spot\",\"position\":[1,2,3],\"direction\":[0,0,-7],\"intensity\":[4,5,6],"
            "\"inner_degrees\":60,\"outer_degrees\":90},"
            "{\"type\":\"directional\",\"direction\":[3,-4,0],\"illuminance\":[7,8,9]}]}");
    const struct punctual_light *l = s->lights;
    assert_float_equal(s->materials[0].emission.z, 1e6f, 0.0f);
    assert_int_equal(s->light_count, 4);
    assert_int_equal(l[0].kind, LIGHT_POINT);
    assert_float_equal(l[0].position.y, 2.0f, 0.0f);
    assert_float_equal(l[0].intensity.z, 6.0f, 0.0f);
    assert_int_equal(l[1].kind, LIGHT_SPOT);
    assert_float_equal(l[1].direction.z, -1.0f, 0.0f);
    assert_float_equal(l[1].inner_cos, 1.0f, 0.0f);
    assert_float_equal(l[1].outer_cos, sqrt(0.5), 1e-6f);
    assert_float_equal(l[2].inner_cos, 0.5f, 1e-6f);
    assert_float_equal(l[2].outer_cos, 0.0f, 1e-6f);
    assert_int_equal(l[3].kind, LIGHT_DIRECTIONAL);
    assert_float_equal(l[3].direction.y, -0.8f, 1e-6f);
    assert_float_equal(l[3].intensity.x, 7.0f, 0.0f);
    scene_destroy(s);
    folder_remove(&f);
}

static void shared_scenes_load(void **state)
{
    static const struct {
        const char *path;
        uint64_t triangles;
    } files[] = {
        { "../scenes/plaza.json", 100156 },
        { "../scenes/ring.json", 19982 },
        { "../scenes/dragon.json", 370002 },
    };

    (void)state;
    for (size_t i = 0; i < sizeof(files) / sizeof(files[0]); i++) {
        struct scene *s = load_or_fail(unit_data(files[i].path));
        assert_int_equal(s->triangle_count, files[i].triangles);
        assert_int_equal(s->camera_count, 1);
        assert_int_equal(s->unmodelled, 0);
        assert_float_equal(s->low.x, -20.0f, 0.0f);
        scene_destroy(s);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(obj_groups_take_materials_by_name),
    cmocka_unit_test(material_of_the_model_overrides_all),
    cmocka_unit_test(transform_is_column_major),
    cmocka_unit_test(alpha_is_the_fraction_that_is_there),
    cmocka_unit_test(reflected_models_keep_their_outside),
    cmocka_unit_test(flat_unless_smooth_is_asked_for),
    cmocka_unit_test(made_normals_do_not_depend_on_how_faces_are_cut),
    cmocka_unit_test(normals_of_the_file_are_used_where_smooth),
    cmocka_unit_test(what_is_no_triangle_is_left_out_with_one_warning),
    cmocka_unit_test(cameras_have_names),
    cmocka_unit_test(unknown_keys_are_warned_about),
    cmocka_unit_test(bad_scenes_are_refused_by_file_place_and_reason),
    cmocka_unit_test(missing_and_foreign_files_are_named),
    cmocka_unit_test(phong_may_be_exactly_white),
    cmocka_unit_test(other_materials_are_read_with_their_defaults),
    cmocka_unit_test(lamps_are_read_with_their_defaults),
    cmocka_unit_test(shared_scenes_load),
};

UNIT_MAIN(tests)
