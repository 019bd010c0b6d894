/* Difficult geometry: a ground a thousand times the object, degenerate triangles, shading normals that face away,
 * flat lights and casters. Means over seeds are compared in standard errors; fixed seeds. */
#include "stability.h"

enum { WIDTH = 16, HEIGHT = 12, PIXELS = WIDTH * HEIGHT, VALUES = 3 * PIXELS };

/* A block and a mirror on a floor that extends `half` metres each way. */
static struct prepared_scene *yard(float half, bool mirror)
{
    static const struct camera aside = { "aside", { 0.6f, 2.6f, 2.2f }, { -0.3f, 0, 0 }, { 0, 1, 0 }, 0.5f };
    static const struct camera above = { "above", { -0.3f, 3.0f, 0 }, { -0.3f, 0, 0 }, { 0, 0, -1 }, 0.3f };
    struct scene *s = scene_create();
    const uint32_t matte = add_lambert(s, 0.7f);

    add_wall(s, matte, 1, 0.0f, (const float[2]){ -half, -half }, (const float[2]){ half, half });
    add_box(s, matte, (const float[3]){ -0.6f, 0, -0.5f }, (const float[3]){ -0.2f, 0.3f, -0.1f });
    if (mirror)
        add_wall(s, add_kind(s, MATERIAL_MIRROR, 0.9f, 0.9f, 0.9f, 0.0f), 0, -1.0f, (const float[2]){ 0, -0.8f },
                 (const float[2]){ 0.8f, 0.8f });
    return set_of(s, mirror ? &above : &aside, WIDTH, HEIGHT, 1); /* from above the mirror is not visible */
}

static struct environment *sunny(void)
{
    struct frame f = sky_overcast(256, 128);

    sky_disc(&f, (const double[3]){ 0.7, 0.7071, 0.1 }, 0.8, 4000.0f, 3600.0f, 2800.0f);
    return sky_environment(f, 64, 0.0);
}

/* Means over seeds of an image's pixels, and of the whole. */
struct means {
    struct tally pixel[PIXELS], whole;
    double hit; /* share of the light tracer's starts that hit a target first */
};

static void average(struct prepared_scene *set, const struct environment *e, const struct relight_desc *desc,
                    uint32_t seeds, struct means *out)
{
    static float rgb[VALUES];
    struct relighter *r = relighter_create(set, best_kernels());
    struct relight_desc by = *desc;

    omp_set_num_threads(1);
    memset(out, 0, sizeof(*out));
    by.direct.samples = by.direct.samples ? by.direct.samples : 32;
    for (uint32_t k = 0; k < seeds; k++) {
        double sum = 0.0;
        by.direct.seed = 1000 + k;
        const struct relight_stats s = image_of(r, e, &by, rgb);
        for (uint32_t i = 0; i < PIXELS; i++) {
            const double l = rgb_luminance(rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]);
            tally_add(&out->pixel[i], l);
            sum += l / PIXELS;
        }
        tally_add(&out->whole, sum);
        out->hit += s.light.particles ? (double)s.light.starts_hit / (double)s.light.particles / seeds : 0.0;
    }
    relighter_destroy(r);
}

/* Mean variance of an image's pixels over their squared mean. */
static double noise(const struct means *m)
{
    double variance = 0.0, square = 0.0;

    for (uint32_t i = 0; i < PIXELS; i++) {
        variance += pow(tally_error(&m->pixel[i]), 2.0) * m->pixel[i].count;
        square += pow(tally_mean(&m->pixel[i]), 2.0);
    }
    return variance / square;
}

/* Shadows, contacts and open ground equal those on a small floor: the same shade points, except for the rounding of
 * larger triangles. */
static void a_ground_of_a_thousand_times_the_object_takes_no_direct_light(void **state)
{
    static float a[VALUES], b[VALUES];
    struct worst off = { 0.0, "" };
    (void)state;
    omp_set_num_threads(1); /* small work items; the cores may be busy */
    struct prepared_scene *small = yard(3.0f, true), *large = yard(3000.0f, true);
    struct environment *e = sunny();
    struct relighter *r = relighter_create(small, best_kernels()), *q = relighter_create(large, best_kernels());
    for (int k = 0; k < VARIANTS; k++) {
        struct relight_desc desc = { .direct = variants[k].desc };
        struct metrics m;
        desc.direct.samples = 64;
        image_of(r, e, &desc, a);
        image_of(q, e, &desc, b);
        assert_true(metrics_compare(b, a, NULL, WIDTH, HEIGHT, 0.0, NULL, &m));
        worst_of(&off, m.rel_mse, variants[k].name, "");
    }
    relighter_destroy(r);
    relighter_destroy(q);
    environment_destroy(e);
    set_destroy(small);
    set_destroy(large);
    holds_below("ground 1000 times the object: direct light", claimants(ANY_SKY), "relMSE from that on a small one",
                off.value, 1e-3, off.where);
    verdict();
}

/* Particles are aimed at the casters: a large ground absorbs none. For indirect light they must go everywhere, and
 * one in a million reaches the visible part, where eye paths start. */
static void a_ground_of_a_thousand_times_the_object_takes_no_caustics(void **state)
{
    static struct means small, large, lit, eye;
    const struct relight_desc caustics = { .classes = PATH_CAUSTICS, .caustics = PLAN_LIGHT, .particles = 4096 };
    const struct relight_desc by_light = { .classes = PATH_INDIRECT, .indirect = PLAN_LIGHT, .particles = 4096 };
    const struct relight_desc by_eye = { .classes = PATH_INDIRECT, .eye_paths = 16 };
    const uint32_t seeds = full() ? 256 : 32;
    struct relight_stats stats;
    static float rgb[VALUES];
    (void)state;
    struct prepared_scene *near = yard(3.0f, true), *far = yard(3000.0f, true), *plain = yard(3000.0f, false);
    struct environment *e = sunny();
    average(near, e, &caustics, seeds, &small);
    average(far, e, &caustics, seeds, &large);
    average(plain, e, &by_light, seeds, &lit);
    average(plain, e, &by_eye, seeds, &eye);
    struct relighter *r = relighter_create(plain, best_kernels());
    stats = image_of(r, e, &(struct relight_desc){ .classes = PATH_ALL, .direct = { .samples = 4 } }, rgb);
    relighter_destroy(r);
    holds_below("ground 1000 times the object: caustics", "light tracer, aimed at casters",
                "relMSE over that with a small one", noise(&large) / noise(&small), 1.5, "");
    shows_above("ground 1000 times the object: starts that meet a caster", "light tracer, aimed at casters", "share",
                large.hit, 0.9 * small.hit, "");
    const bool found = tally_mean(&lit.whole) > 0.0;
    fails_above("ground 1000 times the object: indirect light by light", "light tracer, aimed at all",
                "relMSE of a picture", found ? noise(&lit) : 1e9, 1e3, found ? "" : "no light at all in 32 pictures");
    holds_below("ground 1000 times the object: indirect light by auto", "eye paths", "relMSE of a picture",
                stats.plan.indirect == PLAN_EYE ? noise(&eye) : NAN, 1.0, "");
    environment_destroy(e);
    set_destroy(near);
    set_destroy(far);
    set_destroy(plain);
    verdict();
}

static const char scene_text[] =
    "{\"camera\":{\"position\":[1.5,2,3],\"look_at\":[0,0.2,0],\"up\":[0,1,0],\"fov_y_degrees\":40},"
    "\"models\":[{\"file\":\"model.obj\"}],\"materials\":{\"grey\":{\"type\":\"lambert\",\"albedo\":[0.6,0.5,0.4]},"
    "\"shine\":{\"type\":\"mirror\",\"reflectance\":[0.9,0.9,0.9]}}}";

/* A floor, a slanted card and a mirror, with degenerate triangles: repeated corners, collinear, NaN, out of range,
 * too thin for a normal, and lines and points. */
static struct prepared_scene *card(bool spoilt)
{
    static const char good[] =
        "v -3 0 -3\nv 3 0 -3\nv 3 0 3\nv -3 0 3\nv -0.5 0 -0.5\nv 0.5 0 -0.5\nv 0.4 0.9 0.2\n"
        "v -1 0 -0.8\nv -1 0 0.8\nv -1 0.8 0.8\nv -1 0.8 -0.8\n"
        "v nan 0 0\nv 0 inf 0\nv 1e30 0 0\nv 2 0 0\nv 1 0 0\nv 0 0 0\nv 2 1e-12 0\nv 1 -1e-30 0\n"
        "usemtl grey\nf 1 4 3 2\nf 5 6 7\n";
    static const char bad[] =
        "f 1 1 2\nf 1 1 1\nf 17 16 15\nf 12 2 3\nf 1 13 3\nf 1 2 14\nf 12 13 14\nf 17 18 19\nl 1 2\n"
        "p 3\n";
    static const char more[] = "usemtl shine\nf 8 9 10 11\n";
    char text[2048];
    struct folder f;
    struct prepared_scene *set = NULL;
    struct reason why = { "" };

    omp_set_num_threads(1);
    snprintf(text, sizeof(text), "%s%s%s%s", good, spoilt ? bad : "", more, spoilt ? bad : "");
    folder_make(&f);
    folder_text(&f, "model.obj", text);
    const char *path = folder_text(&f, "scene.json", scene_text);
    log_begin();
    const enum err e = set_create(
        &(struct prepared_scene_desc){
            .scene = path, .width = WIDTH, .height = HEIGHT, .edge_rays = 1 },
        &set, &why);
    (void)log_end();
    folder_remove(&f);
    if (e)
        fail_msg("%s", why.text);
    return set;
}

static void triangles_that_are_none_change_no_bit(void **state)
{
    static float got[VALUES], want[VALUES];
    static const enum method whole[] = { METHOD_PATH, METHOD_MLT, METHOD_PHOTONS, METHOD_VPL };
    uint64_t same = 0, finite = 0, lit = 0, total = 0;
    (void)state;
    struct prepared_scene *good = card(false), *bad = card(true);
    struct environment *e = sunny();
    struct relighter *r = relighter_create(good, best_kernels()), *q = relighter_create(bad, best_kernels());
    for (int k = 0; k < VARIANTS + 6; k++) {
        struct relight_desc desc = { .classes = PATH_ALL, .particles = 500, .eye_paths = 1 };
        bool numbers = true, light = false;
        desc.direct.method = METHOD_AUTO;
        if (k < VARIANTS)
            desc.direct = variants[k].desc;
        else if (k < VARIANTS + 4)
            desc.direct.method = whole[k - VARIANTS];
        desc.caustics = desc.indirect = k == VARIANTS + 4 ? PLAN_LIGHT : k == VARIANTS + 5 ? PLAN_EYE : PLAN_AUTO;
        desc.direct.samples = 4;
        image_of(r, e, &desc, want);
        image_of(q, e, &desc, got);
        for (int i = 0; i < VALUES; i++) {
            numbers = numbers && isfinite(got[i]) && got[i] >= 0.0f;
            light = light || got[i] > 0.0f;
        }
        same += memcmp(got, want, sizeof(got)) == 0;
        finite += numbers;
        lit += light;
        total++;
    }
    relighter_destroy(r);
    relighter_destroy(q);
    environment_destroy(e);
    set_destroy(good);
    set_destroy(bad);
    holds_all("degenerate and NaN geometry", "all, references and light paths too (21)", "finite images with light",
              finite + lit, 2 * total);
    holds_all("degenerate and NaN geometry: as if left out", "all, references and light paths too (21)",
              "pictures of the same bits", same, total);
    verdict();
}

/* A floor whose normals lean by 70 degrees, a wall whose normals point behind it, a coarse ball with inverted
 * normals, and a leaning mirror. */
static struct prepared_scene *leaning(void)
{
    static const struct camera camera = { "leaning", { 0.6f, 1.8f, 2.8f }, { 0, 0.2f, 0 }, { 0, 1, 0 }, 0.8f };
    struct scene *s = scene_create();
    const uint32_t matte = add_kind(s, MATERIAL_LAMBERT, 0.7f, 0.6f, 0.5f, 0.0f);

    add_wall(s, matte, 1, 0.0f, (const float[2]){ -2, -2 }, (const float[2]){ 2, 2 });
    tilt_last(s, 0.9f, 0.35f, 0.2f);
    add_wall(s, matte, 2, -1.0f, (const float[2]){ -1, 0 }, (const float[2]){ 1, 1 });
    tilt_last(s, 0.6f, 0.3f, -0.7f);
    add_bowl(s, matte, vec3_make(0.4f, 0.4f, 0.2f), 0.4f, 0.0, 5, 8, true);
    struct mesh *ball = &s->meshes[s->mesh_count - 1];
    for (uint32_t i = 0; i < 3 * ball->vertex_count; i++)
        ball->normals[i] = -ball->normals[i];
    const struct material gloss = { .kind = MATERIAL_GGX,
                                    .diffuse = { 0.8f, 0.6f, 0.4f },
                                    .metallic = 0.3f,
                                    .roughness = 0.4f,
                                    .texture = MATERIAL_NO_TEXTURE };
    uint32_t glossy;
    assert_int_equal(scene_add_material(s, &gloss, &glossy), ERR_OK);
    add_wall(s, glossy, 0, -1.0f, (const float[2]){ 0, -1 }, (const float[2]){ 1, 1 });
    tilt_last(s, 0.3f, 0.2f, 0.9f);
    return set_of(s, &camera, WIDTH, HEIGHT, 16);
}

/* All methods count the same light: light above both normals, and no other. Against the reference, which has its own
 * camera rays: those of the G-buffer are 16 x 16 at edges, good to 2e-3 of the mean. 15 + 2 comparisons; standard
 * errors below 4 %, mostly 1 %: a bias of 20 % is always detected, one of 5 % mostly. */
static void shading_normals_that_face_away_count_the_same_by_every_method(void **state)
{
    static struct means want, got;
    struct worst z = { 0.0, "" }, error = { 0.0, "" }, rest = { 0.0, "" }, doubt = { 0.0, "" };
    const uint32_t seeds = full() ? 256 : 24;
    static const char *const names[2] = { "eye paths", "light tracer" };
    (void)state;
    struct prepared_scene *set = leaning();
    struct environment *e = sky_environment(sky_overcast(64, 32), 32, 30.0);
    struct relight_desc by = { .classes = PATH_DIRECT, .direct = { .method = METHOD_PATH, .samples = 64 } };
    average(set, e, &by, seeds, &want);
    for (int k = 0; k < VARIANTS; k++) {
        by.direct = variants[k].desc;
        average(set, e, &by, 2 * seeds, &got);
        const double slack = 2e-3 * tally_mean(&want.whole);
        worst_of(&z,
                 fabs(tally_mean(&got.whole) - tally_mean(&want.whole)) /
                     (hypot(tally_error(&got.whole), tally_error(&want.whole)) + slack),
                 variants[k].name, "");
        worst_of(&error, tally_error(&got.whole) / tally_mean(&want.whole), variants[k].name, "");
    }
    by = (struct relight_desc){ .classes = PATH_INDIRECT, .direct = { .method = METHOD_PATH, .samples = 64 } };
    average(set, e, &by, seeds, &want);
    for (int k = 0; k < 2; k++) {
        by = (struct relight_desc){ .classes = PATH_INDIRECT, .particles = 4096, .eye_paths = 16 };
        by.indirect = k ? PLAN_LIGHT : PLAN_EYE;
        average(set, e, &by, k ? 4 * seeds : seeds, &got);
        worst_of(&rest,
                 fabs(tally_mean(&got.whole) - tally_mean(&want.whole)) /
                     (hypot(tally_error(&got.whole), tally_error(&want.whole)) + 4e-3 * tally_mean(&want.whole)),
                 names[k], "");
        worst_of(&doubt, tally_error(&got.whole) / tally_mean(&want.whole), names[k], "");
    }
    environment_destroy(e);
    set_destroy(set);
    holds_below("shading normals that face away: direct light", claimants(ANY_SKY), "standard errors from path",
                z.value, 4.5, z.where);
    holds_below("shading normals that face away: the doubt", claimants(ANY_SKY), "relative standard error", error.value,
                0.04, error.where);
    holds_below("shading normals that face away: indirect light", "eye paths, light tracer",
                "standard errors from path", rest.value, 4.5, rest.where);
    holds_below("shading normals that face away: the doubt there", "eye paths, light tracer", "relative standard error",
                doubt.value, 0.04, doubt.where);
    verdict();
}

/* Light above both normals, by quadrature. */
struct both_normals {
    double shading[3], geometric[3], sum[PACKET];
    uint32_t lane;
};

static void add_above_both(void *user, const double w[3], double solid_angle, const float rgb[3])
{
    struct both_normals *b = user;
    const double s = w[0] * b->shading[0] + w[1] * b->shading[1] + w[2] * b->shading[2];
    const double g = w[0] * b->geometric[0] + w[1] * b->geometric[1] + w[2] * b->geometric[2];

    if (s > 0.0 && g > 0.0)
        b->sum[b->lane] += s * solid_angle * rgb_luminance(rgb[0], rgb[1], rgb[2]) / PI;
}

/* 16 points whose shading normal leans by 0 to 165 degrees from the geometric one, with nothing that would hide light
 * from below: 15 methods, standard errors at most 1 %; a bias of 5 % is always detected. */
static void light_counts_only_above_both_normals(void **state)
{
    struct worst z = { 0.0, "" }, error = { 0.0, "" };
    struct both_normals own = { .lane = 0 }, cube = { .lane = 0 };
    double want[2] = { 0.0, 0.0 };
    (void)state;
    struct environment *e = sky_environment(sky_overcast(64, 32), 32, 0.0);
    struct gbuffer g = points_make(1, LOBE_LAMBERT, 1.0f, 0.0f, 0.0f);
    for (int l = 0; l < PACKET; l++) {
        struct shade_packet *p = g.packets;
        const double lean = l * 11.0 * PI / 180.0;
        const double n[3] = { 0.6, 0.8, 0.0 }, s[3] = { 0.6 * cos(lean), 0.8 * cos(lean), sin(lean) };
        p->ng_x[l] = p->wo_x[l] = (float)n[0];
        p->ng_y[l] = p->wo_y[l] = (float)n[1];
        p->ng_z[l] = p->wo_z[l] = (float)n[2];
        p->ns_x[l] = (float)s[0];
        p->ns_y[l] = (float)s[1];
        p->ns_z[l] = (float)s[2];
        memcpy(own.shading, s, sizeof(s));
        memcpy(own.geometric, n, sizeof(n));
        memcpy(cube.shading, s, sizeof(s));
        memcpy(cube.geometric, n, sizeof(n));
        own.lane = cube.lane = (uint32_t)l;
        each_source_direction(e, add_above_both, &own);
        each_cube_direction(e, add_above_both, &cube);
        want[0] += cube.sum[l] / PACKET;
        want[1] += own.sum[l] / PACKET;
    }
    for (int k = 0; k < VARIANTS; k++) {
        const struct tally t = tally_by(&g, e, &variants[k], 64, full() ? 1024 : 128);
        const double expect = want[(variants[k].claims & OWN_SOURCE) != 0];
        worst_of(&z, fabs(tally_mean(&t) - expect) / (tally_error(&t) + 1e-3 * expect), variants[k].name, "");
        worst_of(&error, tally_error(&t) / expect, variants[k].name, "");
    }
    points_free(&g);
    environment_destroy(e);
    holds_below("normals 0 to 165 degrees apart, no shadows: the mean", claimants(ANY_SKY),
                "standard errors from quadrature", z.value, 4.8, z.where);
    holds_below("normals 0 to 165 degrees apart, no shadows: the doubt", claimants(ANY_SKY), "relative standard error",
                error.value, 0.01, error.where);
    verdict();
}

/* The smallest possible light: a texel of 6e-8 sr at the pole of a map of 16384 rows, at maximum brightness. */
static void a_light_of_hardly_any_area_lights_as_quadrature(void **state)
{
    const double up[3] = { 0, 1, 0 };
    struct worst z = { 0.0, "" };
    uint64_t finite = 0, total = 0;
    float lo[2 * 3 * PACKET];
    (void)state;
    struct frame f = sky_constant(2, IMAGE_MAX_SIDE, 0.0f);
    sky_paint(&f, 0, 0, 1e12f, 1e12f, 1e12f);
    struct environment *e = sky_environment(f, 64, 0.0);
    struct gbuffer g = points_make(2, LOBE_LAMBERT, 1.0f, 0.0f, 0.0f);
    const double cube = irradiance(e, up, false) / PI;
    const double edge = sin(PI / IMAGE_MAX_SIDE), source = 1e12 * 0.5 * edge * edge * PI / PI;
    struct direct *d = direct_create(best_kernels());
    for (int k = 0; k < VARIANTS; k++) {
        shade_by(d, &g, NULL, e, &variants[k], 16, 1, lo);
        for (size_t i = 0; i < sizeof(lo) / sizeof(lo[0]); i++)
            finite += isfinite(lo[i]) && lo[i] >= 0.0f;
        total += sizeof(lo) / sizeof(lo[0]);
        if (!(variants[k].claims & SMALL_SUN))
            continue;
        const struct tally t = tally_by(&g, e, &variants[k], 32, 32);
        const double want = variants[k].claims & OWN_SOURCE ? source : cube;
        worst_of(&z, fabs(tally_mean(&t) - want) / (tally_error(&t) + 1e-4 * want), variants[k].name, "");
    }
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
    holds_all("a light of 6e-8 sr: finite", claimants(ANY_SKY), "values", finite, total);
    holds_below("a light of 6e-8 sr: the mean", claimants(SMALL_SUN), "standard errors from quadrature", z.value, 5.0,
                z.where);
    verdict();
}

/* Flat casters with the sun in their plane: they have no projected area. And a scene whose casters are all
 * degenerate. */
static void a_caster_without_area_casts_nothing(void **state)
{
    static float rgb[VALUES];
    uint64_t finite = 0, total = 0;
    double caustics = 0.0, direct = 0.0;
    (void)state;
    struct scene *s = scene_create();
    omp_set_num_threads(1);
    static const struct camera camera = { "flat", { 0.6f, 2.6f, 2.2f }, { -0.3f, 0, 0 }, { 0, 1, 0 }, 0.5f };
    add_wall(s, add_lambert(s, 0.7f), 1, 0.0f, (const float[2]){ -3, -3 }, (const float[2]){ 3, 3 });
    add_wall(s, add_kind(s, MATERIAL_MIRROR, 0.9f, 0.9f, 0.9f, 0.0f), 0, -0.5f, (const float[2]){ 0, -0.8f },
             (const float[2]){ 0.8f, 0.8f });
    struct prepared_scene *set = set_of(s, &camera, WIDTH, HEIGHT, 1);
    /* One texel on each side of x = 0, at +Z and straight up. */
    for (int place = 0; place < 2; place++) {
        struct frame f = sky_constant(512, 256, 0.0f);
        for (uint32_t x = 255; x <= 256; x++)
            sky_paint(&f, x, place ? 0 : 90, 1e5f, 1e5f, 1e5f);
        struct environment *e = sky_environment(f, 128, 0.0);
        struct relighter *r = relighter_create(set, best_kernels());
        for (int start = START_FACES; start <= START_DISC; start++) {
            struct relight_desc desc = { .classes = PATH_CAUSTICS, .caustics = PLAN_LIGHT, .particles = 20000 };
            desc.start = (enum start_kind)start;
            desc.direct.samples = 16;
            image_of(r, e, &desc, rgb);
            for (int i = 0; i < VALUES; i++) {
                finite += isfinite(rgb[i]) && rgb[i] >= 0.0f;
                caustics += isfinite(rgb[i]) ? rgb[i] : 1e9;
                total++;
            }
        }
        image_of(r, e, &(struct relight_desc){ .direct = { .method = METHOD_AUTO, .samples = 16 } }, rgb);
        for (int i = 0; i < VALUES; i++)
            direct += rgb[i];
        relighter_destroy(r);
        environment_destroy(e);
    }
    set_destroy(set);
    holds_all("a flat caster, the sun in its plane", "light tracer, all starts", "finite values", finite, total);
    holds_below("a flat caster, the sun in its plane: what it casts", "light tracer, all starts",
                "share of the direct light", caustics / 3.0 / direct, 0.01, "");
    verdict();
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_ground_of_a_thousand_times_the_object_takes_no_direct_light),
    cmocka_unit_test(a_ground_of_a_thousand_times_the_object_takes_no_caustics),
    cmocka_unit_test(triangles_that_are_none_change_no_bit),
    cmocka_unit_test(shading_normals_that_face_away_count_the_same_by_every_method),
    cmocka_unit_test(light_counts_only_above_both_normals),
    cmocka_unit_test(a_light_of_hardly_any_area_lights_as_quadrature),
    cmocka_unit_test(a_caster_without_area_casts_nothing),
};
UNIT_MAIN(tests)
