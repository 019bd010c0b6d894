/* Eye paths against closed forms, white furnaces, and a tracer that splits at every event and never samples the sky. */
#include "light/estimators/courts.h"
#include "light/estimators/points.h"

#include "scene/geometry/scatter_hit.h"
#include "scene/surface/lobe.h"
#include "scene/surface/scatter.h"

#include <omp.h>

/* Direct light plus all eye paths must be 1 at every point seen directly, and n^2 at those in glass of index n (mesh
 * `inside`). Per point 24 seeds: |t| < 6.5 each, of up to 600 points (2e-4 false alarms together); the mean over the
 * points has |z| < 4.5 with a standard error below 0.1 %, so that a bias of 0.5 % of all light is caught. */
static void check_furnace(struct lit *x, uint32_t inside, double ior)
{
    enum { SEEDS = 24 };
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 16, 0.0);
    struct direct *d = direct_create(best_kernels());
    struct tally *points = mem_alloc(x->gbuffer->packet_count * PACKET, sizeof(*points)), mean = { 0 };
    uint32_t seen_inside = 0;

    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        const struct direct_desc desc = { .method = METHOD_BRDF, .samples = 128, .seed = seed + 1000 };
        struct direct_stats stats;
        double sum = 0.0;
        assert_int_equal(direct_shade(d, x->gbuffer, x->rays, e, &desc, x->lo, &stats), ERR_OK);
        walk(x, e, PATH_ALL, PATH_ALL, 128, seed);
        for (uint32_t i = 0; i < x->gbuffer->packet_count; i++)
            for (uint32_t l = 0; l < x->gbuffer->packets[i].count; l++) {
                const bool in = x->gbuffer->packets[i].mesh[l] == inside;
                const double v = x->lo[(size_t)i * 3 * PACKET + l] / (in ? ior * ior : 1.0);
                tally_add(&points[i * PACKET + l], v);
                sum += v;
                seen_inside += in;
            }
        tally_add(&mean, sum / (double)x->gbuffer->point_count);
    }
    for (uint32_t i = 0; i < x->gbuffer->packet_count; i++)
        for (uint32_t l = 0; l < x->gbuffer->packets[i].count; l++) {
            const struct tally *t = &points[i * PACKET + l];
            const double error = tally_error(t) + 1e-4;
            if (fabs(tally_mean(t) - 1.0) >= 6.5 * error)
                printf("packet %u, lane %u, mesh %u: %.4f +- %.4f\n", i, l, x->gbuffer->packets[i].mesh[l],
                       tally_mean(t), error);
            assert_true(fabs(tally_mean(t) - 1.0) < 6.5 * error);
        }
    check_mean("furnace", &mean, 1.0, 4.5, 1e-3);
    assert_true((inside != UINT32_MAX) == (seen_inside > 0));
    mem_free(points);
    direct_destroy(d);
    environment_destroy(e);
}

static void a_white_court_with_mirror_and_glass_in_a_white_sky_is_white(void **state)
{
    (void)state;
    struct lit x = lit_create(white_court(), 24, 20);
    check_furnace(&x, UINT32_MAX, 1.0);
    lit_destroy(&x);
}

static void what_is_cast_in_glass_is_as_bright_as_the_index_squared(void **state)
{
    (void)state;
    struct scene *s = scene_from(vec3_make(0, 0.4f, 3.0f), vec3_make(0, 0, 0), 0.7f);
    add_sphere(s, glass(1.6f), vec3_make(0, 0, 0), 1.0f, 16, 0);
    add_sphere(s, lambert(1), vec3_make(0.1f, 0, 0), 0.5f, 12, 0);
    add_box(s, lambert(1), vec3_make(-4, -1.4f, -4), vec3_make(4, -1.2f, 4));
    struct lit x = lit_create(s, 24, 20);
    check_furnace(&x, 1, 1.6);
    lit_destroy(&x);
}

/* A floor at distance a before an endless mirror of height h = 1 loses (1 - a / sqrt(a^2 + 1)) / 2 of a constant sky
 * to it, and gets it back through it times the reflectance: every ray that the mirror sends on leaves upwards. All is
 * caustics. Means over points and 32 seeds, |z| < 4.5, standard error below 0.4 %: 2 % of one colour are caught. */
static void a_mirror_wall_gives_the_sky_it_hides_back_times_its_reflectance(void **state)
{
    enum { SEEDS = 32 };
    static const float reflectance[3] = { 0.9f, 0.5f, 0.2f };
    struct tally ratio[3] = { { 0 } };
    (void)state;
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 16, 0.0);
    struct scene *s = scene_from(vec3_make(0, 0.9f, 3.0f), vec3_make(0, 0.0f, 1.0f), 0.7f);
    add_box(s, lambert(1), vec3_make(-2000, -1, -50), vec3_make(2000, 0, 50));
    add_box(s, mirror(0.9f, 0.5f, 0.2f), vec3_make(-2000, 0, -1), vec3_make(2000, 1, 0));
    struct lit x = lit_create(s, 16, 16);
    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        double got[3] = { 0 }, want = 0.0;
        clear(&x);
        walk(&x, e, PATH_CAUSTICS, PATH_CAUSTICS, 64, seed);
        for (uint32_t i = 0; i < x.gbuffer->packet_count; i++)
            for (uint32_t l = 0; l < x.gbuffer->packets[i].count; l++) {
                const double a = x.gbuffer->packets[i].z[l];
                want += 0.5 * (1.0 - a / sqrt(a * a + 1.0));
                for (int c = 0; c < 3; c++)
                    got[c] += x.lo[((size_t)i * 3 + (size_t)c) * PACKET + l];
            }
        assert_true(want > 10.0);
        for (int c = 0; c < 3; c++)
            tally_add(&ratio[c], got[c] / want);
    }
    for (int c = 0; c < 3; c++)
        check_mean("caustics by the mirror", &ratio[c], reflectance[c], 4.5, 4e-3);
    clear(&x); /* nothing rough is seen from there */
    walk(&x, e, PATH_INDIRECT, PATH_INDIRECT, 64, 0);
    for (size_t k = 0; k < x.size; k++)
        assert_true(x.lo[k] == 0.0f);
    lit_destroy(&x);
    environment_destroy(e);
}

/* From a point of a sphere every patch of the sphere subtends its share of the whole area. So, inside one of albedo r
 * with an opening of share f under a sky of 1, each point sends rf of direct light and r^2 f (1 - f) / (1 - r (1 - f))
 * after more reflections. The sphere is made of flat triangles: 0.4 % are left to that. Mean over points and 24 seeds,
 * standard error below 0.2 %: a bias of 1.5 % is caught. */
static void an_open_sphere_interreflects_in_closed_form(void **state)
{
    enum { SEEDS = 24, ROWS = 96, OPEN = 24 };
    const double r = 0.8, f = 0.5 * (1.0 - cos(PI * OPEN / ROWS));
    const double want = r * r * f * (1.0 - f) / (1.0 - r * (1.0 - f));
    struct tally mean = { 0 };
    (void)state;
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 16, 0.0);
    struct scene *s = scene_from(vec3_make(0, 0, 0), vec3_make(0, -0.3f, 1), 1.2f);
    add_sphere(s, lambert(0.8f), vec3_make(0, 0, 0), 1.0f, ROWS, OPEN);
    struct lit x = lit_create(s, 16, 16);
    assert_int_equal(x.gbuffer->point_count, 256);
    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        double sum = 0.0;
        clear(&x);
        walk(&x, e, PATH_ALL, PATH_ALL, 64, seed);
        for (size_t k = 0; k < x.size; k++)
            sum += x.lo[k] / (3.0 * 256.0);
        tally_add(&mean, sum / want);
    }
    printf("%.5f +- %.5f of the closed form\n", tally_mean(&mean), tally_error(&mean));
    assert_true(tally_error(&mean) < 2e-3);
    assert_true(fabs(tally_mean(&mean) - 1.0) < 4e-3 + 4.5 * tally_error(&mean));
    lit_destroy(&x);
    environment_destroy(e);
}

/* The tests' own tracer: lobe rays alone, all delta rays followed at once, no roulette before the 12th event. */
struct own_tracer {
    const struct lit *lit;
    const struct environment *environment;
    struct rng rng;
    double caustics, indirect; /* luminance */
};

static void own_trace(struct own_tracer *t, struct vec3 origin, struct vec3 dir, const double weight[3], uint32_t rough,
                      uint32_t delta, uint32_t events);

static void own_lobe(struct own_tracer *t, const struct lobe *lobe, struct vec3 wo, struct vec3 start,
                     const double weight[3], uint32_t rough, uint32_t events)
{
    const double x[3] = { rng_next(&t->rng), rng_next(&t->rng), rng_next(&t->rng) };
    const struct vec3 wi = lobe_sample(lobe, wo, x);
    const double p = lobe_density(lobe, wo, wi);
    double brdf[3];
    lobe_evaluate(lobe, wo, wi, brdf);
    for (int c = 0; c < 3; c++)
        brdf[c] *= p > 0.0 ? weight[c] * vec3_dot(lobe->shading, wi) / p : 0.0;
    if (brdf[0] + brdf[1] + brdf[2] > 0.0)
        own_trace(t, start, wi, brdf, rough, 0, events);
}

static void own_trace(struct own_tracer *t, struct vec3 origin, struct vec3 dir, const double weight[3], uint32_t rough,
                      uint32_t delta, uint32_t events)
{
    const float w[3] = { dir.x, dir.y, dir.z };
    double kept[3] = { weight[0], weight[1], weight[2] };
    float rgb[3], pdf;
    struct hit h;
    struct scatter at;
    struct delta_ray out[2];

    if (!rays_intersect(t->lit->rays, origin, dir, 0.0f, &h)) {
        environment_evaluate(t->environment, w, rgb, &pdf);
        const double l = 0.2126 * weight[0] * rgb[0] + 0.7152 * weight[1] * rgb[1] + 0.0722 * weight[2] * rgb[2];
        t->indirect += rough > 0 ? l : 0.0;
        t->caustics += rough == 0 && delta > 0 ? l : 0.0;
        return;
    }
    if (events >= 12) {
        if (rng_next(&t->rng) >= 0.5)
            return;
        for (int c = 0; c < 3; c++)
            kept[c] *= 2.0;
    }
    scatter_at(t->lit->scene, t->lit->rays, &h, dir, &at);
    const uint32_t count = scatter_eye(&at, dir, out);
    for (uint32_t i = 0; i < count; i++) {
        double on[3];
        for (int c = 0; c < 3; c++)
            on[c] = kept[c] * out[i].weight[c] * out[i].radiance_scale;
        if (on[0] + on[1] + on[2] > 1e-6)
            own_trace(t, out[i].origin, out[i].dir, on, rough, delta + 1, events + 1);
    }
    if (at.rough) {
        const struct lobe lobe = lobe_of(&at);
        own_lobe(t, &lobe, vec3_scale(dir, -1.0f), surface_start(&at.surface, 1.0f), kept, rough + 1, events + 1);
    }
}

static struct lobe lane_lobe(const struct shade_packet *p, uint32_t l)
{
    return (struct lobe){
        .kind = (enum lobe_kind)p->kind,
        .geometric = vec3_make(p->ng_x[l], p->ng_y[l], p->ng_z[l]),
        .shading = vec3_make(p->ns_x[l], p->ns_y[l], p->ns_z[l]),
        .diffuse = vec3_make(p->diffuse[0][l], p->diffuse[1][l], p->diffuse[2][l]),
        .specular = vec3_make(p->specular[0][l], p->specular[1][l], p->specular[2][l]),
        .gloss = p->gloss[l],
    };
}

/* The mean over all points by the test's own tracer, one path each. */
static void own_means(const struct lit *x, const struct environment *e, uint64_t seed, double out[2])
{
    struct own_tracer t = { .lit = x, .environment = e, .rng = { rng_mix(77, seed) } };
    for (uint32_t i = 0; i < x->gbuffer->packet_count; i++)
        for (uint32_t l = 0; l < x->gbuffer->packets[i].count; l++) {
            const struct shade_packet *p = &x->gbuffer->packets[i];
            const struct lobe lobe = lane_lobe(p, l);
            own_lobe(&t, &lobe, vec3_make(p->wo_x[l], p->wo_y[l], p->wo_z[l]), vec3_make(p->x[l], p->y[l], p->z[l]),
                     (const double[]){ 1, 1, 1 }, 0, 0);
        }
    out[0] = t.caustics / (double)x->gbuffer->point_count;
    out[1] = t.indirect / (double)x->gbuffer->point_count;
}

static double mean_luminance(const struct lit *x)
{
    double sum = 0.0;
    for (uint32_t i = 0; i < x->gbuffer->packet_count; i++)
        for (uint32_t l = 0; l < PACKET; l++) {
            const float *lo = x->lo + (size_t)i * 3 * PACKET + l;
            sum += rgb_luminance(lo[0], lo[PACKET], lo[2 * PACKET]);
        }
    return sum / (double)x->gbuffer->point_count;
}

/* Classes of eye paths against the tests' own tracer under an overcast sky with a weak sun: standard errors below 1 %
 * each, differences below 4.5 of them, so that a class that loses 6 % of its light is caught. And against each other,
 * with the same seeds: what both together find less what each finds is 0 within 0.2 % of it, so that 1 % of a class
 * that goes to the other is caught. */
static void both_classes_agree_with_lobe_sampling_alone(void **state)
{
    enum { SEEDS = 40, OWN_SEEDS = 1500 };
    static const uint32_t classes[3] = { PATH_CAUSTICS, PATH_INDIRECT, PATH_CAUSTICS | PATH_INDIRECT };
    static double by_own[OWN_SEEDS][2];
    struct tally eye[3] = { { 0 } }, own[3] = { { 0 } }, left = { 0 };
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(32, 16, 20.0f), 32, 0.0);
    struct lit x = lit_create(mixed_court(), 24, 20);
#pragma omp parallel for schedule(dynamic, 16)
    for (int seed = 0; seed < OWN_SEEDS; seed++)
        own_means(&x, e, (uint64_t)seed, by_own[seed]);
    for (int seed = 0; seed < OWN_SEEDS; seed++) {
        tally_add(&own[0], by_own[seed][0]);
        tally_add(&own[1], by_own[seed][1]);
        tally_add(&own[2], by_own[seed][0] + by_own[seed][1]);
    }
    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        double v[3];
        for (int k = 0; k < 3; k++) {
            clear(&x);
            walk(&x, e, classes[k], classes[k], 32, seed);
            v[k] = mean_luminance(&x);
            tally_add(&eye[k], v[k]);
        }
        tally_add(&left, v[2] - v[1] - v[0]);
    }
    for (int k = 0; k < 3; k++) {
        const double a = tally_mean(&eye[k]), b = tally_mean(&own[k]);
        const double ea = tally_error(&eye[k]), eb = tally_error(&own[k]);
        printf("class %d: %.5f +- %.5f, own %.5f +- %.5f\n", k, a, ea, b, eb);
        assert_true(ea < 0.01 * a && eb < 0.01 * b);
        assert_true(fabs(a - b) < 4.5 * sqrt(ea * ea + eb * eb));
    }
    printf("both less each: %.5f +- %.5f\n", tally_mean(&left), tally_error(&left));
    assert_true(tally_error(&left) < 2e-3 * tally_mean(&eye[0]));
    assert_true(fabs(tally_mean(&left)) < 4.5 * tally_error(&left));
    lit_destroy(&x);
    environment_destroy(e);
}

/* Where no surface has both lobes, what is asked for does not turn a path: the classes add up at every point. And what
 * is asked for at points of one sort is not found at those of the other. */
static void classes_add_up_and_keep_to_their_points(void **state)
{
    (void)state;
    struct environment *e = sky_environment(sky_overcast(32, 16), 16, 0.0);
    struct lit x = lit_create(white_court(), 24, 20);
    float *all = mem_alloc(x.size, sizeof(float));
    uint32_t behind = 0, direct = 0;
    clear(&x);
    const struct eye_paths_stats stats = walk(&x, e, PATH_ALL, PATH_ALL, 16, 3);
    assert_int_equal(stats.paths, 16 * x.gbuffer->point_count);
    assert_true(stats.rays > stats.paths);
    memcpy(all, x.lo, x.size * sizeof(float));
    clear(&x);
    walk(&x, e, PATH_CAUSTICS, PATH_INDIRECT, 16, 3); /* four runs that add up to it */
    walk(&x, e, 0, PATH_CAUSTICS, 16, 3);
    walk(&x, e, PATH_INDIRECT, 0, 16, 3);
    for (size_t k = 0; k < x.size; k++)
        assert_true(fabsf(x.lo[k] - all[k]) <= 1e-5f * (1.0f + all[k]));
    clear(&x);
    walk(&x, e, PATH_ALL, 0, 16, 3);
    for (uint32_t i = 0; i < x.gbuffer->packet_count; i++)
        for (uint32_t l = 0; l < PACKET; l++) {
            const struct shade_packet *p = &x.gbuffer->packets[i];
            const size_t k = (size_t)i * 3 * PACKET + l;
            assert_true(x.lo[k] == (l < p->count && !p->behind[l] ? all[k] : 0.0f));
            behind += l < p->count && p->behind[l] && all[k] > 0.0f;
            direct += l < p->count && !p->behind[l] && all[k] > 0.0f;
        }
    assert_true(behind > 20 && direct > 100);
    mem_free(all);
    lit_destroy(&x);
    environment_destroy(e);
}

static void same_seed_gives_the_same_bits_at_any_thread_count(void **state)
{
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(32, 16, 20.0f), 16, 0.0);
    struct lit x = lit_create(mixed_court(), 24, 20);
    float *one = mem_alloc(x.size, sizeof(float));
    const int before = omp_get_max_threads();
    omp_set_num_threads(1);
    walk(&x, e, PATH_ALL, PATH_ALL, 5, 9);
    memcpy(one, x.lo, x.size * sizeof(float));
    for (int threads = 2; threads <= 5; threads++) {
        omp_set_num_threads(threads);
        clear(&x);
        walk(&x, e, PATH_ALL, PATH_ALL, 5, 9);
        assert_memory_equal(one, x.lo, x.size * sizeof(float));
    }
    omp_set_num_threads(before);
    clear(&x);
    walk(&x, e, PATH_ALL, PATH_ALL, 5, 10);
    assert_memory_not_equal(one, x.lo, x.size * sizeof(float));
    mem_free(one);
    lit_destroy(&x);
    environment_destroy(e);
}

/* A point's mean is at most what one path may bring; a limit that no path reaches changes no bit. */
static void no_path_brings_more_than_the_limit(void **state)
{
    struct environment *e = sky_environment(sky_with_sun(64, 32, 1e4f), 64, 0.0);
    struct lit x = lit_create(white_court(), 12, 10);
    struct eye_paths_desc desc = { PATH_ALL, PATH_ALL, .paths = 4 };
    struct eye_paths_stats stats;
    float *plain = mem_alloc(x.size, sizeof(float));
    double most = 0.0;
    (void)state;

    assert_non_null(plain);
    clear(&x);
    assert_int_equal(eye_paths_shade(x.scene, x.rays, x.gbuffer, e, &desc, x.lo, &stats), ERR_OK);
    memcpy(plain, x.lo, x.size * sizeof(float));
    for (size_t k = 0; k < x.size; k++)
        most = fmax(most, (double)x.lo[k]);
    desc.most = 1e9;
    clear(&x);
    assert_int_equal(eye_paths_shade(x.scene, x.rays, x.gbuffer, e, &desc, x.lo, &stats), ERR_OK);
    assert_memory_equal(plain, x.lo, x.size * sizeof(float));
    desc.most = 0.01 * most;
    clear(&x);
    assert_int_equal(eye_paths_shade(x.scene, x.rays, x.gbuffer, e, &desc, x.lo, &stats), ERR_OK);
    for (uint32_t i = 0; i < x.gbuffer->packet_count; i++)
        for (uint32_t l = 0; l < x.gbuffer->packets[i].count; l++) {
            double sum = 0.0;
            for (size_t c = 0; c < 3; c++)
                sum += (double)x.lo[((size_t)i * 3 + c) * PACKET + l];
            assert_true(sum <= desc.most * (1.0 + 1e-6));
        }
    mem_free(plain);
    lit_destroy(&x);
    environment_destroy(e);
}

/* Cancelled before it begins, and under a black sky, nothing is added to what was there. */
static void cancelled_or_black_adds_nothing(void **state)
{
    const atomic_bool cancel = true;
    struct eye_paths_stats stats;
    struct eye_paths_desc desc = { PATH_ALL, PATH_ALL, .paths = 4, .cancel = &cancel };
    (void)state;
    struct environment *sun = sky_environment(sky_constant(16, 8, 1.0f), 16, 0.0);
    struct environment *black = sky_environment(sky_constant(16, 8, 0.0f), 16, 0.0);
    struct lit x = lit_create(white_court(), 12, 10);
    for (size_t k = 0; k < x.size; k++)
        x.lo[k] = 0.25f;
    assert_int_equal(eye_paths_shade(x.scene, x.rays, x.gbuffer, sun, &desc, x.lo, &stats), ERR_OK);
    assert_int_equal(stats.paths, 0);
    desc.cancel = NULL;
    assert_int_equal(eye_paths_shade(x.scene, x.rays, x.gbuffer, black, &desc, x.lo, &stats), ERR_OK);
    for (size_t k = 0; k < x.size; k++)
        assert_true(x.lo[k] == 0.25f);
    lit_destroy(&x);
    environment_destroy(black);
    environment_destroy(sun);
}

/* The passes of one seed go on with one sequence: 16 passes of one path have at most 0.6 times the variance that 16
 * seeds of one path have, in the light that only the first ray decides. */
static void passes_continue_one_sequence(void **state)
{
    enum { REPLICATES = 32, PASSES = 16 };
    struct tally by[2] = { { 0 } };
    (void)state;
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 16, 0.0);
    struct scene *s = scene_from(vec3_make(0, 0.9f, 3.0f), vec3_make(0, 0.0f, 1.0f), 0.7f);
    add_box(s, lambert(1), vec3_make(-2000, -1, -50), vec3_make(2000, 0, 50));
    add_box(s, mirror(1, 1, 1), vec3_make(-2000, 0, -1), vec3_make(2000, 1, 0));
    struct lit x = lit_create(s, 8, 8);
    for (uint64_t r = 0; r < REPLICATES; r++)
        for (int seeds = 0; seeds < 2; seeds++) {
            clear(&x);
            for (uint64_t pass = 0; pass < PASSES; pass++) {
                struct eye_paths_stats stats;
                const struct eye_paths_desc desc = { .classes = PATH_CAUSTICS,
                                                     .paths = 1,
                                                     .seed = seeds ? r * PASSES + pass : r,
                                                     .pass = seeds ? 0 : pass };
                assert_int_equal(eye_paths_shade(x.scene, x.rays, x.gbuffer, e, &desc, x.lo, &stats), ERR_OK);
            }
            tally_add(&by[seeds], mean_luminance(&x));
        }
    printf("error of passes %.5f, of seeds %.5f\n", tally_error(&by[0]), tally_error(&by[1]));
    assert_true(pow(tally_error(&by[0]) / tally_error(&by[1]), 2.0) < 0.6);
    lit_destroy(&x);
    environment_destroy(e);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_white_court_with_mirror_and_glass_in_a_white_sky_is_white),
    cmocka_unit_test(what_is_cast_in_glass_is_as_bright_as_the_index_squared),
    cmocka_unit_test(a_mirror_wall_gives_the_sky_it_hides_back_times_its_reflectance),
    cmocka_unit_test(an_open_sphere_interreflects_in_closed_form),
    cmocka_unit_test(both_classes_agree_with_lobe_sampling_alone),
    cmocka_unit_test(classes_add_up_and_keep_to_their_points),
    cmocka_unit_test(same_seed_gives_the_same_bits_at_any_thread_count),
    cmocka_unit_test(no_path_brings_more_than_the_limit),
    cmocka_unit_test(cancelled_or_black_adds_nothing),
    cmocka_unit_test(passes_continue_one_sequence),
};
UNIT_MAIN(tests)
