#include "clients/feed/feeder.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/progress.h"
#include "clients/common/client.h"
#include "clients/common/message.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define FLIGHTS 64       /* frames sent completely and not yet answered; a server that grants more credit is ignored */
#define PATIENCE_MS 5000 /* delay before a hint about what is missing */

struct flight {
    uint64_t number;
    char name[256];
};

struct feeder {
    struct feeder_desc desc;
    struct reader *reader;
    struct connection *connection;
    struct progress line;
    bool begun;                     /* the reader has been started */
    uint64_t credit, most;          /* frames that may be sent now; maximum bytes of a message */
    struct flight flights[FLIGHTS]; /* sent on this connection, in order */
    size_t flight_count;
    bool transmitting; /* the reader's oldest parcel is being sent */
    bool has_settled;  /* lockstep: the server has the frames up to `settled`, as far as is known */
    uint64_t settled;
    double due_s;       /* of the next frame, if there is a rate */
    int64_t waiting_ms; /* since when a frame has been waiting for credit; 0: none */
    bool hinted;
    bool interrupted;
    bool has_owed, owed_counted; /* lockstep: the fate of a frame sent on an earlier connection is still open */
    uint64_t owed;               /* its number; counted: as used */

    struct feeder_report report; /* without what the reader and the connection count */
};

/* ---- Sending frames, receiving fates ---- */

static void settle(struct feeder *f, uint64_t *count)
{
    (*count)++;
    progress_step(&f->line, 1);
    connection_thrive(f->connection);
}

static void refuse_here(struct feeder *f, const struct parcel *p, const char *text)
{
    log_error("%s: frame %" PRIu64 " %s", p->frame.name, p->frame.number, text);
    settle(f, &f->report.refused);
    reader_drop(f->reader);
}

/* Refuses a frame that cannot succeed. True: the parcel was dropped. */
static bool is_hopeless(struct feeder *f, const struct parcel *p)
{
    char text[160];

    if (f->most > 0 && (uint64_t)p->header.payload + sizeof(p->head) > f->most) {
        snprintf(text, sizeof(text), "has %" PRIu32 " bytes; the server's limit is %" PRIu64, p->header.payload,
                 f->most);
        refuse_here(f, p, text);
        return true;
    }
    if (f->desc.lockstep && f->report.has_last && p->frame.number < f->report.last) {
        snprintf(text, sizeof(text), "comes after frame %" PRIu64 "; in lockstep frame numbers must increase",
                 f->report.last);
        refuse_here(f, p, text);
        return true;
    }
    return false;
}

static void send_parcel(struct feeder *f, struct parcel *p)
{
    struct flight *flight = &f->flights[f->flight_count++];

    flight->number = p->frame.number;
    snprintf(flight->name, sizeof(flight->name), "%s", p->frame.name);
    f->credit--;
    f->transmitting = true;
    f->waiting_ms = 0;
    f->report.last = p->frame.number;
    f->report.has_last = true;
    connection_send(f->connection, p->head, sizeof(p->head), p->payload, p->header.payload);
}

/* With a rate: whether the next frame is due; else schedules a tick for when it is. */
static bool is_due(struct feeder *f)
{
    const double now = clock_seconds();

    if (f->desc.rate <= 0.0)
        return true;
    if (now < f->due_s) {
        connection_tick_within(f->connection, (int64_t)(1e6 * (f->due_s - now)) + 500);
        return false;
    }
    /* On the grid, but at most one frame behind it: delays are not made up for. */
    f->due_s = f->due_s + 1.0 / f->desc.rate > now ? f->due_s + 1.0 / f->desc.rate : now + 1.0 / f->desc.rate;
    return true;
}

static void hint(struct feeder *f)
{
    const int64_t now = clock_ms();

    if (f->waiting_ms == 0)
        f->waiting_ms = now;
    if (!f->desc.lockstep || f->hinted || now - f->waiting_ms < PATIENCE_MS)
        return;
    f->hinted = true;
    log_info("waiting until the last image is stored; is 'relight-record --recorder %s' running?", f->desc.sequence);
}

/* Every frame has its fate. In lockstep the last image has been stored too, since its credit was returned. */
static bool is_all_settled(struct feeder *f)
{
    return reader_is_done(f->reader) && f->flight_count == 0 && !f->transmitting &&
           (!f->desc.lockstep || f->credit > 0);
}

static void say_end(struct feeder *f)
{
    if (!f->report.complete)
        connection_say(f->connection, json_pack("{s:s}", "op", "end"));
    f->report.complete = true;
    connection_finish(f->connection);
}

static void pump(struct feeder *f)
{
    if (!connection_is_open(f->connection) || f->transmitting || f->interrupted || f->report.complete)
        return;
    struct parcel *p = reader_take(f->reader);
    while (p && is_hopeless(f, p))
        p = reader_take(f->reader);
    if (is_all_settled(f)) {
        say_end(f);
        return;
    }
    if (f->credit == 0 && (p || reader_is_done(f->reader)))
        hint(f);
    if (!p || f->credit == 0 || f->flight_count == FLIGHTS || (f->desc.lockstep && f->flight_count > 0))
        return;
    if (is_due(f))
        send_parcel(f, p);
}

/* In lockstep the parcel is kept until its fate is known, because it may have to be sent again. */
static void on_sent(void *user)
{
    struct feeder *f = user;
    const struct parcel *p = reader_take(f->reader);

    f->transmitting = false;
    f->report.sent++;
    f->report.bytes += sizeof(p->head) + p->header.payload;
    if (!f->desc.lockstep)
        reader_drop(f->reader);
    pump(f);
}

static void tell_refused(const char *name, uint64_t number, const json_t *m)
{
    char code[40], message[240];

    message_plain(m, "code", code, sizeof(code));
    message_plain(m, "message", message, sizeof(message));
    log_error("%s%sframe %" PRIu64 " refused%s%s: %s", name, name[0] ? ": " : "", number, code[0] ? " as " : "", code,
              message);
}

/* In lockstep a fate goes to the current producer of the sequence: the frame may have been sent on an earlier
 * connection, or even by a feeder that was killed. */
static void on_owed_fate(struct feeder *f, uint64_t number, const json_t *m)
{
    if (strcmp(json_string_value(json_object_get(m, "fate")), "refused") == 0) {
        tell_refused("", number, m);
        f->report.refused++;
        f->report.used -= f->owed_counted;
    }
    f->has_owed = false;
}

static void on_fate(struct feeder *f, const json_t *m)
{
    const char *fate = json_string_value(json_object_get(m, "fate"));
    uint64_t number;
    size_t i = 0;

    if (!fate || !message_number(m, "number", &number))
        return;
    while (i < f->flight_count && f->flights[i].number != number)
        i++;
    if (i == f->flight_count && f->has_owed && f->owed == number)
        on_owed_fate(f, number, m);
    if (i == f->flight_count || (f->transmitting && i == f->flight_count - 1))
        return; /* not sent on this connection, or not yet completely */
    if (strcmp(fate, "refused") == 0) {
        tell_refused(f->flights[i].name, number, m);
        settle(f, &f->report.refused);
    } else {
        settle(f, strcmp(fate, "superseded") == 0 ? &f->report.superseded : &f->report.used);
        f->has_settled = true;
        f->settled = number;
    }
    memmove(f->flights + i, f->flights + i + 1, (f->flight_count - i - 1) * sizeof(f->flights[0]));
    f->flight_count--;
    if (f->desc.lockstep)
        reader_drop(f->reader);
}

static void on_text(void *user, const char *op, const json_t *m)
{
    struct feeder *f = user;
    uint64_t frames;

    if (strcmp(op, "credit") == 0 && message_number(m, "frames", &frames) && frames <= FLIGHTS)
        f->credit += frames;
    else if (strcmp(op, "frame") == 0)
        on_fate(f, m);
    pump(f);
}

/* ---- Connections ---- */

static void begin_reading(struct feeder *f, bool has_after, uint64_t after)
{
    struct reason why;

    if (reader_begin(f->reader, has_after, after, &why))
        connection_fail(f->connection, CONNECTION_LOST, "%s", why.text);
    f->begun = true;
}

/* The server names the last frame it has. If that includes the held frame, it is dropped. If frames that were already
 * released are missing, this is a different server, and the source restarts after that number. */
static void resume_lockstep(struct feeder *f, bool has_after, uint64_t after)
{
    const struct parcel *held = f->begun ? reader_take(f->reader) : NULL;

    f->owed_counted = false;
    if (!f->begun) {
        f->report.resumed = has_after;
        f->report.resume_after = after;
        if (has_after)
            log_info("sequence %s continues after frame %" PRIu64, f->desc.sequence, after);
        begin_reading(f, has_after, after);
    } else if (f->has_settled && (!has_after || after < f->settled)) {
        log_warning("the server has lost frames up to %" PRIu64 "%s", f->settled,
                    f->desc.watched ? "; a watched folder cannot be replayed: images may be missing"
                                    : ", they are sent again");
        f->report.images_lost |= f->desc.watched;
        if (!f->desc.watched) {
            f->report.has_last = false;
            begin_reading(f, has_after, after);
        }
    } else if (f->report.has_last && held && held->frame.number == f->report.last && has_after &&
               after >= f->report.last) {
        settle(f, &f->report.used); /* its fate was lost with the connection, or is still to come */
        reader_drop(f->reader);
        f->owed_counted = true;
    }
    f->has_owed = has_after;
    f->owed = after;
    f->has_settled = has_after;
    f->settled = after;
}

static void on_welcome(void *user, const json_t *welcome)
{
    struct feeder *f = user;
    const json_t *producer = json_object_get(welcome, "producer");
    uint64_t after = 0;

    if (!json_is_object(producer) || !message_number(producer, "credit", &f->credit)) {
        connection_fail(f->connection, CONNECTION_REFUSED,
                        "%s does not accept frames; start relightd with --source push:", f->desc.connection.url);
        return;
    }
    const bool has_after = message_number(producer, "resume_after", &after);
    f->most = 0;
    (void)message_number(producer, "frame_bytes", &f->most);
    if (f->desc.lockstep)
        resume_lockstep(f, has_after, after);
    else if (!f->begun)
        begin_reading(f, false, 0);
    f->report.complete = false;
    pump(f);
}

/* Frames not sent completely are sent again. Live frames that were sent but not answered count as lost. */
static void on_lost(void *user)
{
    struct feeder *f = user;
    const size_t whole = f->flight_count - f->transmitting;

    if (!f->desc.lockstep)
        for (size_t i = 0; i < whole; i++)
            settle(f, &f->report.lost);
    f->flight_count = 0;
    f->transmitting = false;
    f->credit = 0;
    f->waiting_ms = 0;
}

/* On the first signal, sends no new frames and waits for outstanding fates. A sequence gets no `end`, so that it can be
 * continued. */
static void on_tick(void *user)
{
    struct feeder *f = user;

    f->interrupted |= client_is_stopping(f->connection);
    if (f->interrupted && f->flight_count == 0 && f->desc.lockstep)
        connection_finish(f->connection);
    else if (f->interrupted && f->flight_count == 0)
        say_end(f);
    pump(f);
}

static void wake(void *user)
{
    const struct feeder *f = user;
    connection_wake(f->connection);
}

/* ---- Creation and running ---- */

enum err feeder_create(const struct feeder_desc *d, struct feeder **out, struct reason *why)
{
    struct feeder *f = mem_alloc(1, sizeof(*f));

    *out = NULL;
    if (!f)
        return err_say(why, ERR_NOMEM, "out of memory for a producer");
    f->desc = *d;
    f->desc.connection.user = f->desc.reader.user = f;
    f->desc.connection.role = "producer";
    f->desc.connection.pace = d->lockstep ? "lockstep" : "live";
    f->desc.connection.sequence = d->lockstep ? d->sequence : NULL;
    f->desc.reader.wake = wake;
    f->desc.connection.hooks = (struct connection_hooks){
        .welcome = on_welcome, .text = on_text, .sent = on_sent, .lost = on_lost, .tick = on_tick
    };
    enum err e = connection_create(&f->desc.connection, &f->connection, why);
    if (!e)
        e = reader_create(&f->desc.reader, &f->reader, why);
    if (e)
        feeder_destroy(f);
    else
        *out = f;
    return e;
}

void feeder_destroy(struct feeder *f)
{
    if (!f)
        return;
    reader_destroy(f->reader); /* first, because its thread wakes the connection */
    connection_destroy(f->connection);
    mem_free(f);
}

enum connection_end feeder_run(struct feeder *f, struct reason *why)
{
    f->due_s = clock_seconds();
    progress_begin(&f->line, "frames", reader_total(f->reader), f->desc.connection.quiet ? NULL : stderr);
    const enum connection_end end = connection_run(f->connection, why);
    progress_end(&f->line);
    return end;
}

void feeder_report(struct feeder *f, struct feeder_report *out)
{
    struct reader_counts counts;

    reader_counts(f->reader, &counts);
    *out = f->report;
    out->refused += counts.faulty;
    out->passed = counts.passed;
    out->connection = f->connection;
}
