/* clients/feed/relight_feed.c */
/* Plays a source of frames to a relightd that takes them (relightd --source push:). The connection runs on the main
 * thread, the source is read ahead by reader.h on another; everything here is called by the connection. */
#include "clock.h"
#include "connection.h"
#include "log.h"
#include "message.h"
#include "options.h"
#include "progress.h"
#include "reader.h"

#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FLIGHTS 64 /* frames sent whole and without a fate; a server that grants more credit is not believed */
#define EXIT_REFUSED 3
#define PATIENCE_MS 5000 /* until a hint about what is missing */
#define GOODBYE_MS 2000  /* for the fates of frames under way after an interrupt */

struct flight {
    uint64_t number;
    char name[256];
};

struct feed {
    bool lockstep, json, watched;
    double rate; /* 0: as fast as credit allows */
    const char *sequence, *token;
    struct reader_desc reader_desc;
    struct connection_desc connection_desc;

    struct reader *reader;
    struct connection *connection;
    struct progress line;
    bool begun;                     /* the reader runs */
    uint64_t credit, most;          /* frames that may be sent now; bytes of one message */
    struct flight flights[FLIGHTS]; /* in the order sent, of this connection */
    size_t flight_count;
    bool transmitting; /* the reader's oldest parcel is being sent */
    bool sent_once;    /* last_sent is valid */
    uint64_t last_sent;
    bool has_settled; /* lockstep: the server has the frames up to `settled`, as far as we know */
    uint64_t settled;
    double due_s;       /* of the next frame, with a rate */
    int64_t waiting_ms; /* when we began to have a frame and no credit; 0: no */
    bool hinted;
    int64_t interrupted_ms; /* 0: no */
    bool complete;          /* end was said */

    bool has_owed, owed_counted; /* lockstep: the fate of a frame that an earlier connection sent may still come */
    uint64_t owed;               /* its number; counted: as used */

    bool resumed;
    uint64_t resume_after; /* of the first welcome */
    uint64_t sent, used, superseded, refused, lost, bytes;
    double start_s;
};

/* Set by the signal handler, which can reach nothing else: how often it was asked to stop. */
static volatile sig_atomic_t stops_asked;

static void ask_to_stop(int signal_number)
{
    (void)signal_number;
    stops_asked++;
}

/* ---- Frames out, fates in ---- */

static void settle(struct feed *f, uint64_t *count)
{
    (*count)++;
    progress_step(&f->line, 1);
    connection_thrive(f->connection);
}

static void refuse_here(struct feed *f, const struct parcel *p, const char *text)
{
    log_error("%s: frame %" PRIu64 " %s", p->frame.name, p->frame.number, text);
    settle(f, &f->refused);
    reader_drop(f->reader);
}

/* What need not be tried. True: the parcel was dropped. */
static bool is_hopeless(struct feed *f, const struct parcel *p)
{
    char text[160];

    if (f->most > 0 && (uint64_t)p->header.payload + sizeof(p->head) > f->most) {
        snprintf(text, sizeof(text), "has %" PRIu32 " bytes, the server takes %" PRIu64, p->header.payload, f->most);
        refuse_here(f, p, text);
        return true;
    }
    if (f->lockstep && f->sent_once && p->frame.number < f->last_sent) {
        snprintf(text, sizeof(text), "comes after %" PRIu64 "; in lockstep numbers must rise", f->last_sent);
        refuse_here(f, p, text);
        return true;
    }
    return false;
}

static void send_parcel(struct feed *f, struct parcel *p)
{
    struct flight *flight = &f->flights[f->flight_count++];

    flight->number = p->frame.number;
    snprintf(flight->name, sizeof(flight->name), "%s", p->frame.name);
    f->credit--;
    f->transmitting = true;
    f->waiting_ms = 0;
    f->last_sent = p->frame.number;
    f->sent_once = true;
    connection_send(f->connection, p->head, sizeof(p->head), p->payload, p->header.payload);
}

/* With a rate: whether the next frame is due; else comes back when it is. */
static bool is_due(struct feed *f)
{
    const double now = clock_seconds();

    if (f->rate <= 0.0)
        return true;
    if (now < f->due_s) {
        connection_tick_within(f->connection, (int64_t)(1e6 * (f->due_s - now)) + 500);
        return false;
    }
    /* On the grid, but never behind it by more than a frame: what was late is not made up for. */
    f->due_s = f->due_s + 1.0 / f->rate > now ? f->due_s + 1.0 / f->rate : now + 1.0 / f->rate;
    return true;
}

static void hint(struct feed *f)
{
    const int64_t now = clock_ms();

    if (f->waiting_ms == 0)
        f->waiting_ms = now;
    if (!f->lockstep || f->hinted || now - f->waiting_ms < PATIENCE_MS)
        return;
    f->hinted = true;
    log_info("waiting until the last picture is stored; is 'relight-record --recorder %s' running?", f->sequence);
}

/* All was sent and has its fate; in lockstep its picture has been stored too, since the credit has come back. */
static bool is_all_settled(struct feed *f)
{
    return reader_is_done(f->reader) && f->flight_count == 0 && !f->transmitting && (!f->lockstep || f->credit > 0);
}

static void say_end(struct feed *f)
{
    if (!f->complete)
        connection_say(f->connection, json_pack("{s:s}", "op", "end"));
    f->complete = true;
    connection_finish(f->connection);
}

static void pump(struct feed *f)
{
    if (!connection_is_open(f->connection) || f->transmitting || f->interrupted_ms || f->complete)
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
    if (!p || f->credit == 0 || f->flight_count == FLIGHTS || (f->lockstep && f->flight_count > 0))
        return;
    if (is_due(f))
        send_parcel(f, p);
}

/* In lockstep the parcel is kept until its fate is known: it may have to be sent again. */
static void on_sent(void *user)
{
    struct feed *f = user;
    const struct parcel *p = reader_take(f->reader);

    f->transmitting = false;
    f->sent++;
    f->bytes += sizeof(p->head) + p->header.payload;
    if (!f->lockstep)
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

/* In lockstep a fate goes to whoever produces the sequence by then: this frame was sent by an earlier connection, or
 * even by a feeder that was killed. */
static void on_owed_fate(struct feed *f, uint64_t number, const json_t *m)
{
    if (strcmp(json_string_value(json_object_get(m, "fate")), "refused") == 0) {
        tell_refused("", number, m);
        f->refused++;
        f->used -= f->owed_counted;
    }
    f->has_owed = false;
}

static void on_fate(struct feed *f, const json_t *m)
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
        return; /* not one of ours, or not yet sent whole */
    if (strcmp(fate, "refused") == 0) {
        tell_refused(f->flights[i].name, number, m);
        settle(f, &f->refused);
    } else {
        settle(f, strcmp(fate, "superseded") == 0 ? &f->superseded : &f->used);
        f->has_settled = true;
        f->settled = number;
    }
    memmove(f->flights + i, f->flights + i + 1, (f->flight_count - i - 1) * sizeof(f->flights[0]));
    f->flight_count--;
    if (f->lockstep)
        reader_drop(f->reader);
}

static void on_text(void *user, const char *op, const json_t *m)
{
    struct feed *f = user;
    uint64_t frames;

    if (strcmp(op, "credit") == 0 && message_number(m, "frames", &frames) && frames <= FLIGHTS)
        f->credit += frames;
    else if (strcmp(op, "frame") == 0)
        on_fate(f, m);
    pump(f);
}

/* ---- Connections ---- */

static json_t *say_hello(void *user)
{
    const struct feed *f = user;
    json_t *hello = json_pack("{s:s, s:s, s:{s:i, s:i}, s:s}", "op", "hello", "role", "producer", "version", "major",
                              PROTOCOL_MAJOR, "minor", PROTOCOL_MINOR, "pace", f->lockstep ? "lockstep" : "live");

    if (f->lockstep)
        json_object_set_new(hello, "sequence", json_string(f->sequence));
    if (f->token)
        json_object_set_new(hello, "token", json_string(f->token));
    return hello;
}

static void begin_reading(struct feed *f, bool has_after, uint64_t after)
{
    struct reason why;

    if (reader_begin(f->reader, has_after, after, &why))
        connection_fail(f->connection, CONNECTION_LOST, "%s", why.text);
    f->begun = true;
}

/* The server names the last frame that it has. Ours is dropped when that is among them; when frames that we let go are
 * not, it is another server than before, and the source begins again behind that number. */
static void resume_lockstep(struct feed *f, bool has_after, uint64_t after)
{
    const struct parcel *held = f->begun ? reader_take(f->reader) : NULL;

    f->owed_counted = false;
    if (!f->begun) {
        f->resumed = has_after;
        f->resume_after = after;
        if (has_after)
            log_info("sequence %s goes on after frame %" PRIu64, f->sequence, after);
        begin_reading(f, has_after, after);
    } else if (f->has_settled && (!has_after || after < f->settled)) {
        log_warning("the server has forgotten frames up to %" PRIu64 "%s", f->settled,
                    f->watched ? "; a watched folder goes on from here" : ", they are sent again");
        if (!f->watched) {
            f->sent_once = false;
            begin_reading(f, has_after, after);
        }
    } else if (f->sent_once && held && held->frame.number == f->last_sent && has_after && after >= f->last_sent) {
        settle(f, &f->used); /* its fate was lost with the connection, or will come yet */
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
    struct feed *f = user;
    const json_t *producer = json_object_get(welcome, "producer");
    uint64_t after = 0;

    if (!json_is_object(producer) || !message_number(producer, "credit", &f->credit)) {
        connection_fail(f->connection, CONNECTION_REFUSED, "%s takes no frames (relightd --source push: does)",
                        f->connection_desc.url);
        return;
    }
    const bool has_after = message_number(producer, "resume_after", &after);
    f->most = 0;
    (void)message_number(producer, "frame_bytes", &f->most);
    if (f->lockstep)
        resume_lockstep(f, has_after, after);
    else if (!f->begun)
        begin_reading(f, false, 0);
    f->complete = false;
    pump(f);
}

/* What was not sent whole is sent again; live, what was and has no fate will not get one. */
static void on_lost(void *user)
{
    struct feed *f = user;
    const size_t whole = f->flight_count - f->transmitting;

    if (!f->lockstep)
        for (size_t i = 0; i < whole; i++)
            settle(f, &f->lost);
    f->flight_count = 0;
    f->transmitting = false;
    f->credit = 0;
    f->waiting_ms = 0;
}

/* The first signal: no new frames, but the fates of those under way; the second: now. */
static void stop_when_asked(struct feed *f)
{
    const int64_t now = clock_ms();

    if (!stops_asked)
        return;
    if (!f->interrupted_ms)
        f->interrupted_ms = now;
    if (stops_asked > 1 || now - f->interrupted_ms > GOODBYE_MS || !connection_is_open(f->connection))
        connection_stop(f->connection);
    else if (f->flight_count == 0 && f->lockstep) /* to be gone on with: no end */
        connection_finish(f->connection);
    else if (f->flight_count == 0)
        say_end(f);
}

static void on_tick(void *user)
{
    struct feed *f = user;

    stop_when_asked(f);
    pump(f);
}

static void wake(void *user)
{
    const struct feed *f = user;
    connection_wake(f->connection);
}

/* ---- The program ---- */

static struct option_row rows[] = {
    { "", NULL, "where to", NULL },
    { "to", "URL", "ws://HOST:PORT of a relightd that was started with --source push:", "ws://127.0.0.1:8080" },
    { "token", "T", "what the server asks producers for; left out: the variable RELIGHT_TOKEN", NULL },
    { "", NULL, "what", NULL },
    { "frames", "A-B", "only the frames with these numbers (one number: that frame)", NULL },
    { "loop", NULL, "begin again after the last frame", NULL },
    { "layout", "L", "of the environment: auto, latlong, latlong-bottom, cube, hcross, vcross, ball or fisheye",
      "auto" },
    { "raw", "half|float", "decode files here and send texels; a computed sky is always sent so", NULL },
    { "", NULL, "how", NULL },
    { "rate", "N", "frames per second; 0: as fast as the server gives credit", "0" },
    { "lockstep", NULL, "every frame gives exactly one picture, which relight-record --recorder stores", NULL },
    { "sequence", "NAME", "of frames and pictures in lockstep; the server knows it by this name", "default" },
    { "retry", "N", "try so many times in a row to come back after a loss; left out: for ever", NULL },
    { "give-up-after", "SECONDS", "give up after so long without a connection; 0: never", "0" },
    { "", NULL, "what is said", NULL },
    { "json", NULL, "a summary as one JSON object on standard output", NULL },
    { "quiet", NULL, "no progress, and no lines but errors", NULL },
    { NULL, NULL, NULL, NULL },
};

static enum err read_source_options(const struct options *o, struct feed *f, struct reason *why)
{
    struct reader_desc *d = &f->reader_desc;
    const char *raw = options_get(o, "raw");

    if (o->operand_count != 1)
        return err_say(why, ERR_USAGE, "SOURCE is missing: what to play (see relight-feed --help)");
    d->source.spec = o->operands[0];
    d->source.loop = options_on(o, "loop");
    f->watched = strncmp(d->source.spec, "watch:", 6) == 0;
    if (raw && strcmp(raw, "half") != 0 && strcmp(raw, "float") != 0)
        return err_say(why, ERR_USAGE, "--raw '%s' is neither half nor float", raw);
    d->parcel.raw = raw != NULL;
    d->parcel.half = raw && strcmp(raw, "half") == 0;
    const enum err e = options_range(o, "frames", &d->source.has_range, &d->source.first, &d->source.last, why);
    return e ? e : parcel_layout_parse(options_get(o, "layout"), &d->parcel, why);
}

static enum err read_options(const struct options *o, struct feed *f, struct reason *why)
{
    uint64_t tries = 0;
    enum err e = read_source_options(o, f, why);

    f->lockstep = options_on(o, "lockstep");
    f->json = options_on(o, "json");
    f->sequence = options_get(o, "sequence");
    f->token = options_get(o, "token") ? options_get(o, "token") : getenv("RELIGHT_TOKEN");
    f->connection_desc.url = options_get(o, "to");
    f->connection_desc.quiet = options_on(o, "quiet");
    f->connection_desc.tries = -1;
    if (!e)
        e = options_double(o, "rate", 0.0, 1000.0, &f->rate, why);
    if (!e)
        e = options_double(o, "give-up-after", 0.0, 1e6, &f->connection_desc.give_up_s, why);
    if (!e && options_get(o, "retry")) {
        e = options_u64(o, "retry", 0, 1000000, &tries, why);
        f->connection_desc.tries = (int64_t)tries;
    }
    if (!e && f->lockstep && f->reader_desc.source.loop)
        e = err_say(why, ERR_USAGE, "--loop and --lockstep exclude each other: numbers must rise");
    if (!e && f->lockstep && f->rate > 0.0)
        e = err_say(why, ERR_USAGE, "--rate and --lockstep exclude each other: the recorder sets the pace");
    if (!e && !message_is_sequence_name(f->sequence))
        e = err_say(why, ERR_USAGE, "--sequence '%s' is not 1 to 64 letters, digits, '.', '_' or '-'", f->sequence);
    if (!e && f->token && strlen(f->token) > 255)
        e = err_say(why, ERR_USAGE, "--token: longer than 255 bytes");
    return e;
}

static const char *end_name(enum connection_end end)
{
    if (end == CONNECTION_DONE)
        return stops_asked ? "interrupted" : "done";
    return end == CONNECTION_LOST ? "lost" : "refused";
}

static void print_summary(struct feed *f, enum connection_end end, const char *message)
{
    struct reader_counts counts = { 0 };
    int64_t ahead_us = 0, uncertain_us = 0;
    const bool clock = connection_clock(f->connection, &ahead_us, &uncertain_us);

    reader_counts(f->reader, &counts);
    json_t *j =
        json_pack("{s:s, s:s, s:I, s:I, s:I, s:I, s:I, s:I, s:o, s:o, s:I, s:i, s:f, s:o}", "end", end_name(end),
                  "message", message, "sent", (json_int_t)f->sent, "used", (json_int_t)f->used, "superseded",
                  (json_int_t)f->superseded, "refused", (json_int_t)(f->refused + counts.faulty), "lost",
                  (json_int_t)f->lost, "passed", (json_int_t)counts.passed, "resumed_after",
                  f->resumed ? json_integer((json_int_t)f->resume_after) : json_null(), "last_frame",
                  f->sent_once ? json_integer((json_int_t)f->last_sent) : json_null(), "bytes", (json_int_t)f->bytes,
                  "connections", (int)connection_count(f->connection), "seconds", clock_seconds() - f->start_s, "clock",
                  clock ? json_pack("{s:I, s:I}", "server_ahead_us", (json_int_t)ahead_us, "uncertain_us",
                                    (json_int_t)uncertain_us)
                        : json_null());
    if (!j)
        return;
    json_dumpf(j, stdout, JSON_REAL_PRECISION(6));
    fputs("\n", stdout);
    json_decref(j);
}

static int conclude(struct feed *f, enum connection_end end, const struct reason *why)
{
    struct reader_counts counts;

    reader_counts(f->reader, &counts);
    if (end != CONNECTION_DONE)
        log_error("%s", why->text);
    if (f->json)
        print_summary(f, end, end == CONNECTION_DONE ? "" : why->text);
    else
        log_info("%" PRIu64 " frames used, %" PRIu64 " superseded, %" PRIu64 " refused, %" PRIu64 " lost", f->used,
                 f->superseded, f->refused + counts.faulty, f->lost);
    if (end == CONNECTION_DONE && f->lockstep && f->complete && f->resumed && f->sent == 0)
        log_warning("nothing was sent: sequence %s had all frames up to %" PRIu64
                    " before; another --sequence begins anew",
                    f->sequence, f->resume_after);
    if (end == CONNECTION_REFUSED)
        return EXIT_REFUSED;
    const bool whole = !f->lockstep || f->complete;
    return end == CONNECTION_DONE && whole && f->refused + counts.faulty + f->lost == 0 ? 0 : 1;
}

static int run(struct feed *f, struct reason *why)
{
    f->start_s = f->due_s = clock_seconds();
    progress_begin(&f->line, "frames", reader_total(f->reader), f->connection_desc.quiet ? NULL : stderr);
    const enum connection_end end = connection_run(f->connection, why);
    progress_end(&f->line);
    return conclude(f, end, why);
}

int main(int argc, char **argv)
{
    struct options options = {
        .program = "relight-feed",
        .synopsis = "[--to ws://HOST:PORT] [--rate N | --lockstep] [flags] SOURCE",
        .about =
            "Plays environment frames to a relightd: a file, a directory, a printf or glob pattern, watch:DIR, or\n"
            "sky:key=value,... When the connection breaks it comes back and goes on; Ctrl-C ends it cleanly.\n"
            "Exit code: 0 all frames were used or superseded by newer ones, 1 some were refused, lost or not sent,\n"
            "2 wrong usage, 3 the server refused us (role, token, version, or its place is taken).",
        .rows = rows,
        .operand_max = 1,
    };
    static struct feed f; /* zeroed, and too large for a stack */
    struct reason why = { "" };
    bool done;

    log_init("relight-feed", LOG_INFO);
    enum err e = options_parse(&options, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = read_options(&options, &f, &why);
    if (!e && f.connection_desc.quiet)
        log_init("relight-feed", LOG_ERROR);
    sigaction(SIGINT, &(struct sigaction){ .sa_handler = ask_to_stop }, NULL);
    sigaction(SIGTERM, &(struct sigaction){ .sa_handler = ask_to_stop }, NULL);
    sigaction(SIGPIPE, &(struct sigaction){ .sa_handler = SIG_IGN }, NULL);
    f.connection_desc.user = f.reader_desc.user = &f;
    f.connection_desc.hooks = (struct connection_hooks){
        .hello = say_hello, .welcome = on_welcome, .text = on_text, .sent = on_sent, .lost = on_lost, .tick = on_tick
    };
    f.reader_desc.wake = wake;
    if (!e)
        e = connection_create(&f.connection_desc, &f.connection, &why);
    if (!e)
        e = reader_create(&f.reader_desc, &f.reader, &why);
    int code = err_exit_code(e);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    else
        code = run(&f, &why);
    reader_destroy(f.reader); /* its thread wakes the connection */
    connection_destroy(f.connection);
    return code;
}
