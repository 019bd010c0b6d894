#include "net/stream/internal.h"

#include "base/clock.h"

#include <string.h>

static bool role_offered(const struct server *s, enum server_role role)
{
    return role == SERVER_VIEWER || (role == SERVER_CONTROLLER && s->controllers) ||
           (role == SERVER_PRODUCER && s->push) || (role == SERVER_RECORDER && s->recorders);
}

static void welcome(struct websocket *ws, const struct message *m, struct fault *fault)
{
    const struct server *s = ws->server;
    struct welcome w = {
        .session = s->session,
        .id = ws->id,
        .max_connections = s->limits.most_admitted,
        .controllers = s->controllers,
        .producers = s->push,
        .recorders = s->recorders,
        .h264 = s->h264,
        .controls = s->controls,
    };

    if (!websocket_has_room(ws) || ws->connection->state != CONNECTION_ARRIVING) /* the latter: it has lost its place */
        return;
    if (m->hello.role == SERVER_PRODUCER)
        producer_hello(ws, m, &w, fault);
    else if (m->hello.role == SERVER_RECORDER)
        recorder_hello(ws, m, &w, fault);
    if (fault->code || !connection_admit(ws->server, ws->connection))
        return;
    ws->greeted = true;
    ws->role = m->hello.role;
    ws->status_due = true;
    websocket_queue(ws, message_welcome(&w));
}

static bool take_token(struct websocket *ws, const char *wanted, const char *given, struct fault *fault)
{
    const enum token_check may = token_check(ws->server, ws->wsi, given, wanted);

    if (may == TOKEN_LATER)
        fault_say(fault, FAULT_TOO_FAST, "4.1.8", "too many wrong tokens came from this address");
    else if (may == TOKEN_WRONG)
        fault_say(fault, FAULT_BAD_TOKEN, "4.1.3", "the token is missing or wrong");
    return may == TOKEN_RIGHT;
}

static void take_hello(struct websocket *ws, const struct message *m, struct fault *fault)
{
    const struct server *s = ws->server;

    if (m->hello.major != PROTOCOL_MAJOR)
        fault_say(fault, FAULT_BAD_VERSION, "4.1.2", "this server speaks version %u, not %u", PROTOCOL_MAJOR,
                  m->hello.major);
    else if (!role_offered(s, m->hello.role))
        fault_say(fault, FAULT_WRONG_ROLE, "4.1.1", "this server does not offer that role");
    else if (m->hello.recorder[0] && m->hello.role != SERVER_RECORDER)
        fault_say(fault, FAULT_WRONG_ROLE, "4.1.6", "a recorder has the role recorder");
    else if (take_token(ws, s->tokens[m->hello.role], m->hello.token, fault))
        welcome(ws, m, fault);
}

void websocket_choose(struct websocket *ws)
{
    pthread_mutex_lock(&ws->server->lock);
    const unsigned kind = subscribed_kind(ws->server, &ws->wish);
    pthread_mutex_unlock(&ws->server->lock);
    if (ws->subscribed && ws->kind != kind) {
        /* Each kind of image has its own numbers. Images under way need no acknowledgement any more. */
        ws->outdated = ws->begun > ws->outdated ? ws->begun : ws->outdated;
        ws->begun = 0;
        ws->unacked_count = 0;
        ws->chained = false;
    }
    ws->kind = kind;
}

static void take_subscribe(struct websocket *ws, const struct message *m, struct fault *fault)
{
    const bool watched = ws->subscribed && !ws->wish.subscribe.paused;

    if ((m->subscribe.format == PROTOCOL_H264 && !ws->server->h264) ||
        (m->subscribe.format >= PROTOCOL_H264 && ws->recorder)) {
        fault_say(fault, FAULT_NOT_OFFERED, ws->recorder ? "4.3.6" : "4.3.1",
                  ws->recorder ? "a recorder gets no H.264 and no changes" : "this server makes no H.264");
        return;
    }
    if (ws->recorder && !recorder_subscribe(ws, m, fault))
        return;
    ws->wish = *m;
    websocket_choose(ws);
    ws->subscribed = true;
    ws->chained = false; /* its decoder may be a new one */
    ws->due_us = 0;
    websocket_queue(ws, message_subscribed(m));
    if (!watched && !m->subscribe.paused) {
        /* A viewer that starts or resumes gets the last image at once and has skipped none. */
        struct sent_image *p = websocket_next_image(ws);
        if (p)
            ws->begun = image_header(p)->sequence - 1;
        else if (m->subscribe.format == PROTOCOL_H264)
            ws->begun = chain_newest(ws->server, ws->kind - STREAM_TRACKS);
        ws->since_us = stream_now_us();
        image_unref(p);
    }
    if (ws->recorder) {
        producers_send(ws->server);
        recorder_send_end(ws);
    }
    viewers_demand(ws->server);
    websocket_request_write(ws);
}

static void take_ack(struct websocket *ws, const struct message *m, struct fault *fault)
{
    const uint64_t sequence = m->ack.sequence;
    unsigned kept = 0;
    bool received = false;

    const bool unsent = sequence > ws->begun || (ws->current && sequence == ws->begun);
    if (unsent && sequence <= ws->outdated) /* of a format watched before */
        return;
    if (unsent) {
        fault_say(fault, FAULT_BAD_ORDER, "4.5.1", "image %llu was not sent yet", (unsigned long long)sequence);
        return;
    }
    for (unsigned i = 0; i < ws->unacked_count; i++)
        received |= ws->unacked[i].sequence == sequence;
    for (unsigned i = 0; i < ws->unacked_count; i++)
        if (ws->unacked[i].sequence > sequence)
            ws->unacked[kept++] = ws->unacked[i];
        else if (ws->unacked[i].sequence == sequence &&
                 ws->unacked[i].placed_us >= ws->since_us) /* else it was old then */
            server_observe(ws->server, SERVER_DISPLAYED, 1e-6 * (double)(stream_now_us() - ws->unacked[i].placed_us));
    atomic_fetch_add(&ws->server->counts.acked, ws->unacked_count - kept);
    /* Acks that return credit do not count for the rate limit: they cannot outnumber images. */
    ws->messages.left += ws->unacked_count > kept ? 1.0 : 0.0;
    ws->unacked_count = kept;
    if (ws->recorder)
        recorder_ack(ws, m, received, fault);
    if (websocket_may_begin(ws))
        websocket_request_write(ws);
}

static void take_control(struct websocket *ws, struct message *m, struct fault *fault)
{
    m->control.by = ws->id;
    if (control_ask(ws->server, &m->control))
        return;
    fault_say(fault, FAULT_BUSY, "4.13.8", "too many requests of controllers wait");
    fault->stays = fault->has_request = true;
    fault->request = m->control.request;
}

static void take_end(struct websocket *ws)
{
    ingest_end(ws->server, ws->sequence);
    if (ws->sequence && ws->sequence->recorder)
        recorder_send_end(ws->sequence->recorder);
}

/* Whether the client may send this op now, whatever its fields: the table of section 4. */
static enum fault_code check_turn(const struct websocket *ws, enum message_op op, struct fault *fault)
{
    if (!ws->greeted && op != MESSAGE_HELLO)
        return fault_say(fault, FAULT_BAD_ORDER, "4.1", "hello comes first");
    if (ws->greeted && op == MESSAGE_HELLO)
        return fault_say(fault, FAULT_BAD_ORDER, "4.1", "hello was already sent");
    if (op == MESSAGE_END && ws->role != SERVER_PRODUCER)
        return fault_say(fault, FAULT_WRONG_ROLE, "4.12", "only a producer may send end");
    if (op == MESSAGE_CONTROL && ws->role != SERVER_CONTROLLER)
        return fault_say(fault, FAULT_WRONG_ROLE, "4.13", "only a controller may change settings");
    if (ws->role == SERVER_PRODUCER && (op == MESSAGE_SUBSCRIBE || op == MESSAGE_ACK || op == MESSAGE_PROBE))
        return fault_say(fault, FAULT_WRONG_ROLE, "4.1.1", "a producer gets no images");
    return FAULT_NONE;
}

/* A well-formed message from a client that may send it. */
static void take_message(struct websocket *ws, struct message *m, struct fault *fault)
{
    if (m->op == MESSAGE_HELLO)
        take_hello(ws, m, fault);
    else if (m->op == MESSAGE_END)
        take_end(ws);
    else if (m->op == MESSAGE_CONTROL)
        take_control(ws, m, fault);
    else if (m->op == MESSAGE_SUBSCRIBE)
        take_subscribe(ws, m, fault);
    else if (m->op == MESSAGE_ACK)
        take_ack(ws, m, fault);
    else if (m->op == MESSAGE_PROBE)
        inspect_take(ws, m, fault);
    else if (ws->outbox_count < STREAM_PONGS) /* no more pongs than this behind a large image on a slow line */
        websocket_queue(ws, message_pong(m->ping.id, clock_wall_us()));
}

static void take_text(struct websocket *ws)
{
    struct message m;
    struct fault fault = { .clause = "" };

    if (!bucket_take(&ws->messages, STREAM_BURST, STREAM_RATE, stream_now_us())) {
        atomic_fetch_add(&ws->server->counts.too_fast, 1);
        fault_say(&fault, FAULT_TOO_FAST, "2.5", "more than %g messages a second", STREAM_RATE);
    } else {
        message_parse(ws->text, ws->text_size, ws->server->controls, &m, &fault);
        /* A message at the wrong time or from the wrong role is one whatever its fields. */
        const bool has_op = m.op != MESSAGE_UNKNOWN || fault.code == FAULT_UNKNOWN_OP;
        if (!(has_op && check_turn(ws, m.op, &fault)) && !fault.code)
            take_message(ws, &m, &fault);
    }
    if (fault.code)
        websocket_send_error(ws, &fault);
}

/* Collects the pieces of one text message; refuses one that is too long as soon as its size is known. */
static void receive_text(struct websocket *ws, const uint8_t *in, size_t length, size_t coming, bool last)
{
    struct fault fault;

    if (lws_is_first_fragment(ws->wsi)) {
        ws->text_size = 0;
        ws->pieces = 0;
    }
    const size_t room = sizeof(ws->text) - ws->text_size;
    const bool big = length > room || coming > room - length;
    if (big || ++ws->pieces > STREAM_PIECES) {
        fault_say(&fault, FAULT_TOO_BIG, "3.3",
                  big ? "a text message has at most %d bytes" : "a text message has at most %d fragments",
                  big ? PROTOCOL_TEXT_MAX : STREAM_PIECES);
        websocket_send_error(ws, &fault);
        return;
    }
    memcpy(ws->text + ws->text_size, in, length);
    ws->text_size += length;
    if (last && coming == 0)
        take_text(ws);
}

void websocket_receive(struct websocket *ws, const uint8_t *in, size_t length)
{
    const size_t coming = lws_remaining_packet_payload(ws->wsi);
    const bool last = lws_is_final_fragment(ws->wsi);
    struct fault fault;

    if (ws->close_code)
        return;
    if (!lws_frame_is_binary(ws->wsi)) {
        receive_text(ws, in, length, coming, last);
    } else if (ws->greeted && ws->role == SERVER_PRODUCER) {
        producer_receive(ws, in, length, coming, last);
    } else {
        fault_say(&fault, FAULT_WRONG_ROLE, "3.5", "only a producer sends binary messages");
        websocket_send_error(ws, &fault);
    }
}
