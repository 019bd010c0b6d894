/* Direct light with traced shadows, on scenes made of a few triangles, against closed forms. */
#include "light/estimators/points.h"

#include "scene/geometry/gbuffer.h"
#include "scene/geometry/scene.h"

static const enum method all_methods[] = { METHOD_UNIFORM,       METHOD_BRDF,  METHOD_LIGHT,
                                           METHOD_FACES_UNIFORM, METHOD_FACES, METHOD_MIS };
#define METHODS (sizeof(all_methods) / sizeof(all_methods[0]))

/* A scene of one white Lambert mesh; positions and indices are copied. */
static struct scene *scene_of(const float *positions, uint32_t vertices, const uint32_t *indices, uint32_t triangles,
                              struct vec3 eye, struct vec3 target)
{
    struct scene *s = mem_alloc(1, sizeof(*s));
    s->meshes = mem_alloc(1, sizeof(*s->meshes));
    s->materials = mem_alloc(1, sizeof(*s->materials));
    s->cameras = mem_alloc(1, sizeof(*s->cameras));
    s->mesh_count = s->material_count = s->camera_count = 1;
    struct mesh *m = s->meshes;
    m->vertex_count = vertices;
    m->triangle_count = triangles;
    m->positions = mem_alloc(3 * (size_t)vertices + 1, sizeof(float));
    m->indices = mem_alloc(3 * (size_t)triangles, sizeof(uint32_t));
    memcpy(m->positions, positions, 3 * (size_t)vertices * sizeof(float));
    memcpy(m->indices, indices, 3 * (size_t)triangles * sizeof(uint32_t));
    s->materials[0] =
        (struct material){ .kind = MATERIAL_LAMBERT, .diffuse = { 1, 1, 1 }, .texture = MATERIAL_NO_TEXTURE };
    s->cameras[0] = (struct camera){ .position = eye, .look_at = target, .up = { 0, 1, 0 }, .fov_y = 0.7f };
    s->triangle_count = triangles;
    return s;
}

struct lit {
    struct scene *scene;
    struct rays *rays;
    struct gbuffer *gbuffer;
    float *lo;
};

static struct lit lit_create(struct scene *scene, uint32_t width, uint32_t height)
{
    struct lit x = { .scene = scene, .rays = rays_create_for(scene, cpu_best()) };
    struct reason why;
    const struct gbuffer_desc desc = { .camera = scene->cameras, .width = width, .height = height, .edge_rays = 1 };
    assert_non_null(x.rays);
    assert_int_equal(gbuffer_create(scene, x.rays, &desc, &x.gbuffer, &why), ERR_OK);
    x.lo = mem_alloc(x.gbuffer->packet_count, 3 * PACKET * sizeof(float));
    return x;
}

static void lit_destroy(struct lit *x)
{
    mem_free(x->lo);
    gbuffer_destroy(x->gbuffer);
    rays_destroy(x->rays);
    scene_destroy(x->scene);
}

/* A sphere of flat triangles, by latitude and longitude. */
static struct scene *make_sphere(void)
{
    enum { ROWS = 24, COLUMNS = 48 };
    static float p[(ROWS + 1) * COLUMNS * 3];
    static uint32_t t[2 * ROWS * COLUMNS * 3];
    uint32_t triangles = 0;
    for (uint32_t i = 0; i <= ROWS; i++)
        for (uint32_t j = 0; j < COLUMNS; j++) {
            const double theta = PI * i / ROWS, phi = 2.0 * PI * j / COLUMNS;
            float *v = p + 3 * (i * COLUMNS + j);
            v[0] = (float)(sin(theta) * sin(phi));
            v[1] = (float)cos(theta);
            v[2] = (float)(sin(theta) * cos(phi));
        }
    for (uint32_t i = 0; i < ROWS; i++)
        for (uint32_t j = 0; j < COLUMNS; j++) {
            const uint32_t a = i * COLUMNS + j, b = i * COLUMNS + (j + 1) % COLUMNS;
            const uint32_t upper[3] = { a, a + COLUMNS, b }, lower[3] = { b, a + COLUMNS, b + COLUMNS };
            if (i > 0) /* at the poles one of the two has no area */
                memcpy(t + 3 * triangles++, upper, sizeof(upper));
            if (i < ROWS - 1)
                memcpy(t + 3 * triangles++, lower, sizeof(lower));
        }
    return scene_of(p, (ROWS + 1) * COLUMNS, t, triangles, vec3_make(0.5f, 1.0f, 4.0f), vec3_make(0, 0, 0));
}

/* One convex object of albedo 1 alone under a sky of 1 is 1: its shadow rays must not meet the object itself. By its
 * lobes each point is exact, so the first point that loses one ray in 512 is caught; by light the mean over seeds is
 * tested, |z| < 4.5 with a standard error below 0.3 %, by the 16 seeds of each commit 0.52 %. */
static void a_convex_object_in_a_white_furnace_is_white(void **state)
{
    const uint32_t seeds = seeds_count(16, 48);
    const double worst = 3e-3 * seeds_blur(16, 48);
    (void)state;
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 16, 0.0);
    struct lit x = lit_create(make_sphere(), 48, 48);
    struct direct *d = direct_create(best_kernels());
    assert_true(x.gbuffer->point_count > 500);
    for (size_t m = 0; m < METHODS; m++) {
        double sum = 0.0, squares = 0.0;
        for (uint64_t seed = 0; seed < seeds; seed++) {
            struct direct_stats stats;
            double mean = 0.0;
            const struct direct_desc desc = { .method = all_methods[m], .samples = 512, .seed = seed };
            assert_int_equal(direct_shade(d, x.gbuffer, x.rays, e, &desc, x.lo, &stats), ERR_OK);
            for (uint32_t i = 0; i < x.gbuffer->packet_count; i++)
                for (uint32_t l = 0; l < x.gbuffer->packets[i].count; l++) {
                    const float v = x.lo[(size_t)i * 3 * PACKET + l];
                    mean += v / (double)x.gbuffer->point_count;
                    if (all_methods[m] == METHOD_BRDF)
                        assert_true(fabsf(v - 1.0f) < 1e-4f);
                }
            sum += mean;
            squares += mean * mean;
        }
        const double mean = sum / seeds;
        const double error = sqrt(fmax(0.0, squares / seeds - mean * mean) / (seeds - 1)) + 2e-6;
        if (fabs(mean - 1.0) >= 4.5 * error || error >= worst)
            printf("%s: %.6f +- %.6f\n", method_name(all_methods[m]), mean, error);
        assert_true(error < worst);
        assert_true(fabs(mean - 1.0) < 4.5 * error);
    }
    direct_destroy(d);
    lit_destroy(&x);
    environment_destroy(e);
}

/* A floor at distance a before an endless wall of height h keeps (1 + a / sqrt(a^2 + h^2)) / 2 of a constant sky. The
 * wall is 4000 times as long as it is high. Means over seeds, |z| < 4.5, standard error below 0.5 %. */
static void a_wall_takes_its_closed_form_share_of_the_sky(void **state)
{
    enum { SEEDS = 48 };
    static const float p[] = {
        -2000, 0, -50, 2000, 0, -50, 2000, 0, 50, -2000, 0, 50, /* floor */
        -2000, 0, 0,   2000, 0, 0,   2000, 1, 0,  -2000, 1, 0,  /* wall on it, in the plane z = 0 */
    };
    static const uint32_t t[] = { 0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7 };
    (void)state;
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 16, 0.0);
    struct scene *scene = scene_of(p, 8, t, 4, vec3_make(0, 0.9f, 3.0f), vec3_make(0, 0.0f, 1.0f));
    struct lit x = lit_create(scene, 24, 24);
    struct direct *d = direct_create(best_kernels());
    for (size_t m = 0; m < METHODS; m++) {
        double sum = 0.0, squares = 0.0;
        for (uint64_t seed = 0; seed < SEEDS; seed++) {
            struct direct_stats stats;
            double mean = 0.0;
            uint64_t points = 0;
            const struct direct_desc desc = { .method = all_methods[m], .samples = 1024, .seed = seed };
            assert_int_equal(direct_shade(d, x.gbuffer, x.rays, e, &desc, x.lo, &stats), ERR_OK);
            for (uint32_t i = 0; i < x.gbuffer->packet_count; i++)
                for (uint32_t l = 0; l < x.gbuffer->packets[i].count; l++) {
                    const struct shade_packet *q = &x.gbuffer->packets[i];
                    if (q->ng_y[l] < 0.5f || q->z[l] < 0.02f)
                        continue; /* the wall itself */
                    const double a = q->z[l], want = 0.5 * (1.0 + a / sqrt(a * a + 1.0));
                    mean += x.lo[(size_t)i * 3 * PACKET + l] / want;
                    points++;
                }
            assert_true(points > 100);
            mean /= (double)points;
            sum += mean;
            squares += mean * mean;
        }
        const double mean = sum / SEEDS, error = sqrt(fmax(0.0, squares / SEEDS - mean * mean) / (SEEDS - 1)) + 2e-6;
        if (fabs(mean - 1.0) >= 4.5 * error || error >= 5e-3)
            printf("%s: %.6f +- %.6f\n", method_name(all_methods[m]), mean, error);
        assert_true(error < 5e-3);
        assert_true(fabs(mean - 1.0) < 4.5 * error);
    }
    direct_destroy(d);
    lit_destroy(&x);
    environment_destroy(e);
}

/* What is in shadow is darker than without shadows, and every ray counted was asked for by an effective sample or a
 * lobe. */
static void visibility_darkens_and_is_counted(void **state)
{
    struct direct_stats with, without;
    (void)state;
    struct environment *e = sky_environment(sky_overcast(32, 16), 16, 0.0);
    static const float p[] = {
        -9, 0, -9, 9, 0, -9, 9, 0, 9, -9, 0, 9, -3, 0, 0, 3, 0, 0, 3, 4, 0, -3, 4, 0,
    };
    static const uint32_t t[] = { 0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7 };
    struct lit x = lit_create(scene_of(p, 8, t, 4, vec3_make(0, 3, 6), vec3_make(0, 0, 1)), 32, 32);
    struct direct *d = direct_create(best_kernels());
    double dark = 0.0, sun = 0.0;
    struct direct_desc desc = { .method = METHOD_MIS, .samples = 32 };
    assert_int_equal(direct_shade(d, x.gbuffer, x.rays, e, &desc, x.lo, &with), ERR_OK);
    for (size_t k = 0; k < (size_t)x.gbuffer->packet_count * 3 * PACKET; k++)
        dark += x.lo[k];
    desc.no_visibility = true;
    assert_int_equal(direct_shade(d, x.gbuffer, x.rays, e, &desc, x.lo, &without), ERR_OK);
    for (size_t k = 0; k < (size_t)x.gbuffer->packet_count * 3 * PACKET; k++)
        sun += x.lo[k];
    assert_true(dark < 0.95 * sun);
    assert_int_equal(without.rays, 0);
    assert_true(with.rays >= with.effective && with.rays <= with.effective + with.lobes);
    assert_int_equal(with.effective, without.effective);
    direct_destroy(d);
    lit_destroy(&x);
    environment_destroy(e);
}

/* A sky with a soft light that is no sun. */
static struct environment *soft_light(void)
{
    struct frame f = sky_constant(64, 32, 0.3f);

    for (uint32_t x = 20; x < 30; x++)
        for (uint32_t y = 6; y < 12; y++)
            sky_paint(&f, x, y, 12.0f, 8.0f, 6.0f);
    return sky_environment(f, 64, 0.0);
}

static void shade_auto(struct direct *d, const struct lit *x, const struct environment *e, uint32_t samples,
                       uint64_t seed)
{
    const struct direct_desc desc = { .method = METHOD_AUTO, .samples = samples, .seed = seed };
    struct direct_stats stats;

    assert_int_equal(direct_shade(d, x->gbuffer, x->rays, e, &desc, x->lo, &stats), ERR_OK);
}

/* What sees all of its sky has the irradiance that is known: no seed changes a point by 1e-4. With too few samples to
 * be corrected they differ by tenths. */
static void a_point_that_sees_all_of_its_sky_has_no_noise(void **state)
{
    static struct irradiance known;
    (void)state;
    struct environment *e = soft_light();
    struct lit x = lit_create(make_sphere(), 48, 48);
    struct direct *d = direct_create(best_kernels());
    double worst = 0.0, few = 0.0;

    irradiance_build(&known, e, NULL);
    for (uint32_t k = 0; k < 16; k++) {
        const uint32_t samples = k < 8 ? 16 : 4;
        shade_auto(d, &x, e, samples, k);
        for (uint32_t i = 0; i < x.gbuffer->packet_count; i++)
            for (uint32_t l = 0; l < x.gbuffer->packets[i].count; l++) {
                const struct shade_packet *p = &x.gbuffer->packets[i];
                float want[3];
                irradiance_at(&known, IRRADIANCE_COSINE, (float[]){ p->ns_x[l], p->ns_y[l], p->ns_z[l] }, want);
                const double off = fabs(PI * (double)x.lo[(size_t)i * 3 * PACKET + l] / (double)want[0] - 1.0);
                worst = samples == 16 ? fmax(worst, off) : worst;
                few = samples == 4 ? fmax(few, off) : few;
            }
    }
    printf("16 samples: worst point %.2g off; 4 samples: %.2g\n", worst, few);
    assert_true(worst < 1e-4 && few > 0.1);
    direct_destroy(d);
    lit_destroy(&x);
    environment_destroy(e);
}

/* Before a wall that hides a part of the soft light from some points and all from others, the mean over seeds is that
 * of `mis`: |z| < 4.5. The standard error is below 0.02 % with few samples, where faults are largest: what the samples
 * themselves say of what is visible, in place of scouts, makes them 0.07 % too dark. */
static void a_correction_leaves_the_mean(void **state)
{
    static const float p[] = {
        -9, 0, -9, 9, 0, -9, 9, 0, 9, -9, 0, 9, -3, 0, 0, 3, 0, 0, 3, 4, 0, -3, 4, 0,
    };
    static const uint32_t t[] = { 0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7 };
    static const struct {
        enum method method;
        uint32_t samples, seeds;
        double worst;
    } rows[] = { { METHOD_MIS, 1024, 2048, 1e-3 }, { METHOD_AUTO, 8, 24576, 2e-4 }, { METHOD_AUTO, 64, 256, 1e-3 } };
    (void)state;
    struct environment *e = soft_light();
    struct lit x = lit_create(scene_of(p, 8, t, 4, vec3_make(0, 3, 6), vec3_make(0, 0, 1)), 12, 12);
    struct direct *d = direct_create(best_kernels());
    double want = 0.0, own = 0.0;

    for (size_t k = 0; k < sizeof(rows) / sizeof(rows[0]); k++) {
        double mean = 0.0, square = 0.0;
        for (uint64_t seed = 0; seed < rows[k].seeds; seed++) {
            const struct direct_desc desc = {
                .method = rows[k].method, .samples = rows[k].samples, .seed = seed, .keep = seed > 0
            };
            struct direct_stats stats;
            double sum = 0.0;
            assert_int_equal(direct_shade(d, x.gbuffer, x.rays, e, &desc, x.lo, &stats), ERR_OK);
            for (size_t i = 0; i < (size_t)x.gbuffer->packet_count * 3 * PACKET; i++)
                sum += (double)x.lo[i];
            mean += sum / rows[k].seeds;
            square += sum * sum / rows[k].seeds;
        }
        const double variance = fmax(0.0, square - mean * mean) / (rows[k].seeds - 1);
        want = k == 0 ? mean : want;
        own = k == 0 ? variance : own;
        const double error = sqrt(variance + own) / want, off = mean / want - 1.0;
        printf("%4u samples: %.3f %% +- %.3f off\n", rows[k].samples, 100.0 * off, 100.0 * error);
        assert_true(error < rows[k].worst);
        assert_true(fabs(off) < 4.5 * error);
    }
    direct_destroy(d);
    lit_destroy(&x);
    environment_destroy(e);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_point_that_sees_all_of_its_sky_has_no_noise),
    cmocka_unit_test(a_correction_leaves_the_mean),
    cmocka_unit_test(a_convex_object_in_a_white_furnace_is_white),
    cmocka_unit_test(a_wall_takes_its_closed_form_share_of_the_sky),
    cmocka_unit_test(visibility_darkens_and_is_counted),
};
UNIT_MAIN(tests)
