/* The cache of indirect light where light goes to and fro so often that sums of series are known, and single paths. */
#include "light/cache_indirect/bounces.h"

/* A sphere of albedo a, open over a quarter of its area, keeps q = 3/4 a of the light at each bounce. Bounce i adds
 * q^i. All bounces together add 1 / (1 - q), and those after bounce i q^(i + 1) / (1 - q), a share of q^(i + 1). The
 * series may end when this share is below 1/1000: for q = 9/20 after 8 bounces ((9/20)^8 = 0.0017, (9/20)^9 = 0.0008),
 * for q = 27/40 after 17 ((27/40)^17 = 0.0013, (27/40)^18 = 0.0008). */
static void the_series_ends_when_little_is_left(void **state)
{
    static const struct {
        double albedo;
        uint32_t bounces;
    } cases[2] = { { 0.6, 8 }, { 0.9, 17 } };
    (void)state;

    for (int k = 0; k < 2; k++) {
        struct scene *s = scene_from(vec3_make(0, 0.2f, 0.9f), vec3_make(0, -0.5f, 0), 1.2f);
        add_sphere(s, lambert((float)cases[k].albedo), vec3_make(0, 0, 0), 1.0f, 36, 12);
        struct lit x = lit_create(s, 12, 9);
        struct transport *t = direct_of(&x);
        struct indirect_desc desc = desc_of(&x, t, 1);
        struct indirect_cache *b;
        struct reason why;
        desc.records = 200;
        desc.gather = 4;
        assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
        printf("albedo %.1f: %u bounces, want %u\n", cases[k].albedo, indirect_stats(b)->bounces, cases[k].bounces);
        assert_int_equal(indirect_stats(b)->bounces, cases[k].bounces);
        indirect_destroy(b);
        transport_destroy(t);
        lit_destroy(&x);
    }
}

/* The directional albedo of a lane's lobe, by quadrature over its hemisphere. */
static double albedo_of(const struct shade_packet *p, uint32_t l)
{
    enum { ROWS = 64, COLUMNS = 128 };
    const struct lobe lobe = lobe_of_lane(p, l);
    const struct vec3 wo = vec3_make(p->wo_x[l], p->wo_y[l], p->wo_z[l]);
    double sum = 0.0;

    for (int i = 0; i < ROWS; i++)
        for (int j = 0; j < COLUMNS; j++) {
            const double cosine = sqrt((i + 0.5) / ROWS), sine = sqrt(1.0 - cosine * cosine);
            const double phi = 2.0 * PI * (j + 0.5) / COLUMNS;
            double brdf[3];
            lobe_evaluate(&lobe, wo, frame_direction(lobe.shading, sine * cos(phi), sine * sin(phi), cosine), brdf);
            sum += brdf[1] * PI / (ROWS * COLUMNS);
        }
    return sum;
}

/* A small metal plate within such a sphere, which faces its closed part, sees the same radiance L = a f / (1 - a (1 -
 * f)) all around, and sends on what its albedo in the viewer's direction leaves of it: seen flatly, where a lobe's rays
 * and those of the matte part meet with densities that differ the most. */
static void a_metal_plate_reflects_the_sphere_around(void **state)
{
    const double a = 0.8, f = 0.25, radiance = a * f / (1.0 - a * (1.0 - f));
    struct scene *s = scene_from(vec3_make(0, 0.1f, 0.6f), vec3_make(0, 0.3f, 0), 0.4f);
    struct material metal = { .kind = MATERIAL_GGX, .diffuse = { 0.9f, 0.9f, 0.9f }, .metallic = 1.0f };
    (void)state;

    metal.roughness = 0.75f;
    add_sphere(s, lambert((float)a), vec3_make(0, 0, 0), 1.0f, 36, 12);
    add_box(s, metal, vec3_make(-0.15f, 0.3f, -0.1f), vec3_make(0.15f, 0.31f, 0.1f));
    struct lit x = lit_create(s, 32, 24);
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
    struct transport *t = direct_of(&x);
    struct indirect_desc desc = desc_of(&x, t, 3);
    struct indirect_cache *b;
    struct reason why;
    double got = 0.0, want = 0.0, count = 0.0;
    desc.records = 300;
    desc.gather = 128;
    assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
    shade_indirect(b, &x, e);
    for (uint32_t i = 0; i < x.gbuffer->packet_count; i++) {
        const struct shade_packet *p = &x.gbuffer->packets[i];
        for (uint32_t l = 0; l < p->count && p->kind == LOBE_GGX; l++)
            if (p->ng_y[l] < -0.9f) {
                got += (double)x.lo[((size_t)i * 3 + 1) * PACKET + l];
                want += radiance * albedo_of(p, l);
                count += 1.0;
            }
    }
    printf("%.0f points: %.4f, want %.4f\n", count, got / count, want / count);
    assert_true(count > 50.0 && t->narrow.count == 0 && fabs(got / want - 1.0) < 0.04);
    indirect_destroy(b);
    transport_destroy(t);
    environment_destroy(e);
    lit_destroy(&x);
}

/* A closed box is dark, where the weights of errors have no light to be relative to. Each path ends where it first
 * hits, so that the basis takes 512 rays from each of 1,536 points and 512 records; the 20 records and the few points
 * take less. */
static void a_closed_box_is_dark(void **state)
{
    struct scene *s = scene_from(vec3_make(0, 0.2f, 0.9f), vec3_make(0, -0.5f, 0), 1.2f);
    (void)state;

    add_box(s, lambert(0.5f), vec3_make(-1, -1, -1), vec3_make(1, 1, 1));
    struct lit x = lit_create(s, 12, 9);
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 16, 0.0);
    struct transport *t = direct_of(&x);
    struct indirect_desc desc = desc_of(&x, t, 7);
    struct indirect_cache *b;
    struct reason why;
    desc.gather = 4;
    desc.records = 20;
    assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
    assert_true(indirect_stats(b)->records > 0);
    printf("%.0f rays\n", (double)indirect_stats(b)->rays);
    assert_in_range(indirect_stats(b)->rays, 2048 * 512, 2048 * 512 + 150000);
    shade_indirect(b, &x, e);
    for (size_t i = 0; i < x.size; i++)
        assert_true(x.lo[i] == 0.0f);
    for (uint32_t k = 0; k < b->group_count; k++)
        assert_int_equal(b->groups[k].pieces[0].rank, 0);
    indirect_destroy(b);
    desc.gather = desc.records = 0;
    desc.quick = true; /* what nothing sees the sky of waits for the full one */
    assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
    assert_null(b);
    transport_destroy(t);
    environment_destroy(e);
    lit_destroy(&x);
}

/* Beneath a wide leaf, which sends 0.4 * 0.9 of the light back and 0.6 * 0.7 through, and alone under the sky: paths
 * choose one of its sides, with weights that make up for it, and meet no record, so that all they bring comes from
 * cells: 0.78 of the sky for a path in the mean. 40,000 paths have an error of 0.005. */
static void a_leaf_sends_light_to_both_sides(void **state)
{
    enum { PATHS = 40000 };
    const struct material leaf = { .kind = MATERIAL_LAMBERT,
                                   .diffuse = { 0.9f, 0.9f, 0.9f },
                                   .transmits = 0.6f,
                                   .through = { 0.7f, 0.7f, 0.7f },
                                   .through_texture = MATERIAL_NO_TEXTURE };
    struct scene *s = scene_from(vec3_make(0, 0, 0), vec3_make(0, 1, 0.1f), 1.0f);
    struct mesh *m = add_mesh(s, leaf, 3, 1);
    struct indirect_records records = { .eye = s->cameras[0].position, .angle = 0.01f };
    struct indirect_spots none = { .at = NULL };
    struct indirect_ends ends = { .at = NULL };
    struct rng r = { 11 };
    double sum = 0.0;
    (void)state;

    memcpy(m->positions, (const float[]){ -9e3f, 1, -9e3f, 9e3f, 1, -9e3f, 0, 1, 9e3f }, 9 * sizeof(float));
    memcpy(m->indices, (const uint32_t[]){ 0, 1, 2 }, 3 * sizeof(uint32_t));
    struct lit x = lit_create(s, 4, 4);
    assert_int_equal(indirect_records_init(&records, &none, 1), ERR_OK);
    const struct indirect_world world = { s, x.rays, &records, NULL };
    for (int k = 0; k < PATHS; k++) {
        const double z = sqrt(rng_next(&r)), phi = 2.0 * PI * rng_next(&r), side = sqrt(1.0 - z * z);
        const struct vec3 up = { (float)(side * cos(phi)), (float)z, (float)(side * sin(phi)) };
        indirect_walk(&world, vec3_make(0, 0, 0), up, &r, &ends);
    }
    for (uint32_t k = 0; k < ends.count; k++)
        sum += (double)ends.at[k].weight[1];
    printf("%.4f, want 0.78\n", sum / PATHS);
    assert_true(fabs(sum / PATHS - 0.78) < 0.02);
    mem_free(ends.at);
    indirect_records_finish(&records);
    lit_destroy(&x);
}

/* Records of random places on a plane seen from above, and the size of their voxels. */
static uint32_t count_records(float *angle, uint32_t most)
{
    enum { SPOTS = 5000 };
    const struct vec3 up = { 0.0f, 1.0f, 0.0f };
    struct indirect_records records = { .eye = { 0.0f, 5.0f, 0.0f }, .angle = *angle };
    struct indirect_spots spots = { .at = mem_alloc(SPOTS, sizeof(*spots.at)), .count = SPOTS };
    struct rng r = { 12 };

    for (uint32_t k = 0; k < SPOTS; k++)
        spots.at[k] =
            (struct indirect_spot){ .at = { (float)(20.0 * rng_next(&r)), 0.0f, (float)(20.0 * rng_next(&r)) },
                                    .geometric = up,
                                    .shading = up,
                                    .length = 1e3f,
                                    .order = k };
    assert_int_equal(indirect_records_init(&records, &spots, most), ERR_OK);
    const uint32_t count = records.count;
    *angle = records.angle;
    mem_free(spots.at);
    indirect_records_finish(&records);
    return count;
}

/* Voxels grow only until there are few enough. Sizes are powers of two, so the last step may take away half of them. */
static void voxels_are_the_smallest_that_are_few_enough(void **state)
{
    float grown = 1e-3f;
    (void)state;

    const uint32_t count = count_records(&grown, 300);
    float before = grown / 1.25f;
    const uint32_t more = count_records(&before, 5000);
    printf("%u records, %u with smaller voxels\n", count, more);
    assert_true(count <= 300 && count > 60 && more > 300);
    assert_true(before == grown / 1.25f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(voxels_are_the_smallest_that_are_few_enough),
    cmocka_unit_test(a_leaf_sends_light_to_both_sides),
    cmocka_unit_test(the_series_ends_when_little_is_left),
    cmocka_unit_test(a_metal_plate_reflects_the_sphere_around),
    cmocka_unit_test(a_closed_box_is_dark),
};
UNIT_MAIN(tests)
