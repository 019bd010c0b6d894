#include "net/stream/internal.h"

#include <stdio.h>
#include <string.h>

void inspections_finish(struct inspections *p)
{
    for (unsigned i = 0; i < p->answer_count; i++)
        message_free(p->answers[i].text);
    p->answer_count = 0;
}

/* {lock} Index of the pixel that a connection follows; followed_count: none. */
static unsigned find_followed(const struct inspections *p, uint64_t by)
{
    unsigned i = 0;

    while (i < p->followed_count && p->followed[i].pixel.by != by)
        i++;
    return i;
}

static void unfollow(struct server *s, uint64_t by)
{
    struct inspections *p = &s->inspections;

    pthread_mutex_lock(&s->lock);
    const unsigned i = find_followed(p, by);
    if (i < p->followed_count)
        p->followed[i] = p->followed[--p->followed_count];
    pthread_mutex_unlock(&s->lock);
}

static bool follow(struct server *s, const struct server_inspection *asked)
{
    struct inspections *p = &s->inspections;

    pthread_mutex_lock(&s->lock);
    const unsigned i = find_followed(p, asked->by);
    const bool room = i < SERVER_FOLLOWED_MAX;
    if (room) {
        p->followed[i] = (struct inspect_followed){ .pixel = { asked->by, asked->x, asked->y } };
        p->followed_count += i == p->followed_count;
    }
    pthread_mutex_unlock(&s->lock);
    return room;
}

/* {lock} Rate limit: a token bucket. Questions about the sky alone are free, since all share one answer. */
static bool may_ask(struct inspections *p, bool sky_alone)
{
    return p->waiting_count < INSPECTIONS_WAITING &&
           (sky_alone || bucket_take(&p->questions, INSPECTIONS_BURST, INSPECTIONS_RATE, stream_now_us()));
}

/* Sets *fault if the question cannot be asked now. */
static void check(const struct websocket *ws, const struct server_inspection *q, struct fault *fault)
{
    struct server *s = ws->server;

    pthread_mutex_lock(&s->lock);
    const uint32_t width = s->figures.width, height = s->figures.height;
    const bool any = s->published > 0;
    pthread_mutex_unlock(&s->lock);
    if (!any)
        fault_say(fault, FAULT_NOT_OFFERED, "4.15.7", "there is no image yet");
    else if (width && height && (q->x >= width || q->y >= height))
        fault_say(fault, FAULT_BAD_FIELD, "4.15.2", "x and y must lie in the image of %ux%u", width, height);
    else if (q->sky_alone ? ws->asking_sky : ws->probing)
        fault_say(fault, FAULT_BUSY, "4.15.6", "the previous question has no answer yet");
}

static void ask(struct websocket *ws, const struct server_inspection *q, struct fault *fault)
{
    struct inspections *p = &ws->server->inspections;

    pthread_mutex_lock(&ws->server->lock);
    const bool may = may_ask(p, q->sky_alone);
    if (may)
        p->waiting[p->waiting_count++] = *q;
    pthread_mutex_unlock(&ws->server->lock);
    if (!may) {
        fault_say(fault, FAULT_BUSY, "4.15.6", "too many questions; the limit is %g per second", INSPECTIONS_RATE);
        return;
    }
    *(q->sky_alone ? &ws->asking_sky : &ws->probing) = true;
    if (ws->server->new_work)
        atomic_store(ws->server->new_work, true);
}

void inspect_take(struct websocket *ws, const struct message *m, struct fault *fault)
{
    struct server_inspection q = m->inspection.question;

    q.by = ws->id;
    if (m->inspection.asks) {
        check(ws, &q, fault);
        if (!fault->code)
            ask(ws, &q, fault);
        if (!fault->code && m->inspection.has_follow && m->inspection.follow && !follow(ws->server, &q))
            fault_say(fault, FAULT_BUSY, "4.15.5", "%d pixels are followed already", SERVER_FOLLOWED_MAX);
    }
    if (!fault->code && m->inspection.has_follow && !m->inspection.follow)
        unfollow(ws->server, ws->id);
    fault->stays = fault->has_request = true;
    fault->request = q.request;
}

void inspect_leave(struct websocket *ws)
{
    struct inspections *p = &ws->server->inspections;
    unsigned kept = 0;

    unfollow(ws->server, ws->id);
    pthread_mutex_lock(&ws->server->lock);
    for (unsigned i = 0; i < p->waiting_count; i++)
        if (p->waiting[i].by != ws->id)
            p->waiting[kept++] = p->waiting[i];
    p->waiting_count = kept;
    pthread_mutex_unlock(&ws->server->lock);
}

/* ---- Any thread: the side that computes ---- */

bool server_take_inspection(struct server *s, struct server_inspection *out)
{
    struct inspections *p = &s->inspections;

    pthread_mutex_lock(&s->lock);
    const bool any = p->waiting_count > 0;
    if (any) {
        *out = p->waiting[0];
        drop_first(p->waiting, &p->waiting_count, sizeof(p->waiting[0]));
    }
    pthread_mutex_unlock(&s->lock);
    return any;
}

void server_answer_inspection(struct server *s, const struct server_inspection *asked, const char *text,
                              const char *error)
{
    struct inspections *p = &s->inspections;
    struct inspect_reply a = { .by = asked->by, .request = asked->request, .sky_alone = asked->sky_alone };

    a.text = text ? message_inspected(text, asked->request) : NULL;
    snprintf(a.error, sizeof(a.error), "%s", error ? error : a.text ? "" : "out of memory");
    pthread_mutex_lock(&s->lock);
    char *old = NULL;
    if (p->answer_count == INSPECTIONS_ANSWERS) {
        old = p->answers[0].text;
        drop_first(p->answers, &p->answer_count, sizeof(p->answers[0]));
    }
    p->answers[p->answer_count++] = a;
    pthread_mutex_unlock(&s->lock);
    message_free(old);
    lws_cancel_service(s->context);
}

uint32_t server_followed(struct server *s, struct server_follow out[SERVER_FOLLOWED_MAX])
{
    pthread_mutex_lock(&s->lock);
    const uint32_t count = s->inspections.followed_count;
    for (uint32_t i = 0; i < count; i++)
        out[i] = s->inspections.followed[i].pixel;
    pthread_mutex_unlock(&s->lock);
    return count;
}

void server_send_radiance(struct server *s, const struct server_follow *f, const struct server_radiance *r)
{
    struct inspections *p = &s->inspections;

    pthread_mutex_lock(&s->lock);
    const unsigned i = find_followed(p, f->by);
    const bool still = i < p->followed_count && p->followed[i].pixel.x == f->x && p->followed[i].pixel.y == f->y;
    if (still) {
        p->followed[i].radiance = *r;
        p->followed[i].due = true;
    }
    pthread_mutex_unlock(&s->lock);
    if (still)
        lws_cancel_service(s->context);
}

/* ---- Sending; thread: service ---- */

void inspections_send(struct server *s)
{
    struct inspect_reply answers[INSPECTIONS_ANSWERS];

    pthread_mutex_lock(&s->lock);
    const unsigned count = s->inspections.answer_count;
    memcpy(answers, s->inspections.answers, count * sizeof(answers[0]));
    s->inspections.answer_count = 0;
    pthread_mutex_unlock(&s->lock);
    for (unsigned i = 0; i < count; i++) {
        struct websocket *ws = websocket_of(s, answers[i].by);
        if (!ws) {
            message_free(answers[i].text);
            continue;
        }
        *(answers[i].sky_alone ? &ws->asking_sky : &ws->probing) = false;
        if (answers[i].text) {
            websocket_queue(ws, answers[i].text);
        } else {
            struct fault fault;
            fault_say(&fault, FAULT_NOT_OFFERED, "4.15.7", "%s", answers[i].error);
            fault.has_request = true;
            fault.request = answers[i].request;
            websocket_send_error(ws, &fault);
        }
    }
}

bool inspect_due(const struct websocket *ws)
{
    const struct inspections *p = &ws->server->inspections;

    if (!ws->greeted)
        return false;
    pthread_mutex_lock(&ws->server->lock);
    const unsigned i = find_followed(p, ws->id);
    const bool due = i < p->followed_count && p->followed[i].due;
    pthread_mutex_unlock(&ws->server->lock);
    return due;
}

char *inspect_text(struct websocket *ws)
{
    struct inspections *p = &ws->server->inspections;
    char *text = NULL;

    pthread_mutex_lock(&ws->server->lock);
    const unsigned i = find_followed(p, ws->id);
    if (i < p->followed_count) {
        text = message_radiance(&p->followed[i].pixel, &p->followed[i].radiance);
        p->followed[i].due = false;
    }
    pthread_mutex_unlock(&ws->server->lock);
    return text;
}
