/* Panes of glass under every estimator, held to quadrature: solid ones that attenuate, whose light is caustics, and
 * thin ones, through which direct light passes.
 *
 * A floor of albedo a below a wide pane, under an even sky of 1, is a 2 int T(c) c dc bright, T(c) being what passes
 * the pane at the cosine c. Beside a wide upright pane of clear thin glass, which keeps all light, it is a: half of the
 * hemisphere and what passes the pane by direct light, what the pane reflects by caustics. */
#include "light/frame/agreement.h"

#include "light/cache_direct/transports.h"
#include "light/estimators/courts.h"

enum { WIDTH = 16, HEIGHT = 12, SEEDS = 6 };

#define Z_MAX 4.5
#define FAR 60.0f

static const double albedo = 0.5;

static double fresnel_of(double c)
{
    const double t = sqrt(1.0 - (1.0 - c * c) / 2.25), p = (1.5 * c - t) / (1.5 * c + t),
                 q = (c - 1.5 * t) / (c + 1.5 * t);
    return 0.5 * (p * p + q * q);
}

/* What passes two faces with exp(-depth / cos_t) between them, all orders together. */
static double passing(double c, double depth)
{
    const double f = fresnel_of(c), a = exp(-depth / sqrt(1.0 - (1.0 - c * c) / 2.25));
    return (1.0 - f) * (1.0 - f) * a / (1.0 - f * f * a * a);
}

static double below(double depth)
{
    enum { STEPS = 20000 };
    double sum = 0.0;

    for (int i = 0; i < STEPS; i++) {
        const double c = (i + 0.5) / STEPS;
        sum += 2.0 * passing(c, depth) * c / STEPS;
    }
    return albedo * sum;
}

/* What a wide upright pane passes of the half of the hemisphere behind it. */
static double beside(void)
{
    enum { STEPS = 1000 };
    double sum = 0.0;

    for (int i = 0; i < STEPS; i++)
        for (int k = 0; k < STEPS; k++) {
            const double u = (i + 0.5) / STEPS, phi = PI * ((k + 0.5) / STEPS - 0.5);
            sum += passing(sqrt(u) * cos(phi), 0.0); /* cosine-weighted: the sine of the polar angle is the root of u */
        }
    return albedo * 0.5 * sum / ((double)STEPS * STEPS);
}

static struct material thin(void)
{
    struct material m = glass(1.5f);

    m.thin = 1;
    m.alpha_texture = MATERIAL_NO_TEXTURE;
    return m;
}

static void add_sheet(struct scene *s, struct material m, const float q[4][3])
{
    static const uint32_t two[6] = { 0, 1, 2, 0, 2, 3 };
    struct mesh *sheet = add_mesh(s, m, 4, 2);

    memcpy(sheet->indices, two, sizeof(two));
    memcpy(sheet->positions, q, 12 * sizeof(float));
}

static struct scene *floor_from(struct vec3 eye, struct vec3 target, float fov)
{
    struct scene *s = scene_from(eye, target, fov);

    add_box(s, lambert((float)albedo), vec3_make(-FAR, -1, -FAR), vec3_make(FAR, 0, FAR));
    s->low = vec3_make(-FAR, -1, -FAR);
    s->high = vec3_make(FAR, FAR, FAR);
    return s;
}

static struct scene *below_pane(const struct material *m)
{
    struct scene *s = floor_from(vec3_make(0, 0.5f, 0.01f), vec3_make(0, 0, 0), 0.3f);
    const float q[4][3] = { { -FAR, 1, -FAR }, { -FAR, 1, FAR }, { FAR, 1, FAR }, { FAR, 1, -FAR } };

    if (m->thin)
        add_sheet(s, *m, q);
    else
        add_box(s, *m, vec3_make(-FAR, 1.0f, -FAR), vec3_make(FAR, 1.02f, FAR));
    return s;
}

static struct scene *beside_pane(void)
{
    struct scene *s = floor_from(vec3_make(0.04f, 0.1f, 0.001f), vec3_make(0.04f, 0, 0), 0.1f);
    const float q[4][3] = { { 0, 0, -FAR }, { 0, FAR, -FAR }, { 0, FAR, FAR }, { 0, 0, FAR } };

    add_sheet(s, thin(), q);
    return s;
}

static double mean_of_points(const struct lit *x)
{
    double sum = 0.0;

    for (uint32_t i = 0; i < x->gbuffer->packet_count; i++)
        for (uint32_t l = 0; l < x->gbuffer->packets[i].count; l++)
            sum += (double)x->lo[((size_t)i * 3 + 1) * PACKET + l];
    return sum / (double)x->gbuffer->point_count;
}

static void assert_caustics(struct lit *x, const struct environment *e, uint32_t paths, double want)
{
    struct tally tally = { 0 };

    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        clear(x);
        walk(x, e, PATH_CAUSTICS, PATH_CAUSTICS, paths, seed);
        tally_add(&tally, mean_of_points(x));
    }
    printf("want %.5f\n", want);
    check_mean("eye paths", &tally, want, Z_MAX, 4e-3);
}

/* By every method, and by the cache. */
static void assert_direct(struct lit *x, const struct environment *e, double want)
{
    static const enum method methods[] = { METHOD_UNIFORM,       METHOD_BRDF,         METHOD_LIGHT,
                                           METHOD_FACES_UNIFORM, METHOD_FACES,        METHOD_MIS,
                                           METHOD_LATLONG,       METHOD_LATLONG_ROWS, METHOD_AUTO };
    struct direct *d = direct_create(best_kernels());
    struct transport_frame_stats stats;

    for (size_t k = 0; k < sizeof(methods) / sizeof(methods[0]); k++) {
        struct tally tally = { 0 };
        for (uint64_t seed = 0; seed < SEEDS; seed++) {
            const struct direct_desc desc = { .method = methods[k], .samples = 512, .seed = rng_mix(seed, k) };
            struct direct_stats of_run;
            assert_int_equal(direct_shade(d, x->gbuffer, x->rays, e, &desc, x->lo, &of_run), ERR_OK);
            tally_add(&tally, mean_of_points(x));
        }
        printf("want %.5f\n", want);
        check_mean(method_name(methods[k]), &tally, want, Z_MAX, 8e-3);
    }
    direct_destroy(d);
    struct transport *t = transport_of(x->gbuffer, x->rays, &(struct transport_desc){ .per_cell = 2 });
    assert_int_equal(transport_shade(t, e, &(struct transport_frame){ .end = 0 }, x->lo, &stats), ERR_OK);
    printf("transport: %.5f, want %.5f\n", mean_of_points(x), want);
    assert_true(fabs(mean_of_points(x) / want - 1.0) < 8e-3);
    transport_destroy(t);
}

static void a_solid_pane_attenuates_the_light_below_it(void **state)
{
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
    struct material m = glass(1.5f);

    (void)state;
    m.attenuation = vec3_make(20.0f, 20.0f, 20.0f);
    struct lit x = lit_create(below_pane(&m), WIDTH, HEIGHT);
    assert_caustics(&x, e, 256, below(20.0 * 0.02));
    lit_destroy(&x);
    environment_destroy(e);
}

static void direct_light_passes_a_thin_pane(void **state)
{
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
    const struct material m = thin();

    (void)state;
    struct lit x = lit_create(below_pane(&m), WIDTH, HEIGHT);
    assert_direct(&x, e, below(0.0));
    lit_destroy(&x);
    environment_destroy(e);
}

/* The two parts are everything: no light is lost and none is counted twice. */
static void a_thin_pane_passes_one_part_and_reflects_the_other(void **state)
{
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
    const double direct = 0.5 * albedo + beside();
    struct lit x = lit_create(beside_pane(), WIDTH, HEIGHT);

    (void)state;
    assert_direct(&x, e, direct);
    assert_caustics(&x, e, 1024, albedo - direct);
    lit_destroy(&x);
    environment_destroy(e);
}

/* The references, class by class. */
static void references_agree_beside_a_thin_pane(void **state)
{
    const double direct = 0.5 * albedo + beside();
    const struct {
        struct technique technique;
        double want;
    } of[] = {
        { { "path, direct", BY_PATH, PATH_DIRECT, .count = 256 }, direct },
        { { "path, caustics", BY_PATH, PATH_CAUSTICS, .count = 2048 }, albedo - direct },
        { { "mlt, direct and caustics", BY_MLT, PATH_DIRECT | PATH_CAUSTICS, .count = 512 }, albedo },
    };
    struct world w = { .scene = beside_pane(), .direct = direct_create(best_kernels()) };

    (void)state;
    omp_set_num_threads(1);
    w.environment = sky_environment(sky_constant(16, 8, 1.0f), 32, 0.0);
    world_look(&w, WIDTH, HEIGHT);
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        const struct estimate got = measure(&w, &of[i].technique);
        printf("%s: %.5f +- %.5f, want %.5f\n", of[i].technique.name, got.mean[0], got.error[0], of[i].want);
        assert_true(got.error[0] < 6e-3 * of[i].want && fabs(got.mean[0] - of[i].want) < Z_MAX * got.error[0]);
    }
    world_finish(&w);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_solid_pane_attenuates_the_light_below_it),
    cmocka_unit_test(direct_light_passes_a_thin_pane),
    cmocka_unit_test(a_thin_pane_passes_one_part_and_reflects_the_other),
    cmocka_unit_test(references_agree_beside_a_thin_pane),
};
UNIT_MAIN(tests)
