/* Textures of numbers in glTF files: what the materials become, and what is said of those that do not fit. */
#include "gltf_make.h"

#include "pngs.h"
#include "scene/scatter.h"

static const float corners[] = { 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0 };
static const float uvs[] = { 0, 1, 1, 1, 1, 0, 0, 0 };
static const uint8_t two_triangles[] = { 0, 1, 2, 0, 2, 3 };

#define REST                                                                                                           \
    "\"nodes\":[{\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":2},"         \
    "\"indices\":1,\"material\":0}]}],\"textures\":[{\"source\":0},{\"source\":1}],"                                   \
    "\"images\":[{\"uri\":\"map.png\"},{\"uri\":\"t.png\"}],\"materials\":[{"

/* A square with a material of these members; textures: 0 is map.png, which the test writes, 1 an image of colours. */
static const char *square_of(struct make *m, const char *material)
{
    static char text[4096];

    m->size = 0;
    m->views[0] = m->accessors[0] = '\0';
    m->view_count = m->accessor_count = 0;
    FLOATS(m, corners, "VEC3", 4);
    make_array(m, two_triangles, sizeof(two_triangles), 5121, "SCALAR", 6);
    FLOATS(m, uvs, "VEC2", 4);
    folder_write(&m->folder, "t.png", four_png, sizeof(four_png));
    snprintf(text, sizeof(text), REST "%s}]", material);
    return make_gltf(m, text);
}

/* The material as it was read, and what was said of it; its maps are checked to be textures of numbers. */
static struct material read_material(struct make *m, const char *material, const char **said)
{
    log_begin();
    struct scene *s = load_or_fail(square_of(m, material));
    *said = log_end();
    const struct material out = s->materials[0];
    if (out.maps & MAP_ROUGHNESS)
        assert_int_equal(s->textures[out.roughness_texture].values, TEXTURE_LINEAR);
    scene_destroy(s);
    return out;
}

#define ROUGH(factors, texture)                                                                                        \
    "\"pbrMetallicRoughness\":{" factors "\"baseColorTexture\":{\"index\":1},\"metallicRoughnessTexture\":{" texture   \
    "}}"

static void metallic_roughness_textures_become_maps(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    struct material m = read_material(&f, ROUGH("\"roughnessFactor\":0.5,", "\"index\":0"), &said);
    assert_int_equal(m.maps, MAP_ROUGHNESS);
    assert_true(m.metallic == 1.0f && m.roughness == 0.5f && m.roughness_texture != m.texture);
    assert_string_equal(said, "");
    /* other coordinates than the base colour's: the means, of green and of blue */
    m = read_material(&f, ROUGH("\"roughnessFactor\":0.5,", "\"index\":0,\"texCoord\":1"), &said);
    assert_int_equal(m.maps, 0);
    assert_float_equal(m.roughness, 0.5f * (0 + 255 + 0 + 128) / 1020.0f, 1e-6f);
    assert_float_equal(m.metallic, (0 + 0 + 255 + 128) / 1020.0f, 1e-6f);
    assert_int_equal(count_of(said, "not supported: texture transforms and second texture coordinates"), 1);
    /* one value is a factor, and may make a mirror */
    folder_write(&f.folder, "map.png", grey16_png, sizeof(grey16_png));
    m = read_material(&f, ROUGH("\"roughnessFactor\":0.03,", "\"index\":0"), &said);
    assert_int_equal(m.maps, 0);
    assert_float_equal(m.roughness, 0.03f * 128.0f / 255.0f, 1e-6f);
    assert_true(material_is_delta(&m));
    make_end(&f);
}

static void faults_of_metallic_roughness_textures_are_named(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    const struct material m =
        read_material(&f, ROUGH("\"roughnessFactor\":0.5,\"metallicFactor\":0.25,", "\"index\":0"), &said);
    assert_int_equal(m.maps, 0);
    assert_true(m.roughness == 0.5f && m.metallic == 0.25f);
    assert_non_null(strstr(said, "map.png: No such file or directory; the metallic and roughness factors alone count"));
    assert_non_null(strstr(make_refused(square_of(&f, ROUGH("", "\"index\":2")), ERR_FORMAT),
                           "metallicRoughnessTexture.index: textures[2] does not exist"));
    assert_non_null(strstr(make_refused(square_of(&f, ROUGH("", "\"texCoord\":0")), ERR_FORMAT),
                           "metallicRoughnessTexture: has no index"));
    make_end(&f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(metallic_roughness_textures_become_maps),
    cmocka_unit_test(faults_of_metallic_roughness_textures_are_named),
};
UNIT_MAIN(tests)
