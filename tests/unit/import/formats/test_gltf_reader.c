/* The parts of glTF's geometry, against numbers worked out by hand. */
#include "gltf_make.h"

#include "scene/geometry/rays.h"
#include "scene/geometry/scatter_hit.h"
#include "scene/geometry/view.h"
#include "scene/surface/scatter.h"

/* A unit square in z = 0, as a fan of its corners. */
static const float corners[] = { 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0 };
static const uint8_t two_triangles[] = { 0, 1, 2, 0, 2, 3 };

/* One texel as a PNG file. */
#define GREY_TEXEL                                                                                                     \
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6"                                                   \
    "fptVAAAACklEQVR42mNoAAAAggCB2kUIOwAAAABJRU5ErkJggg=="

#define NODE "\"nodes\":[{\"mesh\":0}]"
#define MESH(primitive) "\"meshes\":[{\"primitives\":[{" primitive "}]}]"
#define SQUARE "\"attributes\":{\"POSITION\":0},\"indices\":1"

static void make_square(struct make *m)
{
    make_begin(m);
    FLOATS(m, corners, "VEC3", 4);
    make_array(m, two_triangles, sizeof(two_triangles), 5121, "SCALAR", 6);
}

static const char *square_file(struct make *m, const char *rest)
{
    char text[4096];
    snprintf(text, sizeof(text), MESH(SQUARE) ",%s", rest);
    return make_gltf(m, text);
}

static struct scene *square_scene(struct make *m, const char *rest)
{
    return load_or_fail(square_file(m, rest));
}

static struct vec3 ahead_of(const struct camera *c)
{
    return vec3_normalize(vec3_sub(c->look_at, c->position));
}

/* ---- Cameras ---- */

/* The node is turned by 90 degrees about x, so that it looks along +y, and moved by (1, 2, 3) before its parent turns
 * it by 90 degrees about y, (x, y, z) to (z, y, -x), and moves it by 10 along x. */
static void camera_stands_where_its_node_is(void **state)
{
    static const char *const nodes[] = {
        "\"rotation\":[0.70710678,0,0,0.70710678],\"translation\":[1,2,3]",
        "\"matrix\":[1,0,0,0, 0,0,1,0, 0,-1,0,0, 1,2,3,1]",
    };
    struct make m;

    (void)state;
    for (int i = 0; i < 2; i++) {
        char text[1024];
        make_square(&m);
        snprintf(text, sizeof(text),
                 "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0},{\"children\":[2],\"translation\":[10,0,0],"
                 "\"rotation\":[0,0.70710678,0,0.70710678]},{\"camera\":0,%s}],"
                 "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":0.5,\"znear\":0.1}}]",
                 nodes[i]);
        struct scene *s = square_scene(&m, text);
        assert_int_equal(s->camera_count, 1);
        assert_near(s->cameras[0].position, 13, 2, -1);
        assert_near(ahead_of(&s->cameras[0]), 0, 1, 0);
        assert_near(s->cameras[0].up, 1, 0, 0); /* +y became +z, then +x */
        scene_destroy(s);
        make_end(&m);
    }
}

/* A point at the upper edge of the box, in the plane through the middle of the scene, is at the upper edge of the
 * image. */
static void orthographic_camera_becomes_a_distant_one(void **state)
{
    struct projection p;
    struct make m;
    struct view v;

    (void)state;
    make_square(&m);
    log_begin();
    struct scene *s =
        square_scene(&m, "\"nodes\":[{\"mesh\":0},{\"camera\":0,\"translation\":[0.5,0.5,7]}],"
                         "\"cameras\":[{\"type\":\"orthographic\",\"orthographic\":{\"xmag\":2,\"ymag\":3,"
                         "\"zfar\":100,\"znear\":0}}]");
    assert_int_equal(count_of(log_end(), "cameras[0]: is orthographic: approximated"), 1);
    view_init(&v, &s->cameras[0], 100, 100);
    assert_true(view_project(&v, vec3_make(0.5f, 0.5f + 2.9999f, 0.0f), &p));
    assert_float_equal(p.y, 0.0f, 0.01f);
    assert_true(view_project(&v, vec3_make(0.5f + 1.5f, 0.5f, 0.0f), &p));
    assert_float_equal(p.x, 75.0f, 0.01f);
    assert_true(view_project(&v, vec3_make(0.5f + 1.5f, 0.5f, 3.0f), &p)); /* nearly no perspective: 25 * 3 / 688 */
    assert_float_equal(p.x, 75.0f, 0.12f);
    scene_destroy(s);
    make_end(&m);
}

static void bad_camera_is_left_out(void **state)
{
    struct make m;

    (void)state;
    make_square(&m);
    log_begin();
    faults_intended = true;
    struct scene *s = square_scene(
        &m, "\"nodes\":[{\"mesh\":0},{\"camera\":0},{\"camera\":1},{\"camera\":2,\"translation\":[0,0,9]}],"
            "\"cameras\":[{\"type\":\"orthographic\",\"orthographic\":{\"ymag\":0}},"
            "{\"type\":\"perspective\",\"perspective\":{\"yfov\":4}},"
            "{\"name\":\"good\",\"type\":\"perspective\",\"perspective\":{\"yfov\":1,\"znear\":1}}]");
    const char *said = log_end();
    faults_intended = false;
    assert_int_equal(count_of(said, "cameras[0]: is left out: "), 1);
    assert_int_equal(count_of(said, "cameras[1]: is left out: "), 1);
    assert_int_equal(s->camera_count, 1);
    assert_string_equal(s->cameras[0].name, "good");
    scene_destroy(s);
    make_end(&m);
}

static void cameras_are_named_by_node_then_camera(void **state)
{
    static const char *const names[] = { "door", "lens", "camera 1", "door (2)" };
    struct make m;

    (void)state;
    make_square(&m);
    struct scene *s = square_scene(
        &m, "\"nodes\":[{\"mesh\":0},{\"camera\":1},{\"name\":\"door\",\"camera\":0},{\"camera\":0},"
            "{\"camera\":1,\"name\":\"door\"}],"
            "\"cameras\":[{\"name\":\"lens\",\"type\":\"perspective\",\"perspective\":{\"yfov\":1,\"znear\":1}},"
            "{\"type\":\"perspective\",\"perspective\":{\"yfov\":1,\"znear\":1}}]");
    assert_int_equal(s->camera_count, 4);
    for (int i = 0; i < 4; i++)
        assert_string_equal(s->cameras[i].name, names[i]);
    scene_destroy(s);
    make_end(&m);
}

/* ---- Accessors ---- */

/* One triangle whose second corner is `numbers`, of a type; the others are 0 and (0, 1, 0) in whatever unit. */
static struct vec3 second_corner(int type, size_t size, bool normalized, const void *numbers, const void *one)
{
    uint8_t bytes[64] = { 0 }; /* corners 16 bytes apart */
    struct make m;

    make_begin(&m);
    memcpy(bytes + 16, numbers, 3 * size);
    memcpy(bytes + 32 + size, one, size);
    const int view = make_view(&m, bytes, 48, ",\"byteStride\":16");
    make_accessor(&m, "\"bufferView\":%d,\"componentType\":%d,\"type\":\"VEC3\",\"count\":3%s%s", view, type,
                  normalized ? ",\"normalized\":true" : "", make_bounds(bytes, type, 16, 3));
    struct scene *s = make_scene(&m, "\"extensionsRequired\":[\"KHR_mesh_quantization\"]," NODE
                                     "," MESH("\"attributes\":{\"POSITION\":0}"));
    assert_int_equal(s->triangle_count, 1);
    const struct vec3 v = vertex(&s->meshes[0], s->meshes[0].indices[1]);
    scene_destroy(s);
    make_end(&m);
    return v;
}

static void components_of_every_type_are_read(void **state)
{
    const int8_t b[3] = { 127, -128, 64 }, b1 = 100;
    const uint8_t ub[3] = { 255, 0, 51 }, ub1 = 200;
    const int16_t s[3] = { 32767, -32768, 1 }, s1 = 30000;
    const uint16_t us[3] = { 65535, 0, 13107 }, us1 = 60000;
    const float f[3] = { 0.5f, -2.0f, 1e6f }, f1 = 1.0f;

    (void)state;
    assert_near(second_corner(5120, 1, false, b, &b1), 127, -128, 64);
    assert_near(second_corner(5120, 1, true, b, &b1), 1, -1, 64.0f / 127.0f);
    assert_near(second_corner(5121, 1, false, ub, &ub1), 255, 0, 51);
    assert_near(second_corner(5121, 1, true, ub, &ub1), 1, 0, 0.2f);
    assert_near(second_corner(5122, 2, false, s, &s1), 32767, -32768, 1);
    assert_near(second_corner(5122, 2, true, s, &s1), 1, -1, 1.0f / 32767.0f);
    assert_near(second_corner(5123, 2, false, us, &us1), 65535, 0, 13107);
    assert_near(second_corner(5123, 2, true, us, &us1), 1, 0, 0.2f);
    assert_near(second_corner(5126, 4, false, f, &f1), 0.5f, -2.0f, 1e6f);
}

/* Corners 1 and 3 of the square move: its area becomes 6, by the shoelace formula. Where all others are zero, the
 * triangle of these two and corner 0 has 17.5. */
static void sparse_accessors_replace_elements(void **state)
{
    static const uint16_t which[] = { 1, 3 };
    static const float values[] = { 5, 0, 0, 0, 7, 0 };
    static const uint8_t others[] = { 0, 1, 3 };

    (void)state;
    for (int based = 0; based < 2; based++) {
        struct make m;
        make_square(&m);
        const int indices = make_view(&m, which, sizeof(which), ""), to = make_view(&m, values, sizeof(values), "");
        make_accessor(&m,
                      "%s\"componentType\":5126,\"type\":\"VEC3\",\"count\":4,\"min\":[0,0,0],\"max\":[5,7,0],"
                      "\"sparse\":{\"count\":2,"
                      "\"indices\":{\"bufferView\":%d,\"componentType\":5123},\"values\":{\"bufferView\":%d}}",
                      based ? "\"bufferView\":0," : "", indices, to);
        make_array(&m, others, sizeof(others), 5121, "SCALAR", 3);
        struct scene *s = make_scene(&m, based ? NODE "," MESH("\"attributes\":{\"POSITION\":2},\"indices\":1")
                                               : NODE "," MESH("\"attributes\":{\"POSITION\":2},\"indices\":3"));
        assert_near(area_of(&s->meshes[0]), 0, 0, based ? 6.0f : 17.5f);
        scene_destroy(s);
        make_end(&m);
    }
}

/* ---- Primitives ---- */

/* A zigzag as a strip, the square as a fan: both have area 1 towards +z. */
static void strips_and_fans_wind_as_triangles_do(void **state)
{
    static const uint8_t strip[] = { 0, 1, 3, 2 }, joined[] = { 0, 1, 3, 2, 2, 2 }, folded[] = { 0, 1, 3, 2, 0 };
    struct make m;

    (void)state;
    make_square(&m);
    make_array(&m, strip, sizeof(strip), 5121, "SCALAR", 4);
    make_array(&m, joined, sizeof(joined), 5121, "SCALAR", 6);
    make_array(&m, folded, sizeof(folded), 5121, "SCALAR", 5);
    log_begin();
    struct scene *s = make_scene(&m, NODE ",\"meshes\":[{\"primitives\":["
                                          "{\"mode\":5,\"attributes\":{\"POSITION\":0},\"indices\":2},"
                                          "{\"mode\":5,\"attributes\":{\"POSITION\":0},\"indices\":3},"
                                          "{\"mode\":6,\"attributes\":{\"POSITION\":0}},"
                                          "{\"mode\":4,\"attributes\":{\"POSITION\":0},\"indices\":1}]}]");
    assert_int_equal(count_of(log_end(), "degenerate"), 0); /* those that join strips are meant */
    assert_int_equal(s->mesh_count, 4);
    for (int i = 0; i < 4; i++) {
        assert_int_equal(s->meshes[i].triangle_count, 2);
        assert_near(area_of(&s->meshes[i]), 0, 0, 1);
    }
    scene_destroy(s);
    s = make_scene(&m,
                   NODE ",\"meshes\":[{\"primitives\":[{\"mode\":5,\"attributes\":{\"POSITION\":0},\"indices\":4}]}]");
    assert_near(area_of(&s->meshes[0]), 0, 0, 0.5f); /* the third triangle, (3, 2, 0), faces away */
    scene_destroy(s);
    make_end(&m);
}

static void points_and_lines_are_left_out(void **state)
{
    struct make m;

    (void)state;
    make_square(&m);
    log_begin();
    struct scene *s = make_scene(&m, NODE ",\"meshes\":[{\"primitives\":["
                                          "{\"mode\":0,\"attributes\":{\"POSITION\":0}},"
                                          "{\"mode\":3,\"attributes\":{\"POSITION\":0}},{" SQUARE "}]}]");
    assert_int_equal(count_of(log_end(), "left out points and lines"), 1);
    assert_int_equal(s->mesh_count, 1);
    scene_destroy(s);
    const char *path = make_gltf(&m, NODE "," MESH("\"mode\":0,\"attributes\":{\"POSITION\":0}"));
    assert_non_null(strstr(make_refused(path, ERR_FORMAT), "contains no triangles; points and lines are not rendered"));
    make_end(&m);
}

static void reflected_mesh_keeps_its_outside(void **state)
{
    struct make m;

    (void)state;
    make_square(&m);
    struct scene *s = square_scene(&m, "\"nodes\":[{\"mesh\":0,\"scale\":[-2,1,1]}]");
    assert_near(area_of(&s->meshes[0]), 0, 0, 2);
    assert_float_equal(s->low.x, -2.0f, 0.0f);
    scene_destroy(s);
    make_end(&m);
}

/* The vertices of all parts are one accessor. */
static void parts_keep_only_the_vertices_they_use(void **state)
{
    static const uint8_t second[] = { 0, 2, 3 };
    struct make m;

    (void)state;
    make_square(&m);
    make_array(&m, second, sizeof(second), 5121, "SCALAR", 3);
    struct scene *s = make_scene(&m, NODE "," MESH("\"attributes\":{\"POSITION\":0},\"indices\":2"));
    assert_int_equal(s->meshes[0].vertex_count, 3);
    assert_near(area_of(&s->meshes[0]), 0, 0, 0.5f);
    scene_destroy(s);
    make_end(&m);
}

/* ---- Texture coordinates ---- */

/* The second set, (u, v) = (x, y) / 2, is turned by 90 degrees counter-clockwise as seen with v down, so that u' = 3 v
 * + 0.25 and v' = -2 u + 0.5, and then v counts from below. */
static void texture_coordinates_are_chosen_and_transformed(void **state)
{
    static const float first[8] = { 0 }, uvs[] = { 0, 0, 0.5f, 0, 0.5f, 0.5f, 0, 0.5f };
    struct make m;

    (void)state;
    make_square(&m);
    FLOATS(&m, first, "VEC2", 4);
    FLOATS(&m, uvs, "VEC2", 4);
    struct scene *s = make_scene(
        &m, "\"extensionsRequired\":[\"KHR_texture_transform\"]," NODE
            "," MESH("\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":2,\"TEXCOORD_1\":3},\"indices\":1,\"material\":"
                     "0") ",\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0,"
                          "\"texCoord\":0,"
                          "\"extensions\":{\"KHR_texture_transform\":{\"offset\":[0.25,0.5],\"rotation\":1.57079633,"
                          "\"scale\":[2,3],\"texCoord\":1}}}},\"emissiveFactor\":[1,1,1],"
                          "\"emissiveTexture\":{\"index\":0,\"texCoord\":1}}],\"textures\":[{\"source\":0}],"
                          "\"images\":[{\"uri\":\"" GREY_TEXEL "\"}]");
    const struct mesh *mesh = &s->meshes[0];
    assert_int_equal(s->materials[0].second, MAP_EMISSION);
    assert_int_equal(s->unmodelled, 0);
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        const struct vec3 p = vertex(mesh, i);
        assert_float_equal(mesh->uvs[2 * i], 3.0f * 0.5f * p.y + 0.25f, 1e-6f);
        assert_float_equal(mesh->uvs[2 * i + 1], 1.0f - (-2.0f * 0.5f * p.x + 0.5f), 1e-6f);
        assert_float_equal(mesh->more_uvs[2 * i], 0.5f * p.x, 1e-6f); /* of the emission */
        assert_float_equal(mesh->more_uvs[2 * i + 1], 1.0f - 0.5f * p.y, 1e-6f);
    }
    scene_destroy(s);
    make_end(&m);
}

/* Corners red, green and blue: their mean in the middle, times the base colour. The alpha is not used. */
static void vertex_colours_multiply_the_base_colour(void **state)
{
    static const uint16_t colours[] = { 65535, 0, 0, 9, 0, 65535, 0, 9, 0, 0, 65535, 9, 0, 0, 0, 9 };
    struct scatter at;
    struct hit hit;
    struct make m;

    (void)state;
    make_square(&m);
    const int view = make_view(&m, colours, sizeof(colours), "");
    make_accessor(&m, "\"bufferView\":%d,\"componentType\":5123,\"normalized\":true,\"type\":\"VEC4\",\"count\":4",
                  view);
    struct scene *s =
        make_scene(&m, NODE "," MESH("\"attributes\":{\"POSITION\":0,\"COLOR_0\":2},\"indices\":1,\"material\":"
                                     "0") ",\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.9,"
                                          "0.6,0.3,1],\"metallicFactor\":0}}]");
    struct rays *r = rays_create_for(s, cpu_best());
    const struct vec3 down = { 0.0f, 0.0f, -1.0f };
    assert_non_null(r);
    assert_true(rays_intersect(r, vec3_make(2.0f / 3.0f, 1.0f / 3.0f, 5.0f), down, 0.0f, &hit));
    scatter_at(s, r, &hit, down, &at);
    const struct vec3 want = ggx_matte(vec3_make(0.3f, 0.2f, 0.1f), 0.0f, 1.0f, (struct vec3){ 0 });
    assert_near(at.diffuse, want.x, want.y, want.z);
    assert_float_equal(s->meshes[0].colours[4 * 3 + 3], 9.0f / 65535.0f, 1e-9f);
    assert_int_equal(s->unmodelled, 0);
    rays_destroy(r);
    scene_destroy(s);
    make_end(&m);
}

/* ---- Deformation at rest ---- */

/* The second joint stands at (0, 1, 0) and is turned by 90 degrees about z; the vertices with y = 1 follow it. */
static void skin_is_posed_as_its_joints_stand(void **state)
{
    static const uint8_t joints[] = { 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0 };
    float weights[] = { 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0 };
    static const float bind[] = { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0,  0, 1,
                                  1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -1, 0, 1 };
    static const char *const parts[] = { ",\"inverseBindMatrices\":4", "" };

    (void)state;
    for (int i = 0; i < 2; i++) {
        char text[1024];
        struct make m;
        make_square(&m);
        make_array(&m, joints, sizeof(joints), 5121, "VEC4", 4);
        faults_intended = i == 1;
        weights[12] = (float)(1 + i); /* not normalized */
        FLOATS(&m, weights, "VEC4", 4);
        FLOATS(&m, bind, "MAT4", 2);
        snprintf(text, sizeof(text),
                 "\"nodes\":[{\"mesh\":0,\"skin\":0,\"translation\":[100,0,0]},{\"children\":[2]},"
                 "{\"translation\":[0,1,0],\"rotation\":[0,0,0.70710678,0.70710678]}],"
                 "\"skins\":[{\"joints\":[1,2]%s}]," MESH(
                     "\"attributes\":{\"POSITION\":0,\"JOINTS_0\":2,\"WEIGHTS_0\":3},\"indices\":1"),
                 parts[i]);
        struct scene *s = make_scene(&m, text);
        faults_intended = false;
        const struct mesh *mesh = &s->meshes[0];
        const uint32_t *t = mesh->indices;
        assert_near(vertex(mesh, t[1]), 1, 0, 0);
        if (i == 0) /* (1, 1, 0): from the joint (1, 0, 0), which turns to (0, 1, 0) */
            assert_near(vertex(mesh, t[2]), 0, 2, 0);
        else /* (1, 1, 0) turns to (-1, 1, 0), and is moved by the joint's place */
            assert_near(vertex(mesh, t[2]), -1, 2, 0);
        scene_destroy(s);
        make_end(&m);
    }
}

/* Targets move by x and by z; the mesh has weights 0.5 and 0, its second node has weights of its own. */
static void morph_targets_are_added_by_their_weights(void **state)
{
    static const float along[] = { 4, 0, 0, 4, 0, 0, 4, 0, 0, 4, 0, 0 }, up[] = { 0, 0, 3, 0, 0, 3, 0, 0, 3, 0, 0, 3 };
    struct make m;

    (void)state;
    make_square(&m);
    FLOATS(&m, along, "VEC3", 4);
    FLOATS(&m, up, "VEC3", 4);
    struct scene *s = make_scene(&m, "\"nodes\":[{\"mesh\":0},{\"mesh\":0,\"weights\":[0,-1]}],"
                                     "\"meshes\":[{\"weights\":[0.5,0],\"primitives\":[{" SQUARE
                                     ",\"targets\":[{\"POSITION\":2},{\"POSITION\":3}]}]}]");
    assert_near(vertex(&s->meshes[0], s->meshes[0].indices[0]), 2, 0, 0);
    assert_near(vertex(&s->meshes[1], s->meshes[1].indices[0]), 0, 0, -3);
    scene_destroy(s);
    make_end(&m);
}

/* ---- Files ---- */

static void data_uris_and_coded_names_are_read(void **state)
{
    struct make m;

    (void)state;
    make_square(&m);
    folder_write(&m.folder, "my data.bin", m.bytes, m.size);
    const char *text = "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"uri\":\"my%20data.bin\",\"byteLength\":48},"
                       "{\"uri\":\"data:application/octet-stream;base64,AAECAAID\",\"byteLength\":6}],"
                       "\"bufferViews\":[{\"buffer\":0,\"byteLength\":48},{\"buffer\":1,\"byteLength\":6}],"
                       "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"type\":\"VEC3\",\"count\":4,"
                       "\"min\":[0,0,0],\"max\":[1,1,0]},{\"bufferView\":1,\"componentType\":5121,\"type\":\"SCALAR\","
                       "\"count\":6}]," NODE "," MESH(SQUARE) "}";
    struct scene *s = load_or_fail(folder_text(&m.folder, "a.gltf", text));
    assert_near(area_of(&s->meshes[0]), 0, 0, 1);
    scene_destroy(s);
    make_end(&m);
}

static void missing_texture_is_grey(void **state)
{
    struct make m;

    (void)state;
    make_square(&m);
    log_begin();
    faults_intended = true;
    struct scene *s = make_scene(
        &m,
        NODE "," MESH(SQUARE ",\"material\":0") ",\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorFactor\":"
                                                "[0.8,0.4,0.2,1],\"baseColorTexture\":{\"index\":0},"
                                                "\"metallicRoughnessTexture\":{\"index\":0}}}],"
                                                "\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"gone.png\"}]");
    const char *said = log_end();
    faults_intended = false;
    assert_int_equal(count_of(said, "made.gltf: images[0].uri: "), 1);
    assert_int_equal(count_of(said, "gone.png: No such file or directory; the surfaces are grey instead"), 1);
    assert_int_equal(s->texture_count, 0);
    assert_near(s->materials[s->meshes[0].material].diffuse, 0.4f, 0.2f, 0.1f);
    scene_destroy(s);
    make_end(&m);
}

static void extensions_are_refused_or_named(void **state)
{
    struct make m;

    (void)state;
    make_square(&m);
    const char *path = square_file(&m, NODE ",\"extensionsRequired\":[\"KHR_mesh_quantization\",\"ACME_shape\"]");
    assert_non_null(strstr(make_refused(path, ERR_UNSUPPORTED),
                           "made.gltf: requires the extension ACME_shape, which is not supported"));
    path = square_file(&m, NODE ",\"extensionsRequired\":[\"KHR_texture_basisu\"]");
    assert_non_null(strstr(make_refused(path, ERR_UNSUPPORTED), "KHR_texture_basisu, which is not supported; convert"));
    log_begin();
    struct scene *s =
        square_scene(&m, NODE ",\"extensionsUsed\":[\"ACME_shape\",\"KHR_texture_transform\",\"ACME_colour\"]");
    assert_int_equal(count_of(log_end(), "ignored extensions: ACME_shape, ACME_colour\n"), 1);
    scene_destroy(s);
    make_end(&m);
}

static void version_1_is_refused(void **state)
{
    static const uint8_t glb[20] = { 'g', 'l', 'T', 'F', 1, 0, 0, 0, 20 };
    struct folder f;

    (void)state;
    folder_make(&f);
    const char *path = folder_text(&f, "a.gltf", "{\"asset\":{\"version\":\"1.0\"},\"meshes\":{}}");
    assert_non_null(strstr(make_refused(path, ERR_UNSUPPORTED), "glTF 1.0 is not supported; convert"));
    path = folder_write(&f, "a.glb", glb, sizeof(glb));
    assert_non_null(strstr(make_refused(path, ERR_UNSUPPORTED), "glTF 1.0 is not supported; convert"));
    folder_remove(&f);
}

/* ---- Faults ---- */

static void faults_name_their_path(void **state)
{
    static const struct {
        const char *rest, *said;
    } cases[] = {
        { NODE "," MESH("\"attributes\":{\"POSITION\":9}"),
          "meshes[0].primitives[0].attributes.POSITION: accessors[9] does not exist; the file has 5" },
        { NODE "," MESH("\"attributes\":{\"POSITION\":1}"),
          "meshes[0].primitives[0].attributes.POSITION: accessors[1] has 1 components; expected 3" },
        { NODE "," MESH("\"attributes\":{\"POSITION\":0,\"NORMAL\":2},\"indices\":1"),
          "meshes[0].primitives[0].attributes.NORMAL: accessors[2] has 3 elements for 4 vertices" },
        { NODE "," MESH("\"attributes\":{\"POSITION\":2},\"indices\":1"),
          "meshes[0].primitives[0].indices: refers to vertex 3 of 3" },
        { NODE "," MESH("\"attributes\":{\"POSITION\":0},\"indices\":0"),
          "meshes[0].primitives[0].indices: accessors[0] has 3 components; expected 1" },
        { NODE "," MESH("\"attributes\":{\"POSITION\":3}"), "accessors[3]: 5 elements of 12 bytes at steps of 12 from "
                                                            "byte 0 on end beyond bufferViews[0], which has 48" },
        { NODE "," MESH("\"attributes\":{\"POSITION\":4}"), "accessors[4]: componentType is 5124" },
        { NODE "," MESH(SQUARE ",\"material\":0"), "meshes[0].primitives[0].material: materials[0] does not exist" },
        { NODE "," MESH(SQUARE ",\"mode\":7"), "meshes[0].primitives[0]: mode is 7" },
        { "\"nodes\":[{\"mesh\":0,\"scale\":[1,1]}]," MESH(SQUARE), "nodes[0].scale: is not an array of 3 numbers" },
        { "\"nodes\":[{\"mesh\":1}]," MESH(SQUARE), "nodes[0].mesh: meshes[1] does not exist; the file has 1" },
        { "\"nodes\":[{\"mesh\":0},{\"children\":[1]}]," MESH(SQUARE), "nodes are their own descendants" },
        { "\"nodes\":[{\"mesh\":0,\"skin\":0}],\"skins\":[{\"joints\":[4]}]," MESH(SQUARE),
          "skins[0].joints[0]: nodes[4] does not exist" },
        { "\"nodes\":[{\"mesh\":0}],\"scene\":2,\"scenes\":[{}]," MESH(SQUARE), "scene: scenes[2] does not exist" },
    };
    struct make m;

    (void)state;
    make_square(&m);
    make_accessor(&m, "\"bufferView\":0,\"componentType\":5126,\"type\":\"VEC3\",\"count\":3");
    make_accessor(&m, "\"bufferView\":0,\"componentType\":5126,\"type\":\"VEC3\",\"count\":5");
    make_accessor(&m, "\"bufferView\":0,\"componentType\":5124,\"type\":\"VEC3\",\"count\":4");
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        const char *said = make_refused(make_gltf(&m, cases[i].rest), ERR_FORMAT);
        if (!strstr(said, cases[i].said) || !strstr(said, "/made.gltf: "))
            fail_msg("%s\nnot\n%s", said, cases[i].said);
    }
    make_end(&m);
}

/* Light that passes takes the base colour; where that is black, the reflections are all there is. */
static void black_glass_is_a_black_surface_with_reflections(void **state)
{
    struct make m;

    (void)state;
    make_begin(&m);
    FLOATS(&m, corners, "VEC3", 3);
    struct scene *s = make_scene(
        &m,
        NODE "," MESH("\"attributes\":{\"POSITION\":0},\"material\":0") ",\"materials\":[{\"alphaMode\":\"BLEND\","
                                                                        "\"pbrMetallicRoughness\":{\"baseColorFactor\":"
                                                                        "[0,0,0,0.25],\"metallicFactor\":0,"
                                                                        "\"roughnessFactor\":0},\"extensions\":{"
                                                                        "\"KHR_materials_transmission\":{"
                                                                        "\"transmissionFactor\":0.75}}}]");
    const struct material *black = &s->materials[s->meshes[0].material];
    assert_int_equal(black->kind, MATERIAL_GGX);
    assert_int_equal(black->alpha_mode, ALPHA_BLEND);
    assert_float_equal(black->alpha, 0.25f, 1e-6f);
    assert_int_equal(s->unmodelled, 0);
    scene_destroy(s);
    make_end(&m);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(black_glass_is_a_black_surface_with_reflections),
    cmocka_unit_test(camera_stands_where_its_node_is),
    cmocka_unit_test(orthographic_camera_becomes_a_distant_one),
    cmocka_unit_test(bad_camera_is_left_out),
    cmocka_unit_test(cameras_are_named_by_node_then_camera),
    cmocka_unit_test(components_of_every_type_are_read),
    cmocka_unit_test(sparse_accessors_replace_elements),
    cmocka_unit_test(strips_and_fans_wind_as_triangles_do),
    cmocka_unit_test(points_and_lines_are_left_out),
    cmocka_unit_test(reflected_mesh_keeps_its_outside),
    cmocka_unit_test(parts_keep_only_the_vertices_they_use),
    cmocka_unit_test(texture_coordinates_are_chosen_and_transformed),
    cmocka_unit_test(vertex_colours_multiply_the_base_colour),
    cmocka_unit_test(skin_is_posed_as_its_joints_stand),
    cmocka_unit_test(morph_targets_are_added_by_their_weights),
    cmocka_unit_test(data_uris_and_coded_names_are_read),
    cmocka_unit_test(missing_texture_is_grey),
    cmocka_unit_test(extensions_are_refused_or_named),
    cmocka_unit_test(version_1_is_refused),
    cmocka_unit_test(faults_name_their_path),
};

UNIT_MAIN(tests)
