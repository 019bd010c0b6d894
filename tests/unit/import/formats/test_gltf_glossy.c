/* Specular-glossiness materials of glTF files. */
#include "gltf_square.h"

#include "import/formats/gltf.h"

#define GLOSSY(members) "\"extensions\":{\"KHR_materials_pbrSpecularGlossiness\":{" members "}}"

/* Matte albedo and F0 of a grey surface are those that the specular-glossiness model states. */
static void specular_glossiness_keeps_matte_and_specular(void **state)
{
    static const float greys[][2] = {
        { 0.5f, 0.04f }, { 0.2f, 0.1f }, { 0.0f, 0.9f }, { 0.02f, 0.6f }, { 0.1f, 0.2f }
    };
    struct glossy_texel t;

    (void)state;
    for (size_t i = 0; i < sizeof(greys) / sizeof(greys[0]); i++) {
        const float d = greys[i][0], s = greys[i][1];
        glossy_convert((float[3]){ d, d, d }, (float[3]){ s, s, s }, 0.25f, &t);
        assert_float_equal(0.96f * (1.0f - t.metallic) * t.base[0], d * (1.0f - s), 1e-5f);
        assert_float_equal(0.04f * (1.0f - t.metallic) + t.metallic * t.base[0], s, 1e-5f);
        assert_float_equal(t.roughness, 0.75f, 0.0f);
    }
    glossy_convert((float[3]){ 0.8f, 0.5f, 0.1f }, (float[3]){ 0.0f, 0.0f, 0.0f }, 1.0f,
                   &t); /* less than a dielectric */
    assert_true(t.metallic == 0.0f && t.roughness == 0.0f);
    assert_float_equal(t.base[0], 0.8f / 0.96f, 1e-5f);
}

static void specular_glossiness_textures_become_two(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", faint_png, sizeof(faint_png));
    const char *path = square_of(
        &f, GLOSSY("\"specularGlossinessTexture\":{\"index\":0},"
                   "\"diffuseTexture\":{\"index\":1}") "},{" GLOSSY("\"specularGlossinessTexture\":{\"index\":0},"
                                                                    "\"diffuseTexture\":{\"index\":1}"));
    log_begin();
    struct scene *s = load_or_fail(path);
    assert_string_equal(log_end(), "");
    const struct material *m = &s->materials[0];
    assert_int_equal(m->maps, MAP_ROUGHNESS);
    assert_true(m->roughness == 1.0f && m->metallic == 1.0f && m->diffuse.x == 1.0f);
    /* white metal of glossiness 0, 51 / 102, 255 */
    const struct texture *base = &s->textures[m->texture], *rough = &s->textures[m->roughness_texture];
    static const uint8_t roughness[4] = { 255, 204, 153, 0 };
    for (size_t i = 0; i < 4; i++) {
        assert_int_equal(base->texels[4 * i], 255);
        assert_int_equal(rough->texels[4 * i + 1], roughness[i]);
        assert_int_equal(rough->texels[4 * i + 2], 255);
    }
    assert_true(s->materials[1].texture == m->texture && s->materials[1].roughness_texture == m->roughness_texture);
    assert_int_equal(s->texture_count, 2);
    scene_destroy(s);
    /* other coordinates: the means */
    const struct material other = read_material(&f,
                                                GLOSSY("\"specularGlossinessTexture\":{\"index\":0,\"texCoord\":1},"
                                                       "\"diffuseTexture\":{\"index\":1}"),
                                                &said);
    assert_int_equal(other.maps, 0);
    assert_float_equal(other.roughness, 1.0f - (0 + 51 + 102 + 255) / 1020.0f, 1e-6f);
    assert_int_equal(count_of(said, "specular-glossiness texture with other coordinates"), 1);
    make_end(&f);
}

static void missing_specular_glossiness_textures_leave_the_factors(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    faults_intended = true;
    const struct material without =
        read_material(&f, GLOSSY("\"glossinessFactor\":0.25,\"specularGlossinessTexture\":{\"index\":0}"), &said);
    faults_intended = false;
    assert_true(without.maps == 0 && without.roughness == 0.75f);
    assert_non_null(
        strstr(said, "map.png: No such file or directory; the specular and glossiness factors alone count"));
    make_end(&f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(specular_glossiness_keeps_matte_and_specular),
    cmocka_unit_test(specular_glossiness_textures_become_two),
    cmocka_unit_test(missing_specular_glossiness_textures_leave_the_factors),
};
UNIT_MAIN(tests)
