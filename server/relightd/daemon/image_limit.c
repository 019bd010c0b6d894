/* The limit on the time per image (--max-picture-seconds): estimates the cost of settings, and reports the start and
 * end of each image to the housekeeping thread, which enforces the limit. */
#include "relightd/daemon/shade.h"

#include "base/clock.h"
#include "base/mem.h"

#define MEASURE_SAMPLES 4 /* of the image that is made to know what images cost */
#define CUTS_MOST 2       /* images in a row that new settings may cancel: however many come, some are finished */

/* No cost is known before the first image: renders one under a grey sky, twice, because the first one also pays for
 * page faults. On failure the cost stays unknown, and nothing is refused. */
static void measure(struct shade_thread *t)
{
    const struct prepared_scene_desc *size = &t->shared->config.setup.set_desc;
    struct relight_desc light = t->shared->config.setup.light;
    struct environment *e = environment_create(&(struct environment_desc){ .layout = LAYOUT_LATLONG });
    float *rgb = mem_alloc((size_t)size->width * size->height, 3 * sizeof(float));
    struct frame f = { .number = 0 };
    struct relight_stats stats;
    struct reason why;

    light.classes = PATH_DIRECT;
    light.direct.method = METHOD_MIS;
    light.direct.samples = MEASURE_SAMPLES;
    light.direct.cancel = t->shared->stop;
    light.direct.why = &why;
    bool ok = e && rgb && frame_reserve_texels(&f, 8, 4) == ERR_OK;
    for (size_t i = 0; ok && i < (size_t)3 * 8 * 4; i++)
        f.rgb[i] = 1.0f;
    ok = ok && environment_update(e, &f, &why) == ERR_OK;
    for (int i = 0; i < 2 && ok; i++) {
        t->cost = (struct cost){ .sample_s = 0.0 };
        ok = relighter_run(t->relighter, e, &light, rgb, &stats) == ERR_OK;
        if (ok)
            cost_learn(&t->cost, t->set->facts.points, &light, &stats);
    }
    frame_finish(&f);
    mem_free(rgb);
    environment_destroy(e);
}

double image_seconds(struct shade_thread *t, const struct prepared_scene *set, const struct settings *s)
{
    struct relight_desc light = t->shared->config.setup.light;

    if (s->method == METHOD_AUTO && !s->counted)
        return 0.0; /* the pilot keeps to the limit */
    if (method_is_reference(s->method))
        return 0.0; /* sums of components take a fixed time */
    if (!(t->cost.sample_s > 0.0))
        measure(t);
    light.classes = s->classes;
    light.direct.method = s->method;
    light.direct.samples = s->samples;
    return cost_estimate(&t->cost, &set->facts, &light);
}

void image_begin(struct shade_thread *t, bool lockstep)
{
    struct image_watch *w = &t->shared->watch;

    atomic_store(&w->cancel, false);
    if (atomic_load(t->shared->stop)) /* asked after the store above, and so not overlooked */
        atomic_store(&w->cancel, true);
    atomic_store(&w->may_cancel, !lockstep && t->cuts < CUTS_MOST);
    atomic_store(&w->begun_ms, clock_ms());
}

bool image_end(struct shade_thread *t)
{
    struct image_watch *w = &t->shared->watch;

    atomic_store(&w->begun_ms, 0);
    const bool cut = atomic_load(&w->cancel) && !atomic_load(t->shared->stop);
    t->cuts = cut ? t->cuts + 1 : 0;
    t->cut_s = cut ? clock_seconds() : 0.0;
    atomic_store(&w->cancel, false);
    if (cut)
        refine_forget(t); /* the unfinished image may have the memory of the one on display */
    return cut;
}
