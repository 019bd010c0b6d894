/* server/relightd_settings.c */
#include "relightd.h"

#include <string.h>

struct settings daemon_settings(struct daemon *d)
{
    pthread_mutex_lock(&d->settings_lock);
    const struct settings now = d->settings;
    pthread_mutex_unlock(&d->settings_lock);
    return now;
}

/* The wire checked types and ranges; what a method or curve is called only its own room knows. */
static enum err apply(const struct server_control *c, struct settings *s, struct reason *why)
{
    enum err e = ERR_OK;

    if (c->has_method)
        e = method_parse(c->method, &s->method, why);
    if (!e && method_is_reference(s->method))
        e = err_say(why, ERR_USAGE, "method '%s' is a reference: a live picture cannot wait for it", c->method);
    if (!e && c->has_tone)
        e = tone_parse(c->tone, &s->tone, why);
    if (c->has_samples) {
        s->samples = c->samples;
        s->counted = true;
    }
    if (c->has_rotate)
        s->rotation_degrees = c->rotate_degrees;
    if (c->has_scale)
        s->scale_stops = c->scale_stops;
    if (c->has_paused)
        s->paused = c->paused;
    s->version++;
    return e;
}

static void describe(const struct settings *s, struct server_control *out)
{
    *out = (struct server_control){
        .has_rotate = true,
        .has_scale = true,
        .has_method = true,
        .has_samples = true,
        .has_tone = true,
        .has_paused = true,
        .rotate_degrees = s->rotation_degrees,
        .scale_stops = s->scale_stops,
        .samples = s->samples,
        .paused = s->paused,
    };
    strncpy(out->method, method_name(s->method), sizeof(out->method) - 1);
    strncpy(out->tone, tone_name(s->tone), sizeof(out->tone) - 1);
}

void daemon_take_control(struct daemon *d)
{
    struct server_control asked, now;
    struct reason why = { "" };

    while (server_take_control(d->server, &asked)) {
        struct settings next = daemon_settings(d);
        const enum err e = apply(&asked, &next, &why);
        if (!e) {
            pthread_mutex_lock(&d->settings_lock);
            d->settings = next;
            pthread_mutex_unlock(&d->settings_lock);
        } else {
            next = daemon_settings(d);
        }
        describe(&next, &now);
        server_set_control(d->server, &now, &asked, e ? why.text : NULL);
    }
}
