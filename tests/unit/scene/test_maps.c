/* Textures of numbers: what a surface with them is at a place, and in a pixel. */
#include "scene/files.h"
#include "support/gbuffers.h"

#include "scene/scatter.h"
#include "scene/scene_digest.h"

enum { SIDE = 64 };

/* A square -1..1 before a camera 1 m away, whose 64 x 64 pixels it fills: a texel is a pixel. */
static const struct camera front = { "front", { 0, 0, 1 }, { 0, 0, 0 }, { 0, 1, 0 }, (float)PI / 2.0f };

struct card {
    struct scene *scene;
    struct rays *rays;
    struct texture *map;
};

static struct material worn(void)
{
    return (struct material){ .kind = MATERIAL_GGX,
                              .diffuse = { 0.8f, 0.5f, 0.2f },
                              .metallic = 0.9f,
                              .roughness = 0.8f,
                              .texture = MATERIAL_NO_TEXTURE };
}

static struct card card_of(const struct material *m)
{
    static const float corners[4][3] = { { -1, -1, 0 }, { 1, -1, 0 }, { 1, 1, 0 }, { -1, 1, 0 } };
    static const float uvs[8] = { 0, 0, 1, 0, 1, 1, 0, 1 };
    struct card c = { .scene = scene_create() };
    struct texture t;
    uint32_t material;

    assert_int_equal(scene_add_material(c.scene, m, &material), ERR_OK);
    add_quads(c.scene, material, corners, 1);
    c.scene->meshes[0].uvs = mem_alloc(8, sizeof(float));
    memcpy(c.scene->meshes[0].uvs, uvs, sizeof(uvs));
    assert_int_equal(scene_finish(c.scene, "card", NULL), ERR_OK);
    assert_int_equal(texture_init(&t, SIDE, SIDE, TEXTURE_LINEAR), ERR_OK);
    assert_int_equal(scene_add_texture(c.scene, &t, NULL), ERR_OK);
    c.map = &c.scene->textures[0];
    c.rays = rays_create(c.scene);
    return c;
}

/* By its columns: the first of `a`, the next of `b`, each for so many texels. */
static void paint(struct texture *t, uint32_t width, const uint8_t a[3], const uint8_t b[3])
{
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        memcpy(t->texels + 4 * (size_t)i, i % SIDE / width % 2 ? b : a, 3);
        t->texels[4 * (size_t)i + 3] = 255;
    }
    texture_build_levels(t);
}

static void card_end(struct card *c)
{
    rays_destroy(c->rays);
    scene_destroy(c->scene);
}

/* The middle of a texel of the top row; uv_step: as scatter_on has it. */
static struct scatter at_column(const struct card *c, uint32_t column, const float (*uv_step)[2])
{
    const struct vec3 down = { 0, 0, -1 };
    struct scatter out;
    struct hit h;

    assert_true(rays_intersect(c->rays, vec3_make(2.0f * ((float)column + 0.5f) / SIDE - 1.0f, 1.0f - 1.0f / SIDE, 1),
                               down, 0.0f, &h));
    rays_surface(c->rays, &h, vec3_scale(down, -1.0f), &out.surface);
    scatter_on(c->scene, &h, uv_step, &out);
    return out;
}

static void assert_like(const struct scatter *s, float metallic, float roughness)
{
    const struct vec3 base = worn().diffuse, d = ggx_matte(base, metallic, roughness), f = ggx_f0(base, metallic);

    assert_int_equal(s->kind, LOBE_GGX);
    assert_int_equal(s->delta, DELTA_NONE);
    assert_true(s->rough);
    assert_float_equal(s->gloss, roughness * roughness, 1e-5f);
    assert_float_equal(s->diffuse.x, d.x, 1e-5f);
    assert_float_equal(s->diffuse.z, d.z, 1e-5f);
    assert_float_equal(s->specular.x, f.x, 1e-5f);
    assert_float_equal(s->specular.z, f.z, 1e-5f);
}

/* Red, occlusion in most files, does not count. */
static void green_is_roughness_and_blue_metallic(void **state)
{
    static const uint8_t a[3] = { 0, 102, 204 }, b[3] = { 255, 204, 52 };
    struct material m = worn();
    m.maps = MAP_ROUGHNESS;
    struct card c = card_of(&m);
    const float wide[2][2] = { { 1, 0 }, { 0, 1 } };

    (void)state;
    paint(c.map, 1, a, b);
    struct scatter s = at_column(&c, 0, NULL);
    assert_like(&s, 0.9f * 0.8f, 0.8f * 0.4f);
    s = at_column(&c, 33, NULL);
    assert_like(&s, 0.9f * 52.0f / 255.0f, 0.8f * 0.8f);
    s = at_column(&c, 33, wide);
    assert_like(&s, 0.9f * 128.0f / 255.0f, 0.8f * 0.6f);
    card_end(&c);
}

/* A path would else be a caustic or not as a texture is filtered. */
static void a_map_never_makes_a_mirror(void **state)
{
    static const uint8_t smooth[3] = { 255, 0, 255 };
    struct material m = worn();

    (void)state;
    m.roughness = 0.02f;
    assert_true(material_is_delta(&m));
    m.maps = MAP_ROUGHNESS;
    assert_false(material_is_delta(&m));
    assert_true(material_is_rough(&m));
    struct card c = card_of(&m);
    paint(c.map, 1, smooth, smooth);
    const struct scatter s = at_column(&c, 5, NULL);
    assert_int_equal(s.delta, DELTA_NONE);
    assert_true(s.rough && s.gloss == ALPHA_DELTA);
    card_end(&c);
}

/* The points of the pixel in the middle of the picture, and their lobes. */
static uint32_t points_of_middle(const struct card *c, float gloss[8], float specular[8], float weight[8])
{
    /* half a pixel aside, so that the edge between two texels is in the middle of one */
    struct camera aside = front;
    aside.position.x = aside.look_at.x = 1.0f / SIDE;
    const struct gbuffer_desc d = {
        .camera = &aside, .width = SIDE, .height = SIDE, .edge_rays = 8, .every_pixel = true
    };
    struct gbuffer *g = gbuffer_of(c->scene, c->rays, &d);
    const uint32_t pixel = SIDE / 2 * SIDE + SIDE / 2 - 1, first = g->entry_first[pixel];
    const uint32_t count = g->entry_first[pixel + 1] - first;

    for (uint32_t i = 0; i < count && i < 8; i++) {
        const struct gbuffer_entry *e = &g->entries[first + i];
        const struct shade_packet *p = &g->packets[e->point / PACKET];
        gloss[i] = p->gloss[e->point % PACKET];
        specular[i] = p->specular[0][e->point % PACKET];
        weight[i] = e->weight[0];
    }
    gbuffer_destroy(g);
    return count;
}

/* Bilinear between two texels: from 0.3 to 0.9 there is more than one cluster; from 0.45 to 0.5 one, with the mean. */
static void a_pixel_keeps_lobes_apart_that_differ(void **state)
{
    static const uint8_t far_apart[2][3] = { { 0, 77, 255 }, { 0, 230, 255 } },
                         near_by[2][3] = { { 0, 115, 0 }, { 0, 128, 255 } };
    float gloss[8], specular[8], weight[8], least = 1.0f, most = 0.0f, sum = 0.0f;
    struct material m = worn();

    (void)state;
    m.metallic = m.roughness = 1.0f;
    m.maps = MAP_ROUGHNESS;
    struct card c = card_of(&m);
    paint(c.map, SIDE / 2, far_apart[0], far_apart[1]);
    uint32_t count = points_of_middle(&c, gloss, specular, weight);
    assert_in_range(count, 3, 8);
    for (uint32_t i = 0; i < count; i++) {
        least = fminf(least, sqrtf(gloss[i]));
        most = fmaxf(most, sqrtf(gloss[i]));
        sum += weight[i];
    }
    assert_true(least < 0.5f && most > 0.7f);
    assert_float_equal(sum, 1.0f, 1e-5f);
    paint(c.map, SIDE / 2, near_by[0], near_by[1]);
    count = points_of_middle(&c, gloss, specular, weight);
    assert_int_equal(count, 1);
    assert_float_equal(sqrtf(gloss[0]), 0.476f, 2e-3f);
    assert_float_equal(specular[0], 0.5f * (0.04f + 0.8f), 1e-2f);
    card_end(&c);
}

static uint64_t digest_of(const struct scene *s)
{
    struct digest d = { { 0 } };

    digest_scene(&d, s);
    return d.half[0];
}

static void maps_are_part_of_the_digest(void **state)
{
    static const uint8_t grey[3] = { 9, 9, 9 };
    const struct material m = worn();
    struct card c = card_of(&m);

    (void)state;
    paint(c.map, 1, grey, grey);
    const uint64_t plain = digest_of(c.scene);
    c.scene->materials[0].maps = MAP_ROUGHNESS;
    const uint64_t mapped = digest_of(c.scene);
    c.scene->materials[0].roughness_texture = 1;
    assert_true(plain != mapped && mapped != digest_of(c.scene));
    card_end(&c);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(green_is_roughness_and_blue_metallic),
    cmocka_unit_test(a_map_never_makes_a_mirror),
    cmocka_unit_test(a_pixel_keeps_lobes_apart_that_differ),
    cmocka_unit_test(maps_are_part_of_the_digest),
};
UNIT_MAIN(tests)
