/* Surfaces that scatter light to their other side, under every estimator, held to closed forms.
 *
 * A closed convex shell reflects a share r of the light and transmits a share t, under an even sky of 1. Inside, the
 * shell has the radiance t by direct light in all directions. Every further bounce multiplies it by r, so the indirect
 * light is t r / (1 - r). */
#include "light/frame/agreement.h"

#include "light/cache_direct/transports.h"
#include "light/cache_indirect/indirect.h"
#include "light/estimators/courts.h"
#include "scene/geometry/scatter_hit.h"
#include "scene/surface/lobe.h"

enum { WIDTH = 24, HEIGHT = 18, SEEDS = 6 };

#define Z_MAX 4.5

#define FACTOR 0.6f /* of the matte part, that goes to the other side */
static const float albedo = 0.9f, colour = 0.7f;
static const double reflects = (double)(0.4f * 0.9f), transmits = (double)(0.6f * 0.7f);

static struct material leaf(enum material_kind kind)
{
    return (struct material){ .kind = kind,
                              .diffuse = { albedo, albedo, albedo },
                              .roughness = 0.6f,
                              .transmits = FACTOR,
                              .through = { colour, colour, colour },
                              .through_texture = MATERIAL_NO_TEXTURE };
}

/* A shell about the camera. */
static struct scene *shell(struct material m)
{
    struct scene *s = scene_from(vec3_make(0, 0.2f, 0.5f), vec3_make(0, -0.5f, 0), 1.2f);

    add_sphere(s, m, vec3_make(0, 0, 0), 1.0f, 24, 0);
    s->low = vec3_make(-1, -1, -1);
    s->high = vec3_make(1, 1, 1);
    return s;
}

static struct world world_of(struct scene *s)
{
    struct world w = { .scene = s, .direct = direct_create(best_kernels()) };

    omp_set_num_threads(1);
    w.environment = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
    world_look(&w, WIDTH, HEIGHT);
    return w;
}

/* The mean of the pixels. */
static double mean_of_pixels(const struct lit *x)
{
    const struct gbuffer *g = x->gbuffer;
    double sum = 0.0;

    for (uint32_t i = 0; i < g->entry_first[WIDTH * HEIGHT]; i++) {
        const uint32_t at = g->entries[i].point;
        sum += (double)g->entries[i].weight[1] * (double)x->lo[((size_t)(at / PACKET) * 3 + 1) * PACKET + at % PACKET];
    }
    return sum / (WIDTH * HEIGHT);
}

static void assert_shell(const struct technique *of, size_t count, struct material m, const double want[])
{
    struct world w = world_of(shell(m));

    for (size_t i = 0; i < count; i++) {
        const struct estimate got = measure(&w, &of[i]);
        printf("%s: %.5f +- %.5f, want %.5f\n", of[i].name, got.mean[0], got.error[0], want[i]);
        assert_true(got.error[0] < 1e-2 * want[i] && fabs(got.mean[0] - want[i]) < Z_MAX * got.error[0] + 1e-5);
    }
    world_finish(&w);
}

static void light_in_a_shell_that_transmits(void **state)
{
    const double at_once = transmits, later = transmits * reflects / (1.0 - reflects);
    static const struct technique of[] = {
        { "brdf", BY_DIRECT, .count = 128, .direct = { .method = METHOD_BRDF } },
        { "mis", BY_DIRECT, .count = 256, .direct = { .method = METHOD_MIS } },
        { "latlong", BY_DIRECT, .count = 128, .direct = { .method = METHOD_LATLONG } },
        { "path, direct", BY_PATH, PATH_DIRECT, .count = 128 },
        { "eye paths, indirect", BY_EYE, PATH_INDIRECT_LIT, .count = 256 },
        { "path, indirect", BY_PATH, PATH_INDIRECT_LIT, .count = 128 },
        { "mlt, indirect", BY_MLT, PATH_INDIRECT_LIT, .count = 128 },
        { "light tracer, indirect", BY_LIGHT, PATH_INDIRECT_LIT, .count = 240000 },
    };
    const double want[] = { at_once, at_once, at_once, at_once, later, later, later, later };

    (void)state;
    assert_shell(of, sizeof(of) / sizeof(of[0]), leaf(MATERIAL_LAMBERT), want);
}

/* Both caches: their rays are drawn once, so that what they are wrong by is a number of its own. */
static void caches_in_a_shell_that_transmits(void **state)
{
    struct lit x = lit_create(shell(leaf(MATERIAL_LAMBERT)), WIDTH, HEIGHT);
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
    struct transport *t = transport_of(x.gbuffer, x.rays, &(struct transport_desc){ .per_cell = 1 });
    const struct indirect_desc desc = { .scene = x.scene,
                                        .rays = x.rays,
                                        .gbuffer = x.gbuffer,
                                        .direct = t,
                                        .eye = x.scene->cameras[0].position,
                                        .records = 1500 };
    const double later = transmits * reflects / (1.0 - reflects);
    struct transport_frame_stats stats;
    struct indirect_cache *b;
    struct reason why;

    (void)state;
    assert_int_equal(transport_shade(t, e, &(struct transport_frame){ .end = 0 }, x.lo, &stats), ERR_OK);
    const double direct = mean_of_pixels(&x);
    assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
    clear(&x);
    add_indirect_alone(indirect_of_frame(b), x.gbuffer, e, x.lo);
    const double indirect = mean_of_pixels(&x);
    printf("transport %.5f, want %.5f; bounce %.5f, want %.5f\n", direct, transmits, indirect, later);
    assert_true(fabs(direct / transmits - 1.0) < 5e-3);
    assert_true(fabs(indirect / later - 1.0) < 0.02);
    indirect_destroy(b);
    transport_destroy(t);
    environment_destroy(e);
    lit_destroy(&x);
}

/* With a lobe in front there is no closed form: eye and light paths agree, and with the reference. Nothing but white
 * would stay white: the sum of all light below 1. */
static void both_sides_agree_where_leaves_shine(void **state)
{
    static const struct technique of[] = {
        { "path", BY_PATH, PATH_INDIRECT_LIT, .count = 128 },
        { "eye paths", BY_EYE, PATH_INDIRECT_LIT, .count = 128 },
        { "light tracer", BY_LIGHT, PATH_INDIRECT_LIT, .count = 200000 },
        { "path, direct", BY_PATH, PATH_DIRECT, .count = 128 },
        { "mis", BY_DIRECT, .count = 256, .direct = { .method = METHOD_MIS } },
    };
    struct world w = world_of(shell(leaf(MATERIAL_GGX)));
    struct estimate got[5];

    (void)state;
    for (int i = 0; i < 5; i++) {
        got[i] = measure(&w, &of[i]);
        const int reference = i < 3 ? 0 : 3;
        const double error = hypot(got[i].error[0], got[reference].error[0]);
        printf("%s: %.5f +- %.5f\n", of[i].name, got[i].mean[0], got[i].error[0]);
        assert_true(error < 8e-3 * sqrt(samples_part()) * got[reference].mean[0]);
        assert_true(i == reference || fabs(got[i].mean[0] - got[reference].mean[0]) < Z_MAX * error);
    }
    assert_true(got[0].mean[0] + got[3].mean[0] < 1.0);
    world_finish(&w);
}

/* The share of an even sky's light that a white horizontal leaf sends to a direction, by quadrature of both lobes. */
static double albedo_towards(double cosine, enum material_kind kind, float factor)
{
    enum { STEPS = 300 };
    static const float q[4][3] = { { -1, 0, -1 }, { -1, 0, 1 }, { 1, 0, 1 }, { 1, 0, -1 } };
    static const uint32_t two[6] = { 0, 1, 2, 0, 2, 3 };
    struct scene *s = scene_from(vec3_make(0, 1, 0), vec3_make(0, 0, 0), 1.0f);
    struct material m = leaf(kind);
    const float x = (float)sqrt(1.0 - cosine * cosine), y = (float)cosine;
    const struct vec3 dir = vec3_make(-x, -y, 0.0f);
    struct scatter at;
    struct hit h;
    double sum = 0.0;

    m.diffuse = m.through = vec3_make(1, 1, 1);
    m.transmits = factor;
    struct mesh *mesh = add_mesh(s, m, 4, 2);
    memcpy(mesh->indices, two, sizeof(two));
    memcpy(mesh->positions, q, sizeof(q));
    struct rays *r = rays_create_for(s, cpu_best());
    assert_true(rays_intersect(r, vec3_make(x, y, 0.0f), dir, 0.0f, &h));
    rays_surface(r, &h, vec3_scale(dir, -1.0f), &at.surface);
    scatter_on(s, &h, NULL, &at);
    for (int side = 0; side < 2; side++) {
        const struct lobe l = lobe_of(&at);
        const struct vec3 wo = scatter_side(&at, vec3_scale(dir, -1.0f));
        for (int i = 0; i < STEPS; i++)
            for (int k = 0; k < STEPS; k++) {
                const double u = (i + 0.5) / STEPS, phi = 2.0 * PI * (k + 0.5) / STEPS, rho = sqrt(u);
                double brdf[3];
                lobe_evaluate(&l, wo, frame_direction(l.shading, rho * cos(phi), rho * sin(phi), sqrt(1.0 - u)), brdf);
                sum += brdf[0] * PI / (STEPS * STEPS);
            }
        scatter_turn(&at);
    }
    rays_destroy(r);
    scene_destroy(s);
    return sum;
}

/* What is transmitted is missing from what is reflected: a white leaf is as white as a wall, from every angle. */
static void a_white_leaf_keeps_its_light(void **state)
{
    (void)state;
    for (double cosine = 0.1; cosine < 1.0; cosine += 0.2) {
        const double matte = albedo_towards(cosine, MATERIAL_LAMBERT, FACTOR);
        const double leaf_s = albedo_towards(cosine, MATERIAL_GGX, FACTOR),
                     wall_s = albedo_towards(cosine, MATERIAL_GGX, 0.0f);
        printf("cosine %.1f: %.5f, %.5f and %.5f\n", cosine, matte, leaf_s, wall_s);
        assert_float_equal(matte, 1.0, 1e-3);
        assert_float_equal(leaf_s, wall_s, 1e-3);
        assert_true(leaf_s < 1.0);
    }
}

/* Light from below alone reaches the eye above by what is transmitted, and light from above by what is reflected. */
static void each_side_has_its_own_light(void **state)
{
    static const uint32_t rows[2] = { 8, 31 - 8 }; /* as far above the horizon as below it */
    static const uint32_t two[6] = { 0, 1, 2, 0, 2, 3 };
    static const float q[4][3] = { { -9, 0, -9 }, { -9, 0, 9 }, { 9, 0, 9 }, { 9, 0, -9 } };
    double first = 0.0;

    (void)state;
    for (int below = 0; below < 2; below++) {
        struct scene *s = scene_from(vec3_make(0, 2, 0.01f), vec3_make(0, 0, 0), 0.5f);
        struct mesh *mesh = add_mesh(s, leaf(MATERIAL_LAMBERT), 4, 2);
        memcpy(mesh->indices, two, sizeof(two));
        memcpy(mesh->positions, q, sizeof(q));
        s->low = vec3_make(-9, 0, -9);
        s->high = vec3_make(9, 0, 9);
        struct world w = world_of(s);
        environment_destroy(w.environment);
        struct frame f = sky_constant(64, 32, 0.0f);
        sky_paint(&f, 20, rows[below], 1000.0f, 1000.0f, 1000.0f);
        w.environment = sky_environment(f, 64, 0.0);
        const struct technique of[2] = {
            { "light", BY_DIRECT, .count = 16, .direct = { .method = METHOD_LIGHT } },
            { "path", BY_PATH, PATH_DIRECT, .count = 64 },
        };
        struct estimate got[2];
        for (int i = 0; i < 2; i++) {
            got[i] = measure(&w, &of[i]);
            printf("%s: %.6f +- %.6f\n", of[i].name, got[i].mean[0], got[i].error[0]);
        }
        assert_true(got[0].mean[0] > 0.0);
        assert_true(fabs(got[0].mean[0] / got[1].mean[0] - 1.0) < 0.01);
        first = below ? first : got[0].mean[0];
        assert_true(!below || fabs(got[0].mean[0] / first / (transmits / reflects) - 1.0) < 0.01);
        world_finish(&w);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_white_leaf_keeps_its_light),        cmocka_unit_test(each_side_has_its_own_light),
    cmocka_unit_test(light_in_a_shell_that_transmits),     cmocka_unit_test(caches_in_a_shell_that_transmits),
    cmocka_unit_test(both_sides_agree_where_leaves_shine),
};
UNIT_MAIN(tests)
