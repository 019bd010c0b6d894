/* Textures of numbers in glTF files: the materials that result, and the warnings about maps that do not fit. */
#include "gltf_square.h"

#include "scene/surface/scatter.h"

#define ROUGH(factors, texture)                                                                                        \
    "\"pbrMetallicRoughness\":{" factors "\"baseColorTexture\":{\"index\":1},\"metallicRoughnessTexture\":{" texture   \
    "}}"

#define GLOWS(set) "\"emissiveFactor\":[1,1,1],\"emissiveTexture\":{\"index\":1,\"texCoord\":" #set "}"
#define THROUGH(set)                                                                                                   \
    "\"extensions\":{\"KHR_materials_diffuse_transmission\":{\"diffuseTransmissionFactor\":0.5,"                       \
    "\"diffuseTransmissionColorTexture\":{\"index\":1,\"texCoord\":" #set "}}}"

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
    /* other coordinates than the base colour's */
    m = read_material(&f, ROUGH("\"roughnessFactor\":0.5,", "\"index\":0,\"texCoord\":1"), &said);
    assert_true(m.maps == MAP_ROUGHNESS && m.second == MAP_ROUGHNESS && m.moved == 0);
    assert_string_equal(said, "");
    /* and a third set: the means, of green and of blue */
    m = read_material(&f, ROUGH("\"roughnessFactor\":0.5,", "\"index\":0,\"texCoord\":2") "," GLOWS(1), &said);
    assert_true(m.maps == MAP_ROUGHNESS && m.second == MAP_ROUGHNESS);
    assert_int_equal(
        count_of(said, "not supported: a third set of texture coordinates or texture transform in one material"), 1);
    m = read_material(&f, ROUGH("\"roughnessFactor\":0.5,", "\"index\":0,\"texCoord\":2") "," THROUGH(1), &said);
    assert_true(m.maps == 0 && m.second == MAP_THROUGH);
    assert_float_equal(m.roughness, 0.5f * (0 + 255 + 0 + 128) / 1020.0f, 1e-6f);
    assert_float_equal(m.metallic, (0 + 0 + 255 + 128) / 1020.0f, 1e-6f);
    assert_int_equal(
        count_of(said, "not supported: a third set of texture coordinates or texture transform in one material"), 1);
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
    faults_intended = true;
    const struct material m =
        read_material(&f, ROUGH("\"roughnessFactor\":0.5,\"metallicFactor\":0.25,", "\"index\":0"), &said);
    faults_intended = false;
    assert_int_equal(m.maps, 0);
    assert_true(m.roughness == 0.5f && m.metallic == 0.25f);
    assert_non_null(strstr(said, "map.png: No such file or directory; the metallic and roughness factors alone count"));
    assert_non_null(strstr(make_refused(square_of(&f, ROUGH("", "\"index\":2")), ERR_FORMAT),
                           "metallicRoughnessTexture.index: textures[2] does not exist"));
    assert_non_null(strstr(make_refused(square_of(&f, ROUGH("", "\"texCoord\":0")), ERR_FORMAT),
                           "metallicRoughnessTexture: has no index"));
    make_end(&f);
}

/* ---- Normals ---- */

#define BUMPY "\"normalTexture\":{\"index\":0,\"scale\":0.5}"

static void normal_textures_become_maps(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    struct material m = read_material(&f, BUMPY, &said);
    assert_int_equal(m.maps, MAP_NORMAL);
    assert_true(m.normal_scale == 0.5f);
    assert_string_equal(said, "");
    m = read_material(&f, ROUGH("", "\"index\":0") "," BUMPY, &said);
    assert_int_equal(m.maps, MAP_ROUGHNESS | MAP_NORMAL);
    m = read_material(&f, ROUGH("", "\"index\":0") ",\"normalTexture\":{\"index\":0,\"texCoord\":1}", &said);
    assert_true(m.maps == (MAP_ROUGHNESS | MAP_NORMAL) && m.second == MAP_NORMAL);
    assert_string_equal(said, "");
    m = read_material(&f, ROUGH("", "\"index\":0,\"texCoord\":1") ",\"normalTexture\":{\"index\":0,\"texCoord\":2}",
                      &said);
    assert_true(m.maps == MAP_ROUGHNESS && m.second == MAP_ROUGHNESS);
    assert_int_equal(
        count_of(said, "not supported: a third set of texture coordinates or texture transform in one material"), 1);
    m = read_material(&f, BUMPY "," GLOWS(0) ",\"extensions\":{\"KHR_materials_unlit\":{}}", &said);
    assert_int_equal(m.maps, 0);
    assert_true(m.emission.x == 0.0f && m.emission.y == 0.0f && m.emission.z == 0.0f);
    folder_write(&f.folder, "map.png", flat_png, sizeof(flat_png));
    m = read_material(&f, BUMPY, &said);
    assert_int_equal(m.maps, 0);
    make_end(&f);
}

#define COAT(members) ",\"extensions\":{\"KHR_materials_clearcoat\":{" members "}}"
#define COAT_MAP(of, texture) ",\"clearcoat" of "Texture\":{" texture "}"

static void clear_coats_have_factors_and_maps(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    struct material m = read_material(
        &f, ROUGH("", "\"index\":0") COAT("\"clearcoatFactor\":0.5,\"clearcoatRoughnessFactor\":0.25"), &said);
    assert_true(m.kind == MATERIAL_GGX && m.coat == 0.5f && m.coat_roughness == 0.25f && m.maps == MAP_ROUGHNESS);
    assert_string_equal(said, "");
    /* one map is both, at the second coordinates; the normal is the surface's */
    m = read_material(
        &f,
        BUMPY COAT("\"clearcoatFactor\":1,\"clearcoatRoughnessFactor\":1" COAT_MAP("", "\"index\":0,\"texCoord\":1")
                       COAT_MAP("Roughness", "\"index\":0,\"texCoord\":1") COAT_MAP("Normal", "\"index\":0")),
        &said);
    assert_int_equal(m.maps, MAP_NORMAL | MAP_COAT | MAP_COAT_ROUGHNESS);
    assert_int_equal(m.second, MAP_COAT | MAP_COAT_ROUGHNESS);
    assert_true(m.coat == 1.0f && m.coat_bent && m.coat_texture != m.coat_roughness_texture);
    assert_string_equal(said, "");
    m = read_material(&f, BUMPY COAT("\"clearcoatFactor\":1" COAT_MAP("Normal", "\"index\":1")), &said);
    assert_true(m.coat == 1.0f && !m.coat_bent);
    assert_int_equal(count_of(said, "not supported: a normal map of its own of a clear coat"), 1);
    m = read_material(&f,
                      "\"pbrMetallicRoughness\":{\"roughnessFactor\":0},"
                      "\"extensions\":{\"KHR_materials_clearcoat\":{\"clearcoatFactor\":1},"
                      "\"KHR_materials_transmission\":{\"transmissionFactor\":1}}",
                      &said);
    assert_true(m.kind == MATERIAL_GLASS && m.coat == 0.0f);
    assert_int_equal(count_of(said, "not supported: clear coats on glass"), 1);
    folder_write(&f.folder, "map.png", grey16_png, sizeof(grey16_png));
    m = read_material(&f, ROUGH("", "\"index\":1") COAT("\"clearcoatFactor\":0.5" COAT_MAP("", "\"index\":0")), &said);
    assert_true(!(m.maps & MAP_COAT));
    assert_float_equal(m.coat, 0.5f * 128.0f / 255.0f, 1e-6f);
    make_end(&f);
}

#define MOVED(members) ",\"extensions\":{\"KHR_texture_transform\":{" members "}}"
#define BASED(base, rough, normal)                                                                                     \
    "\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":1" base                                                 \
    "},\"metallicRoughnessTexture\":{\"index\":0" rough "}},\"normalTexture\":{\"index\":0" normal "}"

static void assert_moved(const float by[6], float a, float b, float c, float d, float e, float f)
{
    const float want[6] = { a, b, c, d, e, f };

    for (int k = 0; k < 6; k++)
        assert_float_equal(by[k], want[k], 1e-6f);
}

/* In upright coordinates, v = 1 - V: V' = 3 V + 0.5 is v' = 3 v - 2.5. */
static void maps_may_be_scaled_and_moved_against_the_base_colour(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    struct material m = read_material(
        &f, BASED("", MOVED("\"rotation\":1.5707963267948966"), MOVED("\"scale\":[2,3],\"offset\":[0.25,0.5]")), &said);
    assert_int_equal(m.maps, MAP_ROUGHNESS | MAP_NORMAL);
    assert_int_equal(m.moved, MAP_ROUGHNESS | MAP_NORMAL);
    assert_moved(m.moved_by[0], 0, -1, 1, 1, 0, 1);
    assert_moved(m.moved_by[1], 2, 0, 0.25f, 0, 3, -2.5f);
    assert_string_equal(said, "");
    m = read_material(&f, BASED(MOVED("\"scale\":[2,2]"), MOVED("\"scale\":[2,2]"), ""), &said);
    assert_int_equal(m.moved, MAP_NORMAL);
    assert_moved(m.moved_by[1], 0.5f, 0, 0, 0, 0.5f, 0.5f);
    assert_string_equal(said, "");
    /* a turned normal map needs another frame, and nothing is affine in a base without extent: a second set each */
    m = read_material(&f, BASED("", "", MOVED("\"rotation\":1")), &said);
    assert_true(m.maps == (MAP_ROUGHNESS | MAP_NORMAL) && m.moved == 0 && m.second == MAP_NORMAL);
    m = read_material(&f, BASED(MOVED("\"scale\":[0,2]"), "", ""), &said);
    assert_true(m.maps == (MAP_ROUGHNESS | MAP_NORMAL) && m.moved == 0 && m.second == m.maps);
    assert_string_equal(said, "");
    /* maps may be affine in the second set, too */
    m = read_material(&f, BASED("", ",\"texCoord\":1", ",\"texCoord\":1" MOVED("\"scale\":[2,2]")), &said);
    assert_true(m.second == (MAP_ROUGHNESS | MAP_NORMAL) && m.moved == MAP_NORMAL);
    assert_moved(m.moved_by[1], 2, 0, 0, 0, 2, -1);
    assert_string_equal(said, "");
    make_end(&f);
}

static void faults_of_normal_textures_are_named(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    faults_intended = true;
    const struct material m = read_material(&f, BUMPY, &said);
    faults_intended = false;
    assert_int_equal(m.maps, 0);
    assert_non_null(strstr(said, "map.png: No such file or directory; the surfaces are smooth instead"));
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    assert_non_null(strstr(make_refused(square_of(&f, "\"normalTexture\":{\"index\":2}"), ERR_FORMAT),
                           "materials[0].normalTexture.index: textures[2] does not exist"));
    assert_non_null(strstr(make_refused(square_of(&f, "\"normalTexture\":{\"index\":0,\"scale\":[1]}"), ERR_FORMAT),
                           "materials[0].normalTexture.scale: "));
    assert_non_null(strstr(make_refused(square_with(&f, BUMPY, UVS ",\"TANGENT\":3", ""), ERR_FORMAT),
                           "primitives[0].attributes.TANGENT: accessors[3] has 3 components"));
    make_end(&f);
}

/* The first vertex of the mesh, or NULL. */
static void assert_tangent(struct make *f, const char *attributes, const char *node, const float want[4])
{
    struct scene *s = load_or_fail(square_with(f, BUMPY, attributes, node));
    const struct mesh *m = &s->meshes[0];

    assert_true((m->tangents != NULL) == (want != NULL));
    for (uint32_t i = 0; want && i < 4 * m->vertex_count; i++)
        assert_float_equal(m->tangents[i], want[i % 4], 1e-6f);
    scene_destroy(s);
}

static void tangents_are_the_file_s_or_computed(void **state)
{
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    assert_tangent(&f, UVS, "", (const float[]){ 1, 0, 0, 1 });
    assert_tangent(&f, TANGENTS, "", (const float[]){ 0, 1, 0, -1 });
    assert_tangent(&f, UVS, ",\"scale\":[-2,1,1]", (const float[]){ -1, 0, 0, -1 });
    assert_tangent(&f, TANGENTS, ",\"scale\":[-2,1,1]", (const float[]){ 0, 1, 0, 1 });
    assert_tangent(&f, TANGENTS, ",\"scale\":[2,3,4]", (const float[]){ 0, 1, 0, -1 });
    faults_intended = true;
    assert_tangent(&f, ",\"NORMAL\":3", "", NULL); /* without texture coordinates there is no map */
    faults_intended = false;
    assert_tangent(&f, ",\"TEXCOORD_0\":2,\"TANGENT\":4", "", (const float[]){ 1, 0, 0, 1 }); /* no normals: not used */
    make_end(&f);
}

/* ---- Specular ---- */

static struct material specular_of(struct make *f, const char *factors, const char *extensions, const char **said)
{
    char text[512];

    snprintf(text, sizeof(text), "\"pbrMetallicRoughness\":{%s},\"extensions\":{%s}", factors, extensions);
    return read_material(f, text, said);
}

static void assert_f0(const struct material *m, float r, float g, float b)
{
    const struct vec3 f0 = ggx_f0(vec3_make(0.5f, 0.5f, 0.5f), 0.0f, m->specular);

    assert_int_equal(m->kind, MATERIAL_GGX);
    assert_near(f0, r, g, b);
}

#define SPECULAR(members) "\"KHR_materials_specular\":{" members "}"
#define IOR(n) "\"KHR_materials_ior\":{\"ior\":" n "}"
#define DIELECTRIC "\"metallicFactor\":0"

/* F0 = min(((n - 1) / (n + 1))^2 colour, 1) factor */
static void specular_and_ior_make_f0(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    struct material m = specular_of(&f, DIELECTRIC, IOR("1.5"), &said);
    assert_f0(&m, 0.04f, 0.04f, 0.04f);
    m = specular_of(&f, DIELECTRIC, IOR("2"), &said);
    assert_f0(&m, 1.0f / 9.0f, 1.0f / 9.0f, 1.0f / 9.0f);
    m = specular_of(&f, DIELECTRIC, IOR("0"), &said);
    assert_f0(&m, 1.0f, 1.0f, 1.0f);
    m = specular_of(&f, DIELECTRIC, SPECULAR("\"specularFactor\":0.5,\"specularColorFactor\":[0,1,100]"), &said);
    assert_f0(&m, 0.0f, 0.02f, 0.5f);
    assert_string_equal(said, "");
    m = specular_of(&f, DIELECTRIC, SPECULAR("\"specularFactor\":0"), &said);
    assert_int_equal(m.kind, MATERIAL_LAMBERT);
    assert_true(m.specular.x == 0.0f);
    m = specular_of(&f, "\"metallicFactor\":1", SPECULAR("\"specularFactor\":0"), &said);
    assert_int_equal(m.kind, MATERIAL_GGX);
    m = specular_of(&f, DIELECTRIC, SPECULAR("\"specularTexture\":{\"index\":1}"), &said);
    assert_int_equal(count_of(said, "not supported: specular and transmission textures"), 1);
    assert_non_null(
        strstr(make_refused(square_of(&f, "\"extensions\":{" SPECULAR("\"specularColorFactor\":1") "}"), ERR_FORMAT),
               "specularColorFactor"));
    make_end(&f);
}

static void glass_keeps_its_tint(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    const struct material m =
        specular_of(&f, DIELECTRIC ",\"roughnessFactor\":0,\"baseColorFactor\":[0.9,0.5,0.1,1]",
                    "\"KHR_materials_transmission\":{\"transmissionFactor\":1}," IOR("1.33"), &said);
    assert_int_equal(m.kind, MATERIAL_GLASS);
    assert_near(m.diffuse, 0.9f, 0.5f, 0.1f);
    assert_float_equal(m.ior, 1.33f, 1e-6f);
    assert_string_equal(said, "");
    make_end(&f);
}

#define GLASS_ALONE "\"KHR_materials_transmission\":{\"transmissionFactor\":1}"
#define GLASS GLASS_ALONE ","

/* Half of the red light is left after 2 m, all of the green, and none of the blue. */
static void volumes_attenuate(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    const struct material m = specular_of(
        &f, DIELECTRIC ",\"roughnessFactor\":0",
        GLASS
        "\"KHR_materials_volume\":{\"thicknessFactor\":1,\"attenuationDistance\":2,\"attenuationColor\":[0.5,1,0]}",
        &said);
    assert_int_equal(m.kind, MATERIAL_GLASS);
    assert_float_equal(m.attenuation.x, 0.5f * logf(2.0f), 1e-5f);
    assert_float_equal(m.attenuation.y, 0.0f, 0.0f);
    assert_true(m.attenuation.z > 10.0f);
    assert_int_equal(m.thin, 0);
    assert_string_equal(said, "");
    const struct material clear =
        specular_of(&f, DIELECTRIC ",\"roughnessFactor\":0",
                    GLASS "\"KHR_materials_volume\":{\"attenuationColor\":[0.1,0.1,0.1]}", &said);
    assert_float_equal(clear.attenuation.x, 0.0f, 0.0f); /* the distance is infinite */
    assert_int_equal(clear.thin, 1);                     /* the thickness is 0 */
    assert_non_null(
        strstr(make_refused(square_of(&f, "\"pbrMetallicRoughness\":{\"roughnessFactor\":0},\"extensions\":{" GLASS
                                          "\"KHR_materials_volume\":{\"attenuationDistance\":0}}"),
                            ERR_FORMAT),
               "KHR_materials_volume: attenuationDistance is 0; expected more than 0"));
    make_end(&f);
}

static void sheen_has_a_colour_and_its_texture(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    struct material m =
        specular_of(&f, DIELECTRIC,
                    "\"KHR_materials_sheen\":{\"sheenColorFactor\":[0.1,0.2,0.3],\"sheenRoughnessFactor\":0.5}", &said);
    assert_near(m.sheen, 0.1f, 0.2f, 0.3f);
    assert_true(m.sheen_roughness == 0.5f && m.sheen_texture == MATERIAL_NO_TEXTURE);
    assert_string_equal(said, "");
    m = read_material(&f,
                      ROUGH("", "\"index\":0") ",\"extensions\":{\"KHR_materials_sheen\":{\"sheenColorFactor\":[1,1,1],"
                                               "\"sheenColorTexture\":{\"index\":1,\"texCoord\":1},"
                                               "\"sheenRoughnessTexture\":{\"index\":1}}}",
                      &said);
    assert_true(m.sheen_texture != MATERIAL_NO_TEXTURE && m.second == MAP_SHEEN && m.maps == MAP_ROUGHNESS);
    assert_string_equal(said, "");
    m = specular_of(&f, DIELECTRIC ",\"roughnessFactor\":0",
                    "\"KHR_materials_sheen\":{\"sheenColorFactor\":[1,1,1]},"
                    "\"KHR_materials_transmission\":{\"transmissionFactor\":1}",
                    &said);
    assert_true(m.kind == MATERIAL_GLASS && m.sheen.x == 0.0f);
    assert_int_equal(count_of(said, "not supported: sheen on glass"), 1);
    make_end(&f);
}

#define FUZZY(set)                                                                                                     \
    "\"extensions\":{\"KHR_materials_sheen\":{\"sheenColorFactor\":[1,1,1],\"sheenRoughnessFactor\":0.8,"              \
    "\"sheenRoughnessTexture\":{\"index\":0,\"texCoord\":" #set "}}}"

/* The roughness of sheen is the alpha of its texture, here 0, 51, 102 and 255, whatever its colours. */
static void sheen_takes_its_roughness_from_alpha(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", faint_png, sizeof(faint_png));
    struct scene *s = load_or_fail(square_of(&f, ROUGH("", "\"index\":1") "," FUZZY(1)));
    struct material m = s->materials[0];
    const struct texture *t = &s->textures[m.sheen_roughness_texture];
    assert_true(m.maps == (MAP_ROUGHNESS | MAP_SHEEN_ROUGHNESS) && m.second == MAP_SHEEN_ROUGHNESS);
    assert_true(m.sheen_roughness == 0.8f && t->values == TEXTURE_LINEAR);
    for (int k = 0; k < 3; k++) { /* the last is the coarser level, their mean */
        assert_int_equal(t->texels[4 + k], 51);
        assert_int_equal(t->texels[8 + k], 102);
        assert_int_equal(t->texels[16 + k], 102);
    }
    scene_destroy(s);
    /* a third set of coordinates: the mean, of 102 */
    m = read_material(&f, ROUGH("", "\"index\":1") "," GLOWS(1) "," FUZZY(2), &said);
    assert_int_equal(m.maps, MAP_ROUGHNESS);
    assert_float_equal(m.sheen_roughness, 0.8f * 102.0f / 255.0f, 1e-6f);
    assert_int_equal(
        count_of(said, "not supported: a third set of texture coordinates or texture transform in one material"), 1);
    make_end(&f);
}

/* Frosted glass transmits diffusely in its base colour; what lets little light pass becomes a veil. */
static void rough_and_partial_transmission_are_approximated(void **state)
{
    static const char half[] = "\"KHR_materials_transmission\":{\"transmissionFactor\":0.75}",
                      little[] = "\"KHR_materials_transmission\":{\"transmissionFactor\":0.25}";
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    struct material m =
        specular_of(&f, DIELECTRIC ",\"roughnessFactor\":0.5,\"baseColorFactor\":[0.9,0.5,0.1,1]", half, &said);
    assert_true(m.kind == MATERIAL_GGX && m.transmits == 0.75f && m.alpha_mode == ALPHA_OPAQUE);
    assert_near(m.through, 0.9f, 0.5f, 0.1f);
    assert_true(m.through_texture == m.texture && m.texture == MATERIAL_NO_TEXTURE);
    assert_int_equal(count_of(said, "not supported: rough glass"), 1);
    /* the green of the map has a mean of 0.375: smooth enough */
    m = read_material(&f, ROUGH("\"roughnessFactor\":1,", "\"index\":0") ",\"extensions\":{" GLASS_ALONE "}", &said);
    assert_int_equal(m.kind, MATERIAL_GLASS);
    m = specular_of(&f, DIELECTRIC ",\"roughnessFactor\":0.3", half, &said);
    assert_int_equal(m.kind, MATERIAL_GLASS);
    assert_int_equal(count_of(said, "not supported: partial transmission"), 1);
    m = specular_of(&f, DIELECTRIC ",\"roughnessFactor\":0.3", little, &said);
    assert_true(m.kind == MATERIAL_GGX && m.transmits == 0.0f && m.alpha_mode == ALPHA_BLEND && m.alpha == 0.75f);
    assert_int_equal(m.alpha_texture, MATERIAL_NO_TEXTURE);
    assert_int_equal(count_of(said, "not supported: partial transmission"), 1);
    make_end(&f);
}

/* Its colour's texture is that of the base colour here. */
static void leaves_transmit(void **state)
{
    const char *said;
    struct make f;

    (void)state;
    make_begin(&f);
    folder_write(&f.folder, "map.png", four_png, sizeof(four_png));
    const struct material m = specular_of(
        &f, DIELECTRIC,
        "\"KHR_materials_diffuse_transmission\":{\"diffuseTransmissionFactor\":0.25,\"diffuseTransmissionColorFactor\":"
        "[0.1,0.2,0.3]}",
        &said);
    assert_int_equal(m.kind, MATERIAL_GGX);
    assert_float_equal(m.transmits, 0.25f, 1e-6f);
    assert_near(m.through, 0.1f, 0.2f, 0.3f);
    assert_int_equal(m.through_texture, MATERIAL_NO_TEXTURE);
    assert_string_equal(said, "");
    assert_non_null(strstr(make_refused(square_of(&f, "\"extensions\":{\"KHR_materials_diffuse_transmission\":{"
                                                      "\"diffuseTransmissionFactor\":\"all\"}}"),
                                        ERR_FORMAT),
                           "KHR_materials_diffuse_transmission.diffuseTransmissionFactor: is not a number"));
    make_end(&f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(metallic_roughness_textures_become_maps),
    cmocka_unit_test(faults_of_metallic_roughness_textures_are_named),
    cmocka_unit_test(clear_coats_have_factors_and_maps),
    cmocka_unit_test(normal_textures_become_maps),
    cmocka_unit_test(maps_may_be_scaled_and_moved_against_the_base_colour),
    cmocka_unit_test(faults_of_normal_textures_are_named),
    cmocka_unit_test(tangents_are_the_file_s_or_computed),
    cmocka_unit_test(specular_and_ior_make_f0),
    cmocka_unit_test(glass_keeps_its_tint),
    cmocka_unit_test(volumes_attenuate),
    cmocka_unit_test(sheen_has_a_colour_and_its_texture),
    cmocka_unit_test(sheen_takes_its_roughness_from_alpha),
    cmocka_unit_test(rough_and_partial_transmission_are_approximated),
    cmocka_unit_test(leaves_transmit),
};
UNIT_MAIN(tests)
