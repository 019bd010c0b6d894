/* server/relightd_camera.c */
/* Another camera of the scene. Its view, the G-buffer, is computed by a thread of its own while pictures of the former
 * one go on; then the shade thread changes over. The view that was said on the command line is kept for good: it owns
 * scene and rays, lockstep sequences are made with it, and to go back to it costs nothing. */
#include "relightd.h"

#include "log.h"

#include <string.h>

static void *build(void *arg)
{
    struct daemon *d = arg;
    struct camera_build *b = &d->camera;
    struct set_desc desc = d->set_desc;

    desc.camera = b->name;
    progress_begin(&b->line, "computing the view", desc.height, NULL);
    if (set_create_view(d->first_set, &desc, &b->line, &b->set, &b->why))
        b->set = NULL;
    progress_end(&b->line);
    atomic_store(&b->done, true);
    atomic_store(d->stirred, true);
    return NULL;
}

/* What becomes of a wish that cannot be met: the present camera is in force again, and everybody is told. */
static void give_up(struct daemon *d, const char *why)
{
    log_warning("camera '%s': %s", d->camera.name, why);
    daemon_tell_camera(d, d->set->camera, 1.0);
    daemon_tell_control(d, d->set->camera);
}

static void begin(struct daemon *d, const char *name)
{
    struct camera_build *b = &d->camera;

    memcpy(b->name, name, sizeof(b->name));
    b->set = NULL;
    atomic_store(&b->done, false);
    atomic_store(&b->line.done, 0);
    b->running = pthread_create(&b->thread, NULL, build, d) == 0;
    if (b->running)
        daemon_tell_camera(d, b->name, 0.0);
    else
        give_up(d, "a thread could not be started");
}

/* What the former view alone needed goes; of the first one only what can be had again, where no sequence may ask. */
static void leave(struct daemon *d)
{
    daemon_still_forget(d);
    still_destroy(d->still);
    pilot_destroy(d->pilot);
    prober_destroy(d->prober);
    d->still = NULL;
    d->pilot = NULL;
    d->prober = NULL;
    d->buyer = (struct buyer){ 0 };
    if (d->set != d->first_set) {
        relighter_destroy(d->relighter);
        set_destroy(d->set);
    } else if (!d->push) {
        relighter_destroy(d->relighter);
        d->first_relighter = NULL;
    }
}

/* Changes over to a view, which is then owned here. False: there is no memory for it, and the former one stays. */
static bool enter(struct daemon *d, struct set *set)
{
    struct relighter *r = set == d->first_set ? d->first_relighter : NULL;

    if (!r)
        r = relighter_create(set, d->kernels);
    if (!r) {
        if (set != d->first_set)
            set_destroy(set);
        give_up(d, "no memory for its view");
        return false;
    }
    leave(d);
    d->set = set;
    d->relighter = r;
    if (set == d->first_set)
        d->first_relighter = r;
    daemon_tell_camera(d, set->camera, 1.0);
    return true;
}

/* The view is there, or could not be had. */
static bool end(struct daemon *d)
{
    struct camera_build *b = &d->camera;

    pthread_join(b->thread, NULL);
    b->running = false;
    if (!b->set) {
        give_up(d, b->why.text);
        return false;
    }
    if (strcmp(daemon_settings(d).camera, b->name) == 0)
        return enter(d, b->set);
    set_destroy(b->set); /* another one is wanted by now */
    daemon_tell_camera(d, d->set->camera, 1.0);
    return false;
}

bool daemon_camera_follow(struct daemon *d)
{
    struct camera_build *b = &d->camera;
    const struct settings now = daemon_settings(d);

    if (b->running && atomic_load(&b->done))
        return end(d);
    if (b->running) {
        daemon_tell_camera(d, b->name, (double)atomic_load(&b->line.done) / (double)(d->set_desc.height + 1));
        return false;
    }
    if (strcmp(now.camera, d->set->camera) == 0)
        return false;
    if (strcmp(now.camera, d->first_set->camera) == 0)
        return enter(d, d->first_set);
    begin(d, now.camera);
    return false;
}

void daemon_camera_finish(struct daemon *d)
{
    if (d->camera.running) {
        pthread_join(d->camera.thread, NULL);
        set_destroy(d->camera.set);
    }
    if (d->relighter != d->first_relighter)
        relighter_destroy(d->relighter);
    relighter_destroy(d->first_relighter);
    if (d->set != d->first_set)
        set_destroy(d->set);
    set_destroy(d->first_set);
}
