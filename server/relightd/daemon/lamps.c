/* Adds the light of the scene's own lamps (light/frame/relight_lamps.h) to relightd's images. The sky's part of an
 * image is kept, so that another factor, or more samples of the lamps' part, need no relighting. Each view has its own
 * lamps' part, refined on a separate thread and filtered, so that its first images are not grainy; that of the command
 * line's view is kept when the camera changes. Lockstep images, which are not denoised, have an unfiltered one. */
#include "relightd/daemon/shade.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"

#include <string.h>
#include <time.h>

#define PUBLISH_S 0.4       /* at least, between images that only the lamps have changed; */
#define PUBLISH_GROWTH 1.25 /* each has this many times the samples of the one before */
#define WAIT_MS 20          /* how often a lockstep image checks whether the part is complete */

static size_t image_bytes(const struct shade_thread *t)
{
    const struct prepared_scene_desc *d = &t->shared->config.setup.set_desc;

    return 3 * sizeof(float) * d->width * d->height;
}

bool lamps_create_canvas(struct shade_thread *t)
{
    if (!scene_has_lamps(t->first_set->scene))
        return true;
    t->lamps.sky = mem_alloc(image_bytes(t), 1);
    return t->lamps.sky != NULL;
}

/* The part of a view, which is started if it is wanted. NULL: there is none. */
static struct relight_lamps *part_of(struct shade_thread *t, bool lockstep, double scale)
{
    struct shown_lamps *l = &t->lamps;
    struct relight_lamps **part = lockstep ? &l->lockstep : t->set == t->first_set ? &l->first : &l->other;
    const struct setup *setup = &t->shared->config.setup;
    const struct relight_lamps_desc desc = { lockstep ? t->first_set : t->set, setup->lamp_samples,
                                             setup->light.direct.seed, !lockstep, setup->kernels };
    struct reason why = { "" };

    if (*part || !l->sky || l->failed || !(scale > 0.0))
        return *part;
    if (relight_lamps_create(&desc, part, &why) || relight_lamps_start(*part, &why)) {
        log_warning("%s: the lamps stay dark", why.text);
        relight_lamps_destroy(*part);
        *part = NULL;
        l->failed = true;
    }
    return *part;
}

void lamps_take_sky(struct shade_thread *t, const float *rgb)
{
    if (t->lamps.sky)
        memcpy(t->lamps.sky, rgb, image_bytes(t));
}

const float *lamps_sky(const struct shade_thread *t)
{
    return t->lamps.sky;
}

void lamps_add(struct shade_thread *t, bool lockstep, double scale, float *rgb)
{
    struct relight_lamps *part = part_of(t, lockstep, scale);

    while (part && lockstep && !relight_lamps_is_complete(part) && !relight_lamps_has_failed(part) &&
           !atomic_load(t->shared->stop)) { /* to be reproducible */
        server_beat(t->shared->server);
        nanosleep(&(struct timespec){ .tv_nsec = WAIT_MS * 1000000L }, NULL);
    }
    t->lamps.samples = part ? relight_lamps_samples(part) : 0;
    t->lamps.published_s = clock_seconds();
    relight_lamps_add(part, scale, rgb);
    if (t->lamps.sky)
        status_set_lamps(&t->shared->status, t->lamps.samples, t->shared->config.setup.lamp_samples);
}

static struct relight_lamps *present(const struct shade_thread *t)
{
    const struct shown_lamps *l = &t->lamps;

    return t->set != t->first_set ? l->other : l->first ? l->first : l->lockstep;
}

bool lamps_have_news(const struct shade_thread *t)
{
    struct relight_lamps *part = present(t);
    const struct settings now = settings_now(&t->shared->settings);
    struct server_demand demand;

    if (!part || !t->refine.known || !(now.lamps > 0.0) || clock_seconds() - t->lamps.published_s < PUBLISH_S)
        return false;
    const uint32_t samples = relight_lamps_samples(part);
    if (samples == t->lamps.samples ||
        (!relight_lamps_is_complete(part) && samples < PUBLISH_GROWTH * t->lamps.samples))
        return false;
    shared_demand(t->shared, &demand);
    return demand.viewers > 0;
}

bool lamps_come_first(const struct shade_thread *t)
{
    struct relight_lamps *part = present(t);

    return part && settings_now(&t->shared->settings).lamps > 0.0 && !relight_lamps_is_complete(part) &&
           !relight_lamps_has_failed(part) && relight_lamps_samples(part) < RELIGHT_LAMPS_GOOD;
}

void lamps_pixel(const struct shade_thread *t, uint32_t x, uint32_t y, struct probe_lamps *out)
{
    out->scale = settings_now(&t->shared->settings).lamps;
    relight_lamps_pixel(present(t), x, y, out->rgb);
}

void lamps_leave_view(struct shade_thread *t)
{
    relight_lamps_destroy(t->lamps.other);
    t->lamps.other = NULL;
}

void lamps_leave_first(struct shade_thread *t)
{
    relight_lamps_destroy(t->lamps.first);
    t->lamps.first = NULL;
}

void lamps_finish(struct shade_thread *t)
{
    lamps_leave_view(t);
    lamps_leave_first(t);
    relight_lamps_destroy(t->lamps.lockstep);
    mem_free(t->lamps.sky);
    t->lamps = (struct shown_lamps){ .first = NULL };
}
