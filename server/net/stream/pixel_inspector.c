#include "net/stream/internal.h"

#include "base/mem.h"

#include <stdio.h>
#include <string.h>

void inspections_finish(struct inspections *p)
{
    for (unsigned i = 0; i < p->answer_count; i++)
        message_free(p->answers[i].text);
    p->answer_count = 0;
    mem_free(p->sky);
    p->sky = NULL;
}

/* {lock} Index of the pixel that a connection follows; followed_count: none. */
static unsigned find_followed(const struct inspections *p, uint64_t by)
{
    unsigned i = 0;

    while (i < p->followed_count && p->followed[i].pixel.by != by)
        i++;
    return i;
}

/* {lock} */
static void drop_followed(struct inspections *p, unsigned i)
{
    p->followed[i] = p->followed[--p->followed_count];
    p->followers[i] = p->followers[p->followed_count];
}

static void unfollow(struct server *s, uint64_t by)
{
    struct inspections *p = &s->inspections;

    pthread_mutex_lock(&s->lock);
    const unsigned i = find_followed(p, by);
    if (i < p->followed_count)
        drop_followed(p, i);
    pthread_mutex_unlock(&s->lock);
}

/* {lock} Another client gives way if it has most; *out: its connection, to be told. */
static bool make_room_to_follow(struct server *s, const struct websocket *ws, uint64_t *out)
{
    struct inspections *p = &s->inspections;
    const int i = client_crowds((const struct client *const *)p->followers, p->followed_count, ws->connection->client);

    limit_reached(&s->limits, LIMIT_PIXELS, i < 0 ? ws->connection->client : p->followers[i]);
    if (i < 0)
        return false;
    *out = p->followed[i].pixel.by;
    drop_followed(p, (unsigned)i);
    return true;
}

static void say_busy(struct server *s, uint64_t by, const char *clause, const uint64_t *request, const char *text)
{
    struct websocket *ws = websocket_of(s, by);
    struct fault fault;

    if (!ws)
        return;
    fault_say(&fault, FAULT_BUSY, clause, "%s", text);
    fault.stays = true;
    fault.has_request = request != NULL;
    fault.request = request ? *request : 0;
    websocket_send_error(ws, &fault);
}

static bool follow(struct websocket *ws, const struct server_inspection *asked)
{
    struct server *s = ws->server;
    struct inspections *p = &s->inspections;
    uint64_t displaced = 0;

    pthread_mutex_lock(&s->lock);
    unsigned i = find_followed(p, asked->by);
    const bool room = i < SERVER_FOLLOWED_MAX || make_room_to_follow(s, ws, &displaced);
    if (room) {
        i = i < SERVER_FOLLOWED_MAX ? i : p->followed_count;
        p->followed[i] = (struct inspect_followed){ .pixel = { asked->by, asked->x, asked->y } };
        p->followers[i] = ws->connection->client;
        p->followed_count += i == p->followed_count;
    }
    pthread_mutex_unlock(&s->lock);
    if (displaced)
        say_busy(s, displaced, "4.15.5", NULL, "its pixel is followed no more: its address had most of all");
    return room;
}

/* {lock} */
static void drop_waiting(struct inspections *p, unsigned i)
{
    unsigned count = p->waiting_count;

    drop_first(p->waiting + i, &(unsigned){ count - i }, sizeof(p->waiting[0]));
    drop_first(p->askers + i, &(unsigned){ count - i }, sizeof(p->askers[0]));
    p->waiting_count--;
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

/* The same answer for everyone. */
static void ask_sky(struct websocket *ws, const struct server_inspection *q)
{
    pthread_mutex_lock(&ws->server->lock);
    ws->server->inspections.sky_waits = true;
    pthread_mutex_unlock(&ws->server->lock);
    ws->asking_sky = true;
    ws->sky_request = q->request;
}

/* Where all places are taken, a question of the client that has most of them gives way. */
static void ask_pixel(struct websocket *ws, const struct server_inspection *q, struct fault *fault)
{
    struct server *s = ws->server;
    struct inspections *p = &s->inspections;
    struct server_inspection displaced = { .by = 0 };

    pthread_mutex_lock(&s->lock);
    if (p->waiting_count == INSPECTIONS_WAITING) {
        const int i = client_crowds((const struct client *const *)p->askers, p->waiting_count, ws->connection->client);
        limit_reached(&s->limits, LIMIT_PIXELS, i < 0 ? ws->connection->client : p->askers[i]);
        if (i >= 0) {
            displaced = p->waiting[i];
            drop_waiting(p, (unsigned)i);
        }
    }
    const bool may = p->waiting_count < INSPECTIONS_WAITING;
    if (may) {
        p->askers[p->waiting_count] = ws->connection->client;
        p->waiting[p->waiting_count++] = *q;
    }
    pthread_mutex_unlock(&s->lock);
    ws->probing = may;
    if (!may)
        fault_say(fault, FAULT_BUSY, "4.15.6", "%d questions wait already; the server answers %g per second",
                  INSPECTIONS_WAITING, INSPECTIONS_RATE);
    struct websocket *other = displaced.by ? websocket_of(s, displaced.by) : NULL;
    if (other)
        other->probing = false;
    if (other)
        say_busy(s, displaced.by, "4.15.6", &displaced.request, "too many questions wait, most of them its address's");
}

static void ask(struct websocket *ws, const struct server_inspection *q, struct fault *fault)
{
    if (q->sky_alone)
        ask_sky(ws, q);
    else
        ask_pixel(ws, q, fault);
    if (!fault->code && ws->server->new_work)
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
        if (!fault->code && m->inspection.has_follow && m->inspection.follow && !follow(ws, &q))
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

    unfollow(ws->server, ws->id);
    pthread_mutex_lock(&ws->server->lock);
    for (unsigned i = p->waiting_count; i-- > 0;)
        if (p->waiting[i].by == ws->id)
            drop_waiting(p, i);
    pthread_mutex_unlock(&ws->server->lock);
}

/* ---- Any thread: the side that computes ---- */

/* {lock} The question of the client that got its last turn longest ago, at limited rate; -1: none now. */
static int next_waiting(struct inspections *p)
{
    int next = -1;

    for (unsigned i = 0; i < p->waiting_count; i++)
        if (next < 0 || p->askers[i]->answered < p->askers[next]->answered)
            next = (int)i;
    return next >= 0 && bucket_take(&p->questions, INSPECTIONS_BURST, INSPECTIONS_RATE, stream_now_us()) ? next : -1;
}

bool server_take_inspection(struct server *s, struct server_inspection *out)
{
    struct inspections *p = &s->inspections;

    pthread_mutex_lock(&s->lock);
    const bool sky = p->sky_waits;
    const int i = sky ? -1 : next_waiting(p);
    if (sky) {
        *out = (struct server_inspection){ .sky_alone = true };
        p->sky_waits = false;
    } else if (i >= 0) {
        *out = p->waiting[i];
        p->askers[i]->answered = ++p->turns;
        drop_waiting(p, (unsigned)i);
    }
    pthread_mutex_unlock(&s->lock);
    return sky || i >= 0;
}

static void answer_sky(struct server *s, const char *text, const char *error)
{
    struct inspections *p = &s->inspections;
    const size_t size = text ? strlen(text) + 1 : 0;
    char *copy = size ? mem_alloc_raw(size, 1) : NULL;

    if (copy)
        memcpy(copy, text, size);
    pthread_mutex_lock(&s->lock);
    char *old = p->sky;
    p->sky = copy;
    p->sky_due = true;
    snprintf(p->sky_error, sizeof(p->sky_error), "%s", error ? error : "out of memory");
    pthread_mutex_unlock(&s->lock);
    mem_free(old);
}

void server_answer_inspection(struct server *s, const struct server_inspection *asked, const char *text,
                              const char *error)
{
    struct inspections *p = &s->inspections;
    struct inspect_reply a = { .by = asked->by, .request = asked->request };
    char *old = NULL;

    if (asked->sky_alone) {
        answer_sky(s, text, error);
        lws_cancel_service(s->context);
        return;
    }
    a.text = text ? message_inspected(text, asked->request) : NULL;
    snprintf(a.error, sizeof(a.error), "%s", error ? error : a.text ? "" : "out of memory");
    pthread_mutex_lock(&s->lock);
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

/* text NULL: there is none, because of `error`. */
static void reply(struct websocket *ws, uint64_t request, char *text, const char *error)
{
    struct fault fault;

    if (text) {
        websocket_queue(ws, text);
        return;
    }
    fault_say(&fault, FAULT_NOT_OFFERED, "4.15.7", "%s", error);
    fault.has_request = true;
    fault.request = request;
    websocket_send_error(ws, &fault);
}

/* To all that ask, also since it was asked for. */
static void send_sky(struct server *s)
{
    struct inspections *p = &s->inspections;
    char error[sizeof(p->sky_error)];

    pthread_mutex_lock(&s->lock);
    const bool due = p->sky_due;
    char *text = p->sky;
    memcpy(error, p->sky_error, sizeof(error));
    p->sky = NULL;
    p->sky_due = false;
    p->sky_waits = p->sky_waits && !due;
    pthread_mutex_unlock(&s->lock);
    for (struct websocket *ws = s->websockets; ws && due; ws = ws->next) {
        if (!ws->asking_sky)
            continue;
        ws->asking_sky = false;
        reply(ws, ws->sky_request, text ? message_inspected(text, ws->sky_request) : NULL, error);
    }
    mem_free(text);
}

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
        ws->probing = false;
        reply(ws, answers[i].request, answers[i].text, answers[i].error);
    }
    send_sky(s);
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
