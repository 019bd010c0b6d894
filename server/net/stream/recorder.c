#include "net/stream/internal.h"

#include "base/log.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>

void recorder_leave(struct viewer *v)
{
    struct server *s = v->server;
    struct sequence *q = v->sequence;

    if (!v->recorder || !q)
        return;
    v->sequence = NULL;
    q->recorder = NULL;
    q->touched_us = q->left_us = viewer_now_us();
    pthread_mutex_lock(&s->lock);
    q->recording = false;
    pthread_mutex_unlock(&s->lock);
}

/* The recorder's connection has ended, but the service thread has not come to it yet. */
static bool has_gone(const struct viewer *v)
{
    char byte;
    const ssize_t n = recv(lws_get_socket_fd(v->wsi), &byte, 1, MSG_PEEK | MSG_DONTWAIT);

    return v->close_code || n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR);
}

/* Whether another recorder has the name, or had it a moment ago and may return. */
static bool is_held(const struct sequence *q, const struct visitor *by)
{
    if (q->recorder)
        return !has_gone(q->recorder);
    return q->left_us > 0 && memcmp(q->owner, by->address, sizeof(q->owner)) != 0 &&
           viewer_now_us() - q->left_us < STREAM_ABSENT_US;
}

void recorder_displace(struct viewer *v)
{
    struct fault fault;

    recorder_leave(v);
    fault_say(&fault, FAULT_BUSY, "4.1.6", "all %d names are in use, and its address had most of them",
              INGEST_SEQUENCES);
    viewer_send_error(v, &fault);
}

void recorder_hello(struct viewer *v, const struct message *m, struct welcome *w, struct fault *fault)
{
    struct server *s = v->server;
    struct sequence *q = ingest_sequence(s, m->hello.recorder, v->guest->visitor, viewer_now_us());

    if (!q) {
        fault_say(fault, FAULT_BUSY, "4.1.6", "all %d sequences are in use", INGEST_SEQUENCES);
        return;
    }
    if (is_held(q, v->guest->visitor)) {
        fault_say(fault, FAULT_BUSY, "4.1.6", "sequence %s has a recorder", q->name);
        return;
    }
    if (q->recorder)
        recorder_leave(q->recorder);
    v->recorder = true;
    v->sequence = q;
    q->recorder = v;
    memcpy(q->owner, v->guest->visitor->address, sizeof(q->owner));
    w->recorder = true;
    w->has_after = q->has_stored; /* this thread alone hears of it: no lock */
    w->after = q->stored;
    log_debug("%s: the recorder of sequence %s", v->peer, q->name);
}

bool recorder_subscribe(struct viewer *v, const struct message *m, struct fault *fault)
{
    if (v->sequence && ingest_record(v->server, v->sequence, m->subscribe.format))
        return true;
    fault_say(fault, FAULT_NOT_OFFERED, "4.3.6", "a frame of another format is under way");
    return false;
}

void recorder_ack(struct viewer *v, const struct message *m, bool received, struct fault *fault)
{
    if (!m->ack.stored) {
        fault_say(fault, FAULT_BAD_FIELD, "4.5.3", "a recorder acknowledges with \"stored\":true");
        return;
    }
    if (!received || !v->sequence || !ingest_stored(v->server, v->sequence, m->ack.sequence))
        return;
    producers_send(v->server);
    recorder_send_end(v);
}

void recorder_send_end(struct viewer *v)
{
    uint64_t stored;

    if (!v->recorder || !v->sequence)
        return;
    const bool over = ingest_is_over(v->server, v->sequence, &stored);
    if (over && !v->sent_end)
        viewer_queue(v, message_sequence(v->sequence->name, stored));
    v->sent_end = over;
}
