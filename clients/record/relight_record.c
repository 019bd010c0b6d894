/* clients/record/relight_record.c */
/* Stores the pictures of a relightd as files: live, as many as arrive, or as the recorder of a lockstep sequence,
 * exactly one per environment frame. A picture is acknowledged once it is safely on disk. Everything runs on one
 * thread: while a picture is being stored, the server holds back the one after the next. */
#include "base/clock.h"
#include "clients/common/connection.h"
#include "base/file_pattern.h"
#include "base/file_store.h"
#include "clients/record/journal.h"
#include "base/log.h"
#include "clients/common/message.h"
#include "base/options.h"
#include "base/progress.h"
#include "protocol/relight_protocol.h"

#include <errno.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define EXIT_REFUSED 3
#define PICTURE_MAX ((size_t)1 << 30) /* bytes; memory is allocated as they arrive */
#define GOODBYE_MS 2000
#define UNREADABLE_MOST 10 /* pictures in a row */

struct span { /* microseconds */
    uint64_t count;
    double sum, least, most;
};

struct record {
    struct file_pattern out;
    enum protocol_format format;
    int quality;     /* 0: the server's default */
    double max_rate; /* 0: no limit */
    uint64_t wanted; /* pictures; 0: until stopped */
    const char *recorder, *token;
    bool json;
    struct journal journal;
    struct connection_desc connection_desc;

    struct connection *connection;
    struct progress line;
    char session[64];
    uint64_t newest; /* sequence number of the last picture in this session */
    bool has_stored; /* first and last are valid */
    uint64_t first, last;
    uint64_t stored, again, bytes;
    struct span latency;
    int64_t uncertain_us;
    uint64_t unreadable;     /* pictures that were skipped, */
    unsigned unreadable_row; /* of these the last ones in a row */
    bool ended;              /* the sequence has ended, or all requested pictures are stored */
    bool failed;             /* a picture could not be stored */
    bool missed;             /* another recorder stored pictures of the sequence */
    int64_t stopped_ms;      /* time of an interrupt; 0: none */
    double start_s;
};

/* Number of stop requests, incremented by the signal handler. */
static volatile sig_atomic_t stops_asked;

static void ask_to_stop(int signal_number)
{
    (void)signal_number;
    stops_asked++;
}

/* ---- Pictures ---- */

static const char *const format_names[] = {
    [PROTOCOL_JPEG] = "jpeg", [PROTOCOL_EXR_HALF] = "exr_half", [PROTOCOL_EXR_FLOAT] = "exr_float"
};

/* Latency from capture to disk, on the server's clock; false if either time is unknown. */
static bool measure(struct record *r, const struct protocol_picture *h, int64_t *latency_us)
{
    int64_t ahead_us;

    if (h->capture_us == 0 || !connection_clock(r->connection, &ahead_us, &r->uncertain_us))
        return false;
    *latency_us = clock_wall_us() + ahead_us - h->capture_us;
    return true;
}

static void span_add(struct span *s, double us)
{
    s->least = s->count == 0 || us < s->least ? us : s->least;
    s->most = s->count == 0 || us > s->most ? us : s->most;
    s->sum += us;
    s->count++;
}

static enum err list(struct record *r, const struct protocol_picture *h, const char *name, struct reason *why)
{
    static const char *const key[] = { "session", "sequence", "frame", NULL };
    int64_t latency_us = 0;
    const bool known = measure(r, h, &latency_us);

    if (known && !(h->flags & (PROTOCOL_PICTURE_REPEAT | PROTOCOL_PICTURE_FINER)))
        span_add(&r->latency, (double)latency_us);
    if (r->journal.fd < 0)
        return ERR_OK;
    return journal_add(&r->journal,
                       json_pack("{s:I, s:s, s:s, s:I, s:I, s:I, s:I, s:I, s:o, s:o}", "frame", (json_int_t)h->frame,
                                 "file", name, "session", r->session, "sequence", (json_int_t)h->sequence, "bytes",
                                 (json_int_t)h->payload, "capture_us", (json_int_t)h->capture_us, "published_us",
                                 (json_int_t)h->published_us, "stored_us", (json_int_t)clock_wall_us(), "latency_us",
                                 known ? json_integer((json_int_t)latency_us) : json_null(), "uncertain_us",
                                 known ? json_integer((json_int_t)r->uncertain_us) : json_null()),
                       key, why);
}

static enum err store(struct record *r, const struct protocol_picture *h, const uint8_t *payload, struct reason *why)
{
    char name[4096];
    enum err e = file_pattern_name(&r->out, h->frame, name, sizeof(name), why);

    if (!e)
        e = file_store(name, payload, h->payload, why);
    if (!e)
        e = list(r, h, name, why);
    if (e)
        return e;
    r->first = r->has_stored ? r->first : h->frame;
    r->last = h->frame;
    r->has_stored = true;
    r->stored++;
    r->bytes += h->payload;
    progress_step(&r->line, 1);
    connection_thrive(r->connection);
    return ERR_OK;
}

/* Whether the file is already stored: a picture resent because its acknowledgement was lost, or the last one, which a
 * viewer receives again on every connection. */
static bool is_stored(const struct record *r, const struct protocol_picture *h)
{
    if (r->recorder)
        return r->has_stored && h->frame <= r->last;
    return h->sequence <= r->newest;
}

static void acknowledge(struct record *r, const struct protocol_picture *h)
{
    json_t *ack = json_pack("{s:s, s:I}", "op", "ack", "sequence", (json_int_t)h->sequence);

    if (r->recorder)
        json_object_set_new(ack, "stored", json_true());
    connection_say(r->connection, ack);
}

/* What is wrong with a message that should be a picture; NULL: nothing. */
static const char *examine(const struct record *r, const uint8_t *bytes, size_t size, struct protocol_picture *h,
                           size_t *offset)
{
    const enum protocol_result result = protocol_picture_decode(bytes, size, h, offset);

    if (result)
        return protocol_result_text(result);
    if (h->format != r->format)
        return "it does not have the requested format";
    if (r->recorder && !(h->flags & PROTOCOL_PICTURE_LOCKSTEP))
        return "it does not belong to a sequence";
    return NULL;
}

/* A picture that cannot be stored is skipped, but not many in a row, and none of a sequence, which must be complete. */
static void skip(struct record *r, const uint8_t *bytes, size_t size, const char *fault)
{
    const uint64_t sequence = protocol_picture_sequence(bytes, size);

    if (r->recorder || ++r->unreadable_row > UNREADABLE_MOST) {
        connection_fail(r->connection, CONNECTION_LOST, "%s sent a picture that cannot be stored: %s",
                        r->connection_desc.url, fault);
        return;
    }
    log_warning("%s sent a picture that cannot be stored and is skipped: %s", r->connection_desc.url, fault);
    r->unreadable++;
    if (sequence > 0)
        acknowledge(r, &(struct protocol_picture){ .sequence = sequence });
}

static void on_binary(void *user, const uint8_t *bytes, size_t size)
{
    struct record *r = user;
    struct protocol_picture h;
    struct reason why = { "" };
    size_t offset;

    if (r->ended || stops_asked)
        return;
    const char *fault = examine(r, bytes, size, &h, &offset);
    if (fault) {
        skip(r, bytes, size, fault);
        return;
    }
    r->unreadable_row = 0;
    const bool again = is_stored(r, &h);
    if (!again && store(r, &h, bytes + offset, &why)) {
        r->failed = true;
        connection_fail(r->connection, CONNECTION_LOST, "%s", why.text);
        return;
    }
    r->again += again;
    r->newest = h.sequence > r->newest ? h.sequence : r->newest;
    acknowledge(r, &h);
    if (r->wanted > 0 && r->stored == r->wanted) {
        r->ended = true;
        connection_finish(r->connection);
    }
}

/* ---- Connections ---- */

static json_t *say_hello(void *user)
{
    const struct record *r = user;
    json_t *hello = json_pack("{s:s, s:s, s:{s:i, s:i}}", "op", "hello", "role", r->recorder ? "recorder" : "viewer",
                              "version", "major", PROTOCOL_MAJOR, "minor", PROTOCOL_MINOR);

    if (r->recorder)
        json_object_set_new(hello, "recorder", json_string(r->recorder));
    if (r->token)
        json_object_set_new(hello, "token", json_string(r->token));
    return hello;
}

static bool is_offered(const json_t *welcome, const char *format)
{
    const json_t *formats = json_object_get(welcome, "formats");

    for (size_t i = 0; i < json_array_size(formats); i++) {
        const char *one = json_string_value(json_array_get(formats, i));
        if (one && strcmp(one, format) == 0)
            return true;
    }
    return false;
}

/* While we were away another recorder may have stored pictures, which are then missing here. */
static void notice_others(struct record *r, const json_t *welcome)
{
    uint64_t after;

    if (!r->recorder || !r->has_stored ||
        !message_number(json_object_get(welcome, "recorder"), "stored_after", &after) || after <= r->last)
        return;
    log_error("another recorder has stored pictures up to frame %" PRIu64 "; here they end with frame %" PRIu64, after,
              r->last);
    r->missed = true;
}

static void on_welcome(void *user, const json_t *welcome)
{
    struct record *r = user;
    const char *format = format_names[r->format];
    char session[sizeof(r->session)];

    message_plain(welcome, "session", session, sizeof(session));
    if (strcmp(session, r->session) != 0) { /* another run of the server, whose numbering restarts */
        snprintf(r->session, sizeof(r->session), "%s", session);
        r->newest = 0;
        r->has_stored = r->recorder ? false : r->has_stored;
    }
    notice_others(r, welcome);
    if (r->ended) { /* only acknowledgements were outstanding */
        connection_finish(r->connection);
        return;
    }
    if (!is_offered(welcome, format) || (r->recorder && !json_is_object(json_object_get(welcome, "recorder")))) {
        connection_fail(r->connection, CONNECTION_REFUSED, "%s does not offer %s", r->connection_desc.url,
                        is_offered(welcome, format) ? "lockstep (start relightd with --source push:)" : format);
        return;
    }
    json_t *subscribe = json_pack("{s:s, s:s}", "op", "subscribe", "format", format);
    if (r->quality)
        json_object_set_new(subscribe, "quality", json_integer(r->quality));
    if (r->max_rate > 0.0)
        json_object_set_new(subscribe, "max_rate", json_real(r->max_rate));
    connection_say(r->connection, subscribe);
}

static void on_text(void *user, const char *op, const json_t *m)
{
    struct record *r = user;
    const char *name = json_string_value(json_object_get(m, "name"));
    const char *state = json_string_value(json_object_get(m, "state"));
    const char *code = json_string_value(json_object_get(m, "code"));
    char message[200];

    if (strcmp(op, "error") == 0 && code && strcmp(code, "not_offered") == 0) /* the server would never send anything */
        connection_fail(r->connection, CONNECTION_REFUSED, "%s: %s", r->connection_desc.url,
                        message_plain(m, "message", message, sizeof(message)));
    if (strcmp(op, "sequence") != 0 || !r->recorder || !name || strcmp(name, r->recorder) != 0)
        return;
    if (state && strcmp(state, "ended") == 0 && !r->ended) {
        r->ended = true;
        connection_finish(r->connection);
    }
}

static void on_tick(void *user)
{
    struct record *r = user;
    const int64_t now = clock_ms();

    if (!stops_asked)
        return;
    if (!r->stopped_ms)
        r->stopped_ms = now;
    if (stops_asked > 1 || now - r->stopped_ms > GOODBYE_MS || !connection_is_open(r->connection))
        connection_stop(r->connection);
    else
        connection_finish(r->connection);
}

/* ---- Command line ---- */

static struct option_row rows[] = {
    { "", NULL, "Source", NULL },
    { "from", "URL", "ws://HOST:PORT, or wss:// with TLS, of a relightd", "ws://127.0.0.1:8080" },
    { "ca", "FILE", "PEM file of the certificate authorities to trust; default: the system's (wss:// only)", NULL },
    { "token", "T", "access token (of role recorder with --lockstep); default: the variable RELIGHT_TOKEN", NULL },
    { "", NULL, "Output", NULL },
    { "out", "PATTERN", "file name with %d or %04d for the environment frame's number", NULL },
    { "format", "F", "jpeg, exr-half or exr-float; default: jpeg for .jpg, exr-float for .exr", NULL },
    { "quality", "Q", "JPEG quality, 1 to 100; default: the server's", NULL },
    { "index", "FILE", "append a JSON line per picture: frame, file, times, latency", NULL },
    { "", NULL, "Duration", NULL },
    { "frames", "N", "exit after N pictures", NULL },
    { "once", NULL, "store the newest picture and exit; PATTERN then needs no number", NULL },
    { "", NULL, "Behaviour", NULL },
    { "lockstep", NULL, "store one picture for each frame of relight-feed --lockstep, until it ends", NULL },
    { "recorder", "NAME", "the same for the sequence of this name; --lockstep alone means 'default'", NULL },
    { "max-rate", "N", "maximum pictures per second; 0: no limit", "0" },
    { "retry", "N", "consecutive attempts to reconnect; default: unlimited", NULL },
    { "give-up-after", "SECONDS", "give up after this long without a connection; 0: never", "0" },
    { "", NULL, "Messages", NULL },
    { "json", NULL, "print a summary as one JSON object on standard output", NULL },
    { "quiet", NULL, "print only errors, no progress", NULL },
    { NULL, NULL, NULL, NULL },
};

static bool ends_with(const char *text, const char *end)
{
    const size_t a = strlen(text), b = strlen(end);
    return a >= b && strcmp(text + a - b, end) == 0;
}

static enum err parse_format(struct record *r, const char *name, struct reason *why)
{
    const bool jpg = ends_with(r->out.text, ".jpg") || ends_with(r->out.text, ".jpeg"),
               exr = ends_with(r->out.text, ".exr");

    if (!name && !jpg && !exr)
        return err_say(why, ERR_USAGE, "--out '%s' ends neither in .jpg nor in .exr: --format is missing", r->out.text);
    if (!name)
        r->format = jpg ? PROTOCOL_JPEG : PROTOCOL_EXR_FLOAT;
    else if (strcmp(name, "jpeg") == 0)
        r->format = PROTOCOL_JPEG;
    else if (strcmp(name, "exr-half") == 0)
        r->format = PROTOCOL_EXR_HALF;
    else if (strcmp(name, "exr-float") == 0)
        r->format = PROTOCOL_EXR_FLOAT;
    else
        return err_say(why, ERR_USAGE, "unknown --format '%s'; expected jpeg, exr-half or exr-float", name);
    if ((jpg && r->format != PROTOCOL_JPEG) || (exr && r->format == PROTOCOL_JPEG))
        return err_say(why, ERR_USAGE, "--format %s does not match --out '%s'", name, r->out.text);
    return ERR_OK;
}

/* Checks the output folder now rather than when the first picture arrives, perhaps an hour later. */
static enum err check_folder(const struct file_pattern *p, struct reason *why)
{
    char folder[4096];
    const char *slash = strrchr(p->text, '/');

    if (slash && ((p->length && (size_t)(slash - p->text) > p->at) || (size_t)(slash - p->text) >= sizeof(folder)))
        return ERR_OK; /* one folder per frame: checked when needed */
    if (slash)
        snprintf(folder, sizeof(folder), "%.*s", slash == p->text ? 1 : (int)(slash - p->text), p->text);
    if (access(slash ? folder : ".", W_OK) == 0)
        return ERR_OK;
    return err_say(why, ERR_IO, "%s: cannot write to this folder: %s", slash ? folder : ".", strerror(errno));
}

static enum err read_output_options(const struct options *o, struct record *r, struct reason *why)
{
    uint64_t quality = 0;
    const char *out = options_get(o, "out");

    if (!out)
        return err_say(why, ERR_USAGE, "--out is missing: where the pictures go, as --out DIR/picture.%%04d.jpg");
    enum err e = file_pattern_parse(out, "--out", &r->out, why);
    if (!e)
        e = parse_format(r, options_get(o, "format"), why);
    if (!e && options_get(o, "quality"))
        e = options_u64(o, "quality", 1, 100, &quality, why);
    if (!e && quality && r->format != PROTOCOL_JPEG)
        e = err_say(why, ERR_USAGE, "--quality applies only to JPEG");
    r->quality = (int)quality;
    if (!e && options_get(o, "frames"))
        e = options_u64(o, "frames", 1, UINT64_MAX, &r->wanted, why);
    if (!e && options_on(o, "once"))
        r->wanted = 1;
    if (!e && !r->out.length && r->wanted != 1)
        e = err_say(why, ERR_USAGE, "--out '%s' names one file: include %%04d, or use --once for a single picture",
                    out);
    return e ? e : check_folder(&r->out, why);
}

static enum err read_options(const struct options *o, struct record *r, struct reason *why)
{
    uint64_t tries = 0;
    struct connection_desc *d = &r->connection_desc;
    enum err e = read_output_options(o, r, why);

    r->json = options_on(o, "json");
    r->recorder = options_get(o, "recorder")  ? options_get(o, "recorder")
                  : options_on(o, "lockstep") ? "default"
                                              : NULL;
    r->token = options_get(o, "token") ? options_get(o, "token") : getenv("RELIGHT_TOKEN");
    d->url = options_get(o, "from");
    d->ca_file = options_get(o, "ca");
    d->quiet = options_on(o, "quiet");
    d->tries = -1;
    d->binary_most = PICTURE_MAX;
    if (!e && r->recorder && !message_is_sequence_name(r->recorder))
        e = err_say(why, ERR_USAGE, "--recorder '%s' is not 1 to 64 letters, digits, '.', '_' or '-'", r->recorder);
    if (!e && r->recorder && options_on(o, "once"))
        e = err_say(why, ERR_USAGE, "--once and lockstep exclude each other: lockstep stores every picture");
    if (!e)
        e = options_double(o, "max-rate", 0.0, 1000.0, &r->max_rate, why);
    if (!e && r->recorder && r->max_rate > 0.0)
        e = err_say(why, ERR_USAGE, "--max-rate and lockstep exclude each other: lockstep stores every picture");
    if (!e)
        e = options_double(o, "give-up-after", 0.0, 1e6, &d->give_up_s, why);
    if (!e && options_get(o, "retry")) {
        e = options_u64(o, "retry", 0, 1000000, &tries, why);
        d->tries = (int64_t)tries;
    }
    if (!e && r->token && strlen(r->token) > 255)
        e = err_say(why, ERR_USAGE, "--token: longer than 255 bytes");
    return e ? e : journal_open(&r->journal, options_get(o, "index"), why);
}

static const char *end_name(const struct record *r, enum connection_end end)
{
    if (end == CONNECTION_DONE)
        return r->ended ? "done" : "interrupted";
    return r->failed ? "failed" : end == CONNECTION_LOST ? "lost" : "refused";
}

static json_t *number_or_null(bool is, uint64_t number)
{
    return is ? json_integer((json_int_t)number) : json_null();
}

static void print_summary(const struct record *r, enum connection_end end, const char *message)
{
    int64_t ahead_us = 0, uncertain_us = 0;
    const bool clock = connection_clock(r->connection, &ahead_us, &uncertain_us);
    const struct span *l = &r->latency;

    json_t *j = json_pack(
        "{s:s, s:s, s:I, s:I, s:I, s:I, s:s?, s:o, s:o, s:i, s:f, s:o, s:o}", "end", end_name(r, end), "message",
        message, "stored", (json_int_t)r->stored, "again", (json_int_t)r->again, "unreadable",
        (json_int_t)r->unreadable, "bytes", (json_int_t)r->bytes, "recorder", r->recorder, "first_frame",
        number_or_null(r->stored > 0, r->first), "last_frame", number_or_null(r->stored > 0, r->last), "connections",
        (int)connection_count(r->connection), "seconds", clock_seconds() - r->start_s, "clock",
        clock
            ? json_pack("{s:I, s:I}", "server_ahead_us", (json_int_t)ahead_us, "uncertain_us", (json_int_t)uncertain_us)
            : json_null(),
        "latency_ms",
        l->count > 0
            ? json_pack("{s:f, s:f, s:f, s:f}", "least", 1e-3 * l->least, "mean", 1e-3 * l->sum / (double)l->count,
                        "most", 1e-3 * l->most, "uncertain", 1e-3 * (double)r->uncertain_us)
            : json_null());
    if (!j)
        return;
    json_dumpf(j, stdout, JSON_REAL_PRECISION(6));
    fputs("\n", stdout);
    json_decref(j);
}

static int run(struct record *r, struct reason *why)
{
    r->start_s = clock_seconds();
    progress_begin(&r->line, "pictures", r->wanted, r->connection_desc.quiet ? NULL : stderr);
    const enum connection_end end = connection_run(r->connection, why);
    progress_end(&r->line);
    if (end != CONNECTION_DONE)
        log_error("%s", why->text);
    if (r->json)
        print_summary(r, end, end == CONNECTION_DONE ? "" : why->text);
    else
        log_info("%" PRIu64 " pictures stored", r->stored);
    if (end == CONNECTION_DONE && r->recorder && r->ended && r->stored == 0)
        log_warning("sequence %s has already ended; use another name to start a new one", r->recorder);
    if (end == CONNECTION_REFUSED)
        return EXIT_REFUSED;
    return end == CONNECTION_DONE && !r->missed && (r->ended || (!r->recorder && !r->wanted)) ? 0 : 1;
}

int main(int argc, char **argv)
{
    struct options options = {
        .program = "relight-record",
        .synopsis = "--out PATTERN [--from ws://HOST:PORT] [flags]",
        .about = "Stores the pictures of a relightd as files, written atomically and named by the number of the frame\n"
                 "that lit it; a repeated number replaces its file. Reconnects when the connection is lost.\n"
                 "Exit code: 0 everything requested is stored (without --frames and --lockstep: until Ctrl-C),\n"
                 "1 not everything, 2 wrong usage, 3 refused by the server (role, token, version, or already taken).",
        .rows = rows,
    };
    static struct record r = { .journal = { .fd = -1 } };
    struct reason why = { "" };
    bool done;

    log_init("relight-record", LOG_INFO);
    enum err e = options_parse(&options, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = read_options(&options, &r, &why);
    if (!e && r.connection_desc.quiet)
        log_init("relight-record", LOG_ERROR);
    sigaction(SIGINT, &(struct sigaction){ .sa_handler = ask_to_stop }, NULL);
    sigaction(SIGTERM, &(struct sigaction){ .sa_handler = ask_to_stop }, NULL);
    sigaction(SIGPIPE, &(struct sigaction){ .sa_handler = SIG_IGN }, NULL);
    sigaction(SIGXFSZ, &(struct sigaction){ .sa_handler = SIG_IGN },
              NULL); /* exceeding a size limit is then an ordinary error */
    r.connection_desc.user = &r;
    r.connection_desc.hooks = (struct connection_hooks){
        .hello = say_hello, .welcome = on_welcome, .text = on_text, .binary = on_binary, .tick = on_tick
    };
    if (!e)
        e = connection_create(&r.connection_desc, &r.connection, &why);
    int code = err_exit_code(e);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    else
        code = run(&r, &why);
    connection_destroy(r.connection);
    journal_close(&r.journal);
    return code;
}
