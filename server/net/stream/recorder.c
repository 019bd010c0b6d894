#include "net/stream/internal.h"

#include "base/log.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>

void recorder_leave(struct websocket *ws)
{
    struct server *s = ws->server;
    struct sequence *q = ws->sequence;

    if (!ws->recorder || !q)
        return;
    ws->sequence = NULL;
    q->recorder = NULL;
    q->touched_us = q->left_us = stream_now_us();
    pthread_mutex_lock(&s->lock);
    q->recording = false;
    pthread_mutex_unlock(&s->lock);
}

/* The recorder's connection has ended, but the service thread has not come to it yet. */
static bool has_gone(const struct websocket *ws)
{
    char byte;
    const ssize_t n = recv(lws_get_socket_fd(ws->wsi), &byte, 1, MSG_PEEK | MSG_DONTWAIT);

    return ws->close_code || n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR);
}

/* Whether another recorder has the name, or had it a moment ago and may return. */
static bool is_held(const struct sequence *q, const struct client *by)
{
    if (q->recorder)
        return !has_gone(q->recorder);
    return q->left_us > 0 && memcmp(q->owner, by->address, sizeof(q->owner)) != 0 &&
           stream_now_us() - q->left_us < STREAM_ABSENT_US;
}

void recorder_displace(struct websocket *ws)
{
    struct fault fault;

    recorder_leave(ws);
    fault_say(&fault, FAULT_BUSY, "4.1.6", "all %d names are in use, and its address had most of them",
              INGEST_SEQUENCES);
    websocket_send_error(ws, &fault);
}

void recorder_hello(struct websocket *ws, const struct message *m, struct welcome *w, struct fault *fault)
{
    struct server *s = ws->server;
    struct sequence *q = ingest_sequence(s, m->hello.recorder, ws->connection->client, stream_now_us());

    if (!q) {
        fault_say(fault, FAULT_BUSY, "4.1.6", "all %d sequences are in use", INGEST_SEQUENCES);
        return;
    }
    if (is_held(q, ws->connection->client)) {
        fault_say(fault, FAULT_BUSY, "4.1.6", "sequence %s has a recorder", q->name);
        return;
    }
    if (q->recorder)
        recorder_leave(q->recorder);
    ws->recorder = true;
    ws->sequence = q;
    q->recorder = ws;
    memcpy(q->owner, ws->connection->client->address, sizeof(q->owner));
    w->recorder = true;
    w->has_after = q->has_stored; /* this thread alone hears of it: no lock */
    w->after = q->stored;
    log_debug("%s: the recorder of sequence %s", ws->peer, q->name);
}

bool recorder_subscribe(struct websocket *ws, const struct message *m, struct fault *fault)
{
    if (ws->sequence && ingest_record(ws->server, ws->sequence, m->subscribe.format))
        return true;
    fault_say(fault, FAULT_NOT_OFFERED, "4.3.6", "a frame of another format is under way");
    return false;
}

void recorder_ack(struct websocket *ws, const struct message *m, bool received, struct fault *fault)
{
    if (!m->ack.stored) {
        fault_say(fault, FAULT_BAD_FIELD, "4.5.3", "a recorder acknowledges with \"stored\":true");
        return;
    }
    if (!received || !ws->sequence || !ingest_stored(ws->server, ws->sequence, m->ack.sequence))
        return;
    producers_send(ws->server);
    recorder_send_end(ws);
}

void recorder_send_end(struct websocket *ws)
{
    uint64_t stored;

    if (!ws->recorder || !ws->sequence)
        return;
    const bool over = ingest_is_over(ws->server, ws->sequence, &stored);
    if (over && !ws->sent_end)
        websocket_queue(ws, message_sequence(ws->sequence->name, stored));
    ws->sent_end = over;
}
