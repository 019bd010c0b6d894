/* Cases where a method must fail: the size of the failure, its detection without a reference, and auto's alternative.
 * Errors are those of one image at live sample counts, as the standard deviation over seeds, relative to the value,
 * root mean square over points; costs are counted in rays. Bounds are half or less of the measured failures, twice or
 * more of what must hold, so that other random numbers pass too. */
#include "stability.h"

#include "sky/tables/sky_table.h"

enum { SAMPLES = 64, PACKETS = 2, POINTS = PACKETS * PACKET };

/* The error of one image of some points. */
struct failing {
    double error; /* root mean square, relative */
    double noise; /* the part that changes from seed to seed */
    double told;  /* estimated from two images, half of their mean squared difference: the median, relative */
    double lit;   /* effective over chosen light samples */
};

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* want: the value of all points; 0: their mean is taken as correct. */
static struct failing measure(const struct gbuffer *g, const struct environment *e, const struct variant *v,
                              double want)
{
    static float lo[2][POINTS * 3];
    enum { SEEDS_MAX = 2048 };
    static double pairs[SEEDS_MAX / 2];
    struct tally t[POINTS] = { { 0.0, 0.0, 0.0 } };
    struct direct *d = direct_create(best_kernels());
    const uint32_t seeds = full() ? SEEDS_MAX : 256;
    double chosen = 0.0, effective = 0.0, value = 0.0;
    struct failing out = { 0.0, 0.0, 0.0, 0.0 };

    omp_set_num_threads(1);
    for (uint32_t k = 0; k < seeds; k++) {
        const struct direct_stats s = shade_by(d, g, NULL, e, v, SAMPLES, k, lo[k % 2]);
        chosen += (double)s.chosen;
        effective += (double)s.effective;
        for (uint32_t i = 0; i < POINTS; i++) {
            const size_t at = (size_t)(i / PACKET) * 3 * PACKET + i % PACKET;
            tally_add(&t[i], lo[k % 2][at]);
            if (k % 2)
                pairs[k / 2] += 0.5 * pow((double)lo[0][at] - lo[1][at], 2.0) / POINTS;
        }
    }
    direct_destroy(d);
    for (uint32_t i = 0; i < POINTS; i++)
        value += tally_mean(&t[i]) / POINTS;
    want = want > 0.0 ? want : value;
    for (uint32_t i = 0; i < POINTS; i++) {
        const double variance = pow(tally_error(&t[i]), 2.0) * (seeds - 1);
        out.noise += variance / POINTS;
        out.error += (variance + pow(tally_mean(&t[i]) - want, 2.0)) / POINTS;
    }
    qsort(pairs, seeds / 2, sizeof(pairs[0]), ascending);
    out.told = sqrt(pairs[seeds / 4]) / want;
    memset(pairs, 0, sizeof(pairs));
    out.noise = sqrt(out.noise) / want;
    out.error = sqrt(out.error) / want;
    out.lit = chosen > 0.0 ? effective / chosen : 1.0;
    return out;
}

static const struct variant *named(const char *name)
{
    for (int k = 0; k < VARIANTS; k++)
        if (strcmp(variants[k].name, name) == 0)
            return &variants[k];
    fail_msg("there is no variant %s", name);
    return NULL;
}

/* The best of those that must fail, the worst of those that must not. */
static void best_of(struct worst *w, double value, const char *name)
{
    if (!w->where[0] || value < w->value) {
        w->value = value;
        snprintf(w->where, sizeof(w->where), "the best, %s", name);
    }
}

/* Identical points that face slightly aside, seen at 45 degrees. */
static struct gbuffer alike(enum lobe_kind kind, float diffuse, float specular, float gloss)
{
    struct gbuffer g = points_make(PACKETS, kind, diffuse, specular, gloss);
    const struct vec3 n = vec3_normalize(vec3_make(0.1f, 1.0f, 0.05f)), o = vec3_normalize(vec3_make(0.7f, 0.7f, 0.1f));

    for (uint32_t i = 0; i < POINTS; i++) {
        struct shade_packet *p = &g.packets[i / PACKET];
        const uint32_t l = i % PACKET;
        p->ns_x[l] = p->ng_x[l] = n.x;
        p->ns_y[l] = p->ng_y[l] = n.y;
        p->ns_z[l] = p->ng_z[l] = n.z;
        p->wo_x[l] = o.x;
        p->wo_y[l] = o.y;
        p->wo_z[l] = o.z;
    }
    return g;
}

/* The sharper the lobe, the fewer sky samples it sees: of an even sky one in n / 2 at an exponent n. */
static void light_sampling_fails_on_a_near_mirror(void **state)
{
    static const struct {
        const char *name;
        enum lobe_kind kind;
        float gloss;
        double least;
    } lobes[] = { { "exponent 10^4", LOBE_PHONG, 1e4f, 2.0 },
                  { "alpha 0.0025, all but a mirror", LOBE_GGX, 0.0025f, 2.0 } };
    (void)state;
    struct environment *e = sky_environment(sky_overcast(64, 32), 32, 0.0);
    for (int k = 0; k < 2; k++) {
        struct gbuffer g = alike(lobes[k].kind, 0.0f, 0.9f, lobes[k].gloss);
        struct worst best = { 0.0, "" }, worst = { 0.0, "" };
        char name[96];
        for (int v = 0; v < VARIANTS; v++) {
            const bool sharp = variants[v].claims & SHARP_LOBE;
            const double error = measure(&g, e, &variants[v], 0.0).error;
            if (sharp)
                worst_of(&worst, error, variants[v].name, "");
            else
                best_of(&best, error, variants[v].name);
        }
        const struct failing faces = measure(&g, e, named("faces"), 0.0);
        snprintf(name, sizeof(name), "%s, by light alone", lobes[k].name);
        fails_above(name, "by light alone (9)", "error at N_s = 64", best.value, lobes[k].least, best.where);
        snprintf(name, sizeof(name), "%s: two images hide it", lobes[k].name);
        holds_below(name, "faces", "error told by their difference over the true one", faces.told / faces.error, 0.5,
                    "");
        snprintf(name, sizeof(name), "%s, by lobes too", lobes[k].name);
        holds_below(name, claimants(SHARP_LOBE), "error at N_s = 64", worst.value, 0.1, worst.where);
        snprintf(name, sizeof(name), "%s: auto samples lobes by half", lobes[k].name);
        holds_below(name, "auto", "error at N_s = 64", measure(&g, e, named("auto"), 0.0).error, 0.1, "");
        points_free(&g);
    }
    environment_destroy(e);
    verdict();
}

/* A sun of half a degree covers 1.5e-5 of all directions, with ten times the sky's light. */
static void sampling_without_the_light_fails_under_a_small_sun(void **state)
{
    static const char *const blind[] = { "uniform", "brdf" };
    struct worst best = { 0.0, "" }, worst = { 0.0, "" }, told = { 0.0, "" };
    struct sky_table t = { 0 };
    (void)state;
    struct frame f = sky_overcast(512, 256);
    double w[3] = { 0.3, 1.0, 0.5 };
    unit3(w);
    sky_disc(&f, w, 0.1, 3e5f, 3e5f, 3e5f);
    struct environment *e = sky_environment(f, 128, 0.0);
    struct gbuffer g = alike(LOBE_LAMBERT, 0.6f, 0.0f, 0.0f);
    const double n[3] = { g.packets[0].ns_x[0], g.packets[0].ns_y[0], g.packets[0].ns_z[0] };
    const double want = 0.6 * irradiance(e, n, false) / PI;
    struct failing of[2];
    for (int k = 0; k < 2; k++) {
        of[k] = measure(&g, e, named(blind[k]), want);
        best_of(&best, of[k].error, blind[k]);
        worst_of(&told, of[k].told / of[k].error, blind[k], "");
    }
    for (int k = 0; k < VARIANTS; k++)
        if (variants[k].claims & SMALL_SUN)
            worst_of(&worst, measure(&g, e, &variants[k], want).error, variants[k].name, "");
    const struct sky_table_desc desc = { .cells = 1, .sun = true };
    assert_int_equal(sky_table_build(&t, e, &desc), ERR_OK);
    fails_above("small sun, without a look at the light", "uniform, brdf", "error at N_s = 64", best.value, 0.5,
                best.where);
    holds_below("small sun: two images hide it", "uniform, brdf", "error told by their difference over the true one",
                told.value, 0.2, told.where);
    shows_above("small sun: the sky's table shows it", "sky_table", "the sun's part of the light",
                t.has_sun ? t.sun_energy / e->total_energy : 0.0, 0.1, "a tenth is asked for");
    holds_below("small sun, by light", claimants(SMALL_SUN), "error at N_s = 64", worst.value, 0.1, worst.where);
    holds_below("small sun: auto takes it apart", "auto", "error at N_s = 64",
                measure(&g, e, named("auto"), want).error, 0.05, "");
    sky_table_finish(&t);
    points_free(&g);
    environment_destroy(e);
    verdict();
}

/* Set by two degrees: its face is still partly above the horizon, and draws nearly all samples. */
static void light_sampling_fails_where_the_sun_is_down_and_its_face_is_not(void **state)
{
    static const char *const deceived[] = { "light", "faces", "latlong", "latlong-rows" };
    struct worst best = { 0.0, "" }, worst = { 0.0, "" };
    (void)state;
    struct frame f = sky_overcast(256, 128);
    double w[3] = { 0.1, -0.045, 0.99 };
    unit3(w);
    sky_disc(&f, w, 1.0, 1e6f, 0.9e6f, 0.7e6f);
    struct environment *e = sky_environment(f, 64, 0.0);
    struct gbuffer g = alike(LOBE_LAMBERT, 0.6f, 0.0f, 0.0f);
    for (uint32_t i = 0; i < POINTS; i++) { /* straight up */
        struct shade_packet *p = &g.packets[i / PACKET];
        p->ns_x[i % PACKET] = p->ng_x[i % PACKET] = p->ns_z[i % PACKET] = p->ng_z[i % PACKET] = 0.0f;
        p->ns_y[i % PACKET] = p->ng_y[i % PACKET] = 1.0f;
    }
    for (int k = 0; k < 4; k++)
        best_of(&best, measure(&g, e, named(deceived[k]), 0.0).error, deceived[k]);
    for (int k = 0; k < VARIANTS; k++)
        if (variants[k].claims & HIDDEN_SUN)
            worst_of(&worst, measure(&g, e, &variants[k], 0.0).error, variants[k].name, "");
    fails_above("sun down, its face up", "light alone (4)", "error at N_s = 64", best.value, 0.3, best.where);
    shows_above("sun down, its face up: the statistics show it", "faces", "chosen samples for one that is effective",
                1.0 / measure(&g, e, named("faces"), 0.0).lit, 10.0, "");
    holds_below("sun down, its face up", claimants(HIDDEN_SUN), "error at N_s = 64", worst.value, 0.45, worst.where);
    holds_below("sun down, its face up: auto takes it apart", "auto", "error at N_s = 64",
                measure(&g, e, named("auto"), 0.0).error, 0.05, "");
    points_free(&g);
    environment_destroy(e);
    verdict();
}

enum { WIDTH = 16, HEIGHT = 12, PIXELS = WIDTH * HEIGHT };

enum yard_view { FROM_ABOVE, IN_A_MIRROR, THROUGH_THE_LOOKING_GLASS };

/* A floor, a mirror that reflects the sun onto it, and a second one across that shows it; or instead of the second
 * the eye's mirror image behind it. From above no mirror is visible. */
static struct prepared_scene *yard(enum yard_view view)
{
    static const struct camera cameras[] = {
        { "above", { -0.3f, 3.0f, 0 }, { -0.3f, 0, 0 }, { 0, 0, -1 }, 0.3f },
        { "mirror", { -0.5f, 2.4f, 1.0f }, { -0.5f, 0.9f, -1.5f }, { 0, 1, 0 }, 0.3f },
        { "image", { -0.5f, 2.4f, -4.0f }, { -0.5f, 0.9f, -1.5f }, { 0, 1, 0 }, 0.3f },
    };
    struct scene *s = scene_create();

    add_wall(s, add_lambert(s, 0.7f), 1, 0.0f, (const float[2]){ -3, -3 }, (const float[2]){ 3, 3 });
    const uint32_t mirror = add_kind(s, MATERIAL_MIRROR, 0.9f, 0.9f, 0.9f, 0.0f);
    add_wall(s, mirror, 0, -1.0f, (const float[2]){ 0, -0.8f }, (const float[2]){ 0.8f, 0.8f });
    if (view == IN_A_MIRROR)
        add_wall(s, mirror, 2, -1.5f, (const float[2]){ -2, 0 }, (const float[2]){ 1, 2 });
    return set_of(s, &cameras[view], WIDTH, HEIGHT, 1);
}

/* A sun of 0.7 degrees at 45 degrees of height, from +X and slightly behind the second mirror. */
static struct environment *sun_and_sky(float sun, float sky)
{
    struct frame f = sky_constant(512, 256, sky);

    sky_disc(&f, (const double[3]){ 0.7, 0.7071, -0.1 }, 0.1, sun, sun, sun);
    return sky_environment(f, 128, 0.0);
}

/* Images of caustics alone. */
struct gathered {
    struct tally pixel[PIXELS], whole; /* luminance */
    double rays;                       /* an image */
    uint64_t dark, lit;                /* pixels with less than half of their light, pixels with light */
    struct plan plan;
};

static void gather(struct prepared_scene *set, const struct environment *e, const struct relight_desc *desc,
                   uint32_t seeds, struct gathered *out)
{
    static float rgb[PIXELS * 3];
    struct relighter *r = relighter_create(set, best_kernels());
    struct relight_desc by = *desc;

    omp_set_num_threads(1);
    memset(out, 0, sizeof(*out));
    by.classes = PATH_CAUSTICS;
    if (by.direct.samples == 0)
        by.direct.samples = SAMPLES;
    for (uint32_t k = 0; k < seeds; k++) {
        double sum = 0.0;
        by.direct.seed = k;
        const struct relight_stats s = image_of(r, e, &by, rgb);
        out->plan = s.plan;
        out->rays += (double)(s.eye.rays + s.light.rays + s.reference_rays) / seeds;
        for (uint32_t i = 0; i < PIXELS; i++) {
            const double l = rgb_luminance(rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]);
            tally_add(&out->pixel[i], l);
            sum += l / PIXELS;
        }
        tally_add(&out->whole, sum);
    }
    relighter_destroy(r);
}

/* relMSE of one image against another's mean, over pixels with light there; counts those that stay dark. */
static double error_of(struct gathered *a, const struct gathered *truth)
{
    double sum = 0.0, count = 0.0, mean = 0.0;

    for (uint32_t i = 0; i < PIXELS; i++)
        mean += tally_mean(&truth->pixel[i]) / PIXELS;
    a->dark = a->lit = 0;
    for (uint32_t i = 0; i < PIXELS; i++) {
        const double want = tally_mean(&truth->pixel[i]), got = tally_mean(&a->pixel[i]);
        const double variance = pow(tally_error(&a->pixel[i]), 2.0) * (a->pixel[i].count - 1.0);
        if (want < 0.1 * mean)
            continue;
        sum += (variance + (got - want) * (got - want)) / (want * want);
        count += 1.0;
        a->lit++;
        a->dark += got < 0.5 * want;
    }
    return sum / count;
}

/* Eye paths reach a sun behind a mirror by chance; light paths connect to the eye at every event. Errors of one
 * image, at as many rays; the reference is the light tracer with a hundred times as many. */
static void eye_paths_fail_on_a_suns_caustic(void **state)
{
    static struct gathered truth, eye, light, chosen;
    const struct relight_desc by_eye = { .caustics = PLAN_EYE, .eye_paths = 64 };
    const struct relight_desc by_light = { .caustics = PLAN_LIGHT, .particles = 8192 };
    const uint32_t seeds = full() ? 256 : 32;
    char where[64];
    (void)state;
    struct prepared_scene *set = yard(FROM_ABOVE);
    struct environment *e = sun_and_sky(1e4f, 0.02f);
    gather(set, e, &(struct relight_desc){ .caustics = PLAN_LIGHT, .particles = 200000 }, 8, &truth);
    gather(set, e, &by_light, seeds, &light);
    gather(set, e, &by_eye, 32, &eye);
    gather(set, e, &(struct relight_desc){ .caustics = PLAN_AUTO }, 4, &chosen);
    const double failed = error_of(&eye, &truth), held = error_of(&light, &truth);
    snprintf(where, sizeof(where), "%.0f rays", eye.rays);
    fails_above("a sun's caustic, by eye paths", "eye paths", "relMSE of a picture", failed, 10.0, where);
    fails_above("a sun's caustic: 32 images have not found it", "eye paths", "share of its pixels that lack half",
                (double)eye.dark / (double)eye.lit, 0.5, "so that images agree, and all are wrong");
    snprintf(where, sizeof(where), "%.0f rays", light.rays);
    holds_below("a sun's caustic, by light paths", "light tracer", "relMSE of a picture", held, 0.5, where);
    shows_above("a sun's caustic: the plan's facts show it", "plan", "peakedness", facts_peakedness(e), 5.0,
                "the plan asks for 5");
    holds_all("a sun's caustic: auto sends light paths", "auto", "choices",
              chosen.plan.caustics == PLAN_LIGHT && chosen.plan.particles > 0, 1);
    environment_destroy(e);
    set_destroy(set);
    verdict();
}

/* The same yard under an even sky: all light paths contribute equally little, and eye paths find sky in every
 * direction. */
static void the_light_tracer_is_wasted_on_an_even_sky(void **state)
{
    static struct gathered truth, eye, light, chosen;
    const uint32_t seeds = full() ? 256 : 32;
    char where[64];
    (void)state;
    struct prepared_scene *set = yard(FROM_ABOVE);
    struct environment *e = sky_environment(sky_overcast(64, 32), 32, 0.0);
    gather(set, e, &(struct relight_desc){ .caustics = PLAN_EYE, .eye_paths = 4096 }, 4, &truth);
    gather(set, e, &(struct relight_desc){ .caustics = PLAN_EYE, .eye_paths = 64 }, seeds, &eye);
    gather(set, e, &(struct relight_desc){ .caustics = PLAN_LIGHT, .particles = 8192 }, seeds, &light);
    gather(set, e, &(struct relight_desc){ .caustics = PLAN_AUTO }, 4, &chosen);
    const double by_eye = error_of(&eye, &truth) * eye.rays, by_light = error_of(&light, &truth) * light.rays;
    snprintf(where, sizeof(where), "%.0f and %.0f rays", light.rays, eye.rays);
    fails_above("even sky: caustics by light paths", "light tracer", "relMSE times rays over that of eye paths",
                by_light / by_eye, 1.0, where);
    holds_below("even sky: the plan's facts show it", "plan", "peakedness", facts_peakedness(e), 5.0,
                "the plan asks for 5");
    holds_all("even sky: auto sends eye paths", "auto", "choices",
              chosen.plan.caustics == PLAN_EYE && chosen.plan.particles == 0, 1);
    environment_destroy(e);
    set_destroy(set);
    verdict();
}

/* A delta on both sides of the one rough surface: light paths cannot be connected to the eye, and eye paths find the
 * sun by chance. The expected value comes from the eye's mirror image, to which light paths can be connected. */
static void everything_fails_on_a_caustic_seen_in_a_mirror(void **state)
{
    static struct gathered truth, by[4];
    static const struct relight_desc ways[4] = {
        { .caustics = PLAN_AUTO },
        { .caustics = PLAN_LIGHT, .particles = 20000, .eye_paths = 64 },
        { .direct = { .method = METHOD_PATH, .samples = 64 } },
        { .direct = { .method = METHOD_MLT, .samples = 64 } },
    };
    static const char *const names[4] = { "auto", "light, with eye paths behind mirrors", "path", "mlt" };
    struct worst best = { 0.0, "" };
    const uint32_t seeds = full() ? 128 : 16;
    (void)state;
    struct prepared_scene *image = yard(THROUGH_THE_LOOKING_GLASS), *set = yard(IN_A_MIRROR);
    struct environment *e = sun_and_sky(1e4f, 0.02f);
    gather(image, e, &(struct relight_desc){ .caustics = PLAN_LIGHT, .particles = 100000 }, 4, &truth);
    const double want = 0.9 * tally_mean(&truth.whole);
    for (int k = 0; k < 4; k++) {
        gather(set, e, &ways[k], seeds, &by[k]);
        const double share = tally_mean(&by[k].whole) / want; /* without noise where no path finds the sun */
        const double error = hypot(tally_error(&by[k].whole) * sqrt(by[k].whole.count) / want, share - 1.0);
        char where[128];
        snprintf(where, sizeof(where), "%s, a mean of %.2f of what it should be", names[k], share);
        best_of(&best, error, where);
    }
    fails_above("a sun's caustic in a mirror", "auto, light, path, mlt", "relative error of a whole image's mean",
                best.value, 0.3, best.where);
    shows_above("a sun's caustic in a mirror: the plan's facts show it", "plan",
                "peakedness, with points behind mirrors", by[0].plan.behind_caustics ? facts_peakedness(e) : 0.0, 5.0,
                "");
    holds_all("a sun's caustic in a mirror: auto sends eye paths", "auto", "choices, unbiased and grainy",
              by[0].plan.behind_caustics && by[0].plan.eye_paths > 0, 1);
    environment_destroy(e);
    set_destroy(image);
    set_destroy(set);
    verdict();
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(light_sampling_fails_on_a_near_mirror),
    cmocka_unit_test(sampling_without_the_light_fails_under_a_small_sun),
    cmocka_unit_test(light_sampling_fails_where_the_sun_is_down_and_its_face_is_not),
    cmocka_unit_test(eye_paths_fail_on_a_suns_caustic),
    cmocka_unit_test(the_light_tracer_is_wasted_on_an_even_sky),
    cmocka_unit_test(everything_fails_on_a_caustic_seen_in_a_mirror),
};
UNIT_MAIN(tests)
