#include "net/stream/internal.h"

#include <stdio.h>
#include <string.h>

/* Words of one controller in a row are one change; between two controllers the order is kept, so that the last word
 * wins and each gets his answer. */
bool control_ask(struct server *s, const struct server_control *c)
{
    struct control *k = &s->control;

    pthread_mutex_lock(&s->lock);
    struct server_control *last = k->waiting_count ? &k->waiting[k->waiting_count - 1] : NULL;
    const bool same = last && last->by == c->by, room = k->waiting_count < CONTROL_WAITING;
    if (same) {
        settings_join(s->controls, &last->asked, last->values, c->asked, c->values);
        last->by = c->by;
        last->request = c->request;
    } else if (room)
        k->waiting[k->waiting_count++] = *c;
    pthread_mutex_unlock(&s->lock);
    if (s->new_work)
        atomic_store(s->new_work, true);
    return same || room;
}

bool server_take_control(struct server *s, struct server_control *out)
{
    struct control *k = &s->control;

    pthread_mutex_lock(&s->lock);
    const bool any = k->waiting_count > 0;
    if (any) {
        *out = k->waiting[0];
        drop_first(k->waiting, &k->waiting_count, sizeof(k->waiting[0]));
    }
    pthread_mutex_unlock(&s->lock);
    return any;
}

bool server_control_waits(struct server *s)
{
    pthread_mutex_lock(&s->lock);
    const bool any = s->control.waiting_count > 0;
    pthread_mutex_unlock(&s->lock);
    return any;
}

/* {lock} */
static void answer(struct control *k, const struct server_control *asked, const char *error)
{
    if (k->answer_count == CONTROL_ANSWERS)
        drop_first(k->answers, &k->answer_count, sizeof(k->answers[0]));
    struct control_answer *a = &k->answers[k->answer_count++];
    *a = (struct control_answer){ .by = asked->by, .request = asked->request, .clause = asked->clause };
    snprintf(a->error, sizeof(a->error), "%s", error ? error : "");
}

void server_set_control(struct server *s, const void *values, const struct server_control *answered, const char *error)
{
    struct control *k = &s->control;
    char *text = s->controls ? message_control_shared(s->controls, values) : NULL;

    if (!text) /* nothing to send, or out of memory: keep the last */
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
        struct websocket *ws = websocket_of(s, answers[i].by);
        if (!ws)
            continue;
        if (answers[i].error[0]) {
            struct fault fault;
            fault_say(&fault, FAULT_BAD_FIELD, answers[i].clause ? answers[i].clause : "4.13", "%s", answers[i].error);
            fault.stays = fault.has_request = true;
            fault.request = answers[i].request;
            websocket_send_error(ws, &fault);
        } else {
            ws->answer_due = true;
            ws->answer = answers[i].request;
        }
    }
}

bool control_due(const struct websocket *ws)
{
    struct server *s = ws->server;

    if (!ws->greeted || ws->role == SERVER_PRODUCER)
        return false;
    pthread_mutex_lock(&s->lock);
    const bool due = s->control.shared && (ws->answer_due || ws->control_seen != s->control.version);
    pthread_mutex_unlock(&s->lock);
    return due;
}

char *control_text(struct websocket *ws)
{
    struct control *k = &ws->server->control;

    pthread_mutex_lock(&ws->server->lock);
    const bool own = ws->answer_due;
    char *text = message_control(k->shared, own ? ws->id : k->by, own ? ws->answer : k->request);
    /* His own answer is also the last word, unless somebody has spoken since. */
    if (!own || (k->by == ws->id && k->request == ws->answer))
        ws->control_seen = k->version;
    ws->answer_due = false;
    pthread_mutex_unlock(&ws->server->lock);
    return text;
}
