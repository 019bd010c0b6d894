#include "scene/geometry/files.h"
#include "scene/geometry/load.h"

#include "pngs.h"

#include "import/formats/import.h"

#include <math.h>
#include <turbojpeg.h>

/* Two triangles, a unit square in z = 0 with normals (0, 0, 1) and texture coordinates; glTF counts v downwards. */
static const float square[] = {
    0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, /* positions, byte 0 */
    0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, /* normals, byte 48 */
    0, 1, 1, 1, 1, 0, 0, 0,             /* texture coordinates, byte 96 */
};
static const uint16_t square_indices[] = { 0, 1, 2, 0, 2, 3 }; /* byte 128 */

/* 2 x 2 texels of alpha 0, 85 / 170, 255. */
static const uint8_t alpha_png[] = {
    0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48, 0x44, 0x52,
    0x00, 0x00, 0x00, 0x02, 0x00, 0x00, 0x00, 0x02, 0x08, 0x06, 0x00, 0x00, 0x00, 0x72, 0xb6, 0x0d,
    0x24, 0x00, 0x00, 0x00, 0x15, 0x49, 0x44, 0x41, 0x54, 0x78, 0xda, 0x63, 0x38, 0x91, 0x62, 0xc4,
    0x00, 0xc4, 0xa1, 0x20, 0x62, 0x15, 0x10, 0xff, 0x07, 0x00, 0x3e, 0x01, 0x07, 0x77, 0x0f, 0x42,
    0x4c, 0x54, 0x00, 0x00, 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82,
};

#define PARTS                                                                                                          \
    "\"asset\":{\"version\":\"2.0\"},"                                                                                 \
    "\"buffers\":[{\"uri\":\"square.bin\",\"byteLength\":140}],"                                                       \
    "\"bufferViews\":[{\"buffer\":0,\"byteLength\":48},{\"buffer\":0,\"byteOffset\":48,\"byteLength\":48},"            \
    "{\"buffer\":0,\"byteOffset\":96,\"byteLength\":32},{\"buffer\":0,\"byteOffset\":128,\"byteLength\":12}],"         \
    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\","                           \
    "\"min\":[0,0,0],\"max\":[1,1,0]},"                                                                                \
    "{\"bufferView\":1,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"},"                                         \
    "{\"bufferView\":2,\"componentType\":5126,\"count\":4,\"type\":\"VEC2\"},"                                         \
    "{\"bufferView\":3,\"componentType\":5123,\"count\":6,\"type\":\"SCALAR\"}],"
#define SQUARE(material)                                                                                               \
    "{\"attributes\":{\"POSITION\":0,\"NORMAL\":1,\"TEXCOORD_0\":2},\"indices\":3,\"material\":" material "}"
#define TAIL PARTS "\"meshes\":[{\"primitives\":[" SQUARE("0") "]}]}"
#define ONE_NODE "\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}],"
#define MATERIAL(m) "\"materials\":[{\"name\":\"m\"," m "}],"
#define TEXTURED(uri)                                                                                                  \
    MATERIAL("\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0},\"metallicFactor\":0}")                     \
    "\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"" uri "\"}],"

static const char *write_gltf(struct folder *f, const char *name, const char *json)
{
    uint8_t bytes[140];

    memcpy(bytes, square, 128);
    memcpy(bytes + 128, square_indices, 12);
    folder_write(f, "square.bin", bytes, sizeof(bytes));
    return folder_text(f, name, json);
}

static void factors_become_ggx(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    struct scene *s =
        load_or_fail(write_gltf(&f, "a.gltf",
                                "{" ONE_NODE MATERIAL("\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.1,0.2,0.3,1],"
                                                      "\"metallicFactor\":0.25,\"roughnessFactor\":0.75}") TAIL));
    const struct material *m = &s->materials[s->meshes[0].material];
    assert_string_equal(m->name, "m");
    assert_int_equal(m->kind, MATERIAL_GGX);
    assert_float_equal(m->diffuse.x, 0.1f, 1e-6f);
    assert_float_equal(m->diffuse.z, 0.3f, 1e-6f);
    assert_float_equal(m->metallic, 0.25f, 1e-6f);
    assert_float_equal(m->roughness, 0.75f, 1e-6f);
    assert_int_equal(m->texture, MATERIAL_NO_TEXTURE);
    assert_non_null(s->meshes[0].normals); /* the file has them */
    assert_int_equal(s->unmodelled, 0);
    scene_destroy(s);
    folder_remove(&f);
}

static void transmission_becomes_glass(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    struct scene *s = load_or_fail(write_gltf(
        &f, "a.gltf",
        "{\"extensionsUsed\":[\"KHR_materials_transmission\",\"KHR_materials_ior\"]," ONE_NODE MATERIAL(
            "\"pbrMetallicRoughness\":{\"metallicFactor\":0,\"roughnessFactor\":0},\"extensions\":{"
            "\"KHR_materials_transmission\":{\"transmissionFactor\":1},\"KHR_materials_ior\":{\"ior\":1.33}}") TAIL));
    const struct material *m = &s->materials[s->meshes[0].material];
    assert_int_equal(m->kind, MATERIAL_GLASS);
    assert_float_equal(m->ior, 1.33f, 1e-6f);
    assert_int_equal(m->thin, 1); /* without KHR_materials_volume */
    assert_int_equal(s->unmodelled, 0);
    scene_destroy(s);
    folder_remove(&f);
}

static void what_is_not_modelled_is_named_once(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    write_gltf(&f, "a.gltf",
               "{" ONE_NODE MATERIAL("\"pbrMetallicRoughness\":{\"roughnessFactor\":0},\"extensions\":{"
                                     "\"KHR_materials_transmission\":{\"transmissionFactor\":0.75}}") TAIL);
    const char *path = folder_text(&f, "s.json",
                                   "{\"camera\":{\"position\":[0,1,5],\"look_at\":[0,0,0],\"fov_y_degrees\":40},"
                                   "\"models\":[{\"file\":\"a.gltf\"},{\"file\":\"a.gltf\"}]}");
    log_begin();
    struct scene *s = load_or_fail(path);
    const char *said = log_end();
    assert_int_equal(count_of(said, "not supported"), 1);
    assert_int_equal(count_of(said, "a.gltf: material \"m\": not supported: partial transmission"), 1);
    assert_int_equal(s->unmodelled, 1u << FEATURE_PARTIAL_GLASS);
    scene_destroy(s);
    folder_remove(&f);
}

/* The factor, and a texture of its own; its file is that of four_png. */
static void emission_has_a_factor_and_a_texture(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_write(&f, "four.png", four_png, sizeof(four_png));
    struct scene *s = load_or_fail(write_gltf(
        &f, "a.gltf",
        "{" ONE_NODE MATERIAL(
            "\"emissiveFactor\":[1,0.5,0.25],\"emissiveTexture\":{\"index\":0}") "\"textures\":[{"
                                                                                 "\"source\":0}],\"images\":[{\"uri\":"
                                                                                 "\"four.png\"}]," TAIL));
    const struct material *m = &s->materials[s->meshes[0].material];
    assert_float_equal(m->emission.y, 0.5f, 1e-6f);
    assert_int_equal(m->texture, MATERIAL_NO_TEXTURE);
    assert_int_equal(m->emission_texture, 0);
    assert_int_equal(s->texture_count, 1);
    assert_non_null(s->meshes[0].uvs);
    const struct vec3 red = scene_emission(s, s->meshes[0].material, (const float[]){ 0.25f, 0.75f }, NULL);
    assert_float_equal(red.x, 1.0f, 1e-6f);
    assert_float_equal(red.y, 0.0f, 1e-6f);
    assert_true(scene_has_lamps(s));
    scene_destroy(s);
    folder_remove(&f);
}

static void strength_multiplies_the_emission(void **state)
{
    struct material m = { .texture = MATERIAL_NO_TEXTURE };

    (void)state;
    gltf_set_emission(&m, vec3_make(1.0f, 0.5f, 0.0f), 40.0);
    assert_float_equal(m.emission.x, 40.0f, 0.0f);
    assert_float_equal(m.emission.y, 20.0f, 0.0f);
    assert_float_equal(m.emission.z, 0.0f, 0.0f);
    gltf_set_emission(&m, vec3_make(1.0f, NAN, -1.0f), 1e30);
    assert_float_equal(m.emission.x, EMISSION_MAX, 0.0f);
    assert_float_equal(m.emission.y, 0.0f, 0.0f);
    assert_float_equal(m.emission.z, 0.0f, 0.0f);
}

#define LIT(light) "\"extensions\":{\"KHR_lights_punctual\":{\"light\":" light "}},"

static const char three_lights[] =
    "{\"extensionsUsed\":[\"KHR_lights_punctual\"],\"extensions\":{\"KHR_lights_punctual\":{\"lights\":["
    "{\"type\":\"point\",\"color\":[1,0.5,0],\"intensity\":40},"
    "{\"type\":\"spot\",\"intensity\":8,\"spot\":{\"innerConeAngle\":0.2,\"outerConeAngle\":0.6}},"
    "{\"type\":\"directional\",\"intensity\":3}]}},"
    "\"scene\":0,\"scenes\":[{\"nodes\":[0,1,2,4]}],\"nodes\":[{\"mesh\":0},"
    "{\"name\":\"bulb\"," LIT("0") "\"translation\":[1,2,3]},"
                                   "{\"scale\":[2,2,2],\"translation\":[10,0,0],\"children\":[3]},"
                                   "{\"name\":\"torch\"," LIT(
                                       "1") "\"translation\":[0,4,0],\"rotation\":[-0.70710678,0,0,0.70710678]},"
                                            "{\"name\":\"moon\"," LIT("2") "\"translation\":[0,0,0]}]," MATERIAL(
                                                "\"doubleSided\":true") TAIL;

/* The spot hangs below a node that stands at x = 10 and is twice as large; it is turned by -90 degrees about X, so that
 * it shines down. */
static void punctual_lights_stand_at_their_nodes(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    struct scene *s = load_or_fail(write_gltf(&f, "a.gltf", three_lights));
    assert_int_equal(s->unmodelled, 0);
    assert_int_equal(s->light_count, 3);
    const struct punctual_light *l = s->lights;
    assert_int_equal(l[0].kind, LIGHT_POINT);
    assert_float_equal(l[0].position.z, 3.0f, 1e-6f);
    assert_float_equal(l[0].intensity.x, 40.0f, 1e-5f);
    assert_float_equal(l[0].intensity.y, 20.0f, 1e-5f);
    assert_float_equal(l[0].intensity.z, 0.0f, 0.0f);
    assert_int_equal(l[1].kind, LIGHT_SPOT);
    assert_float_equal(l[1].position.x, 10.0f, 1e-5f);
    assert_float_equal(l[1].position.y, 8.0f, 1e-5f);
    assert_float_equal(l[1].direction.y, -1.0f, 1e-6f);
    assert_float_equal(l[1].inner_cos, cos(0.2), 1e-6f);
    assert_float_equal(l[1].outer_cos, cos(0.6), 1e-6f);
    assert_int_equal(l[2].kind, LIGHT_DIRECTIONAL);
    assert_float_equal(l[2].direction.z, -1.0f, 1e-6f);
    assert_float_equal(l[2].intensity.y, 3.0f, 1e-6f);
    scene_destroy(s);
    folder_remove(&f);
}

static void alpha_modes_become_coverage(void **state)
{
    static const struct {
        const char *text;
        enum alpha_mode mode;
        float alpha, cutoff;
    } cases[] = {
        { "\"alphaMode\":\"OPAQUE\"", ALPHA_OPAQUE, 0.25f, 0.5f },
        { "\"alphaMode\":\"MASK\"", ALPHA_MASK, 0.25f, 0.5f },
        { "\"alphaMode\":\"MASK\",\"alphaCutoff\":0.75", ALPHA_MASK, 0.25f, 0.75f },
        { "\"alphaMode\":\"BLEND\"", ALPHA_BLEND, 0.25f, 0.5f },
        { "\"alphaMode\":\"BLEND\",\"extensions\":{\"KHR_materials_transmission\":{\"transmissionFactor\":1}}",
          ALPHA_OPAQUE, 0.25f, 0.5f }, /* glass: see gltf_materials.c */
    };
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_write(&f, "t.png", alpha_png, sizeof(alpha_png));
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        char text[4000];
        snprintf(text, sizeof(text),
                 "{" ONE_NODE "\"extensionsUsed\":[\"KHR_materials_transmission\"],\"materials\":[{%s,"
                 "\"pbrMetallicRoughness\":{\"baseColorFactor\":[1,1,1,0.25],"
                 "\"baseColorTexture\":{\"index\":0},\"roughnessFactor\":0}}],\"textures\":[{\"source\":0}],"
                 "\"images\":[{\"uri\":\"t.png\"}]," TAIL,
                 cases[i].text);
        struct scene *s = load_or_fail(write_gltf(&f, "a.gltf", text));
        const struct material *m = &s->materials[s->meshes[0].material];
        assert_int_equal(m->alpha_mode, cases[i].mode);
        if (cases[i].mode != ALPHA_OPAQUE) {
            assert_float_equal(m->alpha, cases[i].alpha, 1e-6f);
            assert_float_equal(m->alpha_cutoff, cases[i].cutoff, 1e-6f);
            const struct texture *t = &s->textures[m->alpha_texture];
            assert_int_equal(m->alpha_texture, m->texture); /* one image for both */
            assert_float_equal(texture_alpha(t, 0.25f, 0.75f), 0.0f, 1e-6f);
            assert_float_equal(texture_alpha(t, 0.75f, 0.75f), 85.0f / 255.0f, 1e-6f);
            assert_float_equal(texture_alpha(t, 0.25f, 0.25f), 170.0f / 255.0f, 1e-6f);
            assert_float_equal(texture_alpha(t, 0.75f, 0.25f), 1.0f, 1e-6f);
            assert_float_equal(texture_alpha(t, 0.5f, 0.5f), 0.5f, 1e-6f);
        }
        assert_int_equal(s->unmodelled & 1u << FEATURE_ALPHA, 0);
        scene_destroy(s);
    }
    folder_remove(&f);
}

static void mesh_of_two_nodes_stands_in_both_places(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    struct scene *s = load_or_fail(write_gltf(
        &f, "a.gltf",
        "{\"scene\":0,\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0},"
        "{\"translation\":[10,0,0],\"children\":[2]},{\"mesh\":0,\"scale\":[2,3,1],\"translation\":[0,5,0]}]," MATERIAL(
            "\"doubleSided\":true") TAIL));
    assert_int_equal(s->mesh_count, 2);
    assert_int_equal(s->triangle_count, 4);
    assert_float_equal(s->low.x, 0.0f, 0.0f);
    assert_float_equal(s->high.x, 12.0f, 1e-5f);
    assert_float_equal(s->high.y, 8.0f, 1e-5f);
    scene_destroy(s);
    folder_remove(&f);
}

static void cameras_of_the_file_are_taken(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    /* turned by 90 degrees about y: it looks along -x; one that knows its aspect ratio and one that does not */
    struct scene *s = load_or_fail(write_gltf(
        &f, "a.gltf",
        "{\"scene\":0,\"scenes\":[{\"nodes\":[0,1,2]}],\"nodes\":[{\"mesh\":0},{\"name\":\"eye\",\"camera\":0,"
        "\"translation\":[5,0.5,0],\"rotation\":[0,0.70710678,0,0.70710678]},"
        "{\"name\":\"other\",\"camera\":1,\"translation\":[0,0,7]}],"
        "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"aspectRatio\":1.7777778,\"yfov\":0.6,"
        "\"znear\":0.1}},{\"type\":\"perspective\",\"perspective\":{\"yfov\":0.9,\"znear\":0.1}}]," MATERIAL(
            "\"doubleSided\":true") TAIL));
    assert_int_equal(s->camera_count, 2);
    const struct camera *c = scene_camera(s, "eye");
    assert_non_null(c);
    assert_float_equal(c->position.x, 5.0f, 1e-6f);
    const struct vec3 ahead = vec3_normalize(vec3_sub(c->look_at, c->position));
    assert_float_equal(ahead.x, -1.0f, 1e-5f);
    assert_float_equal(c->up.y, 1.0f, 1e-5f);
    assert_float_equal(c->fov_y, 0.6f, 1e-5f);
    assert_float_equal(scene_camera(s, "other")->fov_y, 0.9f, 1e-5f);
    scene_destroy(s);
    folder_remove(&f);
}

static void without_a_camera_the_whole_is_framed(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    struct scene *s = load_or_fail(write_gltf(&f, "a.gltf", "{" ONE_NODE MATERIAL("\"doubleSided\":true") TAIL));
    const struct camera *c = scene_camera(s, NULL);
    const struct vec3 ahead = vec3_normalize(vec3_sub(c->look_at, c->position));
    const struct vec3 right = vec3_normalize(vec3_cross(ahead, c->up)), up = vec3_cross(right, ahead);
    const float tan_y = tanf(0.5f * c->fov_y);
    float most = 0.0f;
    for (int i = 0; i < 4; i++) { /* each corner within an image of 4:3, which is about filled */
        const struct vec3 to = vec3_sub(vec3_make(square[3 * i], square[3 * i + 1], square[3 * i + 2]), c->position);
        const float depth = vec3_dot(to, ahead);
        const float x = fabsf(vec3_dot(to, right)) / (depth * tan_y * 4.0f / 3.0f);
        const float y = fabsf(vec3_dot(to, up)) / (depth * tan_y);
        assert_true(depth > 0.0f && x < 1.0f && y < 1.0f);
        most = fmaxf(most, fmaxf(x, y));
    }
    assert_true(most > 0.8f);
    scene_destroy(s);
    folder_remove(&f);
}

/* Looks the square's material up at (u, v) counted from its lower left. */
static struct vec3 colour_at(const struct scene *s, float u, float v)
{
    const struct mesh *m = &s->meshes[0];

    assert_non_null(m->uvs);
    for (uint32_t i = 0; i < m->vertex_count; i++) { /* v is up in the scene */
        assert_float_equal(m->uvs[2 * i], m->positions[3 * i], 1e-6f);
        assert_float_equal(m->uvs[2 * i + 1], m->positions[3 * i + 1], 1e-6f);
    }
    return texture_lookup(&s->textures[s->materials[m->material].texture], u, v);
}

static void png_texture_is_linear_and_upright(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_write(&f, "four colours.png", four_png, sizeof(four_png));
    struct scene *s = load_or_fail(write_gltf(&f, "a.gltf", "{" ONE_NODE TEXTURED("four%20colours.png") TAIL));
    assert_int_equal(s->texture_count, 1);
    const struct vec3 red = colour_at(s, 0.25f, 0.75f), green = colour_at(s, 0.75f, 0.75f);
    const struct vec3 blue = colour_at(s, 0.25f, 0.25f), grey = colour_at(s, 0.75f, 0.25f);
    assert_float_equal(red.x, 1.0f, 1e-6f);
    assert_float_equal(red.y, 0.0f, 1e-6f);
    assert_float_equal(green.y, 1.0f, 1e-6f);
    assert_float_equal(blue.z, 1.0f, 1e-6f);
    assert_float_equal(grey.x, 0.2158605f, 1e-6f); /* ((128/255 + 0.055) / 1.055)^2.4 */
    /* halfway between the centres, and around the rim */
    assert_float_equal(colour_at(s, 0.5f, 0.75f).x, 0.5f, 1e-6f);
    assert_float_equal(colour_at(s, 1.0f, 0.75f).y, 0.5f, 1e-6f);
    assert_float_equal(colour_at(s, -6.75f, 13.75f).x, 1.0f, 1e-5f);
    scene_destroy(s);
    folder_remove(&f);
}

static void jpeg_texture_is_read(void **state)
{
    unsigned char *jpeg = NULL;
    unsigned long size = 0;
    uint8_t texels[16 * 16 * 3];
    struct folder f;

    (void)state;
    folder_make(&f);
    memset(texels, 188, sizeof(texels));
    tjhandle tj = tjInitCompress();
    assert_int_equal(tjCompress2(tj, texels, 16, 0, 16, TJPF_RGB, &jpeg, &size, TJSAMP_444, 95, 0), 0);
    folder_write(&f, "grey.jpg", jpeg, size);
    struct scene *s = load_or_fail(write_gltf(&f, "a.gltf", "{" ONE_NODE TEXTURED("grey.jpg") TAIL));
    assert_float_equal(colour_at(s, 0.4f, 0.6f).y, 0.5028866f, 1e-3f);
    scene_destroy(s);
    faults_intended = true; /* cut short: within the image, and before it */
    for (size_t left = size / 2; left; left = left > 20 ? 20 : 0) {
        struct reason why = { "" };
        char path[256];
        folder_write(&f, "grey.jpg", jpeg, left);
        snprintf(path, sizeof(path), "%s/a.gltf", f.path);
        log_begin();
        assert_int_equal(load_here(path, &s, &why), ERR_OK);
        assert_non_null(strstr(log_end(), "grey.jpg: JPEG: "));
        scene_destroy(s);
    }
    faults_intended = false;
    tjFree(jpeg);
    tjDestroy(tj);
    folder_remove(&f);
}

/* 16-bit files are sRGB like all others, rounded to 8 bits. */
static void a_png_of_16_bits_is_srgb(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_write(&f, "grey.png", grey16_png, sizeof(grey16_png));
    struct scene *s = load_or_fail(write_gltf(&f, "a.gltf", "{" ONE_NODE TEXTURED("grey.png") TAIL));
    assert_float_equal(colour_at(s, 0.4f, 0.6f).y, 0.2176f, 0.002f); /* ((0x80c0/65535 + 0.055) / 1.055)^2.4 */
    scene_destroy(s);
    folder_remove(&f);
}

/* 80 names of one image, each used by two materials that repeat it and by one that does not. */
static void materials_share_textures(void **state)
{
    enum { NAMES = 80, MATERIALS = 3 * NAMES };
    static char text[100000];
    struct folder f;
    size_t n = 0;

    (void)state;
    folder_make(&f);
    folder_write(&f, "t.png", four_png, sizeof(four_png));
    n += (size_t)sprintf(text + n, "{" ONE_NODE "\"samplers\":[{\"wrapS\":33071,\"wrapT\":33648}],\"materials\":[");
    for (int i = 0; i < MATERIALS; i++)
        n += (size_t)sprintf(text + n,
                             "%s{\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":%d},"
                             "\"metallicRoughnessTexture\":{\"index\":%d}}}",
                             i ? "," : "", i % (2 * NAMES), i % NAMES);
    n += (size_t)sprintf(text + n, "],\"textures\":[");
    for (int i = 0; i < 2 * NAMES; i++)
        n += (size_t)sprintf(text + n, "%s{\"source\":%d%s}", i ? "," : "", i % NAMES,
                             i < NAMES ? "" : ",\"sampler\":0");
    n += (size_t)sprintf(text + n, "],\"images\":[");
    for (int i = 0; i < NAMES; i++) {
        n += (size_t)sprintf(text + n, "%s{\"uri\":\"", i ? "," : "");
        for (int k = 0; k < i; k++)
            n += (size_t)sprintf(text + n, "./");
        n += (size_t)sprintf(text + n, "t.png\"}");
    }
    n += (size_t)sprintf(text + n, "]," PARTS "\"meshes\":[{\"primitives\":["); /* unused materials are not read */
    for (int i = 0; i < MATERIALS; i++)
        n += (size_t)sprintf(text + n, "%s" SQUARE("%d"), i ? "," : "", i);
    sprintf(text + n, "]}]}");
    log_begin();
    struct scene *s = load_or_fail(write_gltf(&f, "a.gltf", text));
    const char *said = log_end();
    assert_null(strstr(said, "repeat"));
    assert_int_equal(s->texture_count, 3 * NAMES);
    for (int i = 0; i < MATERIALS; i++) {
        const struct material *m = &s->materials[i];
        const struct texture *t = &s->textures[m->texture];
        assert_int_equal(m->texture, s->materials[i % (2 * NAMES)].texture);
        assert_int_equal(t->wrap_u, i % (2 * NAMES) < NAMES ? TEXTURE_REPEAT : TEXTURE_CLAMP);
        assert_int_equal(t->wrap_v, i % (2 * NAMES) < NAMES ? TEXTURE_REPEAT : TEXTURE_MIRROR);
        assert_int_equal(m->maps, MAP_ROUGHNESS);
        assert_int_equal(m->roughness_texture, s->materials[i % NAMES].roughness_texture);
        assert_int_equal(s->textures[m->roughness_texture].values, TEXTURE_LINEAR);
    }
    scene_destroy(s);
    folder_remove(&f);
}

static void bad_textures_are_named(void **state)
{
    struct reason why = { "" };
    uint8_t big[sizeof(four_png)];
    struct scene *s;
    struct folder f;

    (void)state;
    folder_make(&f);
    faults_intended = true;
    char path[256];
    snprintf(path, sizeof(path), "%s", write_gltf(&f, "a.gltf", "{" ONE_NODE TEXTURED("t.png") TAIL));
    for (size_t cut = 0; cut < sizeof(four_png); cut++) { /* truncated at every byte */
        folder_write(&f, "t.png", four_png, cut);
        log_begin();
        assert_int_equal(load_here(path, &s, &why), ERR_OK);
        if (!strstr(log_end(), "/t.png: ")) /* all that counts was there */
            assert_true(cut > sizeof(four_png) - 20);
        scene_destroy(s);
    }
    /* an unbelievable width: refused before memory is asked for; byte 29 on is the header's checksum */
    memcpy(big, four_png, sizeof(big));
    memcpy(big + 16, (const uint8_t[]){ 0, 1, 0x86, 0xa0 }, 4);
    memcpy(big + 29, (const uint8_t[]){ 0x54, 0x88, 0xf3, 0x2c }, 4);
    folder_write(&f, "t.png", big, sizeof(big));
    log_begin();
    assert_int_equal(load_here(path, &s, &why), ERR_OK);
    assert_non_null(strstr(log_end(), "/t.png: 100000 x 2"));
    scene_destroy(s);
    write_gltf(&f, "a.gltf", "{" ONE_NODE TEXTURED("https://example.org/t.png") TAIL);
    log_begin();
    assert_int_equal(load_here(path, &s, &why), ERR_OK);
    assert_non_null(strstr(log_end(), "'https://example.org/t.png' is on a server"));
    scene_destroy(s);
    faults_intended = false;
    folder_remove(&f);
}

static void gltf_model_in_a_json_scene_keeps_its_materials_unless_told(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    write_gltf(&f, "a.gltf", "{" ONE_NODE MATERIAL("\"pbrMetallicRoughness\":{\"roughnessFactor\":0.5}") TAIL);
    const char *path = folder_text(
        &f, "s.json",
        "{\"camera\":{\"position\":[0,1,5],\"look_at\":[0,0,0],\"fov_y_degrees\":40},\"models\":["
        "{\"file\":\"a.gltf\"},{\"file\":\"a.gltf\",\"material\":\"grey\",\"smooth\":false},{\"file\":\"a.gltf\"}],"
        "\"materials\":{\"grey\":{\"type\":\"lambert\",\"albedo\":[0.5,0.5,0.5]}}}");
    struct scene *s = load_or_fail(path);
    assert_int_equal(s->mesh_count, 3);
    assert_int_equal(s->materials[s->meshes[0].material].kind, MATERIAL_GGX);
    assert_float_equal(s->materials[s->meshes[2].material].roughness, 0.5f, 1e-6f);
    assert_non_null(s->meshes[0].normals);
    assert_int_equal(s->materials[s->meshes[1].material].kind, MATERIAL_LAMBERT);
    assert_null(s->meshes[1].normals);
    scene_destroy(s);
    folder_remove(&f);
}

static void broken_gltf_is_refused(void **state)
{
    static const char *const texts[] = {
        "",
        "{",
        "{\"asset\":{\"version\":\"2.0\"}}",
        "{" ONE_NODE
        "\"asset\":{\"version\":\"2.0\"},\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":7}}]}]}",
        "glTF\x02",
    };
    struct folder f;

    (void)state;
    folder_make(&f);
    for (size_t i = 0; i < 2 * sizeof(texts) / sizeof(texts[0]); i++) {
        struct reason why = { "" };
        struct scene *s = NULL;
        const char *path = folder_text(&f, i % 2 ? "a.glb" : "a.gltf", texts[i / 2]);
        assert_int_equal(load_here(path, &s, &why), ERR_FORMAT);
        assert_null(s);
        assert_non_null(strstr(why.text, path));
    }
    folder_remove(&f);
}

static void shared_models_load(void **state)
{
    static const struct {
        const char *path;
        uint64_t triangles;
        size_t textures;
        uint32_t unmodelled;
    } files[] = {
        { "models/house.glb", 10497, 1, 0 },
        { "models/glass-table.glb", 592, 0, 0 },
        { "models/low-poly-tree.glb", 1126, 1, 0 },
        { "models/AttenuationTest.glb", 292, 2, 0 },
        { "models/kenney-city/grass-trees.glb", 380, 1, 0 }, /* its texture is a file of its own */
    };

    (void)state;
    for (size_t i = 0; i < sizeof(files) / sizeof(files[0]); i++) {
        struct scene *s = load_or_fail(unit_data(files[i].path));
        assert_int_equal(s->triangle_count, files[i].triangles);
        assert_int_equal(s->texture_count, files[i].textures);
        assert_int_equal(s->unmodelled, files[i].unmodelled);
        assert_int_equal(s->camera_count, 1);
        scene_destroy(s);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(factors_become_ggx),
    cmocka_unit_test(transmission_becomes_glass),
    cmocka_unit_test(what_is_not_modelled_is_named_once),
    cmocka_unit_test(alpha_modes_become_coverage),
    cmocka_unit_test(emission_has_a_factor_and_a_texture),
    cmocka_unit_test(strength_multiplies_the_emission),
    cmocka_unit_test(punctual_lights_stand_at_their_nodes),
    cmocka_unit_test(mesh_of_two_nodes_stands_in_both_places),
    cmocka_unit_test(cameras_of_the_file_are_taken),
    cmocka_unit_test(without_a_camera_the_whole_is_framed),
    cmocka_unit_test(png_texture_is_linear_and_upright),
    cmocka_unit_test(jpeg_texture_is_read),
    cmocka_unit_test(a_png_of_16_bits_is_srgb),
    cmocka_unit_test(materials_share_textures),
    cmocka_unit_test(bad_textures_are_named),
    cmocka_unit_test(gltf_model_in_a_json_scene_keeps_its_materials_unless_told),
    cmocka_unit_test(broken_gltf_is_refused),
    cmocka_unit_test(shared_models_load),
};

UNIT_MAIN(tests)
