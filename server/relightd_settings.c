/* server/relightd_settings.c */
#include "relightd.h"

#include "light_options.h"

#include <stdio.h>
#include <string.h>

struct settings daemon_settings(struct daemon *d)
{
    pthread_mutex_lock(&d->settings_lock);
    const struct settings now = d->settings;
    pthread_mutex_unlock(&d->settings_lock);
    return now;
}

struct moves daemon_take_moves(struct daemon *d)
{
    pthread_mutex_lock(&d->settings_lock);
    const struct moves m = d->moves;
    d->moves = (struct moves){ 0 };
    atomic_store(&d->moves_wait, false);
    pthread_mutex_unlock(&d->settings_lock);
    return m;
}

bool daemon_moves_wait(struct daemon *d)
{
    return atomic_load(&d->moves_wait);
}

/* Says in *clause which one of PROTOCOL.md it is that cannot be obeyed. */
static enum err refuse(const char **clause, const char *which, enum err e)
{
    if (e)
        *clause = which;
    return e;
}

/* The wire checked types and ranges; what a method or curve is called only its own room knows. */
static enum err apply_light(struct daemon *d, const struct server_control *c, struct settings *s, const char **clause,
                            struct reason *why)
{
    enum err e = ERR_OK;

    if (c->has_method)
        e = refuse(clause, "4.13.4", method_parse(c->method, &s->method, why));
    if (!e && method_is_reference(s->method))
        e = refuse(clause, "4.13.4",
                   err_say(why, ERR_USAGE,
                           "method '%s' is a reference: a live picture cannot wait "
                           "for it",
                           c->method));
    if (!e && c->has_paths)
        e = refuse(clause, "4.13.14", paths_parse(c->paths, &s->classes, why));
    if (!e && c->has_camera && !scene_camera(d->set->scene, c->camera))
        e = refuse(clause, "4.13.15", err_say(why, ERR_USAGE, "there is no camera '%s'", c->camera));
    if (e)
        return e;
    if (c->has_camera)
        memcpy(s->camera, c->camera, sizeof(s->camera));
    if (c->has_rotate)
        s->rotation_degrees = c->rotate_degrees;
    if (c->has_scale)
        s->scale_stops = c->scale_stops;
    return ERR_OK;
}

/* A count of samples, or an error that is good enough: the last that was said counts, and the second is for auto only,
 * which knows its error. */
static enum err apply_effort(const struct server_control *c, struct settings *s, const char **clause,
                             struct reason *why)
{
    if (c->has_samples && c->samples == 0)
        s->counted = false;
    if (c->has_samples && c->samples > 0) {
        s->samples = c->samples;
        s->counted = true;
        s->error = 0.0;
    }
    if (c->has_error) {
        s->error = c->error;
        s->counted &= !(c->error > 0.0);
    }
    if (s->method == METHOD_AUTO)
        return ERR_OK;
    if (c->has_error && c->error > 0.0)
        return refuse(clause, "4.13.12", err_say(why, ERR_USAGE, "an error is for method auto, which estimates it"));
    if (c->has_samples && c->samples == 0)
        return refuse(clause, "4.13.5",
                      err_say(why, ERR_USAGE,
                              "samples may be null with method auto only, which "
                              "knows how many there is time for"));
    s->error = 0.0;
    return ERR_OK;
}

static void apply_looks(const struct server_control *c, struct settings *s)
{
    if (c->has_exposure) {
        s->exposure_auto = c->exposure_auto;
        s->exposure_stops = c->exposure_stops;
    }
    if (c->has_bias)
        s->bias_stops = c->bias_stops;
}

/* Whether the source can do what is asked of its place. */
static enum err check_moves(const struct daemon *d, const struct server_control *c, const struct settings *s,
                            const char **clause, struct reason *why)
{
    if (!c->has_step && !c->has_seek && !c->has_hour)
        return ERR_OK;
    const char *which = c->has_step ? "4.13.16" : c->has_seek ? "4.13.17" : "4.13.18";
    if (d->push || d->kind == SOURCE_WATCH)
        return refuse(clause, which,
                      err_say(why, ERR_USAGE,
                              "frames come as their maker gives them: there is no other "
                              "place to go to"));
    if (c->has_step && !s->paused)
        return refuse(clause, "4.13.16", err_say(why, ERR_USAGE, "step is for a source that is paused"));
    if (c->has_seek && d->length > 0 && c->seek >= d->length)
        return refuse(
            clause, "4.13.17",
            err_say(why, ERR_USAGE, "seek must be below %llu, the number of frames", (unsigned long long)d->length));
    if (c->has_hour && d->kind != SOURCE_SKY)
        return refuse(clause, "4.13.18", err_say(why, ERR_USAGE, "only a computed sky has hours"));
    return ERR_OK;
}

/* {settings_lock} */
static void add_moves(struct daemon *d, const struct server_control *c)
{
    struct moves *m = &d->moves;

    if (c->has_seek || c->has_hour)
        *m = (struct moves){ .has_seek = c->has_seek, .has_hour = c->has_hour, .seek = c->seek, .hour = c->hour };
    if (c->has_step && m->has_seek) { /* from there */
        const int64_t to = (int64_t)m->seek + c->step, last = d->length > 0 ? (int64_t)d->length - 1 : INT64_MAX;
        m->seek = (uint64_t)(to < 0 ? 0 : to > last ? last : to);
    } else if (c->has_step) {
        m->step += c->step;
    }
    if (c->has_step || c->has_seek || c->has_hour)
        atomic_store(&d->moves_wait, true);
}

static enum err apply(struct daemon *d, const struct server_control *c, struct settings *s, const char **clause,
                      struct reason *why)
{
    const struct settings before = *s;
    enum err e = apply_light(d, c, s, clause, why);

    if (!e)
        e = apply_effort(c, s, clause, why);
    if (!e && c->has_tone)
        e = refuse(clause, "4.13.6", tone_parse(c->tone, &s->tone, why));
    if (e)
        return e;
    apply_looks(c, s);
    if (c->has_fps)
        s->fps = c->fps;
    if (c->has_paused)
        s->paused = c->paused;
    s->version += s->method != before.method || s->samples != before.samples || s->counted != before.counted ||
                  s->error != before.error || s->classes != before.classes ||
                  s->rotation_degrees != before.rotation_degrees || s->scale_stops != before.scale_stops;
    s->looks += s->tone != before.tone || s->exposure_auto != before.exposure_auto ||
                s->exposure_stops != before.exposure_stops || s->bias_stops != before.bias_stops;
    return check_moves(d, c, s, clause, why);
}

void daemon_describe(const struct settings *s, struct server_control *out)
{
    *out = (struct server_control){
        .has_rotate = true,
        .has_scale = true,
        .has_method = true,
        .has_samples = true,
        .has_tone = true,
        .has_paused = true,
        .has_exposure = true,
        .has_bias = true,
        .has_error = true,
        .has_fps = true,
        .has_paths = true,
        .has_camera = true,
        .rotate_degrees = s->rotation_degrees,
        .scale_stops = s->scale_stops,
        .samples = s->samples,
        .counted = s->counted || s->method != METHOD_AUTO,
        .paused = s->paused,
        .exposure_auto = s->exposure_auto,
        .exposure_stops = s->exposure_stops,
        .bias_stops = s->bias_stops,
        .error = s->error,
        .fps = s->fps,
    };
    snprintf(out->method, sizeof(out->method), "%s", method_name(s->method));
    snprintf(out->tone, sizeof(out->tone), "%s", tone_name(s->tone));
    snprintf(out->paths, sizeof(out->paths), "%s", paths_name(s->classes));
    snprintf(out->camera, sizeof(out->camera), "%s", s->camera);
}

enum err daemon_apply(struct daemon *d, const struct server_control *asked, struct reason *why)
{
    struct settings next = daemon_settings(d);
    const char *clause;
    const enum err e = apply(d, asked, &next, &clause, why);

    if (e)
        return e;
    pthread_mutex_lock(&d->settings_lock);
    d->settings = next;
    pthread_mutex_unlock(&d->settings_lock);
    return ERR_OK;
}

void daemon_take_control(struct daemon *d)
{
    struct server_control asked, now;
    struct reason why = { "" };

    while (server_take_control(d->server, &asked)) {
        struct settings next = daemon_settings(d);
        const enum err e = apply(d, &asked, &next, &asked.clause, &why);
        if (!e) {
            pthread_mutex_lock(&d->settings_lock);
            d->settings = next;
            add_moves(d, &asked);
            pthread_mutex_unlock(&d->settings_lock);
        } else {
            next = daemon_settings(d);
        }
        daemon_describe(&next, &now);
        server_set_control(d->server, &now, &asked, e ? why.text : NULL);
    }
}

void daemon_set(struct daemon *d, const struct settings *s)
{
    struct server_control now;

    pthread_mutex_lock(&d->settings_lock);
    d->settings = *s;
    d->settings.version++;
    d->settings.looks++;
    daemon_describe(&d->settings, &now);
    pthread_mutex_unlock(&d->settings_lock);
    server_set_control(d->server, &now, NULL, NULL);
}

void daemon_tell_control(struct daemon *d, const char *camera)
{
    struct server_control now;

    pthread_mutex_lock(&d->settings_lock);
    snprintf(d->settings.camera, sizeof(d->settings.camera), "%s", camera);
    const struct settings s = d->settings;
    pthread_mutex_unlock(&d->settings_lock);
    daemon_describe(&s, &now);
    server_set_control(d->server, &now, NULL, NULL);
}
