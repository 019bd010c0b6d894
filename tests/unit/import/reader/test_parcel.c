/* A scene as flat arrays in a file: what was written is read again, and forged sizes, indices and values are refused.
 */
#define _GNU_SOURCE /* memfd_create */
#include "scene/geometry/files.h"

#include "base/rng.h"
#include "import/reader/wire.h"

#include <sys/mman.h>

enum { MATERIALS = 2, CORNERS = 4, TRIANGLES = 2 };

/* Where things are in the file. */
enum {
    HEAD = 0,
    MATERIAL = HEAD + 56,
    PANE = MATERIAL + (int)sizeof(struct material),
    CAMERA = MATERIAL + MATERIALS * (int)sizeof(struct material),
    LIGHT = CAMERA + (int)sizeof(struct camera),
    TEXTURE = LIGHT + (int)sizeof(struct punctual_light),
    TEXTURE_HEAD = 20,
    MESH = TEXTURE + TEXTURE_HEAD + (2 * 2 + 1) * 4,
    MESH_HEAD = 104,
    NAME = MESH + 32,
    PLACE = 48, /* of an instance or a placed mesh */
    POSITIONS = MESH + MESH_HEAD,
    NORMALS = POSITIONS + CORNERS * 12,
    UVS = NORMALS + CORNERS * 12,
    MORE_UVS = UVS + CORNERS * 8,
    TANGENTS = MORE_UVS + CORNERS * 8,
    COLOURS = TANGENTS + CORNERS * 16,
    INDICES = COLOURS + CORNERS * 16,
    END = INDICES + TRIANGLES * 12,
};

static float *floats(size_t count, float first, float step)
{
    float *v = mem_alloc(count + 1, sizeof(*v));

    assert_non_null(v);
    for (size_t i = 0; i < count; i++)
        v[i] = first + step * (float)i;
    return v;
}

static struct scene *make(void)
{
    struct scene *s = scene_create();
    const struct material ground = { .name = "ground",
                                     .kind = MATERIAL_GGX,
                                     .diffuse = { 0.1f, 0.2f, 0.3f },
                                     .coat = 0.5f,
                                     .sheen = { 0.5f, 0.5f, 0.5f },
                                     .maps = MAP_ROUGHNESS | MAP_COAT | MAP_COAT_ROUGHNESS | MAP_SHEEN_ROUGHNESS,
                                     .emission = { 7, 0, 1 } };
    const struct material pane = { .name = "pane",
                                   .kind = MATERIAL_GLASS,
                                   .ior = 1.5f,
                                   .texture = MATERIAL_NO_TEXTURE,
                                   .alpha_mode = ALPHA_MASK,
                                   .alpha = 0.75f,
                                   .alpha_cutoff = 0.5f,
                                   .alpha_texture = 0,
                                   .maps = MAP_NORMAL,
                                   .second = MAP_NORMAL };
    const struct camera c = { .name = "main", .position = { 0, 0, 5 }, .up = { 0, 1, 0 }, .fov_y = 1.0f };
    const struct punctual_light l = { .kind = LIGHT_DIRECTIONAL, .direction = { 0, 0, 1 }, .intensity = { 1, 2, 3 } };
    struct texture t;
    struct mesh m = { .vertex_count = CORNERS, .triangle_count = TRIANGLES, .material = 1, .name = "pane" };
    static const uint32_t order[6] = { 0, 1, 2, 0, 2, 3 };

    assert_non_null(s);
    assert_int_equal(texture_init(&t, 2, 2, TEXTURE_CUTOUT), ERR_OK);
    for (uint8_t i = 0; i < 16; i++)
        t.texels[i] = 16 * i;
    t.wrap_u = TEXTURE_CLAMP;
    t.wrap_v = TEXTURE_MIRROR;
    texture_build_levels(&t);
    m.positions = floats(3 * CORNERS, -1.0f, 0.7f);
    m.normals = floats(3 * CORNERS, -0.5f, 0.05f);
    m.uvs = floats(2 * CORNERS, -3.0f, 11.0f);
    m.more_uvs = floats(2 * CORNERS, 5.0f, -2.0f);
    m.tangents = floats(4 * CORNERS, -0.5f, 0.05f);
    m.colours = floats(4 * CORNERS, 0.0f, 0.05f);
    m.indices = mem_alloc(6, sizeof(uint32_t));
    assert_non_null(m.indices);
    memcpy(m.indices, order, sizeof(order));
    assert_int_equal(scene_add_material(s, &ground, NULL), ERR_OK);
    assert_int_equal(scene_add_material(s, &pane, NULL), ERR_OK);
    assert_int_equal(scene_add_camera(s, &c), ERR_OK);
    assert_int_equal(scene_add_light(s, &l), ERR_OK);
    assert_int_equal(scene_add_texture(s, &t, NULL), ERR_OK);
    assert_int_equal(scene_add_mesh(s, &m), ERR_OK);
    s->unmodelled = 1u << FEATURE_ALPHA;
    s->wants_ground = true;
    return s;
}

/* A file with this scene; the caller closes it. */
static int write_it(void)
{
    struct reason why = { "" };
    struct scene *s = make();
    const int fd = memfd_create("parcel", 0);

    assert_true(fd >= 0);
    if (parcel_write(fd, s, &why))
        fail_msg("%s", why.text);
    scene_destroy(s);
    assert_int_equal(lseek(fd, 0, SEEK_END), END);
    return fd;
}

static void what_was_written_is_read(void **state)
{
    struct reason why = { "" };
    struct scene *s = NULL, *same = make();
    const int fd = write_it();

    (void)state;
    if (parcel_read(fd, "a.glb", &s, &why))
        fail_msg("%s", why.text);
    assert_int_equal(s->material_count, 2);
    assert_memory_equal(s->materials, same->materials, 2 * sizeof(*s->materials));
    assert_memory_equal(s->cameras, same->cameras, sizeof(*s->cameras));
    assert_int_equal(s->light_count, 1);
    assert_memory_equal(s->lights, same->lights, sizeof(*s->lights));
    assert_memory_equal(s->textures[0].texels, same->textures[0].texels, 20);
    assert_int_equal(s->textures[0].values, TEXTURE_CUTOUT);
    assert_int_equal(s->textures[0].wrap_u, TEXTURE_CLAMP);
    assert_int_equal(s->textures[0].wrap_v, TEXTURE_MIRROR);
    assert_memory_equal(s->meshes[0].positions, same->meshes[0].positions, 12 * CORNERS);
    assert_memory_equal(s->meshes[0].normals, same->meshes[0].normals, 12 * CORNERS);
    assert_memory_equal(s->meshes[0].uvs, same->meshes[0].uvs, 8 * CORNERS);
    assert_memory_equal(s->meshes[0].more_uvs, same->meshes[0].more_uvs, 8 * CORNERS);
    assert_memory_equal(s->meshes[0].tangents, same->meshes[0].tangents, 16 * CORNERS);
    assert_memory_equal(s->meshes[0].colours, same->meshes[0].colours, 16 * CORNERS);
    assert_memory_equal(s->meshes[0].indices, same->meshes[0].indices, 12 * TRIANGLES);
    assert_int_equal(s->meshes[0].material, 1);
    assert_string_equal(s->meshes[0].name, "pane");
    assert_int_equal(s->unmodelled, 1u << FEATURE_ALPHA);
    assert_true(s->wants_ground);
    assert_int_equal(s->triangle_count, TRIANGLES);
    scene_destroy(same);
    scene_destroy(s);
    close(fd);
}

static void a_file_cut_at_any_byte_is_refused(void **state)
{
    struct reason why = { "" };
    struct scene *s = NULL;
    const int fd = write_it();

    (void)state;
    for (int size = END - 1; size >= 0; size--) {
        assert_int_equal(ftruncate(fd, size), 0);
        assert_int_equal(parcel_read(fd, "a.glb", &s, &why), ERR_FORMAT);
        assert_null(s);
        assert_non_null(strstr(why.text, "a.glb: the reader sent an invalid scene"));
    }
    assert_int_equal(ftruncate(fd, END + 1), 0); /* with a tail */
    close(fd);
    const int longer = write_it();
    assert_int_equal(ftruncate(longer, END + 1), 0);
    assert_int_equal(parcel_read(longer, "a.glb", &s, &why), ERR_FORMAT);
    close(longer);
}

/* Puts `size` bytes at a place and expects a refusal with these words. */
static void forge(long at, const void *bytes, size_t size, const char *because)
{
    struct reason why = { "" };
    struct scene *s = NULL;
    const int fd = write_it();

    assert_int_equal(pwrite(fd, bytes, size, at), size);
    const enum err e = parcel_read(fd, "a.glb", &s, &why);
    if ((e != ERR_FORMAT && e != ERR_RANGE) || s || !strstr(why.text, because))
        fail_msg("byte %ld: not '%s' but %d: %s", at, because, e, why.text);
    close(fd);
}

static void forge_u32(long at, uint32_t value, const char *because)
{
    forge(at, &value, sizeof(value), because);
}

static void forge_float(long at, float value, const char *because)
{
    forge(at, &value, sizeof(value), because);
}

static void forged_sizes_are_refused(void **state)
{
    static const uint32_t counts[] = { 3, 0x10000, 0x7fffffff, 0xffffffff };

    (void)state;
    forge_u32(HEAD, 1, "its beginning");
    for (size_t k = 0; k < sizeof(counts) / sizeof(counts[0]); k++) {
        for (long at = HEAD + 4; at < HEAD + 24; at += 4)
            forge_u32(at, counts[k], "");
        forge_u32(TEXTURE, counts[k], "");
        forge_u32(TEXTURE + 4, counts[k], "");
        forge_u32(MESH, counts[k] + 2, "");
        forge_u32(MESH + 4, counts[k], "");
    }
    forge_u32(HEAD + 8, 0, "its beginning"); /* no camera */
    forge_u32(HEAD + 24, 1u << FEATURE_COUNT, "its beginning");
    forge_u32(HEAD + 28, 2, "its beginning");
    forge_u32(TEXTURE, 0, "the size of a texture");
    forge_u32(TEXTURE, 16385, "the size of a texture");
    forge_u32(TEXTURE, 16384, "too short");
    for (long at = TEXTURE + 8; at < TEXTURE + TEXTURE_HEAD; at += 4) {
        forge_u32(at, 3, "the kind of a texture");
        forge_u32(at, 0xffffffff, "the kind of a texture");
    }
    forge_u32(MESH, UINT32_MAX / 3 + 1, "the size of a mesh");
    forge_u32(MESH, UINT32_MAX / 3, "too short"); /* not out of memory: nothing is allocated for it */
    forge_u32(MESH + 4, 0, "the size of a mesh");
    forge_u32(MESH + 12, 2, "the size of a mesh");
    forge_u32(MESH + 16, 0xffffffff, "the size of a mesh");
    forge_u32(MESH + 20, 2, "the size of a mesh");
    forge_u32(MESH + 24, 2, "the size of a mesh");
    forge_u32(MESH + 28, 2, "the size of a mesh");
    forge_u32(NAME + 64, 1, "an instance names a mesh that is not there");
    forge_u32(NAME + 68, 2, "");
}

static void forged_indices_are_refused(void **state)
{
    (void)state;
    forge_u32(MESH + 8, MATERIALS, "a material that is not there");
    forge_u32(MESH + 8, 0xffffffff, "a material that is not there");
    for (long at = INDICES; at < END; at += 4) {
        forge_u32(at, CORNERS, "a vertex that is not there");
        forge_u32(at, 0xffffffff, "a vertex that is not there");
    }
    forge_u32(MATERIAL + (long)offsetof(struct material, texture), 1, "a texture that is not there");
    forge_u32(MATERIAL + (long)offsetof(struct material, emission_texture), 1, "an emissive texture that is not there");
    forge_u32(MATERIAL + (long)offsetof(struct material, roughness_texture), 1, "a map that is not there");
    forge_u32(MATERIAL + (long)offsetof(struct material, maps), MAPS_ALL + 1, "maps that it cannot have");
    forge_u32(PANE + (long)offsetof(struct material, maps), MAP_ROUGHNESS, "maps that it cannot have");
    forge_float(PANE + (long)offsetof(struct material, coat), 0.5f, "a material is out of range"); /* glass */
    forge_float(MATERIAL + (long)offsetof(struct material, coat), 1.5f, "a material is out of range");
    forge_float(MATERIAL + (long)offsetof(struct material, coat_roughness), NAN, "a material is out of range");
    forge_float(MATERIAL + (long)offsetof(struct material, sheen), 1.5f, "a material is out of range");
    forge_float(PANE + (long)offsetof(struct material, sheen), 0.5f, "a material is out of range"); /* glass */
    forge_float(MATERIAL + (long)offsetof(struct material, sheen_roughness), -1.0f, "a material is out of range");
    forge_u32(MATERIAL + (long)offsetof(struct material, sheen_texture), 1, "a texture that is not there");
    forge_u32(MATERIAL + (long)offsetof(struct material, sheen_roughness_texture), 1, "a texture that is not there");
    forge_u32(MATERIAL + (long)offsetof(struct material, coat_bent), 2, "a material is out of range");
    forge_u32(MATERIAL + (long)offsetof(struct material, coat_texture), 1, "a map that is not there");
    forge_u32(MATERIAL + (long)offsetof(struct material, coat_roughness_texture), 1, "a map that is not there");
    forge_float(PANE + (long)offsetof(struct material, transmits), 0.5f, "a material is out of range"); /* glass */
    forge_float(MATERIAL + (long)offsetof(struct material, transmits), 1.5f, "a material is out of range");
    forge_u32(PANE + (long)offsetof(struct material, thin), 2, "a material is out of range");
    forge_u32(MATERIAL + (long)offsetof(struct material, thin), 1, "a material is out of range"); /* not glass */
    forge_u32(PANE + (long)offsetof(struct material, second), MAP_ROUGHNESS, "the place of a map");
    forge_u32(PANE + (long)offsetof(struct material, second), 1u << 31, "the place of a map");
    forge_u32(PANE + (long)offsetof(struct material, moved), MAP_ROUGHNESS, "the place of a map");
    forge_float(PANE + (long)offsetof(struct material, moved_by), NAN, "the place of a map");
    forge_u32(PANE + (long)offsetof(struct material, normal_texture), 1, "a map that is not there");
    forge_u32(LIGHT + (long)offsetof(struct punctual_light, kind), LIGHT_DIRECTIONAL + 1, "the kind of a light");
    forge_u32(MATERIAL + (long)offsetof(struct material, kind), MATERIAL_GLASS + 1, "a material is out of range");
    forge_u32(MATERIAL + (long)offsetof(struct material, kind), 0xffffffff, "a material is out of range");
}

static void forged_values_are_refused(void **state)
{
    const float wrong[] = { NAN, INFINITY, -INFINITY, 1e30f, -1e30f };
    char name[sizeof(((struct camera *)0)->name)];

    (void)state;
    memset(name, 'x', sizeof(name));
    forge(MATERIAL, name, sizeof(name), "the name of a material has no end");
    forge(CAMERA, name, sizeof(name), "the name of a camera has no end");
    forge(NAME, name, sizeof(name), "the name of a mesh has no end");
    for (size_t k = 0; k < sizeof(wrong) / sizeof(wrong[0]); k++) {
        forge_float(MATERIAL + (long)offsetof(struct material, diffuse), wrong[k], "a material is out of range");
        forge_float(MATERIAL + (long)offsetof(struct material, specular), wrong[k], "a material is out of range");
        forge_float(MATERIAL + (long)offsetof(struct material, roughness), wrong[k], "a material is out of range");
        forge_float(MATERIAL + (long)offsetof(struct material, metallic), wrong[k], "a material is out of range");
        forge_float(MATERIAL + (long)offsetof(struct material, exponent), wrong[k], "a material is out of range");
        forge_float(MATERIAL + (long)(sizeof(struct material) + offsetof(struct material, ior)), wrong[k],
                    "a material is out of range");
        forge_float(MATERIAL + (long)offsetof(struct material, through), wrong[k], "a material is out of range");
        forge_float(PANE + (long)offsetof(struct material, attenuation), wrong[k], "a material is out of range");
        forge_float(PANE + (long)offsetof(struct material, alpha), wrong[k], "the alpha of a material");
        forge_float(MATERIAL + (long)offsetof(struct material, emission), wrong[k], "an emission is out of range");
        forge_float(LIGHT + (long)offsetof(struct punctual_light, intensity), wrong[k], "its intensity is not within");
        forge_float(LIGHT + (long)offsetof(struct punctual_light, direction), wrong[k], "it has no direction");
        forge_float(CAMERA + (long)offsetof(struct camera, fov_y), wrong[k], "a.glb: ");
        forge_float(POSITIONS + 44, wrong[k], "a position is out of range");
        forge_float(NORMALS + 4, wrong[k], "a normal is out of range");
        forge_float(TANGENTS + 12, wrong[k], "a tangent is out of range");
        forge_float(MATERIAL + (long)offsetof(struct material, normal_scale), wrong[k], "the scale of a normal map");
        forge_float(COLOURS + 8, wrong[k], "a colour is out of range");
    }
    forge_float(PANE + (long)offsetof(struct material, alpha_cutoff), NAN, "the alpha of a material");
    forge_float(PANE + (long)offsetof(struct material, alpha_cutoff), -0.1f, "the alpha of a material");
    forge_u32(PANE + (long)offsetof(struct material, alpha_mode), ALPHA_BLEND + 1, "the alpha of a material");
    forge_u32(PANE + (long)offsetof(struct material, alpha_texture), 1, "a texture that is not there");
    forge_float(CAMERA + (long)offsetof(struct camera, position), NAN, "a.glb: ");
}

/* Two meshes with places of their own, and four instances of theirs in turn. */
static int write_instances(void)
{
    struct reason why = { "" };
    struct scene *s = make();
    struct scene *other = make();
    struct mesh second = other->meshes[0];
    const float first[3][4] = { { 1, 0, 0, 7 }, { 0, 2, 0, 0 }, { 0, 0, 1, 0 } };
    const int fd = memfd_create("parcel", 0);

    assert_true(fd >= 0);
    assert_int_equal(mesh_place(&s->meshes[0], first), ERR_OK);
    assert_int_equal(mesh_place(&second, first), ERR_OK);
    assert_int_equal(scene_add_mesh(s, &second), ERR_OK);
    other->mesh_count = 0;
    scene_destroy(other);
    for (uint32_t i = 0; i < 4; i++) {
        const float matrix[3][4] = { { 1, 0, 0, (float)i }, { 0, -1, 0, 0 }, { 0, 0, 1, 0 } };
        assert_int_equal(scene_add_instance(s, i % 2, i == 3 ? "fir" : "", matrix), ERR_OK);
    }
    if (parcel_write(fd, s, &why))
        fail_msg("%s", why.text);
    scene_destroy(s);
    return fd;
}

static void instances_share_what_was_sent_once(void **state)
{
    struct reason why = { "" };
    struct scene *s = NULL;
    const int fd = write_instances();

    (void)state;
    assert_int_equal(lseek(fd, 0, SEEK_END), END + (END - MESH) + 4 * MESH_HEAD + 6 * PLACE);
    if (parcel_read(fd, "a.glb", &s, &why))
        fail_msg("%s", why.text);
    assert_int_equal(s->mesh_count, 6);
    assert_int_equal(s->triangle_count, 6 * TRIANGLES);
    for (uint32_t i = 0; i < 4; i++) {
        const struct mesh *m = &s->meshes[2 + i];
        assert_int_equal(m->source, 1 + i % 2);
        assert_ptr_equal(m->positions, s->meshes[i % 2].positions);
        assert_true(m->placed && m->place.matrix[0][3] == (float)i && m->place.side == -1.0f && m->material == 1);
    }
    assert_string_equal(s->meshes[5].name, "fir");
    assert_string_equal(s->meshes[4].name, "");
    assert_true(s->meshes[0].place.matrix[0][3] == 7.0f && s->meshes[0].place.matrix[1][1] == 2.0f);
    scene_destroy(s);
    close(fd);
}

static void forged_instances_are_refused(void **state)
{
    const long first = END + PLACE + (END - MESH) + PLACE; /* the head of the first instance */
    static const struct {
        long at;
        uint32_t value;
        const char *because;
    } cases[] = {
        { 96, 3, "an instance names a mesh that is not there" }, /* itself */
        { 96, UINT32_MAX, "an instance names a mesh that is not there" },
        { 96 + 2 * (MESH_HEAD + PLACE), 3, "an instance names a mesh that is not there" }, /* an instance */
        { 100, 0, "" },
        { MESH_HEAD, 0, "the place of a mesh is out of range" },
        { MESH_HEAD, 0x7f800000, "the place of a mesh is out of range" },
        { MESH_HEAD + 12, 0x7fc00000, "the place of a mesh is out of range" },
        { MESH + MESH_HEAD - (END + PLACE + (END - MESH) + PLACE), 0, "the place of a mesh is out of range" },
    };

    (void)state;
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        struct reason why = { "" };
        struct scene *s = NULL;
        const int fd = write_instances();
        assert_int_equal(pwrite(fd, &cases[k].value, 4, first + cases[k].at), 4);
        if (parcel_read(fd, "a.glb", &s, &why) != ERR_FORMAT || s || !strstr(why.text, cases[k].because))
            fail_msg("case %zu: not '%s' but %s", k, cases[k].because, why.text);
        close(fd);
    }
}

/* Whatever bytes are changed, a scene that is taken has its indices within its arrays. */
static void random_bytes_never_get_through_unchecked(void **state)
{
    uint8_t whole[END];
    struct scene *s = NULL;
    const int fd = write_it();

    (void)state;
    assert_int_equal(pread(fd, whole, END, 0), END);
    for (uint64_t k = 0; k < 20000; k++) {
        uint8_t bytes[END];
        struct reason why = { "" };
        memcpy(bytes, whole, END);
        for (uint64_t n = 0; n < 1 + k % 4; n++) {
            const uint64_t draw = rng_mix(k, n);
            bytes[draw % END] = (uint8_t)(draw >> 32);
        }
        assert_int_equal(pwrite(fd, bytes, END, 0), END);
        if (parcel_read(fd, "a.glb", &s, &why)) {
            assert_null(s);
            assert_true(why.text[0] != '\0');
            continue;
        }
        for (size_t m = 0; m < s->mesh_count; m++) {
            assert_true(s->meshes[m].material < s->material_count);
            for (size_t i = 0; i < 3 * (size_t)s->meshes[m].triangle_count; i++)
                assert_true(s->meshes[m].indices[i] < s->meshes[m].vertex_count);
        }
        scene_destroy(s);
    }
    close(fd);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(what_was_written_is_read),           cmocka_unit_test(a_file_cut_at_any_byte_is_refused),
    cmocka_unit_test(forged_sizes_are_refused),           cmocka_unit_test(forged_indices_are_refused),
    cmocka_unit_test(forged_values_are_refused),          cmocka_unit_test(random_bytes_never_get_through_unchecked),
    cmocka_unit_test(instances_share_what_was_sent_once), cmocka_unit_test(forged_instances_are_refused),
};

UNIT_MAIN(tests)
