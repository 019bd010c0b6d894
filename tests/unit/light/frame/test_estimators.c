/* All that estimate the same light at the same points agree in the mean, as agreement.h compares, on three scenes under
 * three skies: every method of direct light with every option of its own, and eye paths, against path.h through the
 * pixels' centres. The G-buffer has one ray a pixel: where it has more it merges what is near, which changes the light
 * a little. A pixel without a shade point counts too, as black.
 * In direct light a bias of 1 % is caught under all skies; uniform and brdf are held to it under overcast alone, as the
 * suns are beyond them, and so are eye paths' caustics. Of indirect light as much is said to be caught as 1.25 % on
 * plaza and ring, though at the errors that were measured it is 1 %; on the dragon, glossy, where single paths carry
 * much, it is 2 % without a sun and 7.5 % with one. */
#include "light/frame/agreement.h"

enum sky { OVERCAST, MORNING, NOON };

static const char *const skies[] = {
    [OVERCAST] = "env/overcast_city_1k.hdr", /* no sun */
    [MORNING] = "sky/sky.0012.exr",          /* a low sun of half a degree */
    [NOON] = "env/clear_noon_grass_1k.hdr",  /* a sun in the zenith, captured */
};

#define MIS METHOD_MIS

/* The last two see the source's own texels, where all others see the cube's: shadows that a sun throws are softer by
 * one or the other, which the ninth that they end in can tell. */
static const struct technique of_all_skies[] = {
    { "mis", .count = 768, .direct = { .method = MIS } },
    { "faces", .count = 448, .direct = { .method = METHOD_FACES } },
    { "faces-uniform", .count = 768, .direct = { .method = METHOD_FACES_UNIFORM } },
    { "light", .count = 576, .direct = { .method = METHOD_LIGHT } },
    { "faces, sun", .count = 384, .direct = { .method = METHOD_FACES, .sun = true } },
    { "mis, cells 4", .count = 384, .direct = { .method = MIS, .cells = 4 } },
    { "mis, cells 8, sun", .count = 384, .direct = { .method = MIS, .cells = 8, .sun = true } },
    { "mis, sun, compensated", .count = 256, .direct = { .method = MIS, .sun = true, .compensate = COMPENSATE_ON } },
    { "mis, compensated, scattered", .count = 192,
      .direct = { .method = MIS, .compensate = COMPENSATE_ON, .scatter = true } },
    { "auto, cells 4, scattered", .count = 256, .direct = { .method = METHOD_AUTO, .cells = 4, .scatter = true } },
    { "latlong", .count = 384, .direct = { .method = METHOD_LATLONG }, .allowed = 0.01 },
    { "latlong-rows", .count = 1536, .direct = { .method = METHOD_LATLONG_ROWS }, .allowed = 0.01 },
};

static const struct technique of_smooth_skies[] = {
    { "uniform", .count = 3072, .direct = { .method = METHOD_UNIFORM } },
    { "brdf", .count = 128, .direct = { .method = METHOD_BRDF } },
};

/* more: so many times the samples, where they are drawn by light alone. */
static void assert_direct_agrees(struct world *w, uint32_t more)
{
    const struct technique path = { "path", BY_CENTRE, PATH_DIRECT, .count = 64 };
    const struct estimate want = measure(w, &path);

    for (size_t i = 0; i < sizeof(of_all_skies) / sizeof(of_all_skies[0]); i++) {
        struct technique t = of_all_skies[i];
        t.count *= method_recipe(t.direct.method)->brdf_part > 0.0f ? 1 : more;
        assert_technique_agrees(w, &t, &want);
    }
}

static void assert_smooth_agrees(struct world *w, double worst)
{
    const struct technique path = { "path again", BY_CENTRE, PATH_DIRECT, .count = 64 };
    const struct estimate want = measure(w, &path);

    for (size_t i = 0; i < sizeof(of_smooth_skies) / sizeof(of_smooth_skies[0]); i++) {
        struct technique t = of_smooth_skies[i];
        t.worst = worst;
        assert_technique_agrees(w, &t, &want);
    }
}

static void assert_eye_agrees(struct world *w, const char *name, uint32_t class, uint32_t count, double worst)
{
    const struct technique path = { name, BY_CENTRE, class, .count = 3 * count / 4 };
    const struct technique eye = { name, BY_EYE, class, .count = count, .worst = worst };
    const struct estimate want = measure(w, &path);
    assert_technique_agrees(w, &eye, &want);
}

struct budget { /* of indirect light */
    uint32_t paths;
    double worst;
};

static struct world points_agree(const char *scene, enum sky sky, struct budget lit)
{
    struct world w = world_open(scene);

    world_sky(&w, skies[sky]);
    world_look(&w, 16, 9);
    assert_direct_agrees(&w, sky == MORNING ? 2 : 1);
    if (sky == OVERCAST)
        assert_smooth_agrees(&w, WORST_ERROR);
    world_look(&w, 32, 18);
    assert_eye_agrees(&w, "indirect light, lit", PATH_INDIRECT_LIT, lit.paths, lit.worst);
    return w;
}

static void plaza_agrees_under_overcast(void **state)
{
    (void)state;
    struct world w = points_agree("../scenes/plaza.json", OVERCAST, (struct budget){ 256, 2.5e-3 });
    world_finish(&w);
}

static void plaza_agrees_in_the_morning(void **state)
{
    (void)state;
    struct world w = points_agree("../scenes/plaza.json", MORNING, (struct budget){ 256, 2.5e-3 });
    world_finish(&w);
}

static void plaza_agrees_at_noon(void **state)
{
    (void)state;
    struct world w = points_agree("../scenes/plaza.json", NOON, (struct budget){ 256, 2.5e-3 });
    world_finish(&w);
}

static void ring_agrees_under_overcast(void **state)
{
    (void)state;
    struct world w = points_agree("../scenes/ring.json", OVERCAST, (struct budget){ 256, 2.5e-3 });
    world_finish(&w);
}

/* Here alone eye paths find caustics: a bias of 2.3 % is caught, and where those light what the camera sees, which is
 * rare, one of 15 %. */
static void ring_s_caustics_by_eye_agree_under_overcast(void **state)
{
    (void)state;
    struct world w = world_open("../scenes/ring.json");
    world_sky(&w, skies[OVERCAST]);
    world_look(&w, 32, 18);
    assert_eye_agrees(&w, "caustics", PATH_CAUSTICS, 256, 4.5e-3);
    assert_eye_agrees(&w, "indirect light of caustics", PATH_INDIRECT_CAUSTIC, 128, 3e-2);
    world_finish(&w);
}

static void ring_agrees_in_the_morning(void **state)
{
    (void)state;
    struct world w = points_agree("../scenes/ring.json", MORNING, (struct budget){ 256, 2.5e-3 });
    world_finish(&w);
}

static void ring_agrees_at_noon(void **state)
{
    (void)state;
    struct world w = points_agree("../scenes/ring.json", NOON, (struct budget){ 256, 2.5e-3 });
    world_finish(&w);
}

static void dragon_agrees_under_overcast(void **state)
{
    (void)state;
    struct world w = points_agree("../scenes/dragon.json", OVERCAST, (struct budget){ 160, 4e-3 });
    world_finish(&w);
}

static void dragon_agrees_in_the_morning(void **state)
{
    (void)state;
    struct world w = points_agree("../scenes/dragon.json", MORNING, (struct budget){ 160, 1.5e-2 });
    world_finish(&w);
}

static void dragon_agrees_at_noon(void **state)
{
    (void)state;
    struct world w = points_agree("../scenes/dragon.json", NOON, (struct budget){ 160, 1.5e-2 });
    world_finish(&w);
}

/* Without data from outside: by day with a sun, at night without. */
static void built_in_scene_agrees_under_built_in_skies(void **state)
{
    (void)state;
    struct world w = world_open(NULL);
    world_look(&w, 16, 9);
    world_sky(&w, "sky:turbidity=9");
    assert_direct_agrees(&w, 2);
    world_sky(&w, "sky:hour=0");
    assert_smooth_agrees(&w, WORST_ERROR);
    assert_eye_agrees(&w, "indirect light, lit", PATH_INDIRECT_LIT, 256, 5e-3);
    world_finish(&w);
}

/* Most of it is a sieve, whose shadows make more noise: a bias of 2 % is caught. */
static void built_in_scene_with_holes_agrees(void **state)
{
    const struct technique path = { "path", BY_CENTRE, PATH_DIRECT, .count = 96 };
    (void)state;
    struct world w = world_open(NULL);
    world_perforate(&w);
    world_look(&w, 16, 9);
    world_sky(&w, "sky:turbidity=9");
    const struct estimate want = measure(&w, &path);
    for (size_t i = 0; i < sizeof(of_all_skies) / sizeof(of_all_skies[0]); i++) {
        struct technique t = of_all_skies[i];
        t.count *= 2;
        t.worst = 4e-3;
        assert_technique_agrees(&w, &t, &want);
    }
    world_sky(&w, "sky:hour=0");
    assert_smooth_agrees(&w, 2.5e-3);
    assert_eye_agrees(&w, "indirect light, lit", PATH_INDIRECT_LIT, 256, 5e-3);
    world_finish(&w);
}

/* A bias of 2 % is caught. */
static void assert_maps_agree(void (*give_maps)(struct world *))
{
    const struct technique path = { "path", BY_CENTRE, PATH_DIRECT, .count = 96 };
    struct world w = world_open(NULL);
    world_trim(&w, 8.0f);
    give_maps(&w);
    world_look(&w, 16, 9);
    world_sky(&w, "sky:turbidity=9");
    const struct estimate want = measure(&w, &path);
    for (size_t i = 0; i < sizeof(of_all_skies) / sizeof(of_all_skies[0]); i++) {
        struct technique t = of_all_skies[i];
        t.count *= 2;
        t.worst = 4e-3;
        assert_technique_agrees(&w, &t, &want);
    }
    world_sky(&w, "sky:hour=0");
    assert_smooth_agrees(&w, 4e-3);
    assert_eye_agrees(&w, "indirect light, lit", PATH_INDIRECT_LIT, 256, 5e-3);
    world_finish(&w);
}

static void roughness_maps_agree(void **state)
{
    (void)state;
    assert_maps_agree(world_polish);
}

static void normal_maps_agree(void **state)
{
    (void)state;
    assert_maps_agree(world_bend);
}

/* 1 % more or less by all seeds, 3.85 % by few, of direct light and of indirect light, at the largest error that
 * passes. */
static void planted_bias_of_one_percent_is_caught(void **state)
{
    static const struct technique pairs[][2] = {
        { { "path", BY_CENTRE, PATH_DIRECT, .count = 96 },
          { "auto, cells 8", .count = 256, .direct = { .method = METHOD_AUTO, .cells = 8 } } },
        { { "path", BY_CENTRE, PATH_INDIRECT_LIT, .count = 512 }, { "eye", BY_EYE, PATH_INDIRECT_LIT, .count = 768 } },
    };
    (void)state;
    struct world w = world_open(NULL);
    world_sky(&w, "sky:hour=0");
    world_look(&w, 16, 9);
    for (size_t i = 0; i < sizeof(pairs) / sizeof(pairs[0]); i++) {
        const struct estimate want = measure(&w, &pairs[i][0]), got = measure(&w, &pairs[i][1]);
        assert_agree(pairs[i][1].name, &got, &want, 0.0, 0.0);
        for (int sign = -1; sign <= 1; sign += 2) {
            struct estimate planted = { { 0.0 }, { 0.0 } };
            add_estimate(&planted, &got, 1.0 + 0.01 * blur() * limit() / 4.5 * sign);
            assert_true(sharp(&planted, &want, WORST_ERROR));
            assert_false(agree(&planted, &want, 0.0));
        }
    }
    world_finish(&w);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(plaza_agrees_under_overcast),
    cmocka_unit_test(plaza_agrees_in_the_morning),
    cmocka_unit_test(plaza_agrees_at_noon),
    cmocka_unit_test(ring_agrees_under_overcast),
    cmocka_unit_test(ring_s_caustics_by_eye_agree_under_overcast),
    cmocka_unit_test(ring_agrees_in_the_morning),
    cmocka_unit_test(ring_agrees_at_noon),
    cmocka_unit_test(dragon_agrees_under_overcast),
    cmocka_unit_test(dragon_agrees_in_the_morning),
    cmocka_unit_test(dragon_agrees_at_noon),
    cmocka_unit_test(built_in_scene_agrees_under_built_in_skies),
    cmocka_unit_test(built_in_scene_with_holes_agrees),
    cmocka_unit_test(roughness_maps_agree),
    cmocka_unit_test(normal_maps_agree),
    cmocka_unit_test(planted_bias_of_one_percent_is_caught),
};
UNIT_MAIN(tests)
