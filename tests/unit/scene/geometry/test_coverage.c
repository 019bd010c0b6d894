/* Masks and fractional coverage: which rays stop, at every CPU level and packet width, and what the camera sees. */
#include "scene/geometry/files.h"

#include "base/rng.h"
#include "scene/geometry/coverage.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene_digest.h"

enum { SIDE = 64 }; /* texels */

/* Alpha 255 and 0 in squares of `square` texels, in the left half of the image; 255 in the third quarter, 0 in the
 * fourth. */
static uint32_t add_alpha(struct scene *s, uint32_t square)
{
    struct texture t;
    uint32_t index;

    assert_int_equal(texture_init(&t, 2 * SIDE, SIDE, TEXTURE_CUTOUT), ERR_OK);
    memset(t.texels, 255, 8 * SIDE * SIDE);
    for (uint32_t i = 0; i < 2 * SIDE * SIDE; i++) {
        const uint32_t x = i % (2 * SIDE), y = i / (2 * SIDE);
        if (x < SIDE ? (x / square + y / square) % 2 : x >= 3 * SIDE / 2)
            t.texels[4 * (size_t)i + 3] = 0;
    }
    texture_build_levels(&t);
    assert_int_equal(scene_add_texture(s, &t, &index), ERR_OK);
    return index;
}

/* Texels of 255 and 0 in turn. */
static uint32_t add_even(struct scene *s)
{
    struct texture t;
    uint32_t index;

    assert_int_equal(texture_init(&t, SIDE, SIDE, TEXTURE_CUTOUT), ERR_OK);
    for (uint32_t i = 0; i < SIDE * SIDE; i++)
        memset(t.texels + 4 * (size_t)i, (i % SIDE + i / SIDE) % 2 ? 255 : 0, 4);
    texture_build_levels(&t);
    assert_int_equal(scene_add_texture(s, &t, &index), ERR_OK);
    return index;
}

static uint32_t add_holed(struct scene *s, enum alpha_mode mode, float alpha, uint32_t texture)
{
    const struct material m = { .diffuse = { 0.8f, 0.8f, 0.8f },
                                .texture = MATERIAL_NO_TEXTURE,
                                .alpha_mode = mode,
                                .alpha = alpha,
                                .alpha_cutoff = 0.5f,
                                .alpha_texture = texture };
    uint32_t index = 0;

    assert_int_equal(scene_add_material(s, &m, &index), ERR_OK);
    return index;
}

/* The square -1..1 at this z, with the image's columns from u0 to u1, and as many rows if that is more than one image.
 */
static void add_card(struct scene *s, uint32_t material, float z, float u0, float u1)
{
    const float corners[4][3] = { { -1, -1, z }, { 1, -1, z }, { 1, 1, z }, { -1, 1, z } };
    const float v1 = fmaxf(1.0f, u1), uv[8] = { u0, 0, u1, 0, u1, v1, u0, v1 };

    add_quads(s, material, corners, 1);
    struct mesh *m = &s->meshes[s->mesh_count - 1];
    m->uvs = mem_alloc(8, sizeof(float));
    assert_non_null(m->uvs);
    memcpy(m->uvs, uv, sizeof(uv));
}

/* Rays through the square from in front of it. */
static void rays_through(struct ray16 *p, struct rng *r)
{
    memset(p, 0, sizeof(*p));
    for (int i = 0; i < PACKET; i++) {
        p->org_x[i] = (float)(3.0 * rng_next(r) - 1.5);
        p->org_y[i] = (float)(3.0 * rng_next(r) - 1.5);
        p->org_z[i] = 2.0f;
        p->dir_x[i] = (float)(1.8 * rng_next(r) - 0.9) - p->org_x[i];
        p->dir_y[i] = (float)(1.8 * rng_next(r) - 0.9) - p->org_y[i];
        p->dir_z[i] = -2.0f;
        p->tfar[i] = INFINITY;
        p->mask[i] = UINT32_MAX;
    }
}

static struct vec3 origin_of(const struct ray16 *p, int i)
{
    return vec3_make(p->org_x[i], p->org_y[i], p->org_z[i]);
}

static struct vec3 dir_of(const struct ray16 *p, int i)
{
    return vec3_make(p->dir_x[i], p->dir_y[i], p->dir_z[i]);
}

/* Asks all queries, at all levels, which must agree but where `near` says that rounding decides. Returns the fraction
 * of `packets` * 16 rays that was stopped. */
static double stopped(const struct scene *s, uint32_t packets, bool (*near)(struct vec3 origin, struct vec3 dir))
{
    uint64_t hits = 0;

    for (enum cpu_level level = CPU_BASELINE; level <= cpu_best(); level++) {
        struct rays *r = rays_create_for(s, level);
        struct rng random = { 7 };
        int32_t valid[PACKET];
        assert_non_null(r);
        hits = 0;
        for (uint32_t k = 0; k < packets; k++) {
            struct ray16 p, before;
            struct hit h;
            rays_through(&p, &random);
            before = p;
            for (int i = 0; i < PACKET; i++)
                valid[i] = rng_next(&random) < 0.9 ? -1 : 0;
            rays_occluded16(r, k % 2 ? RAYS_TOGETHER : RAYS_APART, valid, &p);
            for (int i = 0; i < PACKET; i++) {
                const struct vec3 o = origin_of(&before, i), d = dir_of(&before, i);
                const bool met = rays_intersect(r, o, d, 0.0f, &h), blocked = rays_blocked(r, o, d, 0.0f, INFINITY);
                const bool lane = p.tfar[i] < 0.0f;
                if (!near(o, d) && (met != blocked || lane != (blocked && valid[i])))
                    fail_msg("%s: first hit %d, blocked %d, lane %d", cpu_names[level], met, blocked, lane);
                hits += blocked;
            }
        }
        rays_destroy(r);
    }
    return (double)hits / (packets * PACKET);
}

static bool never(struct vec3 origin, struct vec3 dir)
{
    (void)origin;
    (void)dir;
    return false;
}

/* Within 1e-3 texels of the edge of a square of 4. */
static bool near_edge(struct vec3 o, struct vec3 d)
{
    const double t = (double)-o.z / (double)d.z;
    const double x = ((double)o.x + t * (double)d.x + 1.0) * SIDE / 8.0;
    const double y = ((double)o.y + t * (double)d.y + 1.0) * SIDE / 8.0;
    return fabs(x - round(x)) < 1e-3 || fabs(y - round(y)) < 1e-3;
}

/* Of a chequered card half is there; and where, bilinear lookup says at each ray. */
static void a_mask_stops_the_rays_that_meet_it(void **state)
{
    struct scene *s = scene_create();
    struct rng random = { 9 };
    uint32_t wrong = 0;

    (void)state;
    add_card(s, add_holed(s, ALPHA_MASK, 1.0f, add_alpha(s, 4)), 0.0f, 0.0f, 0.5f);
    assert_float_equal(stopped(s, 2000, near_edge), 0.5, 0.01); /* sigma: 0.003 */
    struct rays *r = rays_create_for(s, cpu_best());
    for (int k = 0; k < 1000; k++) {
        struct ray16 p;
        rays_through(&p, &random);
        for (int i = 0; i < PACKET; i++) {
            const float t = -p.org_z[i] / p.dir_z[i];
            const float x = p.org_x[i] + t * p.dir_x[i], y = p.org_y[i] + t * p.dir_y[i];
            const float alpha = texture_alpha(&s->textures[0], 0.25f * (x + 1.0f), 0.5f * (y + 1.0f));
            if (fabsf(alpha - 0.5f) > 1e-3f)
                wrong += rays_blocked(r, origin_of(&p, i), dir_of(&p, i), 0.0f, INFINITY) != (alpha > 0.5f);
        }
    }
    assert_int_equal(wrong, 0);
    rays_destroy(r);
    scene_destroy(s);
}

/* The same answer at every level and width, since it depends on the ray and the triangle alone. */
static void coverage_stops_its_fraction_of_rays(void **state)
{
    const float alphas[] = { 0.1f, 0.5f, 0.85f };

    (void)state;
    for (size_t k = 0; k < sizeof(alphas) / sizeof(alphas[0]); k++) {
        struct scene *s = scene_create();
        add_card(s, add_holed(s, ALPHA_BLEND, alphas[k], MATERIAL_NO_TEXTURE), 0.0f, 0.0f, 0.5f);
        assert_float_equal(stopped(s, 2000, never), alphas[k], 0.01); /* three sigma or more */
        scene_destroy(s);
    }
}

/* Two sheets, even one upon the other, are met independently: 0.7 * 0.4 goes through. Also with a texture's half. */
static void sheets_multiply(void **state)
{
    const float places[] = { 0.0f, -0.05f };

    (void)state;
    for (size_t k = 0; k < 2; k++)
        for (int textured = 0; textured < 2; textured++) {
            struct scene *s = scene_create();
            const uint32_t t = textured ? add_alpha(s, 1) : MATERIAL_NO_TEXTURE;
            add_card(s, add_holed(s, ALPHA_BLEND, 0.3f, MATERIAL_NO_TEXTURE), places[k], 0.0f, 0.5f);
            add_card(s, add_holed(s, ALPHA_BLEND, 0.6f, t), 0.0f, 0.0f, 0.5f);
            const double second = textured ? 0.3 : 0.6; /* the mean alpha of the chequer is a half */
            /* the last bit of u and v may differ, and with it alpha times the hash: once in 10^7 */
            assert_float_equal(stopped(s, 2000, never), 1.0 - 0.7 * (1.0 - second), 0.012);
            scene_destroy(s);
        }
}

static void coverage_is_known_from_the_texture(void **state)
{
    static const struct {
        enum alpha_mode mode;
        float alpha;
        bool textured;
        enum coverage want;
    } cases[] = {
        { ALPHA_OPAQUE, 0.0f, true, COVERAGE_FULL },     { ALPHA_MASK, 0.5f, false, COVERAGE_FULL },
        { ALPHA_MASK, 0.49f, false, COVERAGE_NONE },     { ALPHA_MASK, 1.0f, true, COVERAGE_PARTIAL },
        { ALPHA_MASK, 0.4f, true, COVERAGE_NONE },       { ALPHA_BLEND, 1.0f, false, COVERAGE_FULL },
        { ALPHA_BLEND, 0.99f, false, COVERAGE_PARTIAL }, { ALPHA_BLEND, 0.0f, true, COVERAGE_NONE },
        { ALPHA_BLEND, 1.0f, true, COVERAGE_PARTIAL },
    };
    struct scene *s = scene_create();
    const uint32_t t = add_alpha(s, 4);

    (void)state;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        const struct material m = { .alpha_mode = cases[i].mode,
                                    .alpha = cases[i].alpha,
                                    .alpha_cutoff = 0.5f,
                                    .alpha_texture = cases[i].textured ? t : MATERIAL_NO_TEXTURE };
        assert_int_equal(material_coverage(s, &m), cases[i].want);
    }
    scene_destroy(s);
}

static struct gbuffer *look(const struct scene *s, uint32_t edge_rays)
{
    /* not straight before it: the card's diagonal is where either triangle may be hit */
    static const struct camera front = { "front", { 0.013f, 0.007f, 1.5f }, { 0, 0, 0 }, { 0, 1, 0 }, 0.9f };
    const struct gbuffer_desc d = { .camera = &front, .width = 24, .height = 24, .edge_rays = edge_rays };
    struct rays *r = rays_create_for(s, cpu_best());
    struct gbuffer *g;
    struct reason why;

    assert_non_null(r);
    assert_int_equal(gbuffer_create(s, r, &d, &g, &why), ERR_OK);
    rays_destroy(r);
    return g;
}

static void same_images(const struct gbuffer *a, const struct gbuffer *b)
{
    const size_t pixels = (size_t)a->width * a->height;

    assert_int_equal(a->packet_count, b->packet_count);
    assert_memory_equal(a->entry_first, b->entry_first, (pixels + 1) * sizeof(*a->entry_first));
    assert_memory_equal(a->miss_first, b->miss_first, (pixels + 1) * sizeof(*a->miss_first));
    assert_memory_equal(a->entries, b->entries, a->entry_first[pixels] * sizeof(*a->entries));
    assert_memory_equal(a->misses, b->misses, a->miss_first[pixels] * sizeof(*a->misses));
    for (uint32_t i = 0; i < a->packet_count; i++)
        assert_memory_equal(&a->packets[i], &b->packets[i], offsetof(struct shade_packet, count));
}

/* A wall behind a card that is all hole, or before one that is all surface: by its constant, and where the image is
 * the same all over the card but not elsewhere, so that every hit is looked up. Bit for bit what there is without the
 * card, or with an opaque one. */
static void all_hole_is_no_card_and_all_surface_is_opaque(void **state)
{
    (void)state;
    for (int full = 0; full < 2; full++)
        for (int textured = 0; textured < 2; textured++)
            for (enum alpha_mode mode = ALPHA_MASK; mode <= ALPHA_BLEND; mode++) {
                struct gbuffer *g[2];
                for (int holed = 0; holed < 2; holed++) {
                    struct scene *s = scene_create();
                    const uint32_t t = textured ? add_alpha(s, 4) : MATERIAL_NO_TEXTURE;
                    const uint32_t wall = add_lambert(s, 0.5f);
                    const uint32_t card = add_holed(s, holed ? mode : ALPHA_OPAQUE, textured || full ? 1.0f : 0.0f, t);
                    const float corners[4][3] = { { -3, -1.5f, -1 }, { 3, -1, -1 }, { 0.2f, 1, -1 }, { -3, 1, -1 } };
                    add_quads(s, wall, corners, 1);
                    if (full || holed)
                        add_card(s, card, 0.0f, full ? 0.53f : 0.78f, full ? 0.72f : 0.97f);
                    g[holed] = look(s, 16);
                    scene_destroy(s);
                }
                same_images(g[0], g[1]);
                gbuffer_destroy(g[0]);
                gbuffer_destroy(g[1]);
            }
}

/* The summed weights of escapes, over the pixels of the middle, and their range. */
static double misses_of(const struct gbuffer *g, float range[2])
{
    double sum = 0.0;

    range[0] = 1.0f;
    range[1] = 0.0f;
    for (uint32_t y = 6; y < 18; y++)
        for (uint32_t x = 6; x < 18; x++) {
            const size_t pixel = (size_t)y * 24 + x;
            float w = 0.0f;
            for (uint32_t k = g->miss_first[pixel]; k < g->miss_first[pixel + 1]; k++)
                w += g->misses[k].weight[1];
            range[0] = fminf(range[0], w);
            range[1] = fmaxf(range[1], w);
            sum += (double)w / 144.0;
        }
    return sum;
}

/* The card with white vertices whose alpha grows from 0 at the left to 1 at the right. */
static void fade_card(struct scene *s)
{
    static const float fade[16] = { 1, 1, 1, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0 };
    struct mesh *m = &s->meshes[s->mesh_count - 1];

    m->colours = mem_alloc(16, sizeof(float));
    assert_non_null(m->colours);
    memcpy(m->colours, fade, sizeof(fade));
}

static bool near_middle(struct vec3 o, struct vec3 d)
{
    return fabsf(o.x - o.z / d.z * d.x) < 1e-4f;
}

/* Blended, half of the rays of a card are stopped, times the material's alpha; masked, those through its right half.
 * The camera sees the exact share. */
static void alpha_may_be_of_the_vertices(void **state)
{
    (void)state;
    for (enum alpha_mode mode = ALPHA_MASK; mode <= ALPHA_BLEND; mode++) {
        struct scene *s = scene_create();
        float range[2];

        add_card(s, add_holed(s, mode, mode == ALPHA_MASK ? 1.0f : 0.8f, MATERIAL_NO_TEXTURE), 0.0f, 0.0f, 0.5f);
        fade_card(s);
        assert_float_equal(stopped(s, 1000, near_middle), mode == ALPHA_MASK ? 0.5 : 0.4, 0.015);
        struct gbuffer *g = look(s, 64);
        assert_float_equal(misses_of(g, range), mode == ALPHA_MASK ? 0.5 : 0.6, 2e-3);
        assert_true(mode == ALPHA_MASK ? range[0] == 0.0f && range[1] == 1.0f : range[0] < 0.5f && range[1] > 0.7f);
        gbuffer_destroy(g);
        scene_destroy(s);
    }
}

/* Squares of two texels, three to a pixel: no single ray sees both holes and surface, but 64 do. */
static void a_fine_mask_lets_half_of_each_pixel_through(void **state)
{
    struct scene *s = scene_create();
    float range[2];

    (void)state;
    add_card(s, add_holed(s, ALPHA_MASK, 1.0f, add_alpha(s, 1)), 0.0f, 0.0f, 0.5f);
    struct gbuffer *g = look(s, 64);
    assert_float_equal(misses_of(g, range), 0.5, 0.01);
    assert_true(range[0] > 0.25f && range[1] < 0.75f);
    gbuffer_destroy(g);
    scene_destroy(s);
}

/* Where the mask is the same all over a pixel, one ray is enough: on the third quarter all surface, on the fourth none.
 */
static void a_mask_that_does_not_vary_takes_no_more_rays(void **state)
{
    (void)state;
    for (int quarter = 0; quarter < 2; quarter++) {
        struct scene *s = scene_create();
        float range[2];
        add_card(s, add_holed(s, ALPHA_MASK, 1.0f, add_alpha(s, 4)), 0.0f, quarter ? 0.78f : 0.53f,
                 quarter ? 0.97f : 0.72f);
        struct gbuffer *g = look(s, 16);
        assert_float_equal(misses_of(g, range), quarter, 0.0);
        assert_true(g->edge_pixels < 24 * 24 / 3); /* the card's outline, if any */
        gbuffer_destroy(g);
        scene_destroy(s);
    }
}

/* One ray gives the exact weights: alpha on the front sheet, 1 - alpha on the one behind it. */
static void fractional_coverage_is_seen_as_a_weight(void **state)
{
    struct scene *s = scene_create();
    const float alphas[3] = { 0.3f, 0.6f, 0.25f };

    (void)state;
    const uint32_t texture = add_even(s); /* 15 texels a pixel: its smaller levels have 128 everywhere */
    const double third = 0.25 * 128.0 / 255.0;
    for (int k = 0; k < 3; k++)
        add_card(s, add_holed(s, ALPHA_BLEND, alphas[k], k == 2 ? texture : MATERIAL_NO_TEXTURE), -0.1f * (float)k,
                 0.0f, 8.0f);
    struct gbuffer *g = look(s, 1);
    float range[2];
    assert_float_equal(misses_of(g, range), 0.7 * 0.4 * (1.0 - third), 1e-5);
    for (uint32_t y = 6; y < 18; y++)
        for (uint32_t x = 6; x < 18; x++) {
            const size_t pixel = (size_t)y * 24 + x;
            const struct gbuffer_entry *e = g->entries + g->entry_first[pixel];
            float weights[3] = { 0 };
            assert_int_equal(g->entry_first[pixel + 1] - g->entry_first[pixel], 3);
            for (int k = 0; k < 3; k++)
                weights[g->packets[e[k].point / PACKET].mesh[e[k].point % PACKET]] = e[k].weight[1];
            assert_float_equal(weights[0], 0.3f, 1e-6f);
            assert_float_equal(weights[1], 0.7f * 0.6f, 1e-6f);
            assert_float_equal(weights[2], 0.7 * 0.4 * third, 1e-5);
        }
    gbuffer_destroy(g);
    scene_destroy(s);
}

/* A camera ray has room for fewer sheets: the rest is dropped and counted. */
static void many_sheets_are_cut(void **state)
{
    enum { SHEETS = 90 };
    struct scene *s = scene_create();

    (void)state;
    const uint32_t material = add_holed(s, ALPHA_BLEND, 0.02f, MATERIAL_NO_TEXTURE);
    for (int k = 0; k < SHEETS; k++)
        add_card(s, material, -0.01f * (float)k, 0.0f, 8.0f);
    struct gbuffer *g = look(s, 1);
    const size_t pixel = 12 * 24 + 12;
    const uint32_t points = g->entry_first[pixel + 1] - g->entry_first[pixel];
    double sum = 0.0;
    for (uint32_t i = g->entry_first[pixel]; i < g->entry_first[pixel + 1]; i++)
        sum += (double)g->entries[i].weight[1];
    assert_int_equal(points, 64);
    assert_float_equal(sum, 1.0 - pow(0.98, 64), 1e-4);
    assert_true(g->cut_weight > 0.9 * 144 * pow(0.98, 64)); /* some 12 x 12 pixels and more */
    gbuffer_destroy(g);
    scene_destroy(s);
}

#define SHEET_TINT                                                                                                     \
    {                                                                                                                  \
        1.0f, 0.5f, 0.2f                                                                                               \
    }

static uint32_t add_sheet(struct scene *s)
{
    const struct material m = { .kind = MATERIAL_GLASS,
                                .diffuse = SHEET_TINT,
                                .texture = MATERIAL_NO_TEXTURE,
                                .alpha_texture = MATERIAL_NO_TEXTURE,
                                .ior = 1.5f,
                                .thin = 1 };
    uint32_t index = 0;

    assert_int_equal(scene_add_material(s, &m, &index), ERR_OK);
    return index;
}

/* Two faces of Fresnel reflectance f with the tint b between them: what passes, all orders together. */
static double passing(double f, double b)
{
    return (1.0 - f) * (1.0 - f) * b / (1.0 - f * f * b * b);
}

static double fresnel_of(double c)
{
    const double t = sqrt(1.0 - (1.0 - c * c) / 2.25), p = (1.5 * c - t) / (1.5 * c + t),
                 q = (c - 1.5 * t) / (c + 1.5 * t);
    return 0.5 * (p * p + q * q);
}

/* Each ray passes with the mean of what passes at its angle, the same at every level and width. */
static void a_thin_sheet_stops_what_does_not_pass(void **state)
{
    struct scene *s = scene_create();
    struct rng random = { 7 };
    double sum = 0.0;

    (void)state;
    add_card(s, add_sheet(s), 0.0f, 0.0f, 0.5f);
    for (int k = 0; k < 2000; k++) {
        struct ray16 p;
        rays_through(&p, &random);
        for (int i = 0; i < PACKET; i++) {
            const double f = fresnel_of(fabs((double)vec3_normalize(dir_of(&p, i)).z));
            sum += 1.0 - (passing(f, 1.0) + passing(f, 0.5) + passing(f, (double)0.2f)) / 3.0;
        }
    }
    assert_float_equal(stopped(s, 2000, never), sum / (2000 * PACKET), 0.01); /* three sigma */
    scene_destroy(s);
}

/* By colours: what passes, and what comes back. Square on, F is 0.04. */
static void a_thin_sheet_is_seen_in_its_colours(void **state)
{
    static const struct camera tele = { "tele", { 0.1f, 0.03f, 9 }, { 0.1f, 0.03f, 0 }, { 0, 1, 0 }, 1e-3f };
    const struct gbuffer_desc desc = { .camera = &tele, .width = 2, .height = 2, .edge_rays = 1 };
    const float tint[3] = SHEET_TINT;
    struct scene *s = scene_create();
    struct reason why;
    struct gbuffer *g;

    (void)state;
    add_card(s, add_sheet(s), 0.0f, 0.0f, 0.5f);
    struct rays *r = rays_create_for(s, cpu_best());
    assert_int_equal(gbuffer_create(s, r, &desc, &g, &why), ERR_OK);
    for (int k = 0; k < 3; k++) {
        const double through = passing(0.04, (double)tint[k]), back = 0.04 + 0.04 * (double)tint[k] * through;
        double sum[2] = { 0.0, 0.0 };
        for (uint32_t i = g->miss_first[0]; i < g->miss_first[1]; i++)
            sum[g->misses[i].direction.z > 0.0f] += (double)g->misses[i].weight[k];
        assert_float_equal(sum[0], through, 1e-5);
        assert_float_equal(sum[1], back, 1e-5);
    }
    gbuffer_destroy(g);
    rays_destroy(r);
    scene_destroy(s);
}

static struct digest geometry_of(const struct scene *s)
{
    struct digest d = { 0 };

    digest_geometry(&d, s);
    return d;
}

/* A cache of visibility is kept for as long as the digest stays: it must tell all that decides about holes, and no
 * colour. */
static void a_digest_of_geometry_tells_its_holes(void **state)
{
    struct scene *s = scene_create();

    (void)state;
    add_card(s, add_holed(s, ALPHA_MASK, 1.0f, add_alpha(s, 4)), 0.0f, 0.0f, 0.5f);
    const struct digest whole = geometry_of(s);
    struct material *m = &s->materials[0], kept = *m;
    m->diffuse.x = 0.1f;
    struct digest d = geometry_of(s);
    assert_memory_equal(&d, &whole, sizeof(d));
    for (int change = 0; change < 6; change++) {
        *m = kept;
        m->alpha_mode = change == 0 ? ALPHA_OPAQUE : change == 1 ? ALPHA_BLEND : ALPHA_MASK;
        m->alpha = change == 2 ? 0.9f : 1.0f;
        m->alpha_cutoff = change == 3 ? 0.4f : 0.5f;
        s->textures[0].texels[7] ^= change == 4;
        s->meshes[0].uvs[2] += change == 5 ? 0.1f : 0.0f;
        d = geometry_of(s);
        assert_memory_not_equal(&d, &whole, sizeof(d));
        s->textures[0].texels[7] ^= change == 4;
    }
    *m = kept;
    m->thin = 1;
    m->ior = 1.5f;
    d = geometry_of(s);
    assert_memory_not_equal(&d, &whole, sizeof(d));
    m->diffuse.x = 0.7f; /* of thin glass: decides about how many rays pass */
    const struct digest tinted = geometry_of(s);
    assert_memory_not_equal(&d, &tinted, sizeof(d));
    scene_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_mask_stops_the_rays_that_meet_it),
    cmocka_unit_test(coverage_stops_its_fraction_of_rays),
    cmocka_unit_test(alpha_may_be_of_the_vertices),
    cmocka_unit_test(sheets_multiply),
    cmocka_unit_test(coverage_is_known_from_the_texture),
    cmocka_unit_test(all_hole_is_no_card_and_all_surface_is_opaque),
    cmocka_unit_test(a_fine_mask_lets_half_of_each_pixel_through),
    cmocka_unit_test(a_mask_that_does_not_vary_takes_no_more_rays),
    cmocka_unit_test(many_sheets_are_cut),
    cmocka_unit_test(a_thin_sheet_stops_what_does_not_pass),
    cmocka_unit_test(a_thin_sheet_is_seen_in_its_colours),
    cmocka_unit_test(fractional_coverage_is_seen_as_a_weight),
    cmocka_unit_test(a_digest_of_geometry_tells_its_holes),
};

UNIT_MAIN(tests)
