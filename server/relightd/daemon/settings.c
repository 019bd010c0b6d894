#include "relightd/daemon/config.h"

#include "image/codec/frame.h"
#include "scene/geometry/scene.h"

#include <stdio.h>
#include <string.h>

_Static_assert(sizeof(struct settings) <= SERVER_CONTROL_BYTES, "a control message carries struct settings");

void settings_init(struct settings_store *store, const struct daemon_config *config)
{
    store->config = config;
    store->now = config->setup.initial;
    atomic_init(&store->jpeg_quality, config->setup.quality);
    pthread_mutex_init(&store->lock, NULL);
}

void settings_finish(struct settings_store *store)
{
    pthread_mutex_destroy(&store->lock);
}

struct settings settings_now(struct settings_store *store)
{
    pthread_mutex_lock(&store->lock);
    const struct settings now = store->now;
    pthread_mutex_unlock(&store->lock);
    return now;
}

struct source_request settings_take_source_request(struct settings_store *store)
{
    pthread_mutex_lock(&store->lock);
    const struct source_request m = store->request;
    store->request = (struct source_request){ 0 };
    atomic_store(&store->request_waiting, false);
    pthread_mutex_unlock(&store->lock);
    return m;
}

/* Says in *clause which one of PROTOCOL.md it is that cannot be obeyed. */
static enum err refuse(const char **clause, const char *which, enum err e)
{
    if (e)
        *clause = which;
    return e;
}

/* The row's bit, by the field of struct settings that it sets. */
#define ASKED(c, field) ((c)->asked & bit_of(offsetof(struct settings, field)))
static uint32_t bit_of(size_t offset)
{
    uint32_t k = 0;

    while (settings_table[k].offset != offset)
        k++;
    return (uint32_t)1 << k;
}

/* A sample count or a target error: the latest request wins. A target error requires auto, which estimates its
 * error. */
static enum err apply_effort(const struct server_control *c, const struct settings *asked, struct settings *s,
                             const char **clause, struct reason *why)
{
    if (ASKED(c, samples))
        s->counted = asked->samples > 0;
    if (ASKED(c, samples) && s->counted)
        s->error = 0.0;
    if (ASKED(c, error))
        s->counted &= !(asked->error > 0.0);
    if (s->method == METHOD_AUTO)
        return ERR_OK;
    if (ASKED(c, error) && asked->error > 0.0)
        return refuse(clause, "4.13.12", err_say(why, ERR_USAGE, "error needs method auto, which estimates it"));
    if (ASKED(c, samples) && asked->samples == 0)
        return refuse(clause, "4.13.5",
                      err_say(why, ERR_USAGE, "samples may be null only with method auto, which chooses the count"));
    s->error = 0.0;
    return ERR_OK;
}

/* Whether the source can go where it is asked to. */
static enum err check_source_request(const struct settings_store *store, const struct server_control *c,
                                     const struct settings *s, const char **clause, struct reason *why)
{
    const char *which = ASKED(c, step)   ? "4.13.16"
                        : ASKED(c, seek) ? "4.13.17"
                        : ASKED(c, hour) ? "4.13.18"
                        : ASKED(c, day)  ? "4.13.23"
                                         : NULL;

    if (!which)
        return ERR_OK;
    if (store->config->push || store->source_kind == SOURCE_WATCH || store->source_kind == SOURCE_LIVE)
        return refuse(clause, which, err_say(why, ERR_USAGE, "a live source cannot seek"));
    if (ASKED(c, step) && !s->paused)
        return refuse(clause, "4.13.16", err_say(why, ERR_USAGE, "step needs a paused source"));
    if (ASKED(c, seek) && store->source_length > 0 && s->seek >= store->source_length)
        return refuse(clause, "4.13.17",
                      err_say(why, ERR_USAGE, "seek must be below %llu, the number of frames",
                              (unsigned long long)store->source_length));
    if (ASKED(c, hour) && store->source_kind != SOURCE_SKY && store->source_kind != SOURCE_DAYLIGHT)
        return refuse(clause, "4.13.18", err_say(why, ERR_USAGE, "only a computed sky and a weather file have hours"));
    if (ASKED(c, day) && store->source_kind != SOURCE_DAYLIGHT)
        return refuse(clause, "4.13.23", err_say(why, ERR_USAGE, "only a weather file has days"));
    return ERR_OK;
}

/* {lock} */
static void add_source_request(struct settings_store *store, const struct server_control *c,
                               const struct settings *asked)
{
    struct source_request *m = &store->request;
    const bool seeks = ASKED(c, seek), hours = ASKED(c, hour), steps = ASKED(c, step);
    const bool days = ASKED(c, day);

    if (seeks || hours || days)
        *m = (struct source_request){ .has_seek = seeks,
                                      .has_hour = hours || (days && m->has_hour),
                                      .has_day = days || (hours && m->has_day),
                                      .seek = asked->seek,
                                      .hour = hours ? asked->hour : m->hour,
                                      .day = days ? asked->day : m->day };
    if (steps && m->has_seek) { /* from there */
        const int64_t to = (int64_t)m->seek + asked->step,
                      last = (int64_t)(store->source_length > 0 ? store->source_length - 1 : FRAME_NUMBER_MAX);
        m->seek = (uint64_t)(to < 0 ? 0 : to > last ? last : to);
    } else if (steps) {
        m->step += asked->step;
    }
    if (steps || seeks || hours || days)
        atomic_store(&store->request_waiting, true);
}

bool settings_cost_too_much(struct settings_store *store, const struct settings *s, struct reason *why)
{
    const struct settings now = settings_now(store);

    if (!store->estimate || (s->samples == now.samples && s->counted == now.counted && s->method == now.method &&
                             s->classes == now.classes))
        return false;
    const double seconds = store->estimate(store->estimate_user, s), most = store->config->image_s;
    if (seconds <= most || seconds <= store->estimate(store->estimate_user, &now))
        return false;
    err_say(why, ERR_USAGE, "an image would take some %.*f s, more than the limit of %g s", seconds < 10.0, seconds,
            most);
    return true;
}

static enum err check_cost(struct settings_store *store, const struct server_control *c, const struct settings *s,
                           const char **clause, struct reason *why)
{
    const char *which = ASKED(c, samples)   ? "4.13.5"
                        : ASKED(c, classes) ? "4.13.14"
                        : ASKED(c, method)  ? "4.13.4"
                                            : "4.13.12";

    return settings_cost_too_much(store, s, why) ? refuse(clause, which, ERR_USAGE) : ERR_OK;
}

/* Last, because it cannot be undone: saves the view of the camera in the settings, or deletes a view. */
static enum err keep_views(struct settings_store *store, const struct server_control *c, struct settings *s,
                           const char **clause, struct reason *why)
{
    struct camera camera;
    char view[FREE_VIEW_TEXT];
    enum err e = ERR_OK;

    if (ASKED(c, save_view)) {
        e = settings_find_camera(store, s->camera, &camera, why);
        if (!e) {
            free_view_write(&camera, view);
            e = settings_save_view(store, s->save_view, view, why);
        }
    }
    if (!e && ASKED(c, forget_view))
        e = strcmp(s->forget_view, s->camera) == 0
                ? err_say(why, ERR_USAGE, "'%s' is shown now: choose another camera first", s->camera)
                : settings_forget_view(store, s->forget_view, why);
    return e ? refuse(clause, "4.13.22", e) : ERR_OK;
}

/* Ranges and choices were checked by the table. */
static enum err apply(struct settings_store *store, const struct server_control *c, struct settings *s,
                      const char **clause, struct reason *why)
{
    const struct settings before = *s;
    struct settings asked;

    memcpy(&asked, c->values, sizeof(asked));
    struct camera camera;
    if (ASKED(c, camera) && settings_find_camera(store, asked.camera, &camera, why))
        return refuse(clause, "4.13.15", ERR_USAGE);
    for (uint32_t k = 0; settings_table[k].key; k++)
        if (c->asked >> k & 1)
            setting_copy(&settings_table[k], s, &asked);
    if (ASKED(c, samples) && asked.samples == 0)
        s->samples = before.samples;
    enum err e = apply_effort(c, &asked, s, clause, why);
    if (!e)
        e = check_cost(store, c, s, clause, why);
    if (e)
        return e;
    s->light_version += s->method != before.method || s->samples != before.samples || s->counted != before.counted ||
                        s->error != before.error || s->classes != before.classes ||
                        s->rotation_degrees != before.rotation_degrees || s->scale_stops != before.scale_stops;
    s->display_version += s->tone != before.tone || s->exposure_stops != before.exposure_stops ||
                          s->bias_stops != before.bias_stops || s->lamps != before.lamps;
    e = check_source_request(store, c, s, clause, why);
    return e ? e : keep_views(store, c, s, clause, why);
}

/* Methods other than auto always count their samples. */
static void send_settings(struct settings_store *store, struct settings now, const struct server_control *answered,
                          const char *error)
{
    now.counted |= now.method != METHOD_AUTO;
    server_set_control(store->server, &now, answered, error);
}

enum err settings_apply(struct settings_store *store, const struct server_control *asked, struct reason *why)
{
    struct settings next = settings_now(store);
    const char *clause;
    const enum err e = apply(store, asked, &next, &clause, why);

    if (e)
        return e;
    pthread_mutex_lock(&store->lock);
    store->now = next;
    pthread_mutex_unlock(&store->lock);
    return ERR_OK;
}

void settings_take_control(struct settings_store *store)
{
    struct server_control c;
    struct reason why = { "" };

    while (server_take_control(store->server, &c)) {
        struct settings next = settings_now(store), asked;
        const enum err e = apply(store, &c, &next, &c.clause, &why);
        if (!e) {
            memcpy(&asked, c.values, sizeof(asked));
            pthread_mutex_lock(&store->lock);
            store->now = next;
            add_source_request(store, &c, &asked);
            pthread_mutex_unlock(&store->lock);
        } else {
            next = settings_now(store);
        }
        send_settings(store, next, &c, e ? why.text : NULL);
    }
}

void settings_replace(struct settings_store *store, const struct settings *s)
{
    pthread_mutex_lock(&store->lock);
    store->now = *s;
    store->now.light_version++;
    store->now.display_version++;
    pthread_mutex_unlock(&store->lock);
    send_settings(store, *s, NULL, NULL);
}

void settings_set_camera(struct settings_store *store, const char *camera)
{
    pthread_mutex_lock(&store->lock);
    snprintf(store->now.camera, sizeof(store->now.camera), "%s", camera);
    pthread_mutex_unlock(&store->lock);
    settings_send(store);
}

void settings_send(struct settings_store *store)
{
    send_settings(store, settings_now(store), NULL, NULL);
}
