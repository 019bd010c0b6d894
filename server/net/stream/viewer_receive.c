#include "net/stream/internal.h"

#include "base/clock.h"

#include <string.h>

static bool role_offered(const struct server *s, enum server_role role)
{
    return role == SERVER_VIEWER || (role == SERVER_CONTROLLER && s->controllers) ||
           (role == SERVER_PRODUCER && s->push) || (role == SERVER_RECORDER && s->recorders);
}

static void welcome(struct viewer *v, const struct message *m, struct fault *fault)
{
    const struct server *s = v->server;
    struct welcome w = {
        .session = s->session,
        .id = v->id,
        .max_connections = s->max_connections,
        .controllers = s->controllers,
        .producers = s->push,
        .recorders = s->recorders,
        .h264 = s->h264,
        .controls = s->controls,
    };

    if (!viewer_has_room(v))
        return;
    if (m->hello.role == SERVER_PRODUCER)
        producer_hello(v, m, &w, fault);
    else if (m->hello.role == SERVER_RECORDER)
        recorder_hello(v, m, &w, fault);
    if (fault->code || !guest_admit(v->server, v->guest))
        return;
    v->greeted = true;
    v->role = m->hello.role;
    v->status_due = true;
    viewer_queue(v, message_welcome(&w));
}

static bool take_token(struct viewer *v, const char *wanted, const char *given, struct fault *fault)
{
    const enum admission may = wanted ? admission_token(v->server, v->wsi, given, wanted) : ADMISSION_RIGHT;

    if (may == ADMISSION_LATER)
        fault_say(fault, FAULT_TOO_FAST, "4.1.8", "too many wrong tokens came from this address");
    else if (may == ADMISSION_WRONG)
        fault_say(fault, FAULT_BAD_TOKEN, "4.1.3", "the token is missing or wrong");
    return may == ADMISSION_RIGHT;
}

static void take_hello(struct viewer *v, const struct message *m, struct fault *fault)
{
    const struct server *s = v->server;

    if (m->hello.major != PROTOCOL_MAJOR)
        fault_say(fault, FAULT_BAD_VERSION, "4.1.2", "this server speaks version %u, not %u", PROTOCOL_MAJOR,
                  m->hello.major);
    else if (!role_offered(s, m->hello.role))
        fault_say(fault, FAULT_WRONG_ROLE, "4.1.1", "this server does not offer that role");
    else if (m->hello.recorder[0] && m->hello.role != SERVER_RECORDER)
        fault_say(fault, FAULT_WRONG_ROLE, "4.1.6", "a recorder has the role recorder");
    else if (take_token(v, s->tokens[m->hello.role], m->hello.token, fault))
        welcome(v, m, fault);
}

void viewer_choose(struct viewer *v)
{
    pthread_mutex_lock(&v->server->lock);
    const unsigned kind = subscribed_kind(v->server, &v->wish);
    pthread_mutex_unlock(&v->server->lock);
    if (v->subscribed && v->kind != kind) {
        /* Each kind of image has its own numbers. Images under way need no acknowledgement any more. */
        v->outdated = v->begun > v->outdated ? v->begun : v->outdated;
        v->begun = 0;
        v->unacked_count = 0;
        v->chained = false;
    }
    v->kind = kind;
}

static void take_subscribe(struct viewer *v, const struct message *m, struct fault *fault)
{
    const bool watched = v->subscribed && !v->wish.subscribe.paused;

    if ((m->subscribe.format == PROTOCOL_H264 && !v->server->h264) ||
        (m->subscribe.format >= PROTOCOL_H264 && v->recorder)) {
        fault_say(fault, FAULT_NOT_OFFERED, v->recorder ? "4.3.6" : "4.3.1",
                  v->recorder ? "a recorder gets no H.264 and no changes" : "this server makes no H.264");
        return;
    }
    if (v->recorder && !recorder_subscribe(v, m, fault))
        return;
    v->wish = *m;
    viewer_choose(v);
    v->subscribed = true;
    v->chained = false; /* its decoder may be a new one */
    v->due_us = 0;
    viewer_queue(v, message_subscribed(m));
    if (!watched && !m->subscribe.paused) {
        /* A viewer that starts or resumes gets the last image at once and has skipped none. */
        struct sent_image *p = viewer_next_image(v);
        if (p)
            v->begun = image_header(p)->sequence - 1;
        else if (m->subscribe.format == PROTOCOL_H264)
            v->begun = chain_newest(v->server, v->kind - STREAM_TRACKS);
        v->since_us = viewer_now_us();
        image_unref(p);
    }
    if (v->recorder) {
        producers_send(v->server);
        recorder_send_end(v);
    }
    viewers_demand(v->server);
    viewer_request_write(v);
}

static void take_ack(struct viewer *v, const struct message *m, struct fault *fault)
{
    const uint64_t sequence = m->ack.sequence;
    unsigned kept = 0;
    bool received = false;

    const bool unsent = sequence > v->begun || (v->current && sequence == v->begun);
    if (unsent && sequence <= v->outdated) /* of a format watched before */
        return;
    if (unsent) {
        fault_say(fault, FAULT_BAD_ORDER, "4.5.1", "image %llu was not sent yet", (unsigned long long)sequence);
        return;
    }
    for (unsigned i = 0; i < v->unacked_count; i++)
        received |= v->unacked[i].sequence == sequence;
    for (unsigned i = 0; i < v->unacked_count; i++)
        if (v->unacked[i].sequence > sequence)
            v->unacked[kept++] = v->unacked[i];
        else if (v->unacked[i].sequence == sequence &&
                 v->unacked[i].placed_us >= v->since_us) /* else it was old then */
            server_observe(v->server, SERVER_DISPLAYED, 1e-6 * (double)(viewer_now_us() - v->unacked[i].placed_us));
    atomic_fetch_add(&v->server->counts.acked, v->unacked_count - kept);
    /* Acks that return credit do not count for the rate limit: they cannot outnumber images. */
    v->tokens += v->unacked_count > kept ? 1.0 : 0.0;
    v->unacked_count = kept;
    if (v->recorder)
        recorder_ack(v, m, received, fault);
    if (viewer_may_begin(v))
        viewer_request_write(v);
}

static void take_control(struct viewer *v, struct message *m, struct fault *fault)
{
    m->control.by = v->id;
    if (control_ask(v->server, &m->control))
        return;
    fault_say(fault, FAULT_BUSY, "4.13.8", "too many requests of controllers wait");
    fault->stays = fault->has_request = true;
    fault->request = m->control.request;
}

static void take_end(struct viewer *v)
{
    ingest_end(v->server, v->sequence);
    if (v->sequence && v->sequence->recorder)
        recorder_send_end(v->sequence->recorder);
}

bool viewer_too_fast(struct viewer *v, int64_t now_us)
{
    v->tokens += (double)(now_us - v->tokens_us) * 1e-6 * STREAM_RATE;
    v->tokens_us = now_us;
    if (v->tokens > STREAM_BURST)
        v->tokens = STREAM_BURST;
    if (v->tokens < 1.0)
        return true;
    v->tokens -= 1.0;
    return false;
}

/* Whether the client may send this op now, whatever its fields: the table of section 4. */
static enum fault_code check_turn(const struct viewer *v, enum message_op op, struct fault *fault)
{
    if (!v->greeted && op != MESSAGE_HELLO)
        return fault_say(fault, FAULT_BAD_ORDER, "4.1", "hello comes first");
    if (v->greeted && op == MESSAGE_HELLO)
        return fault_say(fault, FAULT_BAD_ORDER, "4.1", "hello was already sent");
    if (op == MESSAGE_END && v->role != SERVER_PRODUCER)
        return fault_say(fault, FAULT_WRONG_ROLE, "4.12", "only a producer may send end");
    if (op == MESSAGE_CONTROL && v->role != SERVER_CONTROLLER)
        return fault_say(fault, FAULT_WRONG_ROLE, "4.13", "only a controller may change settings");
    if (v->role == SERVER_PRODUCER && (op == MESSAGE_SUBSCRIBE || op == MESSAGE_ACK || op == MESSAGE_PROBE))
        return fault_say(fault, FAULT_WRONG_ROLE, "4.1.1", "a producer gets no images");
    return FAULT_NONE;
}

/* A well-formed message from a client that may send it. */
static void take_message(struct viewer *v, struct message *m, struct fault *fault)
{
    if (m->op == MESSAGE_HELLO)
        take_hello(v, m, fault);
    else if (m->op == MESSAGE_END)
        take_end(v);
    else if (m->op == MESSAGE_CONTROL)
        take_control(v, m, fault);
    else if (m->op == MESSAGE_SUBSCRIBE)
        take_subscribe(v, m, fault);
    else if (m->op == MESSAGE_ACK)
        take_ack(v, m, fault);
    else if (m->op == MESSAGE_PROBE)
        inspect_take(v, m, fault);
    else if (v->outbox_count < STREAM_PONGS) /* no more pongs than this behind a large image on a slow line */
        viewer_queue(v, message_pong(m->ping.id, clock_wall_us()));
}

static void take_text(struct viewer *v)
{
    struct message m;
    struct fault fault = { .clause = "" };

    if (viewer_too_fast(v, viewer_now_us())) {
        atomic_fetch_add(&v->server->counts.too_fast, 1);
        fault_say(&fault, FAULT_TOO_FAST, "2.5", "more than %g messages a second", STREAM_RATE);
    } else {
        message_parse(v->text, v->text_size, v->server->controls, &m, &fault);
        /* A message at the wrong time or from the wrong role is one whatever its fields. */
        const bool has_op = m.op != MESSAGE_UNKNOWN || fault.code == FAULT_UNKNOWN_OP;
        if (!(has_op && check_turn(v, m.op, &fault)) && !fault.code)
            take_message(v, &m, &fault);
    }
    if (fault.code)
        viewer_send_error(v, &fault);
}

/* Collects the pieces of one text message; refuses one that is too long as soon as its size is known. */
static void receive_text(struct viewer *v, const uint8_t *in, size_t length, size_t coming, bool last)
{
    struct fault fault;

    if (lws_is_first_fragment(v->wsi)) {
        v->text_size = 0;
        v->pieces = 0;
    }
    const size_t room = sizeof(v->text) - v->text_size;
    const bool big = length > room || coming > room - length;
    if (big || ++v->pieces > STREAM_PIECES) {
        fault_say(&fault, FAULT_TOO_BIG, "3.3",
                  big ? "a text message has at most %d bytes" : "a text message has at most %d fragments",
                  big ? PROTOCOL_TEXT_MAX : STREAM_PIECES);
        viewer_send_error(v, &fault);
        return;
    }
    memcpy(v->text + v->text_size, in, length);
    v->text_size += length;
    if (last && coming == 0)
        take_text(v);
}

void viewer_receive(struct viewer *v, const uint8_t *in, size_t length)
{
    const size_t coming = lws_remaining_packet_payload(v->wsi);
    const bool last = lws_is_final_fragment(v->wsi);
    struct fault fault;

    if (v->close_code)
        return;
    if (!lws_frame_is_binary(v->wsi)) {
        receive_text(v, in, length, coming, last);
    } else if (v->greeted && v->role == SERVER_PRODUCER) {
        producer_receive(v, in, length, coming, last);
    } else {
        fault_say(&fault, FAULT_WRONG_ROLE, "3.5", "only a producer sends binary messages");
        viewer_send_error(v, &fault);
    }
}
