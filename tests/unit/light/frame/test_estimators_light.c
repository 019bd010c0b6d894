/* The light tracer and path.h agree in the mean, class by class, as agreement.h compares, on three scenes under three
 * skies: indirect light of light that comes directly, caustics, and indirect light of caustics. Both look at all of a
 * pixel; none is left out but those that a mirror or glass is seen in or next to, since what stands behind one is out
 * of the light tracer's reach. Where the ground is wide few particles end where they are seen, so it is cut. Under a
 * sun caustics are beyond path.h: there the ways in which light paths start, each with a density of its own, are
 * compared with each other. Each comparison says what it can tell: a bias of five times what it allows as joint
 * error. */
#include "light/frame/agreement.h"

static const char *const skies[] = {
    "env/overcast_city_1k.hdr",    /* no sun */
    "sky/sky.0012.exr",            /* a low sun of half a degree */
    "env/clear_noon_grass_1k.hdr", /* a sun in the zenith, captured */
};

struct budget {
    uint32_t samples, particles; /* a pixel; a seed */
    double worst, together;      /* joint error that is allowed under each sky, and to all skies */
};

/* Under each sky, and all together, each sky counting the same: that sees less. */
static void assert_sides_agree(struct world *w, float reach, const struct budget *b)
{
    const struct technique path = { "indirect light", BY_PATH, PATH_INDIRECT_LIT, .count = b->samples };
    const struct technique light = { "indirect light, lit", BY_LIGHT, PATH_INDIRECT_LIT, .count = b->particles };
    struct estimate eye_sum = { { 0.0 }, { 0.0 } }, light_sum = { { 0.0 }, { 0.0 } };

    world_trim(w, reach);
    world_look(w, 32, 18);
    world_leave_out_deltas(w);
    for (size_t i = 0; i < sizeof(skies) / sizeof(skies[0]); i++) {
        world_sky(w, skies[i]);
        const struct estimate want = measure(w, &path), got = measure(w, &light);
        assert_agree(skies[i], &got, &want, b->worst, 0.0);
        add_estimate(&eye_sum, &want, 1.0 / want.mean[0]);
        add_estimate(&light_sum, &got, 1.0 / want.mean[0]);
    }
    assert_agree("all skies", &light_sum, &eye_sum, b->together, 0.0);
}

static void both_sides_agree_on_plaza(void **state)
{
    (void)state;
    struct world w = world_open("../scenes/plaza.json");
    assert_sides_agree(&w, 3.5f, &(struct budget){ 384, 320000, 4.5e-3, 2.2e-3 });
    world_finish(&w);
}

static void both_sides_agree_on_ring(void **state)
{
    (void)state;
    struct world w = world_open("../scenes/ring.json");
    assert_sides_agree(&w, 2.5f, &(struct budget){ 512, 320000, 4.5e-3, 2.2e-3 });
    world_finish(&w);
}

/* Blunter than the dragon is: at its exponent of 150 light that it throws to the eye is found by few particles, and
 * light that it throws to the ground by few paths, so that neither side's errors can be trusted at any count that a
 * test has time for. Eye paths and path.h are compared on the dragon as it is (test_estimators.c). */
static void blunt(struct scene *s)
{
    for (size_t i = 0; i < s->material_count; i++)
        s->materials[i].exponent = fminf(s->materials[i].exponent, 10.0f);
}

static void both_sides_agree_on_dragon(void **state)
{
    (void)state;
    struct world w = world_open("../scenes/dragon.json");
    blunt(w.scene);
    assert_sides_agree(&w, 2.0f, &(struct budget){ 384, 320000, 9e-3, 4e-3 });
    world_finish(&w);
}

static const struct technique starts[] = {
    { "faces", BY_LIGHT, PATH_CAUSTICS, .start = START_FACES },
    { "quad", BY_LIGHT, PATH_CAUSTICS, .start = START_QUAD },
    { "disc", BY_LIGHT, PATH_CAUSTICS, .start = START_DISC },
};

enum { STARTS = sizeof(starts) / sizeof(starts[0]) };

static void measure_starts(struct world *w, uint32_t class, uint32_t particles, struct estimate out[STARTS])
{
    for (size_t i = 0; i < STARTS; i++) {
        struct technique t = starts[i];
        t.classes = class;
        t.count = particles;
        out[i] = measure(w, &t);
    }
}

/* All starts against path.h, each and their mean. */
static void assert_caustics_agree(struct world *w, const struct technique *path, uint32_t particles, double worst,
                                  double together)
{
    const struct estimate want = measure(w, path);
    struct estimate got[STARTS], mean = { { 0.0 }, { 0.0 } };

    measure_starts(w, path->classes, particles, got);
    for (size_t i = 0; i < STARTS; i++) {
        assert_agree(starts[i].name, &got[i], &want, worst, 0.0);
        add_estimate(&mean, &got[i], 1.0 / STARTS);
    }
    assert_agree("all starts", &mean, &want, together, 0.0);
}

static struct world ring_under(const char *sky)
{
    struct world w = world_open("../scenes/ring.json");
    world_look(&w, 32, 18);
    world_leave_out_deltas(&w);
    world_sky(&w, sky);
    return w;
}

static void ring_s_caustics_agree_under_overcast(void **state)
{
    (void)state;
    struct world w = ring_under(skies[0]);
    const struct technique path = { "caustics", BY_PATH, PATH_CAUSTICS, .count = 512 };
    assert_caustics_agree(&w, &path, 40000, 1e-2, 6e-3);
    world_finish(&w);
}

/* And mutations of paths, which here make more noise than independent ones. */
static void ring_s_rare_caustics_agree_under_overcast(void **state)
{
    (void)state;
    struct world w = ring_under(skies[0]);
    const struct technique path = { "indirect light of caustics", BY_PATH, PATH_INDIRECT_CAUSTIC, .count = 512 };
    const struct technique caustics = { "caustics", BY_PATH, PATH_CAUSTICS, .count = 128 };
    const struct technique mutations = { "mlt", BY_MLT, PATH_CAUSTICS, .count = 96, .worst = 3e-2 };
    const struct estimate want = measure(&w, &caustics);
    assert_technique_agrees(&w, &mutations, &want);
    assert_caustics_agree(&w, &path, 15000, 3.5e-2, 2.5e-2);
    world_finish(&w);
}

/* Each start against the one before. */
static void assert_starts_agree(const char *sky, const uint32_t particles[2], const double worst[2])
{
    static const uint32_t classes[2] = { PATH_CAUSTICS, PATH_INDIRECT_CAUSTIC };
    struct world w = ring_under(sky);

    for (int c = 0; c < 2; c++) {
        struct estimate got[STARTS];
        measure_starts(&w, classes[c], particles[c], got);
        for (size_t i = 0; i < STARTS; i++)
            assert_agree(starts[i].name, &got[i], &got[(i + 1) % STARTS], worst[c], 0.0);
    }
    world_finish(&w);
}

static void ring_s_starts_agree_in_the_morning(void **state)
{
    (void)state;
    assert_starts_agree(skies[1], (const uint32_t[2]){ 50000, 15000 }, (const double[2]){ 4e-3, 3.5e-2 });
}

static void ring_s_starts_agree_at_noon(void **state)
{
    (void)state;
    assert_starts_agree(skies[2], (const uint32_t[2]){ 80000, 15000 }, (const double[2]){ 1.2e-2, 4.5e-2 });
}

/* The store, with particles of its own for the sun, against tracing by the whole sky. */
static void assert_stored_agrees(const char *sky, const uint32_t particles[2], const double worst[2])
{
    static const uint32_t classes[2] = { PATH_CAUSTICS, PATH_INDIRECT_CAUSTIC };
    struct world w = ring_under(sky);

    for (int c = 0; c < 2; c++) {
        const struct technique traced = { "traced", BY_LIGHT, classes[c], .count = particles[c] };
        const struct technique stored = { "stored", BY_STORED, classes[c], .count = particles[c], .worst = worst[c] };
        const struct estimate want = measure(&w, &traced);
        assert_technique_agrees(&w, &stored, &want);
    }
    world_finish(&w);
}

static void ring_s_stored_caustics_agree_under_overcast(void **state)
{
    (void)state;
    assert_stored_agrees(skies[0], (const uint32_t[2]){ 60000, 20000 }, (const double[2]){ 1e-2, 4e-2 });
}

static void ring_s_stored_caustics_agree_in_the_morning(void **state)
{
    (void)state;
    assert_stored_agrees(skies[1], (const uint32_t[2]){ 60000, 20000 }, (const double[2]){ 2.5e-3, 2.2e-2 });
}

static void ring_s_stored_caustics_agree_at_noon(void **state)
{
    (void)state;
    assert_stored_agrees(skies[2], (const uint32_t[2]){ 60000, 20000 }, (const double[2]){ 8e-3, 2.8e-2 });
}

/* Without data from outside. There is no mirror and no glass: indirect light alone. */
static void assert_built_in_sides_agree(void (*before)(struct world *), void (*after)(struct world *))
{
    const struct technique path = { "path", BY_PATH, PATH_INDIRECT_LIT, .count = 64 };
    const struct technique light = { "light tracer", BY_LIGHT, PATH_INDIRECT_LIT, .count = 80000, .worst = 1.5e-2 };
    struct world w = world_open(NULL);
    if (before)
        before(&w);
    world_trim(&w, 8.0f);
    if (after)
        after(&w);
    world_look(&w, 32, 18);
    world_sky(&w, "sky:date=06-20,turbidity=9");
    const struct estimate want = measure(&w, &path);
    assert_technique_agrees(&w, &light, &want);
    world_finish(&w);
}

static void both_sides_agree_on_the_built_in_scene(void **state)
{
    (void)state;
    assert_built_in_sides_agree(NULL, NULL);
}

static void both_sides_agree_where_there_are_holes(void **state)
{
    (void)state;
    assert_built_in_sides_agree(world_perforate, NULL);
}

static void both_sides_agree_where_roughness_varies(void **state)
{
    (void)state;
    assert_built_in_sides_agree(NULL, world_polish);
}

static void both_sides_agree_where_normals_are_bent(void **state)
{
    (void)state;
    assert_built_in_sides_agree(NULL, world_bend);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(both_sides_agree_on_plaza),
    cmocka_unit_test(both_sides_agree_on_ring),
    cmocka_unit_test(both_sides_agree_on_dragon),
    cmocka_unit_test(ring_s_caustics_agree_under_overcast),
    cmocka_unit_test(ring_s_rare_caustics_agree_under_overcast),
    cmocka_unit_test(ring_s_starts_agree_in_the_morning),
    cmocka_unit_test(ring_s_starts_agree_at_noon),
    cmocka_unit_test(ring_s_stored_caustics_agree_under_overcast),
    cmocka_unit_test(ring_s_stored_caustics_agree_in_the_morning),
    cmocka_unit_test(ring_s_stored_caustics_agree_at_noon),
    cmocka_unit_test(both_sides_agree_on_the_built_in_scene),
    cmocka_unit_test(both_sides_agree_where_there_are_holes),
    cmocka_unit_test(both_sides_agree_where_roughness_varies),
    cmocka_unit_test(both_sides_agree_where_normals_are_bent),
};
UNIT_MAIN(tests)
