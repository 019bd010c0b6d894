#include "stream/internal.h"

#include "base/log.h"

void recorder_leave(struct viewer *v)
{
    struct server *s = v->server;
    struct sequence *q = v->sequence;

    if (!v->recorder || !q)
        return;
    v->sequence = NULL;
    q->recorder = NULL;
    q->touched_us = viewer_now_us();
    pthread_mutex_lock(&s->lock);
    q->recording = false;
    pthread_mutex_unlock(&s->lock);
}

void recorder_hello(struct viewer *v, const struct message *m, struct welcome *w, struct fault *fault)
{
    struct server *s = v->server;
    struct sequence *q = ingest_sequence(s, m->hello.recorder, viewer_now_us());

    if (!q) {
        fault_say(fault, FAULT_BUSY, "4.1.6", "all %d sequences are in use", INGEST_SEQUENCES);
        return;
    }
    struct viewer *old = q->recorder;
    if (old) {
        struct fault gone;
        recorder_leave(old);
        fault_say(&gone, FAULT_SUPERSEDED, "4.1.6", "another recorder has taken over");
        viewer_send_error(old, &gone);
    }
    v->recorder = true;
    v->sequence = q;
    q->recorder = v;
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

void recorder_ack(struct viewer *v, const struct message *m, struct fault *fault)
{
    if (!m->ack.stored) {
        fault_say(fault, FAULT_BAD_FIELD, "4.5.3", "a recorder acknowledges with \"stored\":true");
        return;
    }
    if (!v->sequence || !ingest_stored(v->server, v->sequence, m->ack.sequence))
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
