/* Difficult frames: invalid values, clipped light, a lookup that differs from the sampled function, sequences that
 * change midway, maps of the maximum width. */
#include "stability.h"

#include "image/codec/image.h"
#include "sky/tables/layout.h"
#include "sky/tables/sky_table.h"

enum { WIDTH = 16, HEIGHT = 12, VALUES = WIDTH * HEIGHT * 3 };

/* The built-in scene, small. */
static struct prepared_scene *court(void)
{
    const struct prepared_scene_desc desc = { .width = WIDTH, .height = HEIGHT, .edge_rays = 1 };
    struct prepared_scene *set = NULL;
    struct reason why;

    omp_set_num_threads(1); /* small work items; the cores may be busy */
    assert_int_equal(set_create(&desc, &set, &why), ERR_OK);
    return set;
}

/* Every way to light an image: the variants of direct light, whole images, light and eye paths. */
static const struct relight_desc others[] = {
    { .direct = { .method = METHOD_PATH }, .classes = PATH_ALL },
    { .direct = { .method = METHOD_MLT }, .classes = PATH_ALL },
    { .direct = { .method = METHOD_PHOTONS }, .classes = PATH_ALL },
    { .direct = { .method = METHOD_VPL }, .classes = PATH_ALL },
    { .direct = { .method = METHOD_CACHED }, .classes = PATH_ALL },
    { .direct = { .method = METHOD_AUTO }, .classes = PATH_ALL, .caustics = PLAN_LIGHT, .indirect = PLAN_LIGHT },
    { .direct = { .method = METHOD_AUTO }, .classes = PATH_ALL, .caustics = PLAN_EYE, .indirect = PLAN_EYE },
};
enum { WAYS = VARIANTS + sizeof(others) / sizeof(others[0]) };

static struct relight_desc way(int k)
{
    struct relight_desc d = k < VARIANTS ? (struct relight_desc){ .direct = variants[k].desc } : others[k - VARIANTS];

    d.direct.samples = 4;
    d.particles = 500;
    d.eye_paths = 1;
    return d;
}

/* Whether every value is a valid radiance. */
static bool is_radiance(const float *rgb)
{
    bool good = true;

    for (int i = 0; i < VALUES; i++)
        good = good && isfinite(rgb[i]) && rgb[i] >= 0.0f;
    return good;
}

/* The highest value beside value i of its channel; marked ones are never neighbours here. */
static float around(const struct frame *f, size_t i)
{
    const long x = (long)(i / 3 % f->width), y = (long)(i / 3 / f->width);
    float most = 0.0f;

    for (long v = y > 0 ? y - 1 : 0; v <= y + 1 && v < (long)f->height; v++)
        for (long u = x > 0 ? x - 1 : 0; u <= x + 1 && u < (long)f->width; u++) {
            const float beside = f->rgb[3 * (size_t)(v * (long)f->width + u) + i % 3];
            assert_true(isfinite(beside) || (u == x && v == y));
            most = isfinite(beside) && beside > most ? beside : most;
        }
    return most;
}

/* A sky in which every thirtieth value is an invalid float, covering all kinds; and the same after the repairs of
 * image.h. */
static struct frame spoilt(bool put_right)
{
    static const float odd[] = { NAN, -NAN, INFINITY, -INFINITY, -1.0f, -1e30f, 1e30f, 3.4e38f, -0.0f, 1e-42f };
    static const float even[] = { NAN, NAN, INFINITY, 0, 0, 0, IMAGE_MAX, IMAGE_MAX, 0, 1e-42f };
    struct frame f = sky_with_sun(64, 32, 1e4f);

    for (size_t i = 0, k = 0; i < 3 * 64 * 32; i += 30 + i % 7, k++)
        f.rgb[i] = put_right ? even[k % 10] : odd[k % 10];
    for (size_t i = 0; put_right && i < 3 * 64 * 32; i++)
        if (!isfinite(f.rgb[i]))
            f.rgb[i] = isnan(f.rgb[i]) ? around(&f, i) : fmaxf(around(&f, i), 65504.0f);
    return f;
}

static void values_that_are_no_radiance_are_as_if_they_were_put_right(void **state)
{
    static float got[VALUES], want[VALUES];
    uint64_t same = 0, finite = 0;
    (void)state;
    struct prepared_scene *set = court();
    struct environment *bad = sky_environment(spoilt(false), 32, 15.0);
    struct environment *good = sky_environment(spoilt(true), 32, 15.0);
    struct relighter *r = relighter_create(set, best_kernels());
    const struct image_faults *f = &bad->image.faults;
    for (int k = 0; k < WAYS; k++) {
        const struct relight_desc desc = way(k);
        image_of(r, bad, &desc, got);
        image_of(r, good, &desc, want);
        same += memcmp(got, want, sizeof(got)) == 0;
        finite += is_radiance(got);
    }
    shows_above("NaN, infinite, negative: counted", "decoding", "values put right",
                (double)(f->nan + f->infinite + f->negative), 100.0, "");
    holds_all("NaN, infinite, negative: nothing of it is left", "all, references and light paths too (22)",
              "finite pictures", finite, WAYS);
    holds_all("NaN, infinite, negative: as if put right before", "all, references and light paths too (22)",
              "pictures of the same bits", same, WAYS);
    relighter_destroy(r);
    environment_destroy(bad);
    environment_destroy(good);
    set_destroy(set);
    verdict();
}

/* A half float ends at 65504: a sun of 10^6 stored as one has lost nearly all its light, irrecoverably. */
static void half_floats_clip_the_sun_and_it_is_said(void **state)
{
    const double up[3] = { 0, 1, 0 };
    double light[2];
    unsigned said_kinds = 0;
    (void)state;
    for (int half = 0; half < 2; half++) {
        struct frame f = sky_overcast(256, 128);
        sky_disc(&f, (const double[3]){ 0.3, 0.9, 0.3 }, 0.5, half ? 65504.0f : 1e6f, half ? 65504.0f : 1e6f,
                 half ? 65504.0f : 1e6f);
        struct environment *e = sky_environment(f, 64, 0.0);
        light[half] = irradiance(e, up, false);
        if (half) {
            log_begin();
            for (int k = 0; k < 3; k++)
                environment_report(e, &said_kinds);
            const int said = count_of(log_end(), "65504");
            shows_above("half floats clipped at 65504: counted", "decoding", "values at the limit",
                        (double)e->image.faults.clipped, 3.0, "");
            holds_all("half floats clipped at 65504: one warning a sequence", "programs", "lines in three frames",
                      (uint64_t)said, 1);
        }
        environment_destroy(e);
    }
    fails_above("half floats clipped at 65504", "every method", "share of the light that is lost",
                1.0 - light[1] / light[0], 0.8, "a sun of 10^6");
    verdict();
}

/* Directions over the whole sphere, and around the lit texel. */
static void random_near(struct rng *r, const double centre[3], double spread, float w[3])
{
    const double y = 2.0 * rng_next(r) - 1.0, phi = 2.0 * PI * rng_next(r), s = sqrt(1.0 - y * y);
    double d[3] = { centre[0] + spread * s * sin(phi), centre[1] + spread * y, centre[2] + spread * s * cos(phi) };

    unit3(d);
    for (int c = 0; c < 3; c++)
        w[c] = (float)d[c];
}

/* A bilinear lookup of a single lit texel gives a tent four times as large, 7/16 of which is on its neighbours, where
 * the nearest texel's density is 0: never sampled [Scotty3D]. Here the sampled function is the evaluated one: in
 * every table, density is positive wherever there is light. */
static void light_has_density_wherever_it_is_evaluated(void **state)
{
    enum { DIRECTIONS = 200000 };
    uint64_t lit = 0, found = 0;
    double seen = 0.0, missed = 0.0;
    struct rng r = { 12 };
    struct sky_table tables[4] = { { 0 } };
    struct latlong latlong = { 0 };
    struct reason why;
    (void)state;
    struct frame f = sky_constant(64, 32, 0.0f);
    const double theta = PI * 12.5 / 32.0, phi = PI - 2.0 * PI * 20.5 / 64.0;
    const double centre[3] = { sin(theta) * sin(phi), cos(theta), sin(theta) * cos(phi) };
    sky_paint(&f, 20, 12, 1e5f, 1e5f, 1e5f);
    struct environment *e = sky_environment(f, 32, 0.0);
    for (uint32_t k = 0; k < 4; k++)
        assert_int_equal(
            sky_table_build(&tables[k], e, &(struct sky_table_desc){ .cells = k & 1 ? 4 : 1, .sun = k & 2 }), ERR_OK);
    assert_int_equal(latlong_build(&latlong, e, &why), ERR_OK);
    for (int k = 0; k < DIRECTIONS; k++) {
        float w[3], rgb[3], pdf[8], sun[2];
        random_near(&r, centre, k % 2 ? 0.2 : 1e6, w);
        (void)environment_evaluate(e, w, rgb, &pdf[0]);
        pdf[1] = environment_sample_density(e, w, rgb);
        for (int t = 0; t < 4; t++) {
            (void)sky_table_evaluate(&tables[t], w, rgb, &pdf[2 + t], &sun[0]);
            pdf[2 + t] += sun[0];
        }
        for (int t = 0; t < 6 && rgb[0] > 0.0f; t++) {
            lit++;
            found += pdf[t] > 0.0f && isfinite(pdf[t]);
        }
        latlong_evaluate(&latlong, w, rgb, &pdf[6]);
        latlong_evaluate_rows(&latlong, w, rgb, &pdf[7]);
        for (int t = 6; t < 8 && rgb[0] > 0.0f; t++) {
            lit++;
            found += pdf[t] > 0.0f && isfinite(pdf[t]);
        }
        if (k % 2)
            continue; /* uniform over the sphere except for the lit texel's size: equal weights */
        environment_lookup(e, vec3_make(w[0], w[1], w[2]), rgb);
        seen += rgb[0];
        missed += pdf[6] > 0.0f ? 0.0 : rgb[0];
    }
    for (int k = 0; k < 4; k++)
        sky_table_finish(&tables[k]);
    latlong_finish(&latlong);
    environment_destroy(e);
    fails_above("a bilinear lookup over nearest-texel densities", "not ours", "share of the light without density",
                missed / seen, 0.35, "7/16 of a single texel's");
    holds_all("evaluated light has density", "samplers (8)", "directions with light", found, lit);
    verdict();
}

/* A sequence of sizes and layouts that a producer may send. */
static const struct {
    const char *layout;
    uint32_t width, height;
} images[] = {
    { "latlong", 64, 32 },        { "latlong", 1, 1 },  { "latlong", 128, 64 },
    { "cube", 16, 96 },           { "hcross", 64, 48 }, { "latlong", 64, 32 },
    { "latlong-bottom", 64, 32 },                                              /* the same shape, different layout */
    { "vcross", 48, 64 },         { "ball", 40, 40 },   { "fisheye", 40, 40 }, /* the same */
    { "latlong", 7, 5 },          { "latlong", 2, 1 },  { "", 64, 32 },
    { "latlong", 300, 20 },
};
enum { IMAGES = sizeof(images) / sizeof(images[0]) };

static struct frame noise_of(int k)
{
    struct frame f = sky_constant(images[k].width, images[k].height, 0.0f);
    struct rng r = { 100 + (uint64_t)k };

    for (size_t i = 0; i < 3 * (size_t)f.width * f.height; i++)
        f.rgb[i] = (float)(0.2 + rng_next(&r));
    snprintf(f.layout, sizeof(f.layout), "%s", images[k].layout);
    return f;
}

/* Tables, samples and images built in reused memory of other sizes equal those in fresh memory, bit for bit. Each
 * commit plays every third image of the sequence, which still changes layout each time, and caches by the first
 * and the twelfth. A cache has another sky behind it from the second on. */
static void a_sequence_whose_size_and_layout_change_is_as_if_each_came_alone(void **state)
{
    static float got[VALUES], want[VALUES];
    const struct environment_desc desc = { .n = 32 };
    uint64_t same = 0, total = 0;
    struct reason why;
    (void)state;
    struct prepared_scene *set = court();
    struct environment *used = environment_create(&desc);
    struct relighter *worn = relighter_create(set, best_kernels());
    for (int k = 0; k < IMAGES; k += seeds_count(3, 1)) {
        struct frame f = noise_of(k);
        struct environment *fresh = environment_create(&desc);
        struct relighter *new = relighter_create(set, best_kernels());
        assert_int_equal(environment_update(used, &f, &why), ERR_OK);
        assert_int_equal(environment_update(fresh, &f, &why), ERR_OK);
        const bool latlong = strstr(images[k].layout, "latlong") || !images[k].layout[0];
        for (int q = 0; q < WAYS; q++) {
            const struct relight_desc by = way(q);
            if (!latlong && q < VARIANTS && variants[q].claims & OWN_SOURCE) {
                struct relight_stats stats; /* refused, without effect on what follows */
                assert_int_equal(relighter_run(worn, used, &by, got, &stats), ERR_UNSUPPORTED);
                continue;
            }
            if (q >= VARIANTS && q < VARIANTS + 4 && k % 4) /* references keep nothing between images */
                continue;
            if (by.direct.method == METHOD_CACHED && k % seeds_count(12, 1))
                continue;
            image_of(worn, used, &by, got);
            if (by.direct.method == METHOD_CACHED && k == 0) /* nothing is worn yet */
                continue;
            image_of(new, fresh, &by, want);
            same += memcmp(got, want, sizeof(got)) == 0;
            total++;
        }
        relighter_destroy(new);
        environment_destroy(fresh);
        frame_finish(&f);
    }
    relighter_destroy(worn);
    environment_destroy(used);
    set_destroy(set);
    holds_all("14 sizes and layouts in one sequence", "all, references and light paths too (22)",
              "pictures as if each came alone", same, total);
    verdict();
}

/* The widest possible map, with one lit texel at the horizon, where texels are smallest relative to the whole; in the
 * short form a band of few rows. 13 methods, |z| < 5; standard errors below 3 %. */
static void a_map_as_wide_as_may_be_lights_as_quadrature(void **state)
{
    const uint32_t height = full() ? 8192 : 24;
    const double up[3] = { 0, 1, 0 };
    struct worst z = { 0.0, "" }, error = { 0.0, "" };
    char name[96];
    (void)state;
    struct frame f = sky_constant(IMAGE_MAX_SIDE, height, 0.0f);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < f.width; x++) {
            const float l = y < height / 2 ? 0.5f : 0.1f;
            sky_paint(&f, x, y, l, l, l);
        }
    /* As much light as the sky's, whatever the height. */
    const float sun = full() ? 1e8f : 3e4f;
    sky_paint(&f, 12345, height / 3, sun, sun, sun);
    struct environment *e = sky_environment(f, 64, 0.0);
    struct gbuffer g = points_make(1, LOBE_LAMBERT, 1.0f, 0.0f, 0.0f);
    /* In closed form, texel by texel: a quadrature of 10^8 of them would dominate the run time. */
    const double a = PI * (height / 3) / height, b = PI * (height / 3 + 1) / height;
    const double of_sun = (sun - 0.5) * 2.0 * PI / f.width * 0.5 * (sin(b) * sin(b) - sin(a) * sin(a));
    const double source = (0.5 * PI + of_sun) / PI, cube = irradiance(e, up, false) / PI;
    (void)up;
    for (int k = 0; k < VARIANTS; k++) {
        if (!(variants[k].claims & SMALL_SUN))
            continue;
        const bool own = variants[k].claims & OWN_SOURCE;
        const struct tally t = tally_by(&g, e, &variants[k], 64, own && full() ? 4 : 64);
        worst_of(&z, fabs(tally_mean(&t) - (own ? source : cube)) / (tally_error(&t) + 1e-3 * cube), variants[k].name,
                 "");
        worst_of(&error, tally_error(&t) / cube, variants[k].name, "");
    }
    points_free(&g);
    environment_destroy(e);
    snprintf(name, sizeof(name), "a map of %u x %u: the mean", IMAGE_MAX_SIDE, height);
    holds_below(name, claimants(SMALL_SUN), "standard errors from quadrature", z.value, 5.0, z.where);
    snprintf(name, sizeof(name), "a map of %u x %u: the doubt", IMAGE_MAX_SIDE, height);
    holds_below(name, claimants(SMALL_SUN), "relative standard error", error.value, 0.03, error.where);
    snprintf(name, sizeof(name), "a map of %u x %u: energy of the cube map", IMAGE_MAX_SIDE, height);
    holds_below(name, "resampling", "relative difference from the source's light", fabs(cube / source - 1.0), 0.02, "");
    verdict();
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(values_that_are_no_radiance_are_as_if_they_were_put_right),
    cmocka_unit_test(half_floats_clip_the_sun_and_it_is_said),
    cmocka_unit_test(light_has_density_wherever_it_is_evaluated),
    cmocka_unit_test(a_sequence_whose_size_and_layout_change_is_as_if_each_came_alone),
    cmocka_unit_test(a_map_as_wide_as_may_be_lights_as_quadrature),
};
UNIT_MAIN(tests)
