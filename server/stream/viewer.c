#include "internal.h"

#include "clock.h"
#include "log.h"
#include "mem.h"

#include <assert.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>

static int64_t now_us(void)
{
    return (int64_t)lws_now_usecs();
}

/* Asks lws for a moment to write; the first asking starts the clock by which a viewer that takes nothing is cut. */
static void want_write(struct viewer *v)
{
    if (!v->waiting) {
        v->waiting = true;
        v->moved_us = now_us();
    }
    lws_callback_on_writable(v->wsi);
}

/* Queues a text; takes it over. A viewer that asks faster than it reads is told so. */
static void say(struct viewer *v, char *text);

static void part(struct viewer *v, uint16_t code, const char *text)
{
    if (v->close_code)
        return;
    v->close_code = code;
    snprintf(v->close_text, sizeof(v->close_text), "%s", text);
    want_write(v);
}

static void complain(struct viewer *v, const struct fault *fault)
{
    atomic_fetch_add(&v->server->counts.errors, 1);
    log_debug("%s: %s (clause %s): %s", v->peer, fault_name(fault->code), fault->clause, fault->text);
    if (v->outbox_count < STREAM_OUTBOX)
        say(v, message_error(fault));
    if (fault_close_code(fault->code)) {
        char text[120];
        snprintf(text, sizeof(text), "clause %s: %.100s", fault->clause, fault->text);
        part(v, fault_close_code(fault->code), text);
    }
}

static void say(struct viewer *v, char *text)
{
    struct fault fault;

    if (text && v->outbox_count == STREAM_OUTBOX) {
        message_free(text);
        fault_say(&fault, FAULT_TOO_FAST, "2.5", "answers wait and are not read");
        complain(v, &fault);
    } else if (text) {
        v->outbox[v->outbox_count++] = text;
        want_write(v);
    }
}

/* The newest picture of the viewer's format, as a new reference, if it has not begun to get it yet. */
static struct picture *next_picture(struct viewer *v)
{
    struct server *s = v->server;
    struct picture *p = NULL;

    pthread_mutex_lock(&s->lock);
    struct picture *latest = s->latest[v->wish.subscribe.format];
    if (latest && picture_header(latest)->sequence > v->begun)
        p = picture_ref(latest);
    pthread_mutex_unlock(&s->lock);
    return p;
}

static void pace_over(lws_sorted_usec_list_t *sul)
{
    struct viewer *v = lws_container_of(sul, struct viewer, pace);

    want_write(v);
}

/* Whether a picture may begin now. Comes back by itself when only the viewer's rate stands against it. */
static bool may_begin(struct viewer *v)
{
    if (v->current || v->close_code || !v->subscribed || v->wish.subscribe.paused ||
        v->unacked_count == PROTOCOL_CREDIT)
        return false;
    struct picture *p = next_picture(v);
    if (!p)
        return false;
    picture_unref(p);
    const int64_t wait = v->due_us - now_us();
    if (wait > 0)
        lws_sul_schedule(v->server->context, 0, &v->pace, pace_over, wait);
    return wait <= 0;
}

static void begin_picture(struct viewer *v)
{
    struct picture *p = next_picture(v);

    if (!p)
        return;
    const struct protocol_picture *header = picture_header(p);
    const double rate = v->wish.subscribe.max_rate;
    if (v->begun > 0) {
        v->skipped += header->sequence - v->begun - 1;
        atomic_fetch_add(&v->server->counts.skipped, header->sequence - v->begun - 1);
    }
    if (rate > 0.0) {
        /* Late by less than one interval is made up for, so that the average holds. */
        const int64_t interval = (int64_t)(1e6 / rate), now = now_us();
        v->due_us = (v->due_us > now - interval ? v->due_us : now) + interval;
    }
    v->begun = header->sequence;
    v->repeated = header->published_us < v->since_us;
    v->unacked[v->unacked_count++] = header->sequence;
    v->current = p;
    v->offset = 0;
}

static int send_fragment(struct viewer *v)
{
    size_t size;
    const uint8_t *message = picture_message(v->current, &size);
    const size_t left = size - v->offset, piece = left < STREAM_CHUNK ? left : STREAM_CHUNK;
    uint8_t *out = v->staging + LWS_PRE;

    memcpy(out, message + v->offset, piece);
    if (v->offset == 0 && v->repeated)
        out[PROTOCOL_PICTURE_FLAGS_AT] |= PROTOCOL_PICTURE_REPEAT;
    if (lws_write(v->wsi, out, piece, lws_write_ws_flags(LWS_WRITE_BINARY, v->offset == 0, piece == left)) < 0)
        return -1;
    v->offset += piece;
    atomic_fetch_add(&v->server->counts.bytes, piece);
    if (v->offset == size) {
        picture_unref(v->current);
        v->current = NULL;
        v->sent++;
        atomic_fetch_add(&v->server->counts.sent, 1);
    }
    return 0;
}

static int send_text(struct viewer *v, const char *text)
{
    const size_t size = strlen(text);

    if (size > STREAM_CHUNK)
        return -1;
    memcpy(v->staging + LWS_PRE, text, size);
    return lws_write(v->wsi, v->staging + LWS_PRE, size, LWS_WRITE_TEXT) < 0 ? -1 : 0;
}

static int send_outbox(struct viewer *v)
{
    char *text = v->outbox[0];

    v->outbox_count--;
    memmove(v->outbox, v->outbox + 1, v->outbox_count * sizeof(v->outbox[0]));
    const int result = send_text(v, text);
    message_free(text);
    return result;
}

static int send_status(struct viewer *v)
{
    struct server *s = v->server;

    v->status_due = false;
    pthread_mutex_lock(&s->lock);
    char *text = message_status(s->status, clock_wall_us(), s->demand.viewers, v->sent, v->skipped);
    pthread_mutex_unlock(&s->lock);
    const int result = text ? send_text(v, text) : 0;
    message_free(text);
    return result;
}

static int say_goodbye(struct viewer *v)
{
    lws_close_reason(v->wsi, (enum lws_close_status)v->close_code, (unsigned char *)v->close_text,
                     strlen(v->close_text));
    return -1;
}

/* One write per call, as lws wants it. Between the fragments of a picture only a close frame may go. */
static int write_next(struct viewer *v)
{
    int result = 0;

    v->waiting = false;
    if (v->close_code && (v->current || v->outbox_count == 0))
        return say_goodbye(v);
    if (!v->current && v->outbox_count > 0) {
        result = send_outbox(v);
    } else if (!v->current && v->status_due) {
        result = send_status(v);
    } else {
        if (may_begin(v))
            begin_picture(v);
        if (v->current)
            result = send_fragment(v);
    }
    if (result == 0 && (v->current || v->outbox_count > 0 || v->status_due || v->close_code || may_begin(v)))
        want_write(v);
    return result;
}

static bool same_token(const char *given, const char *wanted)
{
    /* Looks at every byte whatever it finds, so that the time taken tells nothing about the token. */
    const size_t length = strlen(given);
    unsigned differs = length != strlen(wanted);

    for (size_t i = 0; wanted[i]; i++)
        differs |= (unsigned char)wanted[i] ^ (unsigned char)given[i < length ? i : length];
    return !differs;
}

static void take_hello(struct viewer *v, const struct message *m, struct fault *fault)
{
    const struct server *s = v->server;

    if (v->greeted)
        fault_say(fault, FAULT_BAD_ORDER, "4.1", "hello was said before");
    else if (m->hello.major != PROTOCOL_MAJOR)
        fault_say(fault, FAULT_BAD_VERSION, "4.1.2", "version %u is spoken here, not %u", PROTOCOL_MAJOR,
                  m->hello.major);
    else if (m->hello.role != SERVER_VIEWER)
        fault_say(fault, FAULT_WRONG_ROLE, "4.1.1", "this server takes viewers only");
    else if (s->tokens[m->hello.role] && !same_token(m->hello.token, s->tokens[m->hello.role]))
        fault_say(fault, FAULT_BAD_TOKEN, "4.1.3", "the token is missing or wrong");
    if (fault->code)
        return;
    v->greeted = true;
    v->role = m->hello.role;
    v->status_due = true;
    say(v, message_welcome(s->session, s->max_connections));
}

static void take_subscribe(struct viewer *v, const struct message *m, struct fault *fault)
{
    const bool watched = v->subscribed && !v->wish.subscribe.paused;

    if (m->subscribe.format != PROTOCOL_JPEG) {
        fault_say(fault, FAULT_NOT_OFFERED, "4.3.1", "this server makes jpeg only");
        return;
    }
    v->wish = *m;
    v->subscribed = true;
    v->due_us = 0;
    say(v, message_subscribed(m));
    if (!watched && !m->subscribe.paused) {
        /* Who begins or resumes gets the last picture at once, and has skipped none. */
        struct picture *p = next_picture(v);
        if (p)
            v->begun = picture_header(p)->sequence - 1;
        v->since_us = clock_wall_us();
        picture_unref(p);
    }
    viewers_demand(v->server);
    want_write(v);
}

static void take_ack(struct viewer *v, const struct message *m, struct fault *fault)
{
    const uint64_t sequence = m->ack.sequence;
    unsigned kept = 0;

    if (sequence > v->begun || (v->current && sequence == v->begun)) {
        fault_say(fault, FAULT_BAD_ORDER, "4.5.1", "picture %llu was not sent yet", (unsigned long long)sequence);
        return;
    }
    for (unsigned i = 0; i < v->unacked_count; i++)
        if (v->unacked[i] > sequence)
            v->unacked[kept++] = v->unacked[i];
    atomic_fetch_add(&v->server->counts.acked, v->unacked_count - kept);
    /* Acks that return credit cannot come faster than pictures go: they do not count as messages. */
    v->tokens += v->unacked_count > kept ? 1.0 : 0.0;
    v->unacked_count = kept;
    if (may_begin(v))
        want_write(v);
}

/* A bucket of STREAM_BURST messages that fills at STREAM_RATE a second. */
static bool too_fast(struct viewer *v)
{
    const int64_t now = now_us();

    v->tokens += (double)(now - v->tokens_us) * 1e-6 * STREAM_RATE;
    v->tokens_us = now;
    if (v->tokens > STREAM_BURST)
        v->tokens = STREAM_BURST;
    if (v->tokens < 1.0)
        return true;
    v->tokens -= 1.0;
    return false;
}

static void take_text(struct viewer *v)
{
    struct message m;
    struct fault fault = { .clause = "" };

    if (too_fast(v))
        fault_say(&fault, FAULT_TOO_FAST, "2.5", "more than %g messages a second", STREAM_RATE);
    else if (!message_parse(v->text, v->text_size, &m, &fault)) {
        if (!v->greeted && m.op != MESSAGE_HELLO)
            fault_say(&fault, FAULT_BAD_ORDER, "4.1", "hello comes first");
        else if (m.op == MESSAGE_HELLO)
            take_hello(v, &m, &fault);
        else if (m.op == MESSAGE_SUBSCRIBE)
            take_subscribe(v, &m, &fault);
        else if (m.op == MESSAGE_ACK)
            take_ack(v, &m, &fault);
        else
            say(v, message_pong(m.ping.id, clock_wall_us()));
    }
    if (fault.code)
        complain(v, &fault);
}

/* Gathers the pieces of one message; its size is refused as soon as it is known. */
static void receive(struct viewer *v, const uint8_t *in, size_t length)
{
    struct fault fault;

    if (v->close_code)
        return;
    if (lws_is_first_fragment(v->wsi)) {
        v->text_size = 0;
        v->pieces = 0;
    }
    const size_t coming = lws_remaining_packet_payload(v->wsi), room = sizeof(v->text) - v->text_size;
    if (lws_frame_is_binary(v->wsi)) {
        fault_say(&fault, FAULT_WRONG_ROLE, "3.5", "a viewer sends no binary messages");
        complain(v, &fault);
    } else if (length > room || coming > room - length || ++v->pieces > STREAM_PIECES) {
        fault_say(&fault, FAULT_TOO_BIG, "3.3", "a text message has at most %d bytes", PROTOCOL_TEXT_MAX);
        complain(v, &fault);
    } else {
        memcpy(v->text + v->text_size, in, length);
        v->text_size += length;
        if (lws_is_final_fragment(v->wsi) && coming == 0)
            take_text(v);
    }
}

/* Before the upgrade is answered. */
static int filter(struct server *s, struct lws *wsi)
{
    char path[64], version[8];

    if (!atomic_load(&s->stopping) && http_host_ok(s, wsi) && http_origin_ok(wsi) &&
        lws_hdr_copy(wsi, path, sizeof(path), WSI_TOKEN_GET_URI) > 0 && strcmp(path, PROTOCOL_PATH) == 0 &&
        lws_hdr_copy(wsi, version, sizeof(version), WSI_TOKEN_VERSION) > 0 && strcmp(version, "13") == 0)
        return 0;
    atomic_fetch_add(&s->counts.refused, 1);
    lws_return_http_status(wsi, 403, NULL);
    return -1;
}

static int open_viewer(struct server *s, struct lws *wsi, struct viewer **out)
{
    const int unsent = STREAM_UNSENT;
    struct fault fault;
    struct viewer *v = mem_alloc(1, sizeof(*v));

    if (!v)
        return -1;
    *out = v;
    v->server = s;
    v->wsi = wsi;
    v->tokens = STREAM_BURST;
    v->opened_us = v->tokens_us = v->moved_us = now_us();
    lws_get_peer_simple(wsi, v->peer, sizeof(v->peer));
    setsockopt(lws_get_socket_fd(wsi), IPPROTO_TCP, TCP_NOTSENT_LOWAT, &unsent, sizeof(unsent));
    v->next = s->viewers;
    s->viewers = v;
    atomic_fetch_add(&s->counts.connections, 1);
    const uint64_t open = atomic_fetch_add(&s->counts.open, 1);
    if (atomic_load(&s->stopping)) {
        part(v, 1001, "the server is going away");
    } else if (open >= s->max_connections) {
        atomic_fetch_add(&s->counts.refused, 1);
        fault_say(&fault, FAULT_FULL, "2.4", "all %u connections are taken", s->max_connections);
        complain(v, &fault);
    }
    return 0;
}

static void close_viewer(struct viewer *v)
{
    struct server *s = v->server;
    struct viewer **link = &s->viewers;

    while (*link != v)
        link = &(*link)->next;
    *link = v->next;
    atomic_fetch_sub(&s->counts.open, 1);
    lws_sul_cancel(&v->pace);
    picture_unref(v->current);
    while (v->outbox_count > 0)
        message_free(v->outbox[--v->outbox_count]);
    mem_free(v);
    viewers_demand(s);
}

void viewers_wake(struct server *s)
{
    const bool urgent = atomic_exchange(&s->urgent, false);

    for (struct viewer *v = s->viewers; v; v = v->next) {
        if (urgent && v->greeted)
            v->status_due = true;
        if (v->status_due || may_begin(v))
            want_write(v);
    }
}

void viewers_tick(struct server *s)
{
    const int64_t now = now_us();
    struct fault fault;

    for (struct viewer *v = s->viewers; v; v = v->next) {
        if (v->waiting && now - v->moved_us > STREAM_STALL_US) {
            atomic_fetch_add(&s->counts.stalled, 1);
            log_warning("%s: cut, since it took no byte for %d s; it had %llu pictures and skipped %llu", v->peer,
                        STREAM_STALL_US / 1000000, (unsigned long long)v->sent, (unsigned long long)v->skipped);
            lws_set_timeout(v->wsi, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_ASYNC);
        } else if (!v->greeted && !v->close_code && now - v->opened_us > STREAM_HELLO_US) {
            fault_say(&fault, FAULT_NO_HELLO, "4.1", "no hello within %d s", STREAM_HELLO_US / 1000000);
            complain(v, &fault);
        } else if (v->greeted && !v->close_code) {
            v->status_due = true;
            want_write(v);
        }
    }
}

void viewers_leave(struct server *s)
{
    for (struct viewer *v = s->viewers; v; v = v->next)
        part(v, 1001, "the server is going away");
}

void viewers_demand(struct server *s)
{
    struct server_demand d = { 0 };
    bool unlimited = false;

    for (struct viewer *v = s->viewers; v; v = v->next) {
        if (!v->subscribed || v->wish.subscribe.paused || v->close_code)
            continue;
        d.viewers++;
        d.formats |= 1u << v->wish.subscribe.format;
        if (v->wish.subscribe.quality > d.jpeg_quality)
            d.jpeg_quality = v->wish.subscribe.quality;
        if (v->wish.subscribe.max_rate > d.max_rate)
            d.max_rate = v->wish.subscribe.max_rate;
        unlimited = unlimited || v->wish.subscribe.max_rate == 0.0;
    }
    if (unlimited)
        d.max_rate = 0.0;
    pthread_mutex_lock(&s->lock);
    s->demand = d;
    pthread_mutex_unlock(&s->lock);
}

/* relight.v1 on one connection. Thread: service. */
int viewer_callback(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t length)
{
    struct server *s = lws_context_user(lws_get_context(wsi));
    struct viewer **slot = user, *v = slot ? *slot : NULL;

    switch (reason) {
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION: return filter(s, wsi);
    case LWS_CALLBACK_ESTABLISHED: return open_viewer(s, wsi, slot);
    case LWS_CALLBACK_RECEIVE:
        receive(v, in, length);
        lws_validity_confirmed(wsi);
        return 0;
    case LWS_CALLBACK_SERVER_WRITEABLE: return write_next(v);
    case LWS_CALLBACK_CLOSED:
        if (v)
            close_viewer(v);
        *slot = NULL;
        return 0;
    case LWS_CALLBACK_EVENT_WAIT_CANCELLED:
        if (atomic_load(&s->stopping) && !s->leaving) {
            s->leaving = true;
            viewers_leave(s);
        }
        viewers_wake(s);
        return 0;
    default: return 0;
    }
}
