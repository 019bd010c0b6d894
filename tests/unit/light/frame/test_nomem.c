/* Memory runs out while a scene is prepared, lit by each method, made finer, and encoded. */
#include "support/nomem.h"

#include "base/log.h"
#include "base/mem.h"
#include "image/codec/encode.h"
#include "light/cache/cache_file.h"
#include "light/estimators/points.h"
#include "light/frame/pilot.h"
#include "light/frame/relight.h"
#include "light/frame/refine.h"
#include "light/inspector/inspector.h"

enum { WIDTH = 32, HEIGHT = 18 };

struct stage {
    struct prepared_scene *set;
    struct environment *sky;
    struct relight_desc light;
    const char *scene;
    float rgb[WIDTH * HEIGHT * 3];
};

static void stage_make(struct stage *s, uint32_t width, uint32_t height)
{
    struct reason why;

    memset(s, 0, sizeof(*s));
    s->scene = RING;
    assert_int_equal(
        set_create(&(struct prepared_scene_desc){ .scene = RING, .width = width, .height = height, .edge_rays = 2 },
                   &s->set, &why),
        ERR_OK);
    s->sky = sky_environment(sky_with_sun(32, 16, 2e3f), 16, 0.0);
    s->light.direct.samples = 4;
    s->light.eye_paths = 1;
    s->light.particles = 1000;
}

static void stage_finish(struct stage *s)
{
    set_destroy(s->set);
    environment_destroy(s->sky);
}

static enum err build(void *context, struct reason *why)
{
    const struct stage *s = context;
    struct prepared_scene *set = NULL, *other = NULL;
    const struct prepared_scene_desc desc = { .scene = s->scene, .width = WIDTH, .height = HEIGHT, .edge_rays = 2 };
    enum err e = set_create(&desc, &set, why);

    if (!e)
        e = set_create_view(set, &desc, NULL, &other, why);
    set_destroy(other);
    set_destroy(set);
    return e;
}

static void a_scene_is_prepared(void **state)
{
    static struct stage s;
    (void)state;

    s.scene = NULL;
    nomem_each("the built-in scene", build, &s);
    s.scene = RING;
    nomem_each("a scene file", build, &s);
}

/* Two images, as what is kept from the first may fail in the second. */
static enum err light_it(void *context, struct reason *why)
{
    struct stage *s = context;
    struct relighter *r = relighter_create(s->set, best_kernels());
    struct relight_stats stats;
    enum err e = r ? ERR_OK : ERR_NOMEM;

    s->light.direct.why = why;
    for (int k = 0; k < 2 && !e; k++) {
        s->light.turn = (uint64_t)k;
        e = relighter_run(r, s->sky, &s->light, s->rgb, &stats);
    }
    if (e == ERR_NOMEM && r) { /* what has failed once can be used again */
        nomem_disarm();
        assert_int_equal(relighter_run(r, s->sky, &s->light, s->rgb, &stats), ERR_OK);
    }
    relighter_destroy(r);
    return e;
}

static void every_live_method_lights_it(void **state)
{
    static struct stage s;
    (void)state;

    stage_make(&s, WIDTH, HEIGHT);
    s.light.classes = PATH_ALL;
    for (int m = 0; m < METHOD_COUNT; m++) {
        if (method_is_reference((enum method)m) || m == METHOD_CACHED)
            continue;
        s.light.direct.method = (enum method)m;
        nomem_each(method_name((enum method)m), light_it, &s);
    }
    stage_finish(&s);
}

static void the_cache_lights_it(void **state)
{
    static struct stage s;
    (void)state;

    stage_make(&s, 8, 5);
    s.light.direct.method = METHOD_CACHED;
    nomem_most = 12; /* each of them computes what is kept */
    nomem_each("cached, direct light", light_it, &s);
    s.light.classes = PATH_BACKGROUND | PATH_DIRECT | PATH_CAUSTICS;
    s.light.caustics = PLAN_STORED;
    s.light.stored_paths = 500;
    nomem_each("cached, stored caustics", light_it, &s);
    stage_finish(&s);
}

static enum err refine(void *context, struct reason *why)
{
    struct stage *s = context;
    struct refiner *refiner = refiner_create(s->set, best_kernels());
    enum err e = refiner ? ERR_OK : ERR_NOMEM;

    s->light.direct.why = why;
    if (!e)
        refiner_begin(refiner, s->rgb);
    for (int k = 0; k < 2 && !e; k++)
        e = refiner_pass(refiner, s->sky, &s->light);
    refiner_destroy(refiner);
    return e;
}

static enum err steer(void *context, struct reason *why)
{
    struct stage *s = context;
    struct relighter *r = relighter_create(s->set, best_kernels());
    struct pilot *pilot = r ? pilot_create(r, NULL) : NULL;
    const struct budget_target target = { .seconds = 0.01 };
    struct relight_stats stats;
    struct pilot_stats told;
    enum err e = pilot ? ERR_OK : ERR_NOMEM;

    s->light.direct.why = why;
    for (int k = 0; k < 2 && !e; k++)
        e = pilot_run(pilot, s->sky, &s->light, &target, s->rgb, &stats, &told);
    pilot_destroy(pilot);
    relighter_destroy(r);
    return e;
}

static void images_are_steered_and_made_finer(void **state)
{
    static struct stage s;
    (void)state;

    stage_make(&s, WIDTH, HEIGHT);
    s.light.direct.method = METHOD_AUTO;
    s.light.classes = PATH_ALL;
    nomem_most = 40;
    nomem_each("still", refine, &s);
    nomem_each("pilot", steer, &s);
    stage_finish(&s);
}

static enum err encode(void *context, struct reason *why)
{
    struct stage *s = context;
    uint8_t display[WIDTH * HEIGHT * 3] = { 0 }, *bytes = NULL;
    const uint8_t *borrowed;
    size_t size;
    const struct exr_desc exr = { .rgb = s->rgb, .width = WIDTH, .height = HEIGHT, .depth = EXR_HALF };
    struct jpeg_encoder *jpeg = jpeg_encoder_create();
    enum err e = jpeg ? jpeg_encode(jpeg, display, WIDTH, HEIGHT, 85, &borrowed, &size) : ERR_NOMEM;

    if (!e)
        e = exr_encode(&exr, &bytes, &size, why);
    if (!e)
        mem_free(bytes);
    jpeg_encoder_destroy(jpeg);
    return e;
}

static void images_are_encoded(void **state)
{
    static struct stage s;
    (void)state;

    for (int k = 0; k < WIDTH * HEIGHT * 3; k++)
        s.rgb[k] = (float)k * 1e-3f;
    nomem_each("encoders", encode, &s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_scene_is_prepared), cmocka_unit_test(every_live_method_lights_it),
    cmocka_unit_test(the_cache_lights_it), cmocka_unit_test(images_are_steered_and_made_finer),
    cmocka_unit_test(images_are_encoded),
};

int main(int argc, char **argv)
{
    log_init("test", LOG_ERROR);
    return unit_main(argc, argv, tests, sizeof(tests) / sizeof(tests[0]));
}
