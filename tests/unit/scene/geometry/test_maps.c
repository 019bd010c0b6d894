/* Textures of numbers: what a surface with them is at a place, and in a pixel. */
#include "scene/geometry/files.h"
#include "support/gbuffers.h"

#include "scene/geometry/scatter_hit.h"
#include "scene/geometry/scene_digest.h"
#include "scene/surface/scatter.h"

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
    c.rays = rays_create_for(c.scene, cpu_best());
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
    const struct vec3 base = worn().diffuse, d = ggx_matte(base, metallic, roughness, (struct vec3){ 0 }),
                      f = ggx_f0(base, metallic, (struct vec3){ 0 });

    assert_int_equal(s->kind, LOBE_GGX);
    assert_int_equal(s->delta, DELTA_NONE);
    assert_true(s->rough);
    assert_float_equal(s->gloss, roughness * roughness, 1e-5f);
    assert_float_equal(s->diffuse.x, d.x, 1e-5f);
    assert_float_equal(s->diffuse.z, d.z, 1e-5f);
    assert_float_equal(s->specular.x, f.x, 1e-5f);
    assert_float_equal(s->specular.z, f.z, 1e-5f);
}

/* The map's left half is of a, its right half of b. Scaled by 8 it repeats eight times over the card, and with columns
 * of a and b in turn, the footprint of one texel holds four of both. */
static void a_map_may_be_moved_against_the_mesh(void **state)
{
    static const uint8_t a[3] = { 0, 102, 204 }, b[3] = { 255, 204, 52 };
    const float texel[2][2] = { { 1.0f / SIDE, 0 }, { 0, 1.0f / SIDE } };
    struct material m = worn();
    m.maps = MAP_ROUGHNESS;
    struct card c = card_of(&m);
    struct material *moved = &c.scene->materials[0];

    (void)state;
    paint(c.map, SIDE / 2, a, b);
    struct scatter s = at_column(&c, 20, NULL);
    assert_like(&s, 0.9f * 0.8f, 0.8f * 0.4f);
    moved->moved = MAP_ROUGHNESS;
    memcpy(moved->moved_by[0], (const float[6]){ 8, 0, 0, 0, 8, 0 }, sizeof(moved->moved_by[0]));
    s = at_column(&c, 20, NULL); /* u = 2.5625 */
    assert_like(&s, 0.9f * 52.0f / 255.0f, 0.8f * 0.8f);
    memcpy(moved->moved_by[0], (const float[6]){ 8, 0, 0.5f, 0, 8, 0 }, sizeof(moved->moved_by[0]));
    s = at_column(&c, 20, NULL); /* half a texture further */
    assert_like(&s, 0.9f * 0.8f, 0.8f * 0.4f);
    paint(c.map, 1, a, b);
    s = at_column(&c, 20, texel);
    assert_like(&s, 0.9f * 128.0f / 255.0f, 0.8f * 0.6f);
    moved->moved = 0;
    s = at_column(&c, 20, texel);
    assert_like(&s, 0.9f * 0.8f, 0.8f * 0.4f);
    card_end(&c);
}

/* Second texture coordinates, the first times 8 with u and v exchanged, and half a texel further: the roughness map and
 * the emission have them, the base colour and its footprint have not. One texel of the card is then eight texels along
 * v, which do not matter to a map by columns. */
static void a_map_may_be_at_the_second_texture_coordinates(void **state)
{
    static const float to = 0.5f / SIDE, second[8] = { to, 0, to, 8, 8 + to, 8, 8 + to, 0 };
    static const uint8_t a[3] = { 0, 102, 204 }, b[3] = { 255, 204, 52 };
    const float step[4][2] = { { 1.0f / SIDE, 0 }, { 0, 1.0f / SIDE }, { 0, 8.0f / SIDE }, { 8.0f / SIDE, 0 } };
    struct material m = worn();
    m.maps = MAP_ROUGHNESS;
    m.second = MAP_ROUGHNESS | MAP_EMISSION;
    m.emission = vec3_make(1, 1, 1);
    struct card c = card_of(&m);
    struct mesh *mesh = &c.scene->meshes[0];

    (void)state;
    c.scene->materials[0].emission_texture = 0;
    mesh->more_uvs = mem_alloc(8, sizeof(float));
    memcpy(mesh->more_uvs, second, sizeof(second));
    paint(c.map, SIDE / 2, a, b);
    struct scatter s = at_column(&c, 20, NULL);
    assert_float_equal(s.surface.more_uv[0], 8.0f * s.surface.uv[1] + to, 1e-5f);
    assert_float_equal(s.surface.more_uv[1], 8.0f * s.surface.uv[0], 1e-5f);
    assert_like(&s, 0.9f * 52.0f / 255.0f, 0.8f * 0.8f); /* u = 7.945 */
    assert_true(s.surface.uv[0] < 0.5f);                 /* where it would be a */
    const struct vec3 glow = scene_emission(c.scene, 0, map_uv(&m, MAP_EMISSION, &s.surface), NULL);
    assert_true(glow.y > 0.79f && glow.y < 0.81f);
    paint(c.map, 1, a, b); /* eight columns are as many of both */
    s = at_column(&c, 20, step);
    assert_like(&s, 0.9f * 128.0f / 255.0f, 0.8f * 0.6f);
    c.scene->materials[0].second = 0;
    s = at_column(&c, 20, step);
    assert_like(&s, 0.9f * 0.8f, 0.8f * 0.4f);
    card_end(&c);
}

/* Tangents follow the set that the normal map has. */
static void tangents_follow_the_second_texture_coordinates(void **state)
{
    static const float turned[8] = { 0, 0, 0, 1, 1, 1, 1, 0 }; /* (v, u) */
    const struct material m = worn();
    struct card c = card_of(&m);
    struct mesh *mesh = &c.scene->meshes[0];

    (void)state;
    mesh->more_uvs = mem_alloc(8, sizeof(float));
    memcpy(mesh->more_uvs, turned, sizeof(turned));
    assert_int_equal(mesh_make_tangents(mesh, false), ERR_OK);
    assert_true(mesh->tangents[0] == 1.0f && mesh->tangents[3] == 1.0f);
    assert_int_equal(mesh_make_tangents(mesh, true), ERR_OK);
    assert_true(mesh->tangents[1] == 1.0f && mesh->tangents[3] == -1.0f);
    card_end(&c);
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

/* Red, where the reader puts the alpha of glTF's texture. */
static void red_is_the_roughness_of_sheen(void **state)
{
    static const uint8_t a[3] = { 51, 255, 255 }, b[3] = { 153, 255, 255 };
    const float wide[2][2] = { { 1, 0 }, { 0, 1 } };
    struct material m = worn();
    m.maps = MAP_SHEEN_ROUGHNESS;
    m.sheen = vec3_make(0.5f, 0.5f, 0.5f);
    m.sheen_texture = MATERIAL_NO_TEXTURE;
    m.sheen_roughness = 0.5f;
    struct card c = card_of(&m);

    (void)state;
    paint(c.map, 1, a, b);
    assert_float_equal(at_column(&c, 0, NULL).veil.sheen_roughness, 0.5f * 0.2f, 1e-6f);
    assert_float_equal(at_column(&c, 33, NULL).veil.sheen_roughness, 0.5f * 0.6f, 1e-6f);
    assert_float_equal(at_column(&c, 33, wide).veil.sheen_roughness, 0.5f * 0.4f, 1e-3f);
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

/* The points of the pixel in the middle of the image, and their lobes. */
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

/* ---- Normals ---- */

/* A card with a map of one colour and these texture coordinates; its shading normal in the middle, seen from in front
 * or from behind. */
static struct vec3 bent_normal(const float uvs[8], const uint8_t colour[3], float scale, float from)
{
    struct material m = worn();
    m.maps = MAP_NORMAL;
    m.normal_scale = scale;
    struct card c = card_of(&m);
    const struct vec3 dir = { 0.0f, 0.0f, -from };
    struct scatter at;
    struct hit h;

    paint(c.map, 1, colour, colour);
    memcpy(c.scene->meshes[0].uvs, uvs, 8 * sizeof(float));
    assert_int_equal(mesh_make_tangents(&c.scene->meshes[0], false), ERR_OK);
    assert_true(rays_intersect(c.rays, vec3_make(0.1f, 0.2f, from), dir, 0.0f, &h));
    scatter_at(c.scene, c.rays, &h, dir, &at);
    card_end(&c);
    return at.surface.shading;
}

static void assert_normal(struct vec3 n, double x, double y, double z)
{
    const double length = sqrt(x * x + y * y + z * z);

    if (fabs((double)n.x - x / length) + fabs((double)n.y - y / length) + fabs((double)n.z - z / length) > 1e-5)
        fail_msg("(%g, %g, %g), not along (%g, %g, %g)", (double)n.x, (double)n.y, (double)n.z, x, y, z);
}

/* Red turns it along rising u, green along rising v, wherever those point; behind, the same bump is a dent. */
static void normals_turn_along_the_texture(void **state)
{
    static const float upright[8] = { 0, 0, 1, 0, 1, 1, 0, 1 }, mirrored[8] = { 1, 0, 0, 0, 0, 1, 1, 1 },
                       turned[8] = { 0, 1, 0, 0, 1, 0, 1, 1 }; /* u rises along y, v against x */
    static const uint8_t colour[3] = { 204, 153, 255 };        /* 0.6, 0.2, 1 */
    static const uint8_t steep[3] = { 255, 128, 0 };           /* behind the surface */

    (void)state;
    assert_normal(bent_normal(upright, colour, 1.0f, 1.0f), 0.6, 0.2, 1.0);
    assert_normal(bent_normal(upright, colour, -0.5f, 1.0f), -0.3, -0.1, 1.0);
    assert_normal(bent_normal(mirrored, colour, 1.0f, 1.0f), -0.6, 0.2, 1.0);
    assert_normal(bent_normal(turned, colour, 1.0f, 1.0f), -0.2, 0.6, 1.0);
    assert_normal(bent_normal(upright, colour, 1.0f, -1.0f), -0.6, -0.2, -1.0);
    const struct vec3 n = bent_normal(upright, steep, 1.0f, 1.0f);
    assert_true(n.z > 0.01f && n.z < 0.03f && n.x > 0.9f);
}

/* Half of a card is the mirror image of the other, in texture space: they share two vertices, which become four. */
static void mirror_images_have_tangents_of_their_own(void **state)
{
    static const float places[6][3] = { { -1, -1, 0 }, { 0, -1, 0 }, { 1, -1, 0 },
                                        { 1, 1, 0 },   { 0, 1, 0 },  { -1, 1, 0 } };
    static const float uvs[12] = { 1, 0, 0, 0, 1, 0, 1, 1, 0, 1, 1, 1 };
    static const uint32_t triangles[12] = { 0, 1, 4, 0, 4, 5, 1, 2, 3, 1, 3, 4 };
    struct mesh m = { .vertex_count = 6, .triangle_count = 4 };

    (void)state;
    m.positions = mem_alloc(19, sizeof(float));
    m.uvs = mem_alloc(12, sizeof(float));
    m.indices = mem_alloc(12, sizeof(uint32_t));
    memcpy(m.positions, places, sizeof(places));
    memcpy(m.uvs, uvs, sizeof(uvs));
    m.more_uvs = mem_alloc(12, sizeof(float));
    memcpy(m.more_uvs, uvs, sizeof(uvs));
    memcpy(m.indices, triangles, sizeof(triangles));
    assert_int_equal(mesh_make_tangents(&m, false), ERR_OK);
    assert_int_equal(m.vertex_count, 8);
    for (uint32_t i = 0; i < 12; i++) {
        const uint32_t v = m.indices[i];
        const float *t = m.tangents + 4 * (size_t)v, side = i < 6 ? -1.0f : 1.0f;
        assert_memory_equal(m.positions + 3 * (size_t)v, places[triangles[i]], 3 * sizeof(float));
        assert_memory_equal(m.uvs + 2 * (size_t)v, uvs + 2 * (size_t)triangles[i], 2 * sizeof(float));
        assert_memory_equal(m.more_uvs + 2 * (size_t)v, uvs + 2 * (size_t)triangles[i], 2 * sizeof(float));
        assert_true(t[0] == side && t[1] == 0.0f && t[2] == 0.0f && t[3] == side);
    }
    mesh_finish(&m);
}

/* On a cylinder of 12 sides the directions on two neighbours meet in the plane of their vertex. */
static void tangents_are_means_in_the_plane_of_the_normal(void **state)
{
    enum { SIDES = 12, COUNT = 2 * (SIDES + 1) };
    struct mesh m = { .vertex_count = COUNT, .triangle_count = 2 * SIDES };

    (void)state;
    m.positions = mem_alloc(3 * COUNT + 1, sizeof(float));
    m.normals = mem_alloc(3 * COUNT, sizeof(float));
    m.uvs = mem_alloc(2 * COUNT, sizeof(float));
    m.indices = mem_alloc(6 * SIDES, sizeof(uint32_t));
    for (uint32_t i = 0; i < COUNT; i++) {
        const double phi = 2.0 * PI * (i / 2) / SIDES;
        const float x = (float)sin(phi), z = (float)cos(phi);
        memcpy(m.positions + 3 * (size_t)i, (float[]){ x, (float)(i % 2), z }, 3 * sizeof(float));
        memcpy(m.normals + 3 * (size_t)i, (float[]){ x, 0.0f, z }, 3 * sizeof(float));
        memcpy(m.uvs + 2 * (size_t)i, (float[]){ (float)(i / 2), (float)(i % 2) }, 2 * sizeof(float));
    }
    for (uint32_t i = 0; i < SIDES; i++) {
        const uint32_t a = 2 * i, two[6] = { a, a + 2, a + 3, a, a + 3, a + 1 };
        memcpy(m.indices + 6 * (size_t)i, two, sizeof(two));
    }
    assert_int_equal(mesh_make_tangents(&m, false), ERR_OK);
    assert_int_equal(m.vertex_count, COUNT);
    for (size_t i = 0; i < COUNT; i++) {
        assert_float_equal(m.tangents[4 * i], m.normals[3 * i + 2], 1e-6f);
        assert_float_equal(m.tangents[4 * i + 1], 0.0f, 1e-6f);
        assert_float_equal(m.tangents[4 * i + 2], -m.normals[3 * i], 1e-6f);
        assert_true(m.tangents[4 * i + 3] == 1.0f);
    }
    mesh_finish(&m);
}

/* Opposite slopes in the columns: far away they cancel, in a pixel with several rays too. */
static void slopes_are_averaged_in_a_pixel(void **state)
{
    static const uint8_t left[3] = { 102, 128, 255 }, right[3] = { 153, 128, 255 };
    struct camera aside = front;
    struct material m = worn();
    float least = 1.0f;

    (void)state;
    m.maps = MAP_NORMAL;
    m.normal_scale = 1.0f;
    struct card c = card_of(&m);
    paint(c.map, 1, left, right);
    assert_int_equal(mesh_make_tangents(&c.scene->meshes[0], false), ERR_OK);
    const struct gbuffer_desc d = { .camera = &aside, .width = SIDE / 2, .height = SIDE / 2, .every_pixel = true };
    struct gbuffer *g = gbuffer_of(c.scene, c.rays, &d);
    assert_int_equal(g->point_count, SIDE * SIDE / 4);
    for (uint32_t i = 0; i < g->packet_count; i++)
        for (uint32_t l = 0; l < g->packets[i].count; l++)
            least = fminf(least, g->packets[i].ns_z[l]);
    assert_true(least > 0.99f);
    gbuffer_destroy(g);
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
    c.scene->materials[0].second = MAP_ROUGHNESS;
    const uint64_t second = digest_of(c.scene);
    c.scene->materials[0].second = 0;
    assert_true(second != digest_of(c.scene));
    c.scene->materials[0].maps = MAP_NORMAL;
    const uint64_t bent = digest_of(c.scene);
    c.scene->materials[0].normal_scale = 2.0f;
    assert_true(bent != mapped && bent != digest_of(c.scene));
    card_end(&c);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_map_may_be_moved_against_the_mesh),
    cmocka_unit_test(a_map_may_be_at_the_second_texture_coordinates),
    cmocka_unit_test(tangents_follow_the_second_texture_coordinates),
    cmocka_unit_test(green_is_roughness_and_blue_metallic),
    cmocka_unit_test(red_is_the_roughness_of_sheen),
    cmocka_unit_test(a_map_never_makes_a_mirror),
    cmocka_unit_test(a_pixel_keeps_lobes_apart_that_differ),
    cmocka_unit_test(normals_turn_along_the_texture),
    cmocka_unit_test(mirror_images_have_tangents_of_their_own),
    cmocka_unit_test(tangents_are_means_in_the_plane_of_the_normal),
    cmocka_unit_test(slopes_are_averaged_in_a_pixel),
    cmocka_unit_test(maps_are_part_of_the_digest),
};
UNIT_MAIN(tests)
