/* Models without a JSON scene, and OBJ with its MTL. */
#include "scene/geometry/files.h"
#include "scene/geometry/load.h"

#include "pngs.h"

#include <math.h>
#include <sys/stat.h>

#define TRIANGLE "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"
#define FACE "f 1/1 2/2 3/3\n"
#define RED "newmtl m\nKd 1 0 0\n"

/* The material that an OBJ triangle gets from this text of its MTL file, `newmtl m` being given. */
static struct material material_of(const char *mtl)
{
    char text[1024];
    struct folder f;

    folder_make(&f);
    snprintf(text, sizeof(text), "newmtl m\n%s", mtl);
    folder_text(&f, "m.mtl", text);
    struct scene *s = load_or_fail(folder_text(&f, "m.obj", "mtllib m.mtl\n" TRIANGLE "usemtl m\n" FACE));
    const struct material m = s->materials[s->meshes[0].material];
    assert_string_equal(m.name, "m");
    scene_destroy(s);
    folder_remove(&f);
    return m;
}

static void assert_colour(struct vec3 c, float r, float g, float b)
{
    assert_float_equal(c.x, r, 1e-6f);
    assert_float_equal(c.y, g, 1e-6f);
    assert_float_equal(c.z, b, 1e-6f);
}

static void kd_alone_is_lambert(void **state)
{
    (void)state;
    const struct material m = material_of("Kd 0.1 0.2 0.3\nNs 200\nillum 2\n");
    assert_int_equal(m.kind, MATERIAL_LAMBERT);
    assert_colour(m.diffuse, 0.1f, 0.2f, 0.3f);
}

/* alpha^2 = 2 / (Ns + 2): Ns 510 has alpha 1/16, a roughness of 1/4. */
static void ks_and_ns_are_a_highlight(void **state)
{
    (void)state;
    const struct material m = material_of("Kd 0.1 0.2 0.3\nKs 0.5 0.5 0.5\nNs 510\nillum 2\n");
    assert_int_equal(m.kind, MATERIAL_GGX);
    assert_colour(m.diffuse, 0.1f, 0.2f, 0.3f);
    assert_float_equal(m.metallic, 0.0f, 0.0f);
    assert_float_equal(m.roughness, 0.25f, 1e-6f);
}

static void black_kd_with_ks_is_metal(void **state)
{
    (void)state;
    const struct material metal = material_of("Kd 0 0 0\nKs 0.9 0.7 0.3\nNs 510\n");
    assert_int_equal(metal.kind, MATERIAL_GGX);
    assert_float_equal(metal.metallic, 1.0f, 0.0f);
    assert_colour(metal.diffuse, 0.9f, 0.7f, 0.3f);
    const struct material mirror = material_of("Kd 0 0 0\nKs 0.9 0.9 0.9\nillum 5\n");
    assert_int_equal(mirror.kind, MATERIAL_MIRROR);
    assert_colour(mirror.diffuse, 0.9f, 0.9f, 0.9f);
}

static void pr_and_pm_come_before_ns(void **state)
{
    (void)state;
    const struct material m = material_of("Kd 0.8 0.8 0.8\nKs 0.5 0.5 0.5\nNs 510\nPr 0.6\nPm 0.4\n");
    assert_int_equal(m.kind, MATERIAL_GGX);
    assert_float_equal(m.roughness, 0.6f, 1e-6f);
    assert_float_equal(m.metallic, 0.4f, 1e-6f);
}

static void transparent_and_refracting_is_glass(void **state)
{
    (void)state;
    const struct material by_index = material_of("Kd 0.2 0.2 0.2\nd 0.1\nNi 1.45\n");
    assert_int_equal(by_index.kind, MATERIAL_GLASS);
    assert_float_equal(by_index.ior, 1.45f, 1e-6f);
    const struct material by_illum = material_of("Kd 0.2 0.2 0.2\nTr 0.9\nillum 7\n");
    assert_int_equal(by_illum.kind, MATERIAL_GLASS);
    assert_float_equal(by_illum.ior, 1.5f, 0.0f);
    assert_int_equal(material_of("Kd 0.2 0.2 0.2\nd 0.9\nNi 1.45\n").kind, MATERIAL_LAMBERT);
}

/* d and Tr are the share of the surface that is there. What is wholly absent is a mistake of the exporter. */
static void d_and_tr_are_coverage(void **state)
{
    (void)state;
    struct material m = material_of("Kd 0.8 0.8 0.8\nd 0.25\n");
    assert_int_equal(m.alpha_mode, ALPHA_BLEND);
    assert_float_equal(m.alpha, 0.25f, 1e-6f);
    assert_int_equal(m.alpha_texture, MATERIAL_NO_TEXTURE);
    m = material_of("Kd 0.8 0.8 0.8\nTr 0.25\n");
    assert_float_equal(m.alpha, 0.75f, 1e-6f);
    assert_int_equal(material_of("Kd 0.8 0.8 0.8\nd 1\n").alpha_mode, ALPHA_OPAQUE);
    log_begin();
    m = material_of("Kd 0.8 0.8 0.8\nd 0\n");
    assert_non_null(strstr(log_end(), "material 'm' has d 0 (Tr 1): it is shown opaque"));
    assert_int_equal(m.alpha_mode, ALPHA_OPAQUE);
    assert_int_equal(material_of("Kd 0.2 0.2 0.2\nd 0.1\nNi 1.45\n").alpha_mode, ALPHA_OPAQUE); /* glass */
}

/* map_d by its alpha, or by its red if it has none; norm with tangents; map_Bump with a warning. */
static void maps_of_mtl_files_are_read(void **state)
{
    static const char mapped[] = "mtllib m.mtl\n" TRIANGLE "usemtl m\n" FACE;
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_write(&f, "four.png", four_png, sizeof(four_png));
    folder_text(&f, "m.mtl", "newmtl m\nKd 0.5 0.5 0.5\nmap_d four.png\nnorm four.png\nmap_Bump four.png\n");
    log_begin();
    struct scene *s = load_or_fail(folder_text(&f, "m.obj", mapped));
    const char *said = log_end();
    const struct material *m = &s->materials[s->meshes[0].material];
    assert_int_equal(count_of(said, "not supported"), 1);
    assert_int_equal(s->unmodelled, 1u << FEATURE_BUMP_MAP);
    assert_int_equal(m->alpha_mode, ALPHA_BLEND);
    const uint8_t *mask = s->textures[m->alpha_texture].texels; /* red, green / blue, grey 128 */
    assert_true(mask[3] == 255 && mask[7] == 0 && mask[11] == 0 && mask[15] == 128);
    assert_int_equal(m->maps, MAP_NORMAL);
    assert_int_equal(s->textures[m->normal_texture].values, TEXTURE_LINEAR);
    assert_true(m->normal_scale == 1.0f && s->meshes[0].tangents && s->meshes[0].tangents[0] == 1.0f);
    scene_destroy(s);
    folder_text(&f, "m.mtl", "newmtl m\nKd 0.5 0.5 0.5\nmap_d gone.png\nnorm gone.png\n");
    log_begin();
    s = load_or_fail(folder_text(&f, "m.obj", mapped));
    said = log_end();
    assert_non_null(strstr(said, "gone.png: No such file or directory; the surface has no holes"));
    assert_non_null(strstr(said, "gone.png: No such file or directory; the surface is smooth"));
    assert_int_equal(s->materials[s->meshes[0].material].alpha_mode, ALPHA_OPAQUE);
    scene_destroy(s);
    folder_remove(&f);
}

/* A path of another machine means the file of that name beside the model. Kd 0 beside map_Kd is what exporters write
 * who mean the texture alone. */
static void a_texture_is_found_beside_the_model(void **state)
{
    /* 1 x 1 texel, sRGB 188, 128, 64 */
    static const uint8_t png[] = {
        0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48, 0x44, 0x52, 0x00, 0x00,
        0x00, 0x01, 0x00, 0x00, 0x00, 0x01, 0x08, 0x02, 0x00, 0x00, 0x00, 0x90, 0x77, 0x53, 0xde, 0x00, 0x00, 0x00,
        0x0c, 0x49, 0x44, 0x41, 0x54, 0x78, 0x9c, 0x63, 0xd8, 0xd3, 0xe0, 0x00, 0x00, 0x03, 0x78, 0x01, 0x7d, 0xda,
        0x32, 0x53, 0xea, 0x00, 0x00, 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82,
    };
    static const char *const names[] = { "t.png", "C:\\maps\\t.png", "/maps/t.png", "./t.png" };
    char mtl[256];
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_write(&f, "t.png", png, sizeof(png));
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        snprintf(mtl, sizeof(mtl), "newmtl m\nKd 0 0 0\nmap_Kd %s\nnewmtl n\nKd 0.5 0.5 0.5\nmap_Kd %s\n", names[i],
                 names[i]);
        folder_text(&f, "m.mtl", mtl);
        struct scene *s =
            load_or_fail(folder_text(&f, "m.obj", "mtllib m.mtl\n" TRIANGLE "usemtl m\n" FACE "usemtl n\n" FACE));
        assert_int_equal(s->texture_count, 1);
        const struct material *m = &s->materials[scene_find_material(s, "m", 0)];
        const struct material *n = &s->materials[scene_find_material(s, "n", 0)];
        assert_int_equal(m->texture, 0);
        assert_int_equal(n->texture, 0);
        assert_colour(m->diffuse, 1.0f, 1.0f, 1.0f);
        assert_colour(n->diffuse, 0.5f, 0.5f, 0.5f);
        assert_non_null(s->meshes[0].uvs);
        const struct vec3 c = texture_lookup(&s->textures[0], 0.5f, 0.5f);
        assert_float_equal(c.x, 0.502886f, 1e-3f);
        assert_float_equal(c.y, 0.215861f, 1e-3f);
        assert_float_equal(c.z, 0.051269f, 1e-3f);
        scene_destroy(s);
    }
    folder_remove(&f);
}

static void what_is_missing_is_grey_with_a_warning(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "m.mtl", "newmtl m\nKd 1 0 0\nmap_Kd nowhere.png\n");
    log_begin();
    struct scene *s = load_or_fail(folder_text(&f, "m.obj", "mtllib m.mtl\n" TRIANGLE "usemtl m\n" FACE));
    const char *said = log_end();
    assert_non_null(strstr(said, "nowhere.png"));
    assert_non_null(strstr(said, "'m' is grey"));
    assert_colour(s->materials[s->meshes[0].material].diffuse, 0.5f, 0.5f, 0.5f);
    assert_int_equal(s->materials[s->meshes[0].material].texture, MATERIAL_NO_TEXTURE);
    scene_destroy(s);

    log_begin();
    s = load_or_fail(folder_text(&f, "n.obj", "mtllib nowhere.mtl\n" TRIANGLE "usemtl wood\n" FACE));
    said = log_end();
    assert_non_null(strstr(said, "material 'wood' is grey"));
    assert_non_null(strstr(said, "nowhere.mtl"));
    scene_destroy(s);
    folder_remove(&f);
}

static void names_of_the_scene_file_come_first(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_text(&f, "m.mtl", "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n");
    folder_text(&f, "m.obj", "mtllib m.mtl\n" TRIANGLE "usemtl a\n" FACE "usemtl b\n" FACE);
    struct scene *s = load_or_fail(folder_text(&f, "s.json",
                                               "{\"models\":[{\"file\":\"m.obj\"},{\"file\":\"m.obj\"}],\"materials\":"
                                               "{\"b\":{\"type\":\"lambert\",\"albedo\":[0,0,1]}}}"));
    assert_int_equal(s->mesh_count, 4);
    for (size_t i = 0; i < 4; i++) {
        const struct material *m = &s->materials[s->meshes[i].material];
        if (strcmp(m->name, "a") == 0)
            assert_colour(m->diffuse, 1.0f, 0.0f, 0.0f);
        else
            assert_colour(m->diffuse, 0.0f, 0.0f, 1.0f);
    }
    assert_int_equal(s->camera_count, 1); /* the scene file has none: the models are framed */
    assert_string_equal(s->cameras[0].name, "framed");
    scene_destroy(s);
    folder_remove(&f);
}

static const char stl[] = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0\nendloop\n"
                          "endfacet\nendsolid s\n";
static const char ply[] = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float "
                          "z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n"
                          "3 0 1 2\n";

static struct scene *scene_with_tga(struct folder *f, const uint8_t *bytes, size_t size)
{
    folder_write(f, "t.tga", bytes, size);
    folder_text(f, "m.mtl", "newmtl m\nmap_Kd t.tga\n");
    return load_or_fail(folder_text(f, "m.obj", "mtllib m.mtl\n" TRIANGLE "usemtl m\n" FACE));
}

/* Each is 2 x 2: red, green / blue, white. */
static void tga_textures_are_read(void **state)
{
    static const uint8_t plain[] = { 1,   0, 2, 0,   0,   0,   0,   0, 0,   0, 0,   0,
                                     2,   0, 2, 0,   24,  0,   'x', /* from the bottom */
                                     255, 0, 0, 255, 255, 255, 0,   0, 255, 0, 255, 0 };
    static const uint8_t packed[] = { 0,   0, 10, 0,   0,    0,   0,   0,   0,
                                      0,   0, 0,  2,   0,    2,   0,   32,  0x28, /* from the top */
                                      2,   0, 0,  255, 255,  0,   255, 0,   255,
                                      255, 0, 0,  255, 0x80, 255, 255, 255, 255 };
    static const uint8_t mapped[] = { 0, 1,    1,    5, 0,    4,    0,    16,   0, 0, 0, 0,
                                      2, 0,    2,    0, 8,    0x30, /* from the top right */
                                      0, 0x7c, 0xe0, 3, 0x1f, 0,    0xff, 0x7f, 6, 5, 8, 7 };
    static const uint8_t want[] = { 255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255, 255, 255, 255 };
    static const struct {
        const uint8_t *bytes;
        size_t size;
    } files[] = { { plain, sizeof(plain) }, { packed, sizeof(packed) }, { mapped, sizeof(mapped) } };
    struct folder f;

    (void)state;
    folder_make(&f);
    for (size_t i = 0; i < 3; i++) {
        struct scene *s = scene_with_tga(&f, files[i].bytes, files[i].size);
        assert_int_equal(s->texture_count, 1);
        assert_memory_equal(s->textures[0].texels, want, sizeof(want));
        scene_destroy(s);
        for (size_t size = 0; size < files[i].size; size++) { /* truncated */
            log_begin();
            s = scene_with_tga(&f, files[i].bytes, size);
            assert_non_null(strstr(log_end(), size < 18 ? "neither PNG nor JPEG nor WebP nor TGA" : "TGA: the file"));
            assert_int_equal(s->texture_count, 0);
            scene_destroy(s);
        }
    }
    folder_remove(&f);
}

/* A run that covers rows; and an index outside the map. */
static void tga_textures_may_be_grey(void **state)
{
    static const uint8_t run[] = { 0, 0, 11, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, 8, 0x20, 0x83, 7 };
    static const uint8_t outside[] = { 0, 1, 1, 0, 0, 1, 0, 24, 0, 0, 0, 0, 1, 0, 1, 0, 8, 0, 1, 2, 3, 1 };
    struct folder f;

    (void)state;
    folder_make(&f);
    struct scene *s = scene_with_tga(&f, run, sizeof(run));
    for (size_t i = 0; i < 16; i++)
        assert_int_equal(s->textures[0].texels[i], i % 4 == 3 ? 255 : 7);
    scene_destroy(s);
    log_begin();
    s = scene_with_tga(&f, outside, sizeof(outside));
    assert_non_null(strstr(log_end(), "outside its colour map; 'm' is grey"));
    scene_destroy(s);
    folder_remove(&f);
}

/* sRGB in the file; 128 / 255 is 0.2158605. */
static void vertices_of_obj_and_ply_files_have_colours(void **state)
{
    static const char *const texts[] = {
        "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0.5019608 0.5019608 0.5019608\nf 1 2 3\n",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty uchar "
        "red\nproperty uchar green\nproperty uchar blue\nelement face 1\nproperty list uchar int "
        "vertex_indices\nend_header\n0 0 0 255 0 0\n1 0 0 0 255 0\n1 1 0 128 128 128\n3 0 1 2\n",
    };
    static const char *const names[] = { "a.obj", "a.ply" };
    static const float colours[12] = { 1, 0, 0, 1, 0, 1, 0, 1, 0.2158605f, 0.2158605f, 0.2158605f, 1 };
    struct folder f;

    (void)state;
    folder_make(&f);
    for (size_t i = 0; i < 2; i++) {
        log_begin();
        struct scene *s = load_or_fail(folder_text(&f, names[i], texts[i]));
        assert_string_equal(log_end(), "");
        assert_non_null(s->meshes[0].colours);
        for (size_t k = 0; k < 12; k++)
            assert_float_equal(s->meshes[0].colours[k], colours[k], 1e-5f);
        assert_colour(s->materials[s->meshes[0].material].diffuse, 1.0f, 1.0f, 1.0f);
        scene_destroy(s);
    }
    folder_remove(&f);
}

/* A texture comes before them, and so does a material of the scene file. */
static void colours_of_vertices_come_last(void **state)
{
    static const char text[] = "mtllib m.mtl\nv 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nvt 0 0\nvt 1 0\nvt 1 "
                               "1\nusemtl m\n" FACE;
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_write(&f, "t.png", four_png, sizeof(four_png));
    folder_text(&f, "m.mtl", "newmtl m\nKd 0.5 0.5 0.5\n");
    struct scene *s = load_or_fail(folder_text(&f, "m.obj", text));
    assert_non_null(s->meshes[0].colours); /* they multiply Kd */
    assert_colour(s->materials[s->meshes[0].material].diffuse, 0.5f, 0.5f, 0.5f);
    scene_destroy(s);
    s = load_or_fail(folder_text(&f, "s.json",
                                 "{\"models\":[{\"file\":\"m.obj\"}],\"materials\":{\"m\":{\"type\":"
                                 "\"lambert\",\"albedo\":[0,0,1]}}}"));
    assert_null(s->meshes[0].colours);
    scene_destroy(s);
    folder_text(&f, "m.mtl", "newmtl m\nKd 0.5 0.5 0.5\nmap_Kd t.png\n");
    log_begin();
    s = load_or_fail(folder_text(&f, "m.obj", text));
    assert_non_null(strstr(log_end(), "not supported: vertex colours"));
    assert_null(s->meshes[0].colours);
    scene_destroy(s);
    folder_remove(&f);
}

static void a_model_alone_is_a_framed_scene(void **state)
{
    static const struct {
        const char *name, *text;
    } models[] = { { "a.obj", TRIANGLE FACE }, { "a.stl", stl }, { "a.ply", ply } };
    struct folder f;

    (void)state;
    folder_make(&f);
    for (size_t i = 0; i < sizeof(models) / sizeof(models[0]); i++) {
        struct scene *s = load_or_fail(folder_text(&f, models[i].name, models[i].text));
        assert_int_equal(s->triangle_count, 1);
        assert_int_equal(s->camera_count, 1);
        assert_string_equal(s->cameras[0].name, "framed");
        scene_destroy(s);
    }
    folder_remove(&f);
}

static void other_formats_are_refused_with_what_to_do(void **state)
{
    static const char *const names[] = { "a.usdz", "a.blend", "a.xyz" };
    static const char *const words[] = { "convert it to .glb", "export it as glTF", "expected a .json scene" };
    struct folder f;

    (void)state;
    folder_make(&f);
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        struct reason why = { "" };
        struct scene *s;
        assert_int_equal(load_here(folder_text(&f, names[i], "x"), &s, &why), ERR_UNSUPPORTED);
        assert_non_null(strstr(why.text, names[i]));
        assert_non_null(strstr(why.text, words[i]));
    }
    folder_remove(&f);
}

/* ---- What exporters write ---- */

static void an_mtl_is_read_however_it_is_written(void **state)
{
    (void)state;

    assert_colour(material_of("Kd 0.5\n").diffuse, 0.5f, 0.5f, 0.5f);
    assert_colour(material_of("Kd .5 +.25 1\n").diffuse, 0.5f, 0.25f, 1.0f);
    assert_colour(material_of("  Kd 0.5 0.25 1 # brown\r\n").diffuse, 0.5f, 0.25f, 1.0f);
    assert_float_equal(material_of("\tKd 0.8 0.8 0.8\n\td .25\n").alpha, 0.25f, 1e-6f);
}

/* Names of images as hurried exporters and other systems write them. */
static void images_are_found_by_names_that_other_systems_write(void **state)
{
    static const char *const names[] = {
        "red.png",
        "red.png   ",
        "\"red.png\"",
        "RED.PNG",
        "red.png # a comment",
        "-s 2 2 2 red.png",
        "red.png -s 1 1 1",
        "red.png -clamp on",
        ".\\red.png",
        "C:\\tex\\red.png",
        "sub\\blue one.png",
        "Sub/Blue One.PNG",
        "'sub/blue one.png'",
        "sub/blue one.png -bm 1",
    };
    char mtl[300], sub[80];
    struct folder f;
    (void)state;

    folder_make(&f);
    folder_write(&f, "red.png", four_png, sizeof(four_png));
    snprintf(sub, sizeof(sub), "%s/sub", f.path);
    assert_int_equal(mkdir(sub, 0700), 0);
    folder_write(&f, "sub/blue one.png", four_png, sizeof(four_png));
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        snprintf(mtl, sizeof(mtl), "newmtl m\nmap_Kd %s\n", names[i]);
        folder_text(&f, "m.mtl", mtl);
        log_begin();
        struct scene *s = load_or_fail(folder_text(&f, "m.obj", "mtllib m.mtl\n" TRIANGLE "usemtl m\n" FACE));
        const char *said = log_end();
        if (s->texture_count != 1 || said[0])
            fail_msg("'%s': %zu textures; %s", names[i], s->texture_count, said);
        scene_destroy(s);
    }
    snprintf(mtl, sizeof(mtl), "%s/blue one.png", sub);
    unlink(mtl);
    rmdir(sub);
    folder_remove(&f);
}

static void libraries_are_found_however_they_are_written(void **state)
{
    static const char *const names[] = { "m.mtl",        "gone.mtl m.mtl",  "m.mtl gone.mtl",
                                         "\"my m.mtl\"", "my m.mtl # mine", "my m.mtl\tgone.mtl" };
    char obj[300];
    struct folder f;
    (void)state;

    folder_make(&f);
    folder_text(&f, "m.mtl", RED);
    folder_text(&f, "my m.mtl", RED);
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        snprintf(obj, sizeof(obj), "mtllib %s\n" TRIANGLE "usemtl m\n" FACE, names[i]);
        log_begin();
        struct scene *s = load_or_fail(folder_text(&f, "o.obj", obj));
        const char *said = log_end();
        if (said[0])
            fail_msg("'%s': %s", names[i], said);
        assert_colour(s->materials[s->meshes[0].material].diffuse, 1.0f, 0.0f, 0.0f);
        scene_destroy(s);
    }
    folder_remove(&f);
}

static void a_material_that_no_mtl_defines_is_named(void **state)
{
    struct folder f;
    (void)state;

    folder_make(&f);
    folder_text(&f, "m.mtl", RED);
    log_begin();
    scene_destroy(load_or_fail(
        folder_text(&f, "m.obj", "mtllib m.mtl\n" TRIANGLE "usemtl m\n" FACE "usemtl gone\nf 1/1 3/3 2/2\n")));
    const char *said = log_end();
    assert_non_null(strstr(said, "material 'gone' is grey"));
    assert_null(strstr(said, "'m'"));
    folder_remove(&f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(libraries_are_found_however_they_are_written),
    cmocka_unit_test(an_mtl_is_read_however_it_is_written),
    cmocka_unit_test(images_are_found_by_names_that_other_systems_write),
    cmocka_unit_test(a_material_that_no_mtl_defines_is_named),
    cmocka_unit_test(kd_alone_is_lambert),
    cmocka_unit_test(ks_and_ns_are_a_highlight),
    cmocka_unit_test(black_kd_with_ks_is_metal),
    cmocka_unit_test(pr_and_pm_come_before_ns),
    cmocka_unit_test(transparent_and_refracting_is_glass),
    cmocka_unit_test(d_and_tr_are_coverage),
    cmocka_unit_test(maps_of_mtl_files_are_read),
    cmocka_unit_test(a_texture_is_found_beside_the_model),
    cmocka_unit_test(what_is_missing_is_grey_with_a_warning),
    cmocka_unit_test(names_of_the_scene_file_come_first),
    cmocka_unit_test(tga_textures_are_read),
    cmocka_unit_test(tga_textures_may_be_grey),
    cmocka_unit_test(vertices_of_obj_and_ply_files_have_colours),
    cmocka_unit_test(colours_of_vertices_come_last),
    cmocka_unit_test(a_model_alone_is_a_framed_scene),
    cmocka_unit_test(other_formats_are_refused_with_what_to_do),
};
UNIT_MAIN(tests)
