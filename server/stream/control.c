#include "control.h"

#include "internal.h"

#include <stdio.h>
#include <string.h>

/* What `from` says of the light stands; the rest stays. A count of samples and an error are two wishes for one thing.
 */
static void join_light(struct server_control *to, const struct server_control *from)
{
    if (from->has_rotate)
        to->rotate_degrees = from->rotate_degrees;
    if (from->has_scale)
        to->scale_stops = from->scale_stops;
    if (from->has_method)
        memcpy(to->method, from->method, sizeof(to->method));
    if (from->has_samples)
        to->samples = from->samples;
    if (from->has_error)
        to->error = from->error;
    if (from->has_paths)
        memcpy(to->paths, from->paths, sizeof(to->paths));
    if (from->has_camera)
        memcpy(to->camera, from->camera, sizeof(to->camera));
    to->has_rotate |= from->has_rotate;
    to->has_scale |= from->has_scale;
    to->has_method |= from->has_method;
    to->has_samples = from->has_samples || (to->has_samples && !(from->has_error && from->error > 0.0));
    to->has_error = from->has_error || (to->has_error && !(from->has_samples && from->samples > 0));
    to->has_paths |= from->has_paths;
    to->has_camera |= from->has_camera;
}

/* Likewise of what a picture looks like once it is lit. */
static void join_looks(struct server_control *to, const struct server_control *from)
{
    if (from->has_tone)
        memcpy(to->tone, from->tone, sizeof(to->tone));
    if (from->has_exposure) {
        to->exposure_auto = from->exposure_auto;
        to->exposure_stops = from->exposure_stops;
    }
    if (from->has_bias)
        to->bias_stops = from->bias_stops;
    to->has_tone |= from->has_tone;
    to->has_exposure |= from->has_exposure;
    to->has_bias |= from->has_bias;
}

/* Likewise of time. Steps add up, and a place makes those before it void. */
static void join_time(struct server_control *to, const struct server_control *from)
{
    if (from->has_paused)
        to->paused = from->paused;
    if (from->has_fps)
        to->fps = from->fps;
    if (from->has_hour || from->has_seek) {
        to->has_step = to->has_seek = to->has_hour = false;
        to->step = 0;
        to->seek = from->seek;
        to->hour = from->hour;
    }
    if (from->has_step)
        to->step += from->step;
    to->has_paused |= from->has_paused;
    to->has_fps |= from->has_fps;
    to->has_hour |= from->has_hour;
    to->has_seek |= from->has_seek;
    to->has_step |= from->has_step;
}

static void join(struct server_control *to, const struct server_control *from)
{
    join_light(to, from);
    join_looks(to, from);
    join_time(to, from);
    to->by = from->by;
    to->request = from->request;
}

/* Words of one controller in a row are one change; between two controllers the order is kept, so that the last word
 * wins and each gets his answer. */
void control_ask(struct server *s, const struct server_control *c)
{
    struct control *k = &s->control;

    pthread_mutex_lock(&s->lock);
    struct server_control *last = k->waiting_count ? &k->waiting[k->waiting_count - 1] : NULL;
    if (last && (last->by == c->by || k->waiting_count == CONTROL_WAITING))
        join(last, c);
    else
        k->waiting[k->waiting_count++] = *c;
    pthread_mutex_unlock(&s->lock);
    if (s->stirred)
        atomic_store(s->stirred, true);
}

bool server_take_control(struct server *s, struct server_control *out)
{
    struct control *k = &s->control;

    pthread_mutex_lock(&s->lock);
    const bool any = k->waiting_count > 0;
    if (any) {
        *out = k->waiting[0];
        k->waiting_count--;
        memmove(k->waiting, k->waiting + 1, k->waiting_count * sizeof(k->waiting[0]));
    }
    pthread_mutex_unlock(&s->lock);
    return any;
}

/* {lock} */
static void answer(struct control *k, const struct server_control *asked, const char *error)
{
    if (k->answer_count == CONTROL_ANSWERS) {
        k->answer_count--;
        memmove(k->answers, k->answers + 1, k->answer_count * sizeof(k->answers[0]));
    }
    struct control_answer *a = &k->answers[k->answer_count++];
    *a = (struct control_answer){ .by = asked->by, .request = asked->request, .clause = asked->clause };
    snprintf(a->error, sizeof(a->error), "%s", error ? error : "");
}

void server_set_control(struct server *s, const struct server_control *now, const struct server_control *answered,
                        const char *error)
{
    struct control *k = &s->control;
    char *text = message_control_shared(now);

    if (!text) /* out of memory: what was said before stays */
        return;
    pthread_mutex_lock(&s->lock);
    char *old = k->shared;
    k->shared = text;
    if (!error) {
        k->version++;
        k->by = answered ? answered->by : 0;
        k->request = answered ? answered->request : 0;
    }
    if (answered)
        answer(k, answered, error);
    pthread_mutex_unlock(&s->lock);
    message_free(old);
    lws_cancel_service(s->context);
}

void controls_tell(struct server *s)
{
    struct control *k = &s->control;
    struct control_answer answers[CONTROL_ANSWERS];

    pthread_mutex_lock(&s->lock);
    const unsigned count = k->answer_count;
    memcpy(answers, k->answers, count * sizeof(answers[0]));
    k->answer_count = 0;
    pthread_mutex_unlock(&s->lock);
    for (unsigned i = 0; i < count; i++) {
        struct viewer *v = s->viewers;
        while (v && v->id != answers[i].by)
            v = v->next;
        if (!v)
            continue;
        if (answers[i].error[0]) {
            struct fault fault;
            fault_say(&fault, FAULT_BAD_FIELD, answers[i].clause ? answers[i].clause : "4.13", "%s", answers[i].error);
            fault.stays = true;
            fault.request = answers[i].request;
            viewer_complain(v, &fault);
        }
        v->answer_due = true;
        v->answer = answers[i].request;
    }
}

bool control_due(const struct viewer *v)
{
    struct server *s = v->server;

    if (!v->greeted || v->role == SERVER_PRODUCER)
        return false;
    pthread_mutex_lock(&s->lock);
    const bool due = s->control.shared && (v->answer_due || v->control_seen != s->control.version);
    pthread_mutex_unlock(&s->lock);
    return due;
}

char *control_text(struct viewer *v)
{
    struct control *k = &v->server->control;

    pthread_mutex_lock(&v->server->lock);
    const bool own = v->answer_due;
    char *text = message_control(k->shared, own ? v->id : k->by, own ? v->answer : k->request);
    /* His own answer is also the last word, unless somebody has spoken since. */
    if (!own || (k->by == v->id && k->request == v->answer))
        v->control_seen = k->version;
    v->answer_due = false;
    pthread_mutex_unlock(&v->server->lock);
    return text;
}
