/* Skies that samplers and estimators are known to fail on: a sun at all difficult positions, black frames, one sample,
 * more strata than samples, day and night in successive frames.
 *
 * Statistical cases compare the mean over seeds with quadrature of the same function that the method evaluates, in
 * standard errors; the limit accounts for the number of comparisons of the case. */
#include "stability.h"

#define Z_LIMIT 5.0 /* two-sided 5.7e-7: passed by chance once in 5000 runs of 350 comparisons */

struct place {
    const char *name;
    double w[3];
};

/* Seen by a plane that faces up. */
static const struct place seen[] = {
    { "face centre", { 0, 0.35, 1 } },   { "cube edge", { 1, 0.6, 1 } },
    { "upper edge", { 0.3, 1, 1 } },     { "cube corner", { 1, 1, 1 } },
    { "another corner", { -1, 1, -1 } }, { "pole", { 0, 1, 0 } },
    { "seam", { 0.02, 0.5, -1 } },       { "grazing, 2 degrees up", { 0.6, 0.035, 0.8 } },
    { "half set", { 0.8, 0.0, 0.6 } },   { "half set on an edge", { 1, 0, 1 } },
};
enum { SEEN = sizeof(seen) / sizeof(seen[0]) };

/* A sun of 20000 times the sky over 1.5 degrees, high up 20 times as much light as the rest. 130 comparisons. Power:
 * standard errors are at most 5 % (second line; half set, where mostly the sky lights and mostly the sun is sampled),
 * elsewhere 0.2 %, so a bias of 25 % is always detected and one of 1 % mostly. */
static void a_sun_at_every_awkward_place_lights_as_quadrature(void **state)
{
    struct worst z = { 0.0, "" }, error = { 0.0, "" };
    const double up[3] = { 0, 1, 0 };
    const uint32_t seeds = full() ? 512 : 64;
    (void)state;
    struct gbuffer g = points_make(4, LOBE_LAMBERT, 1.0f, 0.0f, 0.0f);
    for (int p = 0; p < SEEN; p++) {
        struct frame f = sky_overcast(256, 128);
        double w[3] = { seen[p].w[0], seen[p].w[1], seen[p].w[2] };
        unit3(w);
        sky_disc(&f, w, 1.5, 2e4f, 1.8e4f, 1.4e4f);
        struct environment *e = sky_environment(f, 64, 0.0);
        const double want[2] = { irradiance(e, up, false) / PI, irradiance(e, up, true) / PI };
        for (int k = 0; k < VARIANTS; k++) {
            if (!(variants[k].claims & SMALL_SUN))
                continue;
            const struct tally t = tally_by(&g, e, &variants[k], 64, seeds);
            const double expect = want[(variants[k].claims & OWN_SOURCE) != 0];
            worst_of(&z, z_of(&t, expect), seen[p].name, variants[k].name);
            worst_of(&error, tally_error(&t) / expect, seen[p].name, variants[k].name);
        }
        environment_destroy(e);
    }
    points_free(&g);
    holds_below("sun at 10 awkward places: the mean", claimants(SMALL_SUN), "standard errors from quadrature", z.value,
                Z_LIMIT, z.where);
    holds_below("sun at 10 awkward places: the doubt", claimants(SMALL_SUN), "relative standard error", error.value,
                0.05, error.where);
    verdict();
}

/* A floor, and a mirror at x = -1 that reflects the sun onto it; from above, where the mirror is not visible. */
static struct prepared_scene *mirror_yard(void)
{
    static const struct camera above = { "above", { -0.3f, 3.0f, 0 }, { -0.3f, 0, 0 }, { 0, 0, -1 }, 0.3f };
    struct scene *s = scene_create();

    add_wall(s, add_lambert(s, 0.7f), 1, 0.0f, (const float[2]){ -3, -3 }, (const float[2]){ 3, 3 });
    add_wall(s, add_kind(s, MATERIAL_MIRROR, 0.9f, 0.9f, 0.9f, 0.0f), 0, -1.0f, (const float[2]){ 0, -0.8f },
             (const float[2]){ 0.8f, 0.8f });
    return set_of(s, &above, 16, 12, 1);
}

/* Mean luminance of the mirror's reflection on the floor, by quadrature over positions and directions: light from w
 * arrives as from its mirror image, as far as visible through the mirror's frame. */
struct thrown {
    double at[2048][2]; /* x and z of the floor */
    uint32_t count;
    double sum;
};

static void add_thrown(void *user, const double w[3], double solid_angle, const float rgb[3])
{
    struct thrown *t = user;
    const double light = solid_angle * w[1] * rgb_luminance(rgb[0], rgb[1], rgb[2]);

    if (w[0] <= 0.0 || w[1] <= 0.0)
        return;
    for (uint32_t k = 0; k < t->count; k++) {
        const double far = (t->at[k][0] + 1.0) / w[0], y = far * w[1], z = t->at[k][1] + far * w[2];
        if (far > 0.0 && y < 0.8 && fabs(z) < 0.8)
            t->sum += light / t->count;
    }
}

static double thrown_light(const struct prepared_scene *set, const struct environment *e)
{
    static struct thrown t;

    t.count = 0;
    t.sum = 0.0;
    for (uint32_t k = 0; k < 48 * 36; k++) {
        const struct vec3 d = view_direction(&set->view, (k % 48 + 0.5) / 3.0, (k / 48 + 0.5) / 3.0);
        const double far = -3.0 / d.y;
        t.at[t.count][0] = -0.3 + far * d.x;
        t.at[t.count++][1] = far * d.z;
    }
    each_cube_direction(e, add_thrown, &t);
    return 0.9 * 0.7 / PI * t.sum;
}

/* Light paths start at the sun wherever it is, in each of the three ways: 18 comparisons, with 1 % of the mean
 * allowed for the quadrature, between whose positions a caustic's border may fall. Standard errors are at most 8 %,
 * for a half-set sun, and mostly 1 %: a bias of 40 % is always detected, one of 7 % mostly. */
static void a_sun_at_every_awkward_place_is_where_light_paths_begin(void **state)
{
    static const int places[] = { 1, 2, 3, 7, 8, 9 };
    static const char *const names[] = { "faces", "quad", "disc" };
    static float rgb[16 * 12 * 3];
    struct worst z = { 0.0, "" }, error = { 0.0, "" };
    (void)state;
    struct prepared_scene *set = mirror_yard();
    struct relighter *r = relighter_create(set, best_kernels());
    omp_set_num_threads(1);
    for (int p = 0; p < 6; p++) {
        struct frame f = sky_constant(256, 128, 0.0f);
        double w[3] = { seen[places[p]].w[0], seen[places[p]].w[1], seen[places[p]].w[2] };
        unit3(w);
        sky_disc(&f, w, 1.5, 1e4f, 1e4f, 1e4f);
        struct environment *e = sky_environment(f, 64, 0.0);
        const double want = thrown_light(set, e);
        for (int start = START_FACES; start <= START_DISC; start++) {
            struct relight_desc desc = { .classes = PATH_CAUSTICS, .caustics = PLAN_LIGHT, .particles = 4096 };
            struct tally t = { 0.0, 0.0, 0.0 };
            desc.start = (enum start_kind)start;
            desc.direct.samples = 1;
            for (desc.direct.seed = 0; desc.direct.seed < (full() ? 512 : 40); desc.direct.seed++) {
                double sum = 0.0;
                image_of(r, e, &desc, rgb);
                for (int i = 0; i < 16 * 12; i++)
                    sum += rgb_luminance(rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]) / (16 * 12);
                tally_add(&t, sum);
            }
            worst_of(&z, fabs(tally_mean(&t) - want) / (tally_error(&t) + 0.01 * want), seen[places[p]].name,
                     names[start]);
            worst_of(&error, tally_error(&t) / want, seen[places[p]].name, names[start]);
        }
        environment_destroy(e);
    }
    relighter_destroy(r);
    set_destroy(set);
    holds_below("sun at 6 awkward places, by a mirror: the mean", "light tracer, all starts",
                "standard errors from quadrature", z.value, Z_LIMIT, z.where);
    holds_below("sun at 6 awkward places, by a mirror: the doubt", "light tracer, all starts",
                "relative standard error", error.value, 0.08, error.where);
    verdict();
}

static const struct place unseen[] = {
    { "behind", { 0, -1, 0.2 } },     { "nadir", { 0, -1, 0 } },
    { "lower corner", { 1, -1, 1 } }, { "2 degrees below", { 0.6, -0.045, 0.8 } },
    { "lower edge", { 1, -0.2, 1 } },
};
enum { UNSEEN = sizeof(unseen) / sizeof(unseen[0]) };

/* Alone in a black sky it lights nothing, bit for bit. With an overcast sky methods that separate the sun, or also
 * sample lobes, lose nothing: 30 comparisons, of standard errors at most 2 %. failures.c measures how much the others
 * lose. */
static void a_sun_that_is_down_does_no_harm(void **state)
{
    struct worst z = { 0.0, "" }, error = { 0.0, "" };
    const double up[3] = { 0, 1, 0 };
    const uint32_t seeds = full() ? 512 : 64;
    uint64_t dark = 0, total = 0;
    (void)state;
    struct gbuffer g = points_make(4, LOBE_LAMBERT, 1.0f, 0.0f, 0.0f);
    struct direct *d = direct_create(best_kernels());
    for (int p = 0; p < UNSEEN; p++) {
        float lo[4 * 3 * PACKET];
        struct frame f = sky_constant(256, 128, 0.0f), cloudy = sky_overcast(256, 128);
        double w[3] = { unseen[p].w[0], unseen[p].w[1], unseen[p].w[2] };
        unit3(w);
        sky_disc(&f, w, 1.5, 1e6f, 1e6f, 1e6f);
        sky_disc(&cloudy, w, 1.5, 1e5f, 0.9e5f, 0.7e5f);
        struct environment *alone = sky_environment(f, 64, 0.0), *e = sky_environment(cloudy, 64, 0.0);
        const double want = irradiance(e, up, false) / PI;
        for (int k = 0; k < VARIANTS; k++) {
            shade_by(d, &g, NULL, alone, &variants[k], 16, 1, lo);
            for (size_t i = 0; i < sizeof(lo) / sizeof(lo[0]); i++)
                dark += lo[i] == 0.0f;
            total += sizeof(lo) / sizeof(lo[0]);
            if (!(variants[k].claims & HIDDEN_SUN))
                continue;
            const struct tally t = tally_by(&g, e, &variants[k], 64, seeds);
            worst_of(&z, z_of(&t, want), unseen[p].name, variants[k].name);
            worst_of(&error, tally_error(&t) / want, unseen[p].name, variants[k].name);
        }
        environment_destroy(alone);
        environment_destroy(e);
    }
    direct_destroy(d);
    points_free(&g);
    holds_all("sun behind or below, black sky", claimants(ANY_SKY), "values that are exactly 0", dark, total);
    holds_below("sun behind or below, overcast: the mean", claimants(HIDDEN_SUN), "standard errors from quadrature",
                z.value, Z_LIMIT, z.where);
    holds_below("sun behind or below, overcast: the doubt", claimants(HIDDEN_SUN), "relative standard error",
                error.value, 0.02, error.where);
    verdict();
}

/* Mean over points of the light from the sky, by quadrature. */
static double mean_irradiance(const struct environment *e, const struct gbuffer *g, bool source)
{
    double sum = 0.0;

    for (uint32_t i = 0; i < g->packet_count * PACKET; i++) {
        const struct shade_packet *p = &g->packets[i / PACKET];
        const uint32_t l = i % PACKET;
        const double n[3] = { p->ns_x[l], p->ns_y[l], p->ns_z[l] };
        sum += irradiance(e, n, source) / (g->packet_count * PACKET);
    }
    return sum;
}

/* One sample per point, and up to 385 strata for up to five: most counts are 0 or fractional, and the mean is correct
 * nevertheless. 15 + 13 methods at 1 and 5 samples: 56 comparisons. Standard errors are at most 3 %, mostly 1 %: a
 * bias of 15 % is always detected, one of 5 % mostly, and one of 1 % in the long form. */
static void fewer_samples_than_strata_do_not_bias(void **state)
{
    static const char *const names[2] = { "overcast", "sun" };
    struct worst z = { 0.0, "" }, error = { 0.0, "" };
    const uint32_t seeds = full() ? 16384 : 1024;
    (void)state;
    struct gbuffer g = points_make(4, LOBE_LAMBERT, 1.0f, 0.0f, 0.0f);
    points_scatter(&g, 3);
    for (int sun = 0; sun < 2; sun++) {
        struct environment *e = sky_environment(sun ? sky_with_sun(64, 32, 1e4f) : sky_overcast(64, 32), 32, 0.0);
        const double want[2] = { mean_irradiance(e, &g, false) / PI, mean_irradiance(e, &g, true) / PI };
        for (int k = 0; k < VARIANTS; k++)
            for (uint32_t n = 1; n <= 5; n += 4) {
                char where[96];
                if (sun && !(variants[k].claims & SMALL_SUN))
                    continue;
                const struct tally t = tally_by(&g, e, &variants[k], n, seeds);
                const double expect = want[(variants[k].claims & OWN_SOURCE) != 0];
                snprintf(where, sizeof(where), "%s, N_s = %u", names[sun], n);
                worst_of(&z, z_of(&t, expect), variants[k].name, where);
                worst_of(&error, tally_error(&t) / expect, variants[k].name, where);
            }
        environment_destroy(e);
    }
    points_free(&g);
    holds_below("N_s of 1 and 5, up to 385 strata: the mean", claimants(ANY_SKY), "standard errors from quadrature",
                z.value, Z_LIMIT, z.where);
    holds_below("N_s of 1 and 5, up to 385 strata: the doubt", claimants(ANY_SKY), "relative standard error",
                error.value, 0.03, error.where);
    verdict();
}

/* Every way to render, including references and light paths, gives exactly black. */
static void a_black_frame_is_black_by_every_method(void **state)
{
    enum { W = 16, H = 12 };
    static float rgb[W * H * 3];
    uint64_t dark = 0, total = 0;
    (void)state;
    struct prepared_scene *set = NULL;
    struct reason why;
    assert_int_equal(
        set_create(&(struct prepared_scene_desc){ .width = W, .height = H, .edge_rays = 1 }, &set,
                   &why),
        ERR_OK);
    struct environment *e = sky_environment(sky_constant(32, 16, 0.0f), 16, 0.0);
    struct relighter *r = relighter_create(set, best_kernels());
    omp_set_num_threads(1);
    const enum method whole[] = { METHOD_PATH, METHOD_MLT, METHOD_PHOTONS, METHOD_VPL };
    for (int k = 0; k < VARIANTS + 4 + 2; k++) {
        struct relight_desc desc = { .classes = PATH_ALL, .particles = 1000, .eye_paths = 2 };
        if (k < VARIANTS)
            desc.direct = variants[k].desc;
        else if (k < VARIANTS + 4)
            desc.direct.method = whole[k - VARIANTS];
        else
            desc.direct.method = METHOD_AUTO;
        desc.caustics = desc.indirect = k == VARIANTS + 4 ? PLAN_LIGHT : k == VARIANTS + 5 ? PLAN_EYE : PLAN_AUTO;
        desc.direct.samples = 4;
        for (size_t i = 0; i < W * H * 3; i++)
            rgb[i] = NAN;
        image_of(r, e, &desc, rgb);
        for (size_t i = 0; i < W * H * 3; i++)
            dark += rgb[i] == 0.0f;
        total += W * H * 3;
    }
    relighter_destroy(r);
    environment_destroy(e);
    set_destroy(set);
    holds_all("a black frame", "all, references and light paths too (21)", "values that are exactly 0", dark, total);
    verdict();
}

/* Noon, then night in the next frame, and back: gains approach their target with each frame, never overshoot, and are
 * never more than a stop off once the image is displayed, so that no image is black or white. */
static void day_to_night_in_a_frame_neither_oscillates_nor_blinds(void **state)
{
    enum { W = 48, H = 32, FRAMES = 40 };
    static float rgb[2][W * H * 3];
    static const double night_stops[] = { -17.0, -40.0, 17.0, 40.0 };
    struct worst far = { 0.0, "" }, left = { 0.0, "" };
    uint64_t turns = 0, steps = 0;
    (void)state;
    struct rng r = { 4 };
    omp_set_num_threads(1);
    for (size_t i = 0; i < W * H * 3; i++)
        rgb[0][i] = (float)exp2(6.0 * (rng_next(&r) - 0.5));
    for (size_t s = 0; s < sizeof(night_stops) / sizeof(night_stops[0]); s++) {
        struct exposure e;
        double log2_mean, last = 0.0;
        char where[32];
        exposure_init(&e);
        (void)exposure_step(&e, rgb[0], W, H, 1);
        for (size_t i = 0; i < W * H * 3; i++)
            rgb[1][i] = rgb[0][i] * (float)exp2(night_stops[s]);
        assert_true(exposure_log2_mean(rgb[1], NULL, W, H, &log2_mean));
        const double goal = log2(e.key) - log2_mean;
        snprintf(where, sizeof(where), "%+g stops", night_stops[s]);
        for (int k = 0; k < FRAMES; k++) {
            const double now = log2(exposure_step(&e, rgb[1], W, H, 1)) - goal;
            worst_of(&far, fabs(now), where, "");
            turns += k > 0 && (now * last < 0.0 || fabs(now) > fabs(last) + 1e-12);
            steps++;
            last = now;
        }
        worst_of(&left, fabs(last), where, "");
    }
    holds_below("day to night in a frame: blinding", "exposure", "stops off from the first frame on", far.value,
                1.0 + 1e-6, far.where);
    holds_all("day to night in a frame: oscillation", "exposure", "steps nearer, none past the goal", steps - turns,
              steps);
    holds_below("day to night in a frame: 40 frames later", "exposure", "stops off", left.value, 0.01, left.where);
    verdict();
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_sun_at_every_awkward_place_lights_as_quadrature),
    cmocka_unit_test(a_sun_at_every_awkward_place_is_where_light_paths_begin),
    cmocka_unit_test(a_sun_that_is_down_does_no_harm),
    cmocka_unit_test(fewer_samples_than_strata_do_not_bias),
    cmocka_unit_test(a_black_frame_is_black_by_every_method),
    cmocka_unit_test(day_to_night_in_a_frame_neither_oscillates_nor_blinds),
};
UNIT_MAIN(tests)
