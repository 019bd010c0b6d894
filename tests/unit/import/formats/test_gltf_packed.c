/* Compressed glTF: what the libraries' own encoders make of a known mesh comes back. */
#include "gltf_make.h"

#include "draco_make.h"

#include <meshoptimizer.h>
#include <stdlib.h>
#include <webp/encode.h>

#define NODE "\"nodes\":[{\"mesh\":0}]"
#define SQUARE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1}]}]"

/* A unit square in z = 0: as floats, and as 16-bit numbers 65535 times as large. */
static const float corners[] = { 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0 };
static const uint16_t shorts[] = { 0, 0, 0, 0, 65535, 0, 0, 0, 65535, 65535, 0, 0, 0, 65535, 0, 0 };
static const unsigned triangles[] = { 0, 1, 2, 0, 2, 3 };

/* ---- Meshopt ---- */

enum { PACKED_SIZE = 1024 };

/* A view of count elements whose data are compressed; `more` holds the members of a view, `how` further ones of the
 * extension. */
static void packed_view(struct make *m, const char *extension, const void *bytes, size_t size, size_t stride,
                        size_t count, const char *more, const char *how)
{
    char text[512];

    m->size = (m->size + 3) & ~(size_t)3;
    assert_true(m->size + size <= sizeof(m->bytes));
    memcpy(m->bytes + m->size, bytes, size);
    snprintf(
        text, sizeof(text),
        "{\"buffer\":1,\"byteOffset\":%zu,\"byteLength\":%zu%s,\"extensions\":{\"%s\":{\"buffer\":0,\"byteOffset\":%zu,"
        "\"byteLength\":%zu,\"byteStride\":%zu,\"count\":%zu,%s}}}",
        m->unpacked, stride * count, more, extension, m->size, size, stride, count, how);
    make_append(m->views, sizeof(m->views), text);
    m->size += size;
    m->unpacked += (stride * count + 3) & ~(size_t)3;
    m->packing = extension;
    m->view_count++;
}

static void make_packed_square(struct make *m, const char *extension, int vertex_version)
{
    unsigned char bytes[PACKED_SIZE];

    make_begin(m);
    meshopt_encodeVertexVersion(0);
    size_t size = meshopt_encodeVertexBuffer(bytes, sizeof(bytes), shorts, 4, 8);
    bytes[0] = (unsigned char)(bytes[0] + vertex_version);
    packed_view(m, extension, bytes, size, 8, 4, ",\"byteStride\":8", "\"mode\":\"ATTRIBUTES\"");
    make_accessor(m, "\"bufferView\":0,\"componentType\":5123,\"normalized\":true,\"type\":\"VEC3\",\"count\":4%s",
                  make_bounds(shorts, 5123, 8, 4));
    size = meshopt_encodeIndexBuffer(bytes, sizeof(bytes), triangles, 6);
    packed_view(m, extension, bytes, size, 2, 6, "", "\"mode\":\"TRIANGLES\"");
    make_accessor(m, "\"bufferView\":1,\"componentType\":5123,\"type\":\"SCALAR\",\"count\":6");
}

static void meshopt_vertices_and_triangles_come_back(void **state)
{
    static const char *const names[] = { "EXT_meshopt_compression", "KHR_meshopt_compression" };

    (void)state;
    for (int i = 0; i < 2; i++) {
        char text[512];
        struct make m;
        make_packed_square(&m, names[i], 0);
        snprintf(text, sizeof(text), "\"extensionsRequired\":[\"%s\",\"KHR_mesh_quantization\"]," NODE "," SQUARE,
                 names[i]);
        struct scene *s = make_scene(&m, text);
        assert_int_equal(s->triangle_count, 2);
        assert_near(area_of(&s->meshes[0]), 0, 0, 1);
        scene_destroy(s);
        make_end(&m);
    }
}

static void meshopt_sequences_and_filters_come_back(void **state)
{
    static const float normals[] = { 0, 0, 1, 0, 0.6f, 0, 0.8f, 0, 0, -1, 0, 0, -0.48f, 0.6f, -0.64f, 0 };
    unsigned char bytes[PACKED_SIZE];
    float exponents[12];
    uint32_t packed[12];
    int8_t octahedral[16];
    struct make m;

    (void)state;
    make_begin(&m);
    memcpy(exponents, corners, sizeof(corners));
    meshopt_encodeFilterExp(packed, 4, 12, 15, exponents);
    size_t size = meshopt_encodeVertexBuffer(bytes, sizeof(bytes), packed, 4, 12);
    packed_view(&m, "EXT_meshopt_compression", bytes, size, 12, 4, "",
                "\"mode\":\"ATTRIBUTES\",\"filter\":\"EXPONENTIAL\"");
    make_accessor(&m, "\"bufferView\":0,\"componentType\":5126,\"type\":\"VEC3\",\"count\":4%s",
                  make_bounds(corners, 5126, 12, 4));
    size = meshopt_encodeIndexSequence(bytes, sizeof(bytes), triangles, 6);
    packed_view(&m, "EXT_meshopt_compression", bytes, size, 4, 6, "", "\"mode\":\"INDICES\"");
    make_accessor(&m, "\"bufferView\":1,\"componentType\":5125,\"type\":\"SCALAR\",\"count\":6");
    meshopt_encodeFilterOct(octahedral, 4, 4, 8, normals);
    size = meshopt_encodeVertexBuffer(bytes, sizeof(bytes), octahedral, 4, 4);
    packed_view(&m, "EXT_meshopt_compression", bytes, size, 4, 4, ",\"byteStride\":4",
                "\"mode\":\"ATTRIBUTES\",\"filter\":\"OCTAHEDRAL\"");
    make_accessor(&m, "\"bufferView\":2,\"componentType\":5120,\"normalized\":true,\"type\":\"VEC3\",\"count\":4");
    struct scene *s =
        make_scene(&m, "\"extensionsRequired\":[\"KHR_mesh_quantization\",\"EXT_meshopt_compression\"]," NODE
                       ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":2},"
                       "\"indices\":1}]}]");
    const struct mesh *mesh = &s->meshes[0];
    assert_near(area_of(mesh), 0, 0, 1);
    for (uint32_t i = 0; i < 4; i++) { /* 8 bits: about 0.01 */
        const struct vec3 p = vertex(mesh, i);
        const int corner = p.x > 0.5f ? (p.y > 0.5f ? 2 : 1) : (p.y > 0.5f ? 3 : 0);
        for (int k = 0; k < 3; k++)
            assert_float_equal(mesh->normals[3 * i + (uint32_t)k], normals[4 * corner + k], 0.015f);
    }
    scene_destroy(s);
    make_end(&m);
}

static void damaged_meshopt_is_refused(void **state)
{
    struct make m;

    (void)state;
    make_packed_square(&m, "KHR_meshopt_compression", 1);
    assert_non_null(strstr(make_refused(make_gltf(&m, NODE "," SQUARE), ERR_UNSUPPORTED),
                           "bufferViews[0].KHR_meshopt_compression: uses version 1 of the vertex codec"));
    make_end(&m);
    make_packed_square(&m, "EXT_meshopt_compression", 0);
    m.bytes[0] = 0; /* no vertex data */
    assert_non_null(strstr(make_refused(make_gltf(&m, NODE "," SQUARE), ERR_FORMAT),
                           "bufferViews[0].EXT_meshopt_compression: its compressed data are damaged"));
    make_end(&m);
}

/* ---- Draco ---- */

#define DRACO_PRIMITIVE                                                                                                \
    "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"]," NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":"   \
    "{\"POSITION\":0,\"TEXCOORD_0\":2},\"indices\":1,\"material\":0,\"extensions\":{\"KHR_draco_mesh_compression\":"   \
    "{\"bufferView\":0,\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1}}}}]}],\"materials\":[{"                        \
    "\"pbrMetallicRoughness\":"                                                                                        \
    "{\"baseColorTexture\":{\"index\":0}}}],\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"one.png\"}]"

/* One grey texel. */
static const uint8_t one_png[] = { 0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48,
                                   0x44, 0x52, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x01, 0x08, 0x00, 0x00, 0x00,
                                   0x00, 0x3a, 0x7e, 0x9b, 0x55, 0x00, 0x00, 0x00, 0x0a, 0x49, 0x44, 0x41, 0x54, 0x78,
                                   0xda, 0x63, 0x68, 0x00, 0x00, 0x00, 0x82, 0x00, 0x81, 0xda, 0x45, 0x08, 0x3b, 0x00,
                                   0x00, 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82 };

static struct scene *load_grid(struct make *m, uint32_t side)
{
    uint8_t *bytes = NULL;

    make_begin(m);
    const size_t size = draco_make_grid(side, &bytes);
    assert_true(size > 0);
    assert_true(size <= sizeof(m->bytes));
    make_view(m, bytes, size, "");
    free(bytes);
    const uint32_t count = (side + 1) * (side + 1);
    make_accessor(m, "\"componentType\":5126,\"type\":\"VEC3\",\"count\":%u,\"min\":[0,0,0],\"max\":[%u,%u,0]", count,
                  side, side);
    make_accessor(m, "\"componentType\":5125,\"type\":\"SCALAR\",\"count\":%u", 6 * side * side);
    make_accessor(m, "\"componentType\":5123,\"normalized\":true,\"type\":\"VEC2\",\"count\":%u", count);
    folder_write(&m->folder, "one.png", one_png, sizeof(one_png));
    return make_scene(m, DRACO_PRIMITIVE);
}

static void draco_meshes_come_back(void **state)
{
    static const uint32_t sides[] = { 1, 7, 300 }; /* the last has 90,601 vertices, more than 16 bits count */
    struct make m;

    (void)state;
    for (int i = 0; i < 3; i++) {
        struct scene *s = load_grid(&m, sides[i]);
        const struct mesh *mesh = &s->meshes[0];
        const float side = (float)sides[i];
        assert_int_equal(mesh->triangle_count, 2 * sides[i] * sides[i]);
        assert_int_equal(mesh->vertex_count, (sides[i] + 1) * (sides[i] + 1));
        assert_float_equal(area_of(mesh).z, side * side, 1e-3f * side * side);
        for (uint32_t k = 0; k < mesh->vertex_count; k++) {
            assert_float_equal(mesh->uvs[2 * k], mesh->positions[3 * k] / side, 5e-5f);
            assert_float_equal(mesh->uvs[2 * k + 1], 1.0f - mesh->positions[3 * k + 1] / side, 5e-5f);
        }
        scene_destroy(s);
        make_end(&m);
    }
}

static void damaged_draco_is_refused(void **state)
{
    struct make m;

    (void)state;
    scene_destroy(load_grid(&m, 3));
    memset(m.bytes + 12, 0xff, 20);
    assert_non_null(strstr(make_refused(make_gltf(&m, DRACO_PRIMITIVE), ERR_FORMAT),
                           "meshes[0].primitives[0].KHR_draco_mesh_compression: its compressed data are damaged"));
    make_end(&m);
}

/* ---- WebP ---- */

/* Beside a PNG, which is for readers without WebP. */
static void webp_textures_are_read(void **state)
{
    static const uint8_t texels[] = { 255, 0, 0, 255, 0, 128, 0, 255 };
    uint8_t *webp = NULL;
    struct make m;

    (void)state;
    make_begin(&m);
    FLOATS(&m, corners, "VEC3", 4);
    const size_t size = WebPEncodeLosslessRGBA(texels, 2, 1, 8, &webp);
    assert_true(size > 0);
    folder_write(&m.folder, "two.webp", webp, size);
    const char *rest =
        NODE ",\"extensionsRequired\":[\"EXT_texture_webp\"],\"meshes\":[{\"primitives\":[{\"attributes\":"
             "{\"POSITION\":0},\"mode\":6,\"material\":0}]}],\"materials\":[{\"pbrMetallicRoughness\":{"
             "\"baseColorTexture\":{\"index\":0}}}],\"textures\":[{\"source\":0,\"extensions\":{"
             "\"EXT_texture_webp\":{\"source\":1}}}],\"images\":[{\"uri\":\"gone.png\"},{\"uri\":\"two.webp\"}]";
    faults_intended = true; /* neither the PNG nor texture coordinates */
    struct scene *s = make_scene(&m, rest);
    faults_intended = false;
    assert_int_equal(s->texture_count, 1);
    assert_near(texture_lookup(&s->textures[0], 0.25f, 0.5f), 1, 0, 0);
    assert_near(texture_lookup(&s->textures[0], 0.75f, 0.5f), 0, 0.2158605f, 0);
    scene_destroy(s);
    folder_write(&m.folder, "two.webp", webp, size - 4);
    log_begin();
    faults_intended = true;
    scene_destroy(make_scene(&m, rest));
    faults_intended = false;
    assert_non_null(strstr(log_end(), "two.webp: WebP: "));
    WebPFree(webp);
    make_end(&m);
}

/* ---- Instances ---- */

/* Two copies: at x = 10 and twice as large, at x = 20 and turned by 90 degrees about z; then the node moves both up. */
static void instances_stand_where_they_are_put(void **state)
{
    static const float places[] = { 10, 0, 0, 20, 0, 0 }, sizes[] = { 2, 2, 2, 1, 1, 1 };
    static const int16_t turns[] = { 0, 0, 0, 32767, 0, 0, 23170, 23170 };
    struct make m;

    (void)state;
    make_begin(&m);
    FLOATS(&m, corners, "VEC3", 4);
    FLOATS(&m, places, "VEC3", 2);
    FLOATS(&m, sizes, "VEC3", 2);
    const int view = make_view(&m, turns, sizeof(turns), "");
    make_accessor(&m, "\"bufferView\":%d,\"componentType\":5122,\"normalized\":true,\"type\":\"VEC4\",\"count\":2",
                  view);
    struct scene *s = make_scene(
        &m, "\"extensionsRequired\":[\"EXT_mesh_gpu_instancing\"],\"nodes\":[{\"mesh\":0,\"translation\":[0,5,0],"
            "\"extensions\":{\"EXT_mesh_gpu_instancing\":{\"attributes\":{\"TRANSLATION\":1,\"SCALE\":2,"
            "\"ROTATION\":3}}}}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"mode\":6}]}]");
    assert_int_equal(s->mesh_count, 2);
    assert_near(area_of(&s->meshes[0]), 0, 0, 4);
    assert_near(area_of(&s->meshes[1]), 0, 0, 1);
    assert_near(s->low, 10, 5, 0);
    assert_near(s->high, 20, 7, 0);
    assert_near(vertex(&s->meshes[1], s->meshes[1].indices[1]), 20, 6, 0);
    scene_destroy(s);
    make_end(&m);
}

enum { GRID = 12, STAND = 500 }; /* 2 * GRID^2 triangles; (uses - 1) * triangles is above 100,000 */

/* A bumpy grid; the first of `STAND` places is flattened to nothing, the second mirrored. */
static void put_grid(struct make *m)
{
    static float points[3 * (GRID + 1) * (GRID + 1)], at[3 * STAND], scales[3 * STAND];
    static uint32_t listed[6 * GRID * GRID];
    uint32_t n = 0;

    for (uint32_t i = 0; i < (GRID + 1) * (GRID + 1); i++) {
        const float x = (float)(i % (GRID + 1)) / GRID, y = (float)(i / (GRID + 1)) / GRID;
        memcpy(points + 3 * i, (const float[]){ x, y, x * y }, 3 * sizeof(float));
        if (i % (GRID + 1) < GRID && i / (GRID + 1) < GRID) {
            const uint32_t two[6] = { i, i + 1, i + GRID + 2, i, i + GRID + 2, i + GRID + 1 };
            memcpy(listed + n, two, sizeof(two));
            n += 6;
        }
    }
    for (uint32_t i = 0; i < STAND; i++) {
        memcpy(at + 3 * i, (const float[]){ 2.0f * (float)i, 0, 0 }, 3 * sizeof(float));
        memcpy(scales + 3 * i, (const float[]){ i == 1 ? -1.0f : 1.0f, 1, i == 0 ? 0.0f : 1.0f }, 3 * sizeof(float));
    }
    FLOATS(m, points, "VEC3", (GRID + 1) * (GRID + 1));
    make_array(m, listed, sizeof(listed), 5125, "SCALAR", n);
    FLOATS(m, at, "VEC3", STAND);
    FLOATS(m, scales, "VEC3", STAND);
}

/* Of instances and of a node; not with weights of its own. What is flat gets a copy. */
static void large_meshes_are_shared(void **state)
{
    struct make m;

    (void)state;
    make_begin(&m);
    put_grid(&m);
    struct scene *s = make_scene(
        &m, "\"nodes\":[{\"mesh\":0,\"extensions\":{\"EXT_mesh_gpu_instancing\":{\"attributes\":{\"TRANSLATION\":2,"
            "\"SCALE\":3}}}},{\"mesh\":0,\"translation\":[0,-50,0]},{\"mesh\":0,\"weights\":[0.5],\"translation\":[0,"
            "90,0]}],"
            "\"meshes\":[{\"weights\":[0],\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1,"
            "\"targets\":[{\"POSITION\":0}]}]}]");
    assert_int_equal(s->mesh_count, STAND + 2);
    const struct mesh *flat = &s->meshes[0], *own = &s->meshes[1], *deformed = &s->meshes[STAND + 1];
    assert_true(!flat->placed && flat->triangle_count > 0); /* a plane has triangles, and no inverse */
    assert_true(own->placed && own->source == 0 && own->place.side == -1.0f && own->place.matrix[0][3] == 2.0f);
    for (uint32_t i = 2; i <= STAND; i++) {
        assert_int_equal(s->meshes[i].source, 2);
        assert_ptr_equal(s->meshes[i].indices, own->indices);
    }
    assert_true(s->meshes[STAND].place.matrix[1][3] == -50.0f);
    assert_true(!deformed->placed && deformed->source == 0);
    assert_near(s->low, 0, -50, 0);
    assert_near(s->high, 2 * STAND - 1, 91.5f, 1.5f);
    assert_int_equal(s->triangle_count, (STAND + 2) * 2 * GRID * GRID);
    scene_destroy(s);
    make_end(&m);
}

static void small_meshes_are_copied(void **state)
{
    struct make m;

    (void)state;
    make_begin(&m);
    put_grid(&m);
    struct scene *s = make_scene(&m, "\"nodes\":[{\"mesh\":0},{\"mesh\":0,\"translation\":[0,3,0]}],"
                                     "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1}]}]");
    assert_int_equal(s->mesh_count, 2);
    assert_true(!s->meshes[0].placed && !s->meshes[1].placed && s->meshes[1].source == 0);
    scene_destroy(s);
    make_end(&m);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(meshopt_vertices_and_triangles_come_back),
    cmocka_unit_test(meshopt_sequences_and_filters_come_back),
    cmocka_unit_test(damaged_meshopt_is_refused),
    cmocka_unit_test(draco_meshes_come_back),
    cmocka_unit_test(damaged_draco_is_refused),
    cmocka_unit_test(webp_textures_are_read),
    cmocka_unit_test(instances_stand_where_they_are_put),
    cmocka_unit_test(large_meshes_are_shared),
    cmocka_unit_test(small_meshes_are_copied),
};

UNIT_MAIN(tests)
