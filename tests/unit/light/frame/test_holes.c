/* Surfaces with holes under every estimator, held to two closed forms.
 *
 * A convex shell whose coverage is c everywhere, under an even sky of 1: from each place inside, a fraction f = 1 - c
 * of the directions sees the sky and c sees the shell, whatever its shape. So what falls on it at once is pi f, and
 * with indirect light pi f / (1 - a c). Radiance at once is a f, what comes by way of others a f a c / (1 - a c).
 *
 * A card over a plane: below its middle it covers the fraction F of the cosine-weighted hemisphere, which is the form
 * factor of a rectangle [Siegel and Howell 1992, configuration 4 of appendix C], and a regular pattern of holes much
 * finer than the card's distance lets through half of that: radiance a (1 - F / 2). */
#include "light/frame/agreement.h"

#include "light/cache_direct/transports.h"
#include "light/cache_indirect/indirect.h"
#include "light/estimators/courts.h"

enum { WIDTH = 24, HEIGHT = 18, SEEDS = 6 };

#define COVERAGE 0.75
#define Z_MAX 4.5

static const double albedo = 0.8;

/* A shell about the camera. */
static struct scene *shell(void)
{
    struct scene *s = scene_from(vec3_make(0, 0.2f, 0.9f), vec3_make(0, -0.5f, 0), 1.2f);
    struct material m = lambert((float)albedo);

    m.alpha_mode = ALPHA_BLEND;
    m.alpha = (float)COVERAGE;
    m.alpha_texture = MATERIAL_NO_TEXTURE;
    add_sphere(s, m, vec3_make(0, 0, 0), 1.0f, 36, 0);
    s->low = vec3_make(-1, -1, -1);
    s->high = vec3_make(1, 1, 1);
    return s;
}

static double at_once(void)
{
    return albedo * (1.0 - COVERAGE);
}

static double by_way_of_others(void)
{
    return at_once() * albedo * COVERAGE / (1.0 - albedo * COVERAGE);
}

static double mean_of_points(const struct lit *x)
{
    double sum = 0.0, count = 0.0;

    for (uint32_t i = 0; i < x->gbuffer->packet_count; i++)
        for (uint32_t l = 0; l < x->gbuffer->packets[i].count; l++) {
            sum += (double)x->lo[((size_t)i * 3 + 1) * PACKET + l];
            count++;
        }
    return sum / count;
}

static const enum method methods[] = {
    METHOD_UNIFORM, METHOD_BRDF,    METHOD_LIGHT,        METHOD_FACES_UNIFORM, METHOD_FACES,
    METHOD_MIS,     METHOD_LATLONG, METHOD_LATLONG_ROWS, METHOD_AUTO,
};

/* Every method's mean, whose error is asserted to be below half a percent (twice that in each commit, which draws a
 * quarter of the samples: a bias of 4.5 % is found), at every CPU level. */
static void assert_direct(struct lit *x, const struct environment *e, double want, double slack)
{
    for (enum cpu_level level = CPU_BASELINE; level <= cpu_best(); level++) {
        const struct kernels *kernels;
        struct reason why;
        rays_destroy(x->rays);
        x->rays = rays_create_for(x->scene, level);
        assert_int_equal(kernels_select(cpu_names[level], &kernels, &why), ERR_OK);
        struct direct *d = direct_create(kernels);
        for (size_t k = 0; k < sizeof(methods) / sizeof(methods[0]); k++) {
            struct tally tally = { 0 };
            char name[64];
            for (uint64_t seed = 0; seed < SEEDS; seed++) {
                const struct direct_desc desc = { .method = methods[k],
                                                  .samples = seeds_count(128, 512),
                                                  .seed = rng_mix(seed, k) };
                struct direct_stats stats;
                assert_int_equal(direct_shade(d, x->gbuffer, x->rays, e, &desc, x->lo, &stats), ERR_OK);
                tally_add(&tally, mean_of_points(x));
            }
            const double error = hypot(tally_error(&tally), slack * want / Z_MAX);
            snprintf(name, sizeof(name), "%s, %s", cpu_names[level], method_name(methods[k]));
            printf("%s: %.5f +- %.5f, want %.5f\n", name, tally_mean(&tally), error, want);
            assert_true(error < 5e-3 * seeds_blur(128, 512) * want && fabs(tally_mean(&tally) - want) < Z_MAX * error);
        }
        direct_destroy(d);
    }
}

static void direct_light_in_a_shell_with_holes(void **state)
{
    struct lit x = lit_create(shell(), WIDTH, HEIGHT);
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);

    (void)state;
    assert_direct(&x, e, at_once(), 0.0);
    environment_destroy(e);
    lit_destroy(&x);
}

static void eye_paths_in_a_shell_with_holes(void **state)
{
    struct lit x = lit_create(shell(), WIDTH, HEIGHT);
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
    struct tally tally = { 0 };

    (void)state;
    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        clear(&x);
        walk(&x, e, PATH_INDIRECT_LIT, PATH_INDIRECT_LIT, 256, seed);
        tally_add(&tally, mean_of_points(&x));
    }
    check_mean("eye paths", &tally, by_way_of_others(), Z_MAX, 5e-3);
    environment_destroy(e);
    lit_destroy(&x);
}

/* Both caches: their rays are drawn once, so that what they are wrong by is a number of its own. */
static void caches_in_a_shell_with_holes(void **state)
{
    struct lit x = lit_create(shell(), WIDTH, HEIGHT);
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
    struct transport *t = transport_of(x.gbuffer, x.rays, &(struct transport_desc){ .per_cell = 1 });
    const struct indirect_desc desc = { .scene = x.scene,
                                        .rays = x.rays,
                                        .gbuffer = x.gbuffer,
                                        .direct = t,
                                        .eye = x.scene->cameras[0].position,
                                        .records = 1500 };
    struct transport_frame_stats stats;
    struct indirect_cache *b;
    struct reason why;

    (void)state;
    assert_int_equal(transport_shade(t, e, &(struct transport_frame){ .end = 0 }, x.lo, &stats), ERR_OK);
    const double direct = mean_of_points(&x);
    assert_int_equal(indirect_create(&desc, best_kernels(), &b, &why), ERR_OK);
    clear(&x);
    add_indirect_alone(indirect_of_frame(b), x.gbuffer, e, x.lo);
    const double indirect = mean_of_points(&x);
    printf("transport %.5f, want %.5f; bounce %.5f, want %.5f\n", direct, at_once(), indirect, by_way_of_others());
    assert_true(fabs(direct / at_once() - 1.0) < 5e-3);
    assert_true(fabs(indirect / by_way_of_others() - 1.0) < 0.015);
    indirect_destroy(b);
    transport_destroy(t);
    environment_destroy(e);
    lit_destroy(&x);
}

/* Whole pixels by path.h, mlt.c and the light tracer: of each, the shell is c. */
static void whole_images_of_a_shell_with_holes(void **state)
{
    static const struct {
        struct technique technique;
        bool direct;
    } of[] = {
        { { "path, direct", BY_PATH, PATH_DIRECT, .count = 128 }, true },
        { { "path, indirect", BY_PATH, PATH_INDIRECT_LIT, .count = 128 }, false },
        { { "mlt, indirect", BY_MLT, PATH_INDIRECT_LIT, .count = 256 }, false },
        { { "light tracer, indirect", BY_LIGHT, PATH_INDIRECT_LIT, .count = 200000 }, false },
    };
    struct world w = { .scene = shell(), .direct = direct_create(best_kernels()) };

    (void)state;
    omp_set_num_threads(1);
    w.environment = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
    world_look(&w, WIDTH, HEIGHT);
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        const struct estimate got = measure(&w, &of[i].technique);
        const double want = COVERAGE * (of[i].direct ? at_once() : by_way_of_others());
        printf("%s: %.5f +- %.5f, want %.5f\n", of[i].technique.name, got.mean[0], got.error[0], want);
        assert_true(got.error[0] < 6e-3 * sqrt(samples_part()) * want);
        assert_true(fabs(got.mean[0] - want) < Z_MAX * got.error[0]);
    }
    world_finish(&w);
}

/* The form factor of a rectangle of the half edges a and b at distance h above its middle. */
static double form_factor(double a, double b, double h)
{
    const double x = a / h, y = b / h, p = sqrt(1.0 + x * x), q = sqrt(1.0 + y * y);
    return 2.0 / PI * (x / p * atan(y / p) + y / q * atan(x / q));
}

/* Black and so that nothing but its shadow is seen; in 512 x 512 squares of 8 mm. */
static void add_perforated_card(struct scene *s)
{
    enum { SIDE = 64, TIMES = 8 };
    static const float xz[4][2] = { { -2, -2 }, { -2, 2 }, { 2, 2 }, { 2, -2 } };
    static const uint32_t two[6] = { 0, 1, 2, 0, 2, 3 };
    struct material m = lambert(0.0f);
    struct texture *t = mem_alloc(1, sizeof(*t));

    assert_int_equal(texture_init(t, SIDE, SIDE, TEXTURE_CUTOUT), ERR_OK);
    for (uint32_t i = 0; i < SIDE * SIDE; i++)
        memset(t->texels + 4 * (size_t)i, (i % SIDE + i / SIDE) % 2 ? 255 : 0, 4);
    texture_build_levels(t);
    s->textures = t;
    s->texture_count = 1;
    m.alpha_mode = ALPHA_MASK;
    m.alpha = 1.0f;
    m.alpha_cutoff = 0.5f;
    struct mesh *card = add_mesh(s, m, 4, 2);
    card->uvs = mem_alloc(8, sizeof(float));
    memcpy(card->indices, two, sizeof(two));
    for (uint32_t k = 0; k < 4; k++) {
        card->positions[3 * k] = xz[k][0];
        card->positions[3 * k + 1] = 1.0f;
        card->positions[3 * k + 2] = xz[k][1];
        card->uvs[2 * k] = TIMES * (xz[k][0] + 2.0f) / 4.0f;
        card->uvs[2 * k + 1] = TIMES * (xz[k][1] + 2.0f) / 4.0f;
    }
}

/* The middle of the plane, 4 cm wide, from between it and the card. What is left of the pattern in the mean over these
 * points is below a thousandth. */
static void light_below_a_perforated_card(void **state)
{
    struct scene *s = scene_from(vec3_make(0, 0.5f, 0.01f), vec3_make(0, 0, 0), 0.08f);
    const double want = albedo * (1.0 - form_factor(2.0, 2.0, 1.0) / 2.0);
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
    struct transport_frame_stats stats;

    (void)state;
    add_box(s, lambert((float)albedo), vec3_make(-9, -1, -9), vec3_make(9, 0, 9));
    add_perforated_card(s);
    struct lit x = lit_create(s, WIDTH, HEIGHT);
    assert_direct(&x, e, want, 2e-3);
    struct transport *t = transport_of(x.gbuffer, x.rays, &(struct transport_desc){ .per_cell = 2 });
    assert_int_equal(transport_shade(t, e, &(struct transport_frame){ .end = 0 }, x.lo, &stats), ERR_OK);
    printf("transport: %.5f, want %.5f\n", mean_of_points(&x), want);
    assert_true(fabs(mean_of_points(&x) / want - 1.0) < 5e-3);
    transport_destroy(t);
    environment_destroy(e);
    lit_destroy(&x);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(direct_light_in_a_shell_with_holes), cmocka_unit_test(eye_paths_in_a_shell_with_holes),
    cmocka_unit_test(caches_in_a_shell_with_holes),       cmocka_unit_test(whole_images_of_a_shell_with_holes),
    cmocka_unit_test(light_below_a_perforated_card),
};
UNIT_MAIN(tests)
