/* Changes to another camera of the scene. A separate thread computes the new view (its G-buffer) while images of the
 * old one continue; then the shade thread switches. Free views, which users drag, are coarse at first. The command
 * line's view is kept: it owns scene and rays, lockstep sequences use it, and returning to it is free. Where it was
 * coarse, for an early first image, the complete one takes its place in the same way. */
#include "relightd/daemon/shade.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/process.h"

#include <omp.h>
#include <stdio.h>
#include <string.h>

#define ALONE_S 10.0 /* so long a coarse first view waits for a frame before the complete one is computed */

/* The building thread. */
static void *build(void *arg)
{
    struct shade_thread *t = arg;
    struct camera_build *b = &t->camera;
    struct prepared_scene_desc desc = t->shared->config.setup.set_desc;

    progress_begin(&b->line, "computing the view", desc.height, NULL);
    if (!b->complete) {
        desc.camera = b->view;
        desc.edge_rays = b->coarse ? 1 : desc.edge_rays;
    }
    if (b->complete ? set_create_complete(t->first_set, &desc, &b->line, &b->set, &b->why)
                    : set_create_view(t->first_set, &desc, &b->line, &b->set, &b->why))
        b->set = NULL;
    if (b->set) /* a saved view goes by its name */
        memcpy(b->set->camera, b->name, sizeof(b->name));
    progress_end(&b->line);
    atomic_store(&b->done, true);
    atomic_store(t->shared->new_work, true);
    return NULL;
}

/* The change failed: the present camera stays in the settings. */
static void give_up(struct shade_thread *t, const char *why)
{
    log_warning("camera '%s': %s", t->camera.name, why);
    t->coarse_view &= t->camera.coarse; /* what could not be made finer stays as it is */
    status_camera_progress(&t->shared->status, t->set->camera, 1.0);
    settings_set_camera(&t->shared->settings, t->set->camera);
}

static void start_build(struct shade_thread *t, const char *name, bool coarse)
{
    struct camera_build *b = &t->camera;

    struct camera camera;
    memcpy(b->name, name, sizeof(b->name));
    if (settings_find_camera(&t->shared->settings, name, &camera, &b->why)) { /* forgotten meanwhile */
        give_up(t, b->why.text);
        return;
    }
    memcpy(b->view, camera.name, sizeof(b->view));
    b->coarse = coarse;
    b->complete = !coarse && t->first_set->coarse && strcmp(name, t->first_set->camera) == 0;
    b->set = NULL;
    atomic_store(&b->done, false);
    atomic_store(&b->line.done, 0);
    b->running = threads_can_start((unsigned)omp_get_max_threads(), &b->why) && /* its own and OpenMP's for it */
                 pthread_create(&b->thread, NULL, build, t) == 0;
    if (b->running)
        status_camera_progress(&t->shared->status, b->name, 0.0);
    else
        give_up(t, "a thread could not be started");
}

/* Frees what only the old view needed. The first view keeps its G-buffer, and also its relighter if a lockstep sequence
 * may come or other ranks light its images. */
static void leave_view(struct shade_thread *t)
{
    refine_forget(t);
    refiner_destroy(t->refine.refiner);
    decider_finish(&t->decider);
    inspector_destroy(t->inspector);
    lamps_leave_view(t);
    t->refine.refiner = NULL;
    t->inspector = NULL;
    if (t->set != t->first_set) {
        relighter_destroy(t->relighter);
        set_destroy(t->set);
    } else if (!t->shared->config.push && !t->shared->ranks) {
        relighter_destroy(t->relighter);
        t->first_relighter = NULL;
    }
}

/* Whether the view's images would exceed the limit and take longer than the current ones. The view is then
 * discarded. */
static bool is_too_costly(struct shade_thread *t, struct prepared_scene *set, const struct settings *now)
{
    const double seconds = image_seconds(t, set, now), most = t->shared->config.image_s;
    char why[100];

    if (seconds <= most || seconds <= image_seconds(t, t->set, now))
        return false;
    set_destroy(set);
    snprintf(why, sizeof(why), "its images would take some %.*f s each, more than the limit of %g s", seconds < 10.0,
             seconds, most);
    give_up(t, why);
    return true;
}

/* Switches to a view and takes ownership of it. False: out of memory, and the old view stays. */
static bool switch_to(struct shade_thread *t, struct prepared_scene *set, bool coarse)
{
    struct relighter *r = set == t->first_set ? t->first_relighter : NULL;

    if (!r)
        r = relighter_create(set, t->shared->config.setup.kernels);
    if (!r) {
        if (set != t->first_set)
            set_destroy(set);
        give_up(t, "no memory for its view");
        return false;
    }
    leave_view(t);
    if (set != t->first_set && t->camera.complete) {
        /* The coarse first view goes; nothing uses it any more. */
        lamps_leave_first(t);
        set_hand_over(t->first_set, set);
        set_destroy(t->first_set);
        t->first_set = set;
    }
    t->set = set;
    t->relighter = r;
    t->coarse_view = coarse;
    if (set == t->first_set)
        t->first_relighter = r;
    status_set_view(&t->shared->status, set->placed);
    status_camera_progress(&t->shared->status, set->camera, 1.0);
    return true;
}

static bool finish_build(struct shade_thread *t)
{
    struct camera_build *b = &t->camera;

    pthread_join(b->thread, NULL);
    b->running = false;
    if (!b->set) {
        give_up(t, b->why.text);
        return false;
    }
    const struct settings now = settings_now(&t->shared->settings);
    /* While someone drags the view, each coarse one that is ready is shown, and the newest is begun next. */
    const bool on_the_way = b->coarse && free_view_is(now.camera) && free_view_is(b->name);
    if (on_the_way || strcmp(now.camera, b->name) == 0)
        return !is_too_costly(t, b->set, &now) && switch_to(t, b->set, b->coarse);
    set_destroy(b->set); /* the settings name another one by now */
    status_camera_progress(&t->shared->status, t->set->camera, 1.0);
    return false;
}

/* The complete view would take the time of the first image. */
static bool is_awaiting_its_image(const struct shade_thread *t)
{
    return t->set->coarse && !(t->shaded_s > 0.0) && clock_seconds() - t->created_s < ALONE_S;
}

bool camera_is_completed(const struct shade_thread *t)
{
    return t->set->coarse && t->shaded_s > 0.0 && t->camera.running && t->camera.complete;
}

bool camera_follow_settings(struct shade_thread *t)
{
    struct camera_build *b = &t->camera;
    const struct settings now = settings_now(&t->shared->settings);

    if (b->running && atomic_load(&b->done))
        return finish_build(t);
    if (b->running) {
        status_camera_progress(&t->shared->status, b->name,
                               (double)atomic_load(&b->line.done) /
                                   (double)(t->shared->config.setup.set_desc.height + 1));
        return false;
    }
    const bool same = strcmp(now.camera, t->set->camera) == 0;
    if (same && (!t->coarse_view || is_awaiting_its_image(t)))
        return false;
    if (strcmp(now.camera, t->first_set->camera) == 0 && !t->first_set->coarse)
        return switch_to(t, t->first_set, false);
    start_build(t, now.camera, !same && free_view_is(now.camera) && t->shared->config.setup.set_desc.edge_rays != 1);
    return false;
}

void camera_finish(struct shade_thread *t)
{
    if (t->camera.running) {
        pthread_join(t->camera.thread, NULL);
        set_destroy(t->camera.set);
    }
    if (t->relighter != t->first_relighter)
        relighter_destroy(t->relighter);
    relighter_destroy(t->first_relighter);
    if (t->set != t->first_set)
        set_destroy(t->set);
    set_destroy(t->first_set);
}
