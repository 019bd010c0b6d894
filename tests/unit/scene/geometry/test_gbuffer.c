#include "import/reader/reader.h"
#include "scene/geometry/files.h"
#include "scene/geometry/load.h"
#include "scene/geometry/quads.h"

#include "scene/geometry/gbuffer.h"

#include <math.h>
#include <omp.h>
#include <sys/resource.h>

static float weight_of_misses(const struct gbuffer *g, uint32_t x, uint32_t y)
{
    const size_t i = (size_t)y * g->width + x;
    float sum = 0.0f;

    for (uint32_t k = g->miss_first[i]; k < g->miss_first[i + 1]; k++)
        sum += g->misses[k].weight[1];
    return sum;
}

static void quad_head_on_fills_its_pixels_and_no_other(void **state)
{
    /* the upper left quarter but for a margin of 8 pixels */
    const float quad[4][3] = { { -0.75f, 0.25f, 0 }, { -0.25f, 0.25f, 0 }, { -0.25f, 0.75f, 0 }, { -0.75f, 0.75f, 0 } };

    (void)state;
    for (uint32_t edge_rays = 1; edge_rays <= 4; edge_rays++) {
        struct view v = view_quads(quad, 1, edge_rays);
        for (uint32_t y = 0; y < 64; y++) {
            for (uint32_t x = 0; x < 64; x++) {
                const bool inside = x >= 8 && x < 24 && y >= 8 && y < 24;
                assert_float_equal(weight_of_points(v.g, x, y), inside ? 1.0f : 0.0f, 1e-6f);
                assert_float_equal(weight_of_misses(v.g, x, y), inside ? 0.0f : 1.0f, 1e-6f);
            }
        }
        assert_int_equal(v.g->edge_pixels == 0, edge_rays == 1);
        view_end(&v);
    }
}

static void half_covered_pixels_weigh_half(void **state)
{
    /* straight edges through the middle of pixels 16 and 48, and a slanted one from corner to corner */
    const float upright[4][3] = {
        { -0.484375f, -2, 0 }, { 0.515625f, -2, 0 }, { 0.515625f, 2, 0 }, { -0.484375f, 2, 0 }
    };
    const float slanted[4][3] = { { -4, -4, 0 }, { 4, -4, 0 }, { 4, 4, 0 }, { 4, 4, 0 } };

    (void)state;
    struct view v = view_quads(upright, 1, 4);
    for (uint32_t y = 0; y < 64; y++) {
        assert_float_equal(weight_of_points(v.g, 16, y), 0.5f, 1e-6f);
        assert_float_equal(weight_of_points(v.g, 48, y), 0.5f, 1e-6f);
        assert_float_equal(weight_of_misses(v.g, 48, y), 0.5f, 1e-6f);
    }
    view_end(&v);
    v = view_quads(slanted, 1, 8);
    double mean = 0.0;
    for (uint32_t i = 0; i < 64; i++) {
        assert_float_equal(weight_of_points(v.g, i, 63 - i), 0.5f, 0.16f);
        mean += weight_of_points(v.g, i, 63 - i) / 64.0;
    }
    assert_float_equal(mean, 0.5f, 0.02f);
    view_end(&v);
}

static void weights_sum_to_one_everywhere(void **state)
{
    struct scene *s = scene_create_builtin();
    struct rays *r = rays_create_for(s, cpu_best());
    const struct gbuffer_desc d = { .camera = scene_camera(s, NULL), .width = 160, .height = 90 };
    struct gbuffer *g = gbuffer_of(s, r, &d);

    (void)state;
    for (size_t i = 0; i < 160 * 90; i++) {
        for (int c = 0; c < 3; c++) {
            double sum = 0.0;
            for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++)
                sum += (double)g->entries[k].weight[c];
            for (uint32_t k = g->miss_first[i]; k < g->miss_first[i + 1]; k++)
                sum += (double)g->misses[k].weight[c];
            assert_true(fabs(sum - 1.0) < 1e-6);
        }
    }
    assert_true(g->edge_pixels > 1000);
    gbuffer_destroy(g);
    rays_destroy(r);
    scene_destroy(s);
}

static void background_is_one_escape_through_the_pixel_centre(void **state)
{
    const float quad[4][3] = { { 0.5f, 0.5f, 0 }, { 2, 0.5f, 0 }, { 2, 2, 0 }, { 0.5f, 2, 0 } };

    (void)state;
    struct view v = view_quads(quad, 1, 4);
    for (uint32_t y = 0; y < 64; y++) {
        for (uint32_t x = 0; x < 64; x++) {
            const size_t i = (size_t)y * 64 + x;
            if (weight_of_misses(v.g, x, y) == 0.0f)
                continue;
            assert_int_equal(v.g->miss_first[i + 1] - v.g->miss_first[i], 1);
            const struct vec3 w = v.g->misses[v.g->miss_first[i]].direction;
            /* edges have the mean of what missed, which is nearby */
            const float room = v.g->entry_first[i] == v.g->entry_first[i + 1] && x < 40 ? 1e-6f : 0.01f;
            const struct vec3 want =
                vec3_normalize(vec3_make(((float)x - 31.5f) / 32.0f, (31.5f - (float)y) / 32.0f, -1));
            assert_true(vec3_length(vec3_sub(w, want)) <= room);
            assert_float_equal(vec3_length(w), 1.0f, 1e-6f);
        }
    }
    view_end(&v);
}

static bool same_gbuffer(const struct gbuffer *a, const struct gbuffer *b)
{
    const size_t pixels = (size_t)a->width * a->height;

    return a->packet_count == b->packet_count && a->point_count == b->point_count && a->camera_rays == b->camera_rays &&
           a->edge_pixels == b->edge_pixels && a->cut_weight == b->cut_weight &&
           memcmp(a->entry_first, b->entry_first, (pixels + 1) * sizeof(uint32_t)) == 0 &&
           memcmp(a->miss_first, b->miss_first, (pixels + 1) * sizeof(uint32_t)) == 0 &&
           memcmp(a->entries, b->entries, a->point_count * sizeof(*a->entries)) == 0 &&
           memcmp(a->misses, b->misses, a->miss_first[pixels] * sizeof(*a->misses)) == 0 &&
           memcmp(a->packets, b->packets, a->packet_count * sizeof(*a->packets)) == 0;
}

static void same_bits_at_any_number_of_threads(void **state)
{
    struct scene *s = scene_create_builtin();
    (void)state;

    for (size_t i = 0; i < s->material_count; i++) {
        if (strcmp(s->materials[i].name, "glaze") == 0) {
            s->materials[i].kind = MATERIAL_GLASS; /* with chains too */
            s->materials[i].ior = 1.5f;
        }
    }
    struct rays *r = rays_create_for(s, cpu_best());
    const struct gbuffer_desc d = { .camera = scene_camera(s, NULL), .width = 200, .height = 112 };
    omp_set_num_threads(1);
    struct gbuffer *one = gbuffer_of(s, r, &d);
    for (int threads = 2; threads <= 7; threads += 5) {
        omp_set_num_threads(threads);
        struct gbuffer *many = gbuffer_of(s, r, &d);
        assert_true(same_gbuffer(one, many));
        gbuffer_destroy(many);
    }
    gbuffer_destroy(one);
    rays_destroy(r);
    scene_destroy(s);
}

/* Every lane in use is some entry's, once; the others repeat the last and are not valid. */
static void packets_are_whole(void **state)
{
    struct scene *s = scene_create_builtin();
    struct rays *r = rays_create_for(s, cpu_best());
    const struct gbuffer_desc d = { .camera = scene_camera(s, NULL), .width = 160, .height = 90 };
    struct gbuffer *g = gbuffer_of(s, r, &d);
    uint8_t *used = mem_alloc((size_t)g->packet_count * PACKET, 1);
    uint64_t points = 0, kinds[3] = { 0 };

    (void)state;
    for (uint64_t i = 0; i < g->point_count; i++) {
        assert_true(g->entries[i].point < g->packet_count * PACKET);
        assert_int_equal(used[g->entries[i].point]++, 0);
    }
    for (uint32_t p = 0; p < g->packet_count; p++) {
        const struct shade_packet *k = &g->packets[p];
        assert_in_range(k->count, 1, PACKET);
        points += k->count;
        kinds[k->kind]++;
        for (uint32_t lane = 0; lane < PACKET; lane++) {
            const struct material *m = &s->materials[k->material[lane]];
            assert_int_equal(used[p * PACKET + lane], lane < k->count);
            assert_int_equal(k->valid[lane], lane < k->count ? -1 : 0);
            assert_int_equal(k->kind, m->kind == MATERIAL_PHONG ? LOBE_PHONG : LOBE_LAMBERT);
            assert_float_equal(k->diffuse[1][lane], m->diffuse.y, 1e-6f);
            assert_float_equal(k->gloss[lane], m->kind == MATERIAL_PHONG ? m->exponent : 0.0f, 0.0f);
            const uint32_t last = k->count - 1;
            if (lane >= k->count)
                assert_true(k->x[lane] == k->x[last] && k->ng_z[lane] == k->ng_z[last] &&
                            k->wo_y[lane] == k->wo_y[last]);
        }
    }
    assert_int_equal(points, g->point_count);
    assert_true(kinds[LOBE_PHONG] > 5 && kinds[LOBE_LAMBERT] > 100);
    mem_free(used);
    gbuffer_destroy(g);
    rays_destroy(r);
    scene_destroy(s);
}

static void packets_are_near_each_other(void **state)
{
    const float wall[4][3] = { { -2, -2, 0 }, { 2, -2, 0 }, { 2, 2, 0 }, { -2, 2, 0 } };

    (void)state;
    struct view v = view_quads(wall, 1, 4);
    assert_int_equal(v.g->point_count, 64 * 64);
    assert_int_equal(v.g->packet_count, 64 * 4);
    for (uint32_t p = 0; p < v.g->packet_count; p++) {
        const struct shade_packet *k = &v.g->packets[p];
        for (int lane = 1; lane < PACKET; lane++) { /* blocks of 4 x 4 pixels of 1/32 m */
            assert_true(fabsf(k->x[lane] - k->x[0]) < 3.5f / 32.0f);
            assert_true(fabsf(k->y[lane] - k->y[0]) < 3.5f / 32.0f);
        }
    }
    view_end(&v);
}

static void normals_face_the_viewer_and_points_lie_on_that_side(void **state)
{
    /* its outside faces away from the camera */
    const float wall[4][3] = { { -2, -2, 0 }, { -2, 2, 0 }, { 2, 2, 0 }, { 2, -2, 0 } };

    (void)state;
    struct view v = view_quads(wall, 1, 4);
    for (uint32_t p = 0; p < v.g->packet_count; p++) {
        for (int lane = 0; lane < PACKET; lane++) {
            const struct shade_packet *k = &v.g->packets[p];
            assert_float_equal(k->ng_z[lane], 1.0f, 1e-6f);
            assert_float_equal(k->ns_z[lane], 1.0f, 1e-6f);
            assert_true(k->z[lane] > 0.0f && k->z[lane] < 1e-5f);
            const struct vec3 to_eye = vec3_normalize(vec3_make(-k->x[lane], -k->y[lane], 1.0f - k->z[lane]));
            assert_float_equal(k->wo_x[lane], to_eye.x, 1e-5f);
            assert_float_equal(k->wo_y[lane], to_eye.y, 1e-5f);
            assert_float_equal(k->wo_z[lane], to_eye.z, 1e-5f);
        }
    }
    view_end(&v);
}

/* Far finer than a pixel. */
static struct texture columns_of_black_and_white(void)
{
    struct texture t;

    assert_int_equal(texture_init(&t, 64, 64, TEXTURE_SRGB), ERR_OK);
    for (int i = 0; i < 64 * 64; i++)
        memset(t.texels + 4 * (size_t)i, i % 2 ? 255 : 0, 4);
    texture_build_levels(&t);
    return t;
}

static void textures_are_averaged_over_the_pixel(void **state)
{
    const float wall[4][3] = { { -2, -2, 0 }, { 2, -2, 0 }, { 2, 2, 0 }, { -2, 2, 0 } };
    const struct gbuffer_desc d = { .camera = &front, .width = 4, .height = 4, .edge_rays = 32 };
    struct scene *s = scene_create();
    struct texture t = columns_of_black_and_white();

    (void)state;
    const struct material m = { .diffuse = { 1.0f, 0.5f, 0.0f }, .texture = 0 };
    assert_int_equal(scene_add_texture(s, &t, NULL), ERR_OK);
    assert_int_equal(scene_add_material(s, &m, NULL), ERR_OK);
    add_quads(s, 0, wall, 1);
    const float uv[8] = { 0, 0, 1.21f, 0, 1.21f, 1, 0, 1 }; /* so that no pixel's centre is like the next */
    s->meshes[0].uvs = mem_alloc(8, sizeof(float));
    memcpy(s->meshes[0].uvs, uv, sizeof(uv));
    struct rays *r = rays_create_for(s, cpu_best());
    struct gbuffer *g = gbuffer_of(s, r, &d);
    assert_int_equal(g->point_count, 16); /* one point each: colours do not part a pixel */
    for (int i = 0; i < 16; i++) {
        assert_float_equal(g->packets[0].diffuse[0][i], 0.5f, 0.08f);
        assert_float_equal(g->packets[0].diffuse[1][i], 0.25f, 0.04f);
        assert_float_equal(g->packets[0].diffuse[2][i], 0.0f, 0.0f);
    }
    gbuffer_destroy(g);
    rays_destroy(r);
    scene_destroy(s);
}

/* One ray a pixel, which covers 20 columns of a wall that is seen at 45 degrees; by its middle alone each would be
 * black or white. */
static void one_ray_sees_the_mean_of_its_footprint(void **state)
{
    const float wall[4][3] = { { -40, -40, -40 }, { 40, -40, 40 }, { 40, 40, 40 }, { -40, 40, -40 } };
    const float uv[8] = { 0, 0, 80, 0, 80, 80, 0, 80 };
    const struct gbuffer_desc d = { .camera = &front, .width = 8, .height = 8, .edge_rays = 1 };
    struct scene *s = scene_create();
    const struct material m = { .diffuse = { 1.0f, 0.5f, 0.0f }, .texture = 0 };
    struct texture t = columns_of_black_and_white();

    (void)state;
    assert_int_equal(scene_add_texture(s, &t, NULL), ERR_OK);
    assert_int_equal(scene_add_material(s, &m, NULL), ERR_OK);
    add_quads(s, 0, wall, 1);
    s->meshes[0].uvs = mem_alloc(8, sizeof(float));
    memcpy(s->meshes[0].uvs, uv, sizeof(uv));
    struct rays *r = rays_create_for(s, cpu_best());
    struct gbuffer *g = gbuffer_of(s, r, &d);
    assert_int_equal(g->point_count, 64);
    for (uint32_t i = 0; i < g->packet_count; i++)
        for (uint32_t lane = 0; lane < g->packets[i].count; lane++) {
            assert_float_equal(g->packets[i].diffuse[0][lane], 0.5f, 0.0031f); /* half a step of sRGB */
            assert_float_equal(g->packets[i].diffuse[1][lane], 0.25f, 0.0016f);
        }
    gbuffer_destroy(g);
    rays_destroy(r);
    scene_destroy(s);
}

static void ggx_carries_its_parameters(void **state)
{
    const float wall[4][3] = { { -2, -2, 0 }, { 2, -2, 0 }, { 2, 2, 0 }, { -2, 2, 0 } };
    const struct gbuffer_desc d = { .camera = &front, .width = 4, .height = 4 };
    const struct material m = {
        .kind = MATERIAL_GGX,
        .diffuse = { 0.8f, 0.4f, 0.2f },
        .metallic = 0.25f,
        .roughness = 0.5f,
        .texture = MATERIAL_NO_TEXTURE,
    };
    struct scene *s = scene_create();

    (void)state;
    assert_int_equal(scene_add_material(s, &m, NULL), ERR_OK);
    add_quads(s, 0, wall, 1);
    struct rays *r = rays_create_for(s, cpu_best());
    struct gbuffer *g = gbuffer_of(s, r, &d);
    assert_int_equal(g->packet_count, 1);
    assert_int_equal(g->packets[0].kind, LOBE_GGX);
    /* F0 = 0.23: three quarters of the base colour below the surface, and what a roughness of 0.5 returns late */
    assert_float_equal(g->packets[0].diffuse[0][3], 0.75f * 0.8f * 0.77f * 1.0485f + 0.00572f, 1e-5f);
    assert_float_equal(g->packets[0].specular[0][3], 0.75f * 0.04f + 0.25f * 0.8f, 1e-6f);
    assert_float_equal(g->packets[0].specular[2][3], 0.75f * 0.04f + 0.25f * 0.2f, 1e-6f);
    assert_float_equal(g->packets[0].gloss[3], 0.25f, 1e-6f);
    gbuffer_destroy(g);
    rays_destroy(r);
    scene_destroy(s);
}

static void sizes_and_memory_are_limited(void **state)
{
    const float wall[4][3] = { { -2, -2, 0 }, { 2, -2, 0 }, { 2, 2, 0 }, { -2, 2, 0 } };
    static const struct {
        uint32_t width, height, edge_rays;
        uint64_t max_bytes;
        const char *told;
    } cases[] = {
        { 0, 64, 0, 0, "0 x 64" },         { 64, 0, 0, 0, "64 x 0" },
        { 16385, 64, 0, 0, "16385 x 64" }, { 64, 99999, 0, 0, "64 x 99999" },
        { 64, 64, 65, 0, "65" },           { 64, 64, 0, 1000, "64 x 64" },
        { 64, 64, 0, 300000, "64 x 64" },  { 16384, 16384, 0, 1 << 20, "16384 x 16384" },
    };
    struct view v = view_quads(wall, 1, 1);

    (void)state;
    assert_true(v.g->bytes > 300000 && v.g->bytes < 600000);
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        const struct gbuffer_desc d = {
            .camera = &front,
            .width = cases[i].width,
            .height = cases[i].height,
            .edge_rays = cases[i].edge_rays,
            .max_bytes = cases[i].max_bytes,
        };
        struct reason why = { "" };
        struct gbuffer *g = v.g;
        assert_int_equal(gbuffer_create(v.scene, v.rays, &d, &g, &why), ERR_RANGE);
        assert_null(g);
        assert_non_null(strstr(why.text, cases[i].told));
    }
    view_end(&v);
}

static void building_takes_little_more_than_what_stays(void **state)
{
    const float wall[4][3] = { { -9, -9, 0 }, { 9, -9, 0 }, { 9, 9, 0 }, { -9, 9, 0 } };
    static const struct {
        uint32_t width, height;
        uint64_t max_bytes;
        enum err want;
    } cases[] = {
        { 2048, 1024, 352 << 20, ERR_OK },    /* 2^21 points of 130 bytes stay: 260 MiB */
        { 2048, 1024, 288 << 20, ERR_RANGE }, /* enough for these, but not for the building */
        { 1, 16384, 16 << 20, ERR_OK },       /* a row of one pixel takes no more than one pixel */
        { 16384, 1, 32 << 20, ERR_OK },
    };
    struct view v = view_quads(wall, 1, 1);

    (void)state;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        const struct gbuffer_desc d = {
            .camera = &front, .width = cases[i].width, .height = cases[i].height, .max_bytes = cases[i].max_bytes
        };
        struct reason why = { "" };
        struct gbuffer *g = NULL;
        struct rusage before, after;
        getrusage(RUSAGE_SELF, &before);
        assert_int_equal(gbuffer_create(v.scene, v.rays, &d, &g, &why), cases[i].want);
        getrusage(RUSAGE_SELF, &after);
#ifndef __SANITIZE_ADDRESS__ /* which keeps what is freed. ru_maxrss is in KiB; a slab goes back whole */
        assert_true((uint64_t)(after.ru_maxrss - before.ru_maxrss) * 1024 <= cases[i].max_bytes + (33 << 20));
#endif
        if (!g)
            assert_non_null(strstr(why.text, "2048 x 1024 pixels: more than the allowed 0.3 GiB"));
        gbuffer_destroy(g);
    }
    view_end(&v);
}

static void every_pixel_can_be_taken_as_an_edge(void **state)
{
    const float wall[4][3] = { { -2, -2, 0 }, { 2, -2, 0 }, { 2, 2, 0 }, { -2, 2, 0 } };
    const struct gbuffer_desc d = { .camera = &front, .width = 64, .height = 64, .edge_rays = 3, .every_pixel = true };
    struct view v = view_quads(wall, 1, 1);

    (void)state;
    struct gbuffer *g = gbuffer_of(v.scene, v.rays, &d);
    assert_int_equal(g->edge_pixels, 64 * 64);
    assert_true(g->camera_rays >= 64 * 64 * 9);
    assert_int_equal(g->point_count, 64 * 64); /* and still one point each on a plane */
    assert_int_equal(v.g->edge_pixels, 0);
    gbuffer_destroy(g);
    view_end(&v);
}

static void shared_plaza_has_a_shade_point_where_it_should(void **state)
{
    struct scene *s = load_or_fail(unit_data("../scenes/plaza.json"));
    struct rays *r = rays_create_for(s, cpu_best());
    const struct gbuffer_desc d = { .camera = scene_camera(s, NULL), .width = 160, .height = 90 };
    struct gbuffer *g = gbuffer_of(s, r, &d);

    (void)state;
    /* top left is sky, the bottom row is ground, the middle is the dragon */
    assert_float_equal(weight_of_misses(g, 0, 0), 1.0f, 1e-6f);
    const uint32_t low = g->entries[g->entry_first[89 * 160 + 80]].point;
    assert_string_equal(s->materials[g->packets[low / PACKET].material[low % PACKET]].name, "ground");
    assert_true(fabsf(g->packets[low / PACKET].y[low % PACKET]) < 1e-4f);
    uint32_t dragon = 0;
    for (uint32_t p = 0; p < g->packet_count; p++) {
        for (uint32_t lane = 0; lane < g->packets[p].count; lane++)
            dragon += strcmp(s->materials[g->packets[p].material[lane]].name, "dragon") == 0;
    }
    assert_true(dragon > 500);
    gbuffer_destroy(g);
    rays_destroy(r);
    scene_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(quad_head_on_fills_its_pixels_and_no_other),
    cmocka_unit_test(half_covered_pixels_weigh_half),
    cmocka_unit_test(weights_sum_to_one_everywhere),
    cmocka_unit_test(background_is_one_escape_through_the_pixel_centre),
    cmocka_unit_test(same_bits_at_any_number_of_threads),
    cmocka_unit_test(packets_are_whole),
    cmocka_unit_test(packets_are_near_each_other),
    cmocka_unit_test(normals_face_the_viewer_and_points_lie_on_that_side),
    cmocka_unit_test(textures_are_averaged_over_the_pixel),
    cmocka_unit_test(one_ray_sees_the_mean_of_its_footprint),
    cmocka_unit_test(ggx_carries_its_parameters),
    cmocka_unit_test(sizes_and_memory_are_limited),
    cmocka_unit_test(building_takes_little_more_than_what_stays),
    cmocka_unit_test(every_pixel_can_be_taken_as_an_edge),
    cmocka_unit_test(shared_plaza_has_a_shade_point_where_it_should),
};

UNIT_MAIN(tests)
