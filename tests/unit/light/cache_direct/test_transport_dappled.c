/* The cache of light transport under leaves, where most points see the sun in part, and at edges, where few do. */
#include "light/cache_direct/transport.h"
#include "light/cache_direct/transports.h"
#include "light/estimators/points.h"
#include "light/estimators/worlds.h"

enum { LEAVES = 11000, SLABS = 60, WIDTH = 64, HEIGHT = 48 };

/* A floor seen from above, and small leaves at random in a layer over it: a tenth of the sun comes through. */
static struct scene *shade_of_leaves(void)
{
    static const float floor[4][3] = { { -6, 0, -6 }, { -6, 0, 6 }, { 6, 0, 6 }, { 6, 0, -6 } };
    float(*corners)[3] = mem_alloc((size_t)4 * LEAVES, sizeof(*corners));
    struct scene *s = scene_create();
    struct rng r = { 7 };

    add_quads(s, add_lambert(s, 0.5f), floor, 1);
    for (uint32_t k = 0; k < LEAVES; k++) {
        const float at[3] = { (float)(6.0 * rng_next(&r) - 3.0), (float)(2.0 + rng_next(&r)),
                              (float)(6.0 * rng_next(&r) - 3.0) };
        const float a = (float)(2.0 * PI * rng_next(&r)), u[2] = { 0.06f * cosf(a), 0.06f * sinf(a) };
        const float leaf[4][3] = { { at[0] + u[0], at[1], at[2] + u[1] },
                                   { at[0] - u[1], at[1] + 0.03f, at[2] + u[0] },
                                   { at[0] - u[0], at[1], at[2] - u[1] },
                                   { at[0] + u[1], at[1] - 0.03f, at[2] - u[0] } };
        memcpy(corners[4 * (size_t)k], leaf, sizeof(leaf));
    }
    add_quads(s, add_lambert(s, 0.2f), corners, LEAVES);
    mem_free(corners);
    return s;
}

static double mean_of(const struct gbuffer *g, const float *lo)
{
    double sum = 0.0;

    for (size_t i = 0; i < (size_t)g->packet_count * 3 * PACKET; i++)
        sum += (double)lo[i];
    return sum / (3.0 * (double)g->point_count);
}

/* Where points count as dark because the first directions agree, the shade comes out too dark: by 0.78 % of all light
 * if each point decides by itself, which this is to find, and by 0.11 % as it is: always the same numbers. */
static void dappled_shade_is_not_darker_than_it_is(void **state)
{
    const struct camera above = { "above", { 0, 1.8f, 0.01f }, { 0, 0, 0 }, { 0, 0, -1 }, 1.2f };
    const struct transport_desc desc = { .seed = 8 };
    const struct direct_desc all = { .method = METHOD_MIS, .sun = true, .samples = 4096, .seed = 4 };
    const struct gbuffer_desc size = { .width = WIDTH, .height = HEIGHT, .edge_rays = 1 };
    struct gbuffer_desc seen = size;
    struct transport_frame_stats stats;
    struct direct_stats direct_stats;
    struct reason why = { "" };
    struct transport *t;
    struct gbuffer *g;
    struct world w;
    (void)state;

    world_make(&w, shade_of_leaves(), &above, WIDTH, HEIGHT, sky_environment(sky_with_sun(256, 128, 4e3f), 128, 0.0));
    seen.camera = &above;
    assert_int_equal(gbuffer_create(w.scene, w.rays, &seen, &g, &why), ERR_OK);
    const size_t packets = g->packet_count;
    float *lo = mem_alloc(packets, 3 * PACKET * sizeof(float)), *want = mem_alloc(packets, 3 * PACKET * sizeof(float));
    t = transport_of(g, w.rays, &desc);
    const struct transport_frame frame = { .end = 0 };
    assert_int_equal(transport_shade(t, w.environment, &frame, lo, &stats), ERR_OK);
    const double sum = mean_of(g, lo);
    struct direct *d = direct_create(best_kernels());
    assert_int_equal(direct_shade(d, g, w.rays, w.environment, &all, want, &direct_stats), ERR_OK);
    printf("%.4f of what it is; %u of %zu packets in penumbrae, %.2f of the light bright\n", sum / mean_of(g, want),
           stats.penumbra, packets, stats.share);
    assert_true(stats.penumbra > packets / 2);
    assert_true(fabs(sum / mean_of(g, want) - 1.0) < 0.002);
    direct_destroy(d);
    transport_destroy(t);
    gbuffer_destroy(g);
    world_finish(&w);
    mem_free(lo);
    mem_free(want);
}

/* A floor under slabs so high that a cell of the sky is wider than a block, with gaps as wide as they are. */
static struct scene *shade_of_slabs(void)
{
    static const float floor[4][3] = { { -9, 0, -9 }, { -9, 0, 9 }, { 9, 0, 9 }, { 9, 0, -9 } };
    float slabs[SLABS][4][3];
    struct scene *s = scene_create();

    for (int k = 0; k < SLABS; k++) {
        const float x = 1.0f * (float)(k - SLABS / 2);
        const float slab[4][3] = { { x - 1, 5, -20 }, { x - 0.5f, 5, -20 }, { x + 1.5f, 5, 20 }, { x + 1, 5, 20 } };
        memcpy(slabs[k], slab, sizeof(slab));
    }
    add_quads(s, add_lambert(s, 0.5f), floor, 1);
    add_quads(s, add_lambert(s, 0.2f), (const float(*)[3])slabs, SLABS);
    return s;
}

/* Points for which all samples see the sun, or none does, are lit or dark by the cache, too: a block that has a rim as
 * narrow as a point is not judged as a whole. Blocks judged by the cells that a tile is in alone have 3,000 of 40,000
 * wrong. */
static void rims_of_shadows_are_lit(void **state)
{
    const struct camera above = { "above", { 0, 1.4f, 0.01f }, { 0, 0, 0 }, { 0, 0, -1 }, 0.9f };
    const struct direct_desc all = { .method = METHOD_MIS, .sun = true, .samples = 64, .seed = 4 };
    const struct gbuffer_desc seen = { .camera = &above, .width = WIDTH, .height = HEIGHT };
    const struct transport_frame frame = { .end = 0 };
    struct transport_frame_stats stats;
    struct direct_stats direct_stats;
    struct reason why = { "" };
    struct gbuffer *g;
    struct world w;
    uint32_t wrong = 0, points = 0;
    (void)state;

    world_make(&w, shade_of_slabs(), &above, WIDTH, HEIGHT, sky_environment(sky_with_sun(512, 256, 2e5f), 256, 0.0));
    assert_int_equal(gbuffer_create(w.scene, w.rays, &seen, &g, &why), ERR_OK);
    const size_t size = (size_t)g->packet_count * 3 * PACKET;
    float *lo = mem_alloc(size, sizeof(float)), *want = mem_alloc(size, sizeof(float));
    struct transport *t = transport_of(g, w.rays, &(struct transport_desc){ .per_cell = 1 });
    struct direct *d = direct_create(best_kernels());
    for (int turn = 0; turn < 24; turn++) {
        struct environment *e = sky_environment(sky_with_sun(512, 256, 2e5f), 256, 0.37 * turn);
        float most = 0.0f, least = INFINITY;
        assert_int_equal(transport_shade(t, e, &frame, lo, &stats), ERR_OK);
        assert_int_equal(direct_shade(d, g, w.rays, e, &all, want, &direct_stats), ERR_OK);
        for (size_t i = 0; i < size; i++) {
            most = i % (3 * PACKET) < PACKET ? fmaxf(most, want[i]) : most;
            least = i % (3 * PACKET) < PACKET ? fminf(least, want[i]) : least;
        }
        for (size_t i = 0; i < size; i++) {
            const float full = most - least;
            if (i % (3 * PACKET) >= PACKET || (want[i] > least + 0.05f * full && want[i] < most - 0.05f * full))
                continue;
            points++;
            wrong += fabsf(lo[i] - want[i]) > 0.3f * full;
        }
        environment_destroy(e);
    }
    printf("%u of %u points wrong\n", wrong, points);
    assert_true(points > 20000);
    assert_int_equal(wrong, 0);
    direct_destroy(d);
    transport_destroy(t);
    gbuffer_destroy(g);
    world_finish(&w);
    mem_free(lo);
    mem_free(want);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(rims_of_shadows_are_lit),
    cmocka_unit_test(dappled_shade_is_not_darker_than_it_is),
};
UNIT_MAIN(tests)
