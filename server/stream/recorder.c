#include "internal.h"

#include "log.h"

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
        fault_say(fault, FAULT_BUSY, "4.1.6", "%d sequences are remembered already, and all in use", INGEST_SEQUENCES);
        return;
    }
    struct viewer *old = q->recorder;
    if (old) {
        struct fault gone;
        recorder_leave(old);
        fault_say(&gone, FAULT_SUPERSEDED, "4.1.6", "another recorder has taken over");
        viewer_complain(old, &gone);
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
    fault_say(fault, FAULT_NOT_OFFERED, "4.3.6", "a frame is under way to become a picture in another format");
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
    producers_tell(v->server);
    recorder_tell(v);
}

void recorder_tell(struct viewer *v)
{
    uint64_t stored;

    if (!v->recorder || !v->sequence)
        return;
    const bool over = ingest_is_over(v->server, v->sequence, &stored);
    if (over && !v->told_end)
        viewer_say(v, message_sequence(v->sequence->name, stored));
    v->told_end = over;
}
