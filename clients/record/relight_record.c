/* Stores a relightd's images as files: live, as many as arrive, or as the recorder of a lockstep sequence, exactly
 * one per environment frame. An image is acknowledged once it is safely on disk. Everything runs on one thread: while
 * an image is being stored, the server holds back the one after the next. */
#include "base/clock.h"
#include "base/file_store.h"
#include "base/log.h"
#include "base/progress.h"
#include "base/setting_table.h"
#include "base/text.h"
#include "clients/common/client.h"
#include "clients/common/message.h"
#include "clients/record/journal.h"
#include "protocol/relight_protocol.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define PICTURE_MAX ((size_t)1 << 30) /* bytes; memory is allocated as they arrive */
#define UNREADABLE_MOST 10            /* images in a row */

struct span { /* microseconds */
    uint64_t count;
    double sum, least, most;
};

struct record {
    struct file_pattern out;
    enum protocol_format format; /* 0: by the file's name */
    int quality;                 /* 0: the server's default */
    double max_rate;             /* 0: no limit */
    uint64_t wanted;             /* images; 0: until stopped */
    const char *recorder;        /* NULL: not in lockstep */
    const char *pattern, *index_path;
    bool once, lockstep, json;
    struct journal journal;
    struct connection_desc connection_desc;

    struct connection *connection;
    struct progress line;
    char session[64];
    uint64_t newest; /* sequence number of the last image in this session */
    bool has_stored; /* first and last are valid */
    uint64_t first, last;
    uint64_t stored, again, bytes;
    struct span latency;
    int64_t uncertain_us;
    uint64_t unreadable;     /* images that were skipped, */
    unsigned unreadable_row; /* of these the last ones in a row */
    bool ended;              /* the sequence has ended, or all requested images are stored */
    bool failed;             /* an image could not be stored */
    bool missed;             /* another recorder stored images of the sequence */
};

/* ---- Images ---- */

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

/* Whether the file is already stored: an image resent because its acknowledgement was lost, or the last one, which a
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

/* What is wrong with a message that should be an image; NULL: nothing. */
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

/* An image that cannot be stored is skipped, but not many in a row, and none of a sequence, which must be complete. */
static void skip(struct record *r, const uint8_t *bytes, size_t size, const char *fault)
{
    const uint64_t sequence = protocol_picture_sequence(bytes, size);

    if (r->recorder || ++r->unreadable_row > UNREADABLE_MOST) {
        connection_fail(r->connection, CONNECTION_LOST, "%s sent an image that cannot be stored: %s",
                        r->connection_desc.url, fault);
        return;
    }
    log_warning("%s sent an image that cannot be stored and is skipped: %s", r->connection_desc.url, fault);
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

    if (r->ended || client_interrupted())
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

/* While we were away another recorder may have stored images, which are then missing here. */
static void notice_others(struct record *r, const json_t *welcome)
{
    uint64_t after;

    if (!r->recorder || !r->has_stored ||
        !message_number(json_object_get(welcome, "recorder"), "stored_after", &after) || after <= r->last)
        return;
    log_error("another recorder has stored images up to frame %" PRIu64 "; here they end with frame %" PRIu64, after,
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

    if (client_is_stopping(r->connection))
        connection_finish(r->connection);
}

/* ---- Command line ---- */

#define OUTPUT .section = "Output"
#define DURATION .section = "Duration"
#define BEHAVIOUR .section = "Behaviour"
#define AT(field) SETTING_AT(record, field)

static const struct setting_choice format_choices[] = {
    { "jpeg", PROTOCOL_JPEG, "tone-mapped", 0 },
    { "exr-half", PROTOCOL_EXR_HALF, "linear, 16-bit floats", 0 },
    { "exr-float", PROTOCOL_EXR_FLOAT, "linear, 32-bit floats", 0 },
    { NULL, 0, NULL, 0 },
};

static const struct setting rows[] = {
    { "from", "URL", "ws://HOST:PORT, or wss:// with TLS, of a relightd", "ws://127.0.0.1:8080",
      .section = "Connection", TEXT, AT(connection_desc.url) },
    { "out", "PATTERN", "file name with %d or %04d for the environment frame's number", NULL, OUTPUT, TEXT,
      AT(pattern) },
    { "format", "F", "file format; default: from the extension of PATTERN, exr-float for .exr", NULL, OUTPUT,
      CHOICE(format_choices), AT(format) },
    { "quality", "Q", "JPEG quality, 1 to 100; default: the server's", NULL, OUTPUT, WHOLE(1, 100), AT(quality) },
    { "index", "FILE", "append a JSON line per image: frame, file, times, latency", NULL, OUTPUT, TEXT,
      AT(index_path) },
    { "frames", "N", "exit after N images", NULL, DURATION, WHOLE(1, 0x1p64), AT(wanted) },
    { "once", NULL, "store the newest image and exit; PATTERN then needs no number", NULL, DURATION, SWITCH, AT(once) },
    { "lockstep", NULL,
      "store one image for each frame of relight-feed --lockstep, until it ends (--token of role recorder)", NULL,
      BEHAVIOUR, SWITCH, AT(lockstep) },
    { "recorder", "NAME", "the same for the sequence of this name; --lockstep alone means 'default'", NULL, BEHAVIOUR,
      TEXT, AT(recorder) },
    { "max-rate", "N", "maximum images per second; 0: no limit", "0", BEHAVIOUR, REAL(0.0, 1000.0), AT(max_rate) },
    { "json", NULL, "print a summary as one JSON object on standard output", NULL, .section = "Messages", SWITCH,
      AT(json) },
    { .name = NULL },
};

static enum err choose_format(struct record *r, struct reason *why)
{
    const bool jpg = text_ends_with(r->out.text, ".jpg") || text_ends_with(r->out.text, ".jpeg"),
               exr = text_ends_with(r->out.text, ".exr");

    if (!r->format && !jpg && !exr)
        return err_say(why, ERR_USAGE, "--out '%s' ends in neither .jpg nor .exr: add --format", r->out.text);
    if (!r->format)
        r->format = jpg ? PROTOCOL_JPEG : PROTOCOL_EXR_FLOAT;
    if ((jpg && r->format != PROTOCOL_JPEG) || (exr && r->format == PROTOCOL_JPEG))
        return err_say(why, ERR_USAGE, "--format %s does not match --out '%s'", choice_name(format_choices, r->format),
                       r->out.text);
    return ERR_OK;
}

/* Checks the output folder now rather than when the first image arrives, perhaps an hour later. */
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

static enum err check_output_options(struct record *r, struct reason *why)
{
    if (!r->pattern)
        return err_say(why, ERR_USAGE, "--out is missing: name the images, such as --out DIR/image.%%04d.jpg");
    enum err e = file_pattern_parse(r->pattern, "--out", &r->out, why);
    if (!e)
        e = choose_format(r, why);
    if (!e && r->quality && r->format != PROTOCOL_JPEG)
        e = err_say(why, ERR_USAGE, "--quality applies only to JPEG");
    r->wanted = r->once ? 1 : r->wanted;
    if (!e && !r->out.length && r->wanted != 1)
        e = err_say(why, ERR_USAGE, "--out '%s' names one file: include %%04d, or use --once for a single image",
                    r->pattern);
    return e ? e : check_folder(&r->out, why);
}

static enum err check_options(struct record *r, struct reason *why)
{
    enum err e = check_output_options(r, why);

    if (!r->recorder && r->lockstep)
        r->recorder = "default";
    if (!e && r->recorder && !message_is_sequence_name(r->recorder))
        e = err_say(why, ERR_USAGE, "--recorder '%s' is not 1 to 64 letters, digits, '.', '_' or '-'", r->recorder);
    if (!e && r->recorder && r->once)
        e = err_say(why, ERR_USAGE, "--once and lockstep exclude each other: lockstep stores every image");
    if (!e && r->recorder && r->max_rate > 0.0)
        e = err_say(why, ERR_USAGE, "--max-rate and lockstep exclude each other: lockstep stores every image");
    return e ? e : journal_open(&r->journal, r->index_path, why);
}

static const char *end_name(const struct record *r, enum connection_end end)
{
    if (end == CONNECTION_DONE)
        return r->ended ? "done" : "interrupted";
    return r->failed ? "failed" : end == CONNECTION_LOST ? "lost" : "refused";
}

static void print_summary(const struct record *r, enum connection_end end, const char *message)
{
    const struct span *l = &r->latency;
    json_t *latency = json_null();

    if (l->count > 0)
        latency = json_pack("{s:f, s:f, s:f, s:f}", "least", 1e-3 * l->least, "mean", 1e-3 * l->sum / (double)l->count,
                            "most", 1e-3 * l->most, "uncertain", 1e-3 * (double)r->uncertain_us);
    client_print(json_pack("{s:s, s:s, s:I, s:I, s:I, s:I, s:s?, s:o, s:o, s:o}", "end", end_name(r, end), "message",
                           message, "stored", (json_int_t)r->stored, "again", (json_int_t)r->again, "unreadable",
                           (json_int_t)r->unreadable, "bytes", (json_int_t)r->bytes, "recorder", r->recorder,
                           "first_frame", client_number(r->stored > 0, r->first), "last_frame",
                           client_number(r->stored > 0, r->last), "latency_ms", latency),
                 r->connection);
}

static int run(struct record *r, struct reason *why)
{
    progress_begin(&r->line, "images", r->wanted, r->connection_desc.quiet ? NULL : stderr);
    const enum connection_end end = connection_run(r->connection, why);
    progress_end(&r->line);
    if (end != CONNECTION_DONE)
        log_error("%s", why->text);
    if (r->json)
        print_summary(r, end, end == CONNECTION_DONE ? "" : why->text);
    else
        log_info("%" PRIu64 " images stored", r->stored);
    if (end == CONNECTION_DONE && r->recorder && r->ended && r->stored == 0)
        log_warning("sequence %s has already ended; use another name to start a new one", r->recorder);
    return client_exit_code(end, !r->missed && (r->ended || (!r->recorder && !r->wanted)));
}

int main(int argc, char **argv)
{
    static struct record r = { .journal = { .fd = -1 } };
    struct command command = {
        .name = "relight-record",
        .synopsis = "--out PATTERN [--from ws://HOST:PORT] [flags]",
        .about = "Stores the images of a relightd as files, written atomically and named by the number of the frame\n"
                 "that lit it; a repeated number replaces its file. Reconnects when the connection is lost.\n"
                 "Exit code: 0 everything requested is stored (without --frames and --lockstep: until Ctrl-C),\n"
                 "1 not everything, 2 wrong usage, 3 refused by the server (role, token, version, or already taken).",
        .lists = { { rows, &r }, { client_rows, &r.connection_desc } },
    };
    struct reason why = { "" };
    bool done;
    enum err e = client_start(&command, argc, argv, &done, &why);

    if (!e && done)
        return 0;
    if (!e)
        e = check_options(&r, &why);
    r.connection_desc.role = r.recorder ? "recorder" : "viewer";
    r.connection_desc.recorder = r.recorder;
    r.connection_desc.binary_most = PICTURE_MAX;
    r.connection_desc.user = &r;
    r.connection_desc.hooks =
        (struct connection_hooks){ .welcome = on_welcome, .text = on_text, .binary = on_binary, .tick = on_tick };
    if (!e)
        e = connection_create(&r.connection_desc, &r.connection, &why);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    const int code = e ? err_exit_code(e) : run(&r, &why);
    connection_destroy(r.connection);
    journal_close(&r.journal);
    return code;
}
