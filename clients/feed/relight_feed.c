/* clients/feed/relight_feed.c */
/* Streams a source of frames to a relightd started with --source push:. This file is the command line; feeder.h talks
 * to the server, and reader.h reads ahead on a separate thread. */
#include "base/clock.h"
#include "clients/feed/feeder.h"
#include "base/log.h"
#include "clients/common/message.h"
#include "base/options.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EXIT_REFUSED 3

/* Number of stop requests, incremented by the signal handler. */
static volatile sig_atomic_t stops_asked;

static void ask_to_stop(int signal_number)
{
    (void)signal_number;
    stops_asked++;
}

static struct option_row rows[] = {
    { "", NULL, "Destination", NULL },
    { "to", "URL",
      "ws://HOST:PORT, or wss:// with TLS, of a relightd started with --source push:", "ws://127.0.0.1:8080" },
    { "ca", "FILE", "PEM file of the certificate authorities to trust; default: the system's (wss:// only)", NULL },
    { "token", "T", "access token; default: the variable RELIGHT_TOKEN", NULL },
    { "", NULL, "Frames", NULL },
    { "frames", "A-B", "only the frames with these numbers (one number: that frame)", NULL },
    { "loop", NULL, "restart after the last frame", NULL },
    { "layout", "L",
      "layout of the environment map: auto, latlong, latlong-bottom, cube, hcross, vcross, ball or fisheye", "auto" },
    { "raw", "half|float", "decode files here and send texels; computed skies are always sent as texels", NULL },
    { "", NULL, "Behaviour", NULL },
    { "rate", "N", "frames per second; 0: as fast as the server accepts them", "0" },
    { "lockstep", NULL, "exactly one picture per frame, stored by relight-record --recorder", NULL },
    { "sequence", "NAME", "name of the lockstep sequence", "default" },
    { "retry", "N", "consecutive attempts to reconnect; default: unlimited", NULL },
    { "give-up-after", "SECONDS", "give up after this long without a connection; 0: never", "0" },
    { "", NULL, "Messages", NULL },
    { "json", NULL, "print a summary as one JSON object on standard output", NULL },
    { "quiet", NULL, "print only errors, no progress", NULL },
    { NULL, NULL, NULL, NULL },
};

static enum err read_source_options(const struct options *o, struct feeder_desc *f, struct reason *why)
{
    struct reader_desc *d = &f->reader;
    const char *raw = options_get(o, "raw");

    if (o->operand_count != 1)
        return err_say(why, ERR_USAGE, "SOURCE is missing (see relight-feed --help)");
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

static enum err read_options(const struct options *o, struct feeder_desc *f, struct reason *why)
{
    uint64_t tries = 0;
    enum err e = read_source_options(o, f, why);

    f->lockstep = options_on(o, "lockstep");
    f->sequence = options_get(o, "sequence");
    f->token = options_get(o, "token") ? options_get(o, "token") : getenv("RELIGHT_TOKEN");
    f->connection.url = options_get(o, "to");
    f->connection.ca_file = options_get(o, "ca");
    f->connection.quiet = options_on(o, "quiet");
    f->connection.tries = -1;
    if (!e)
        e = options_double(o, "rate", 0.0, 1000.0, &f->rate, why);
    if (!e)
        e = options_double(o, "give-up-after", 0.0, 1e6, &f->connection.give_up_s, why);
    if (!e && options_get(o, "retry")) {
        e = options_u64(o, "retry", 0, 1000000, &tries, why);
        f->connection.tries = (int64_t)tries;
    }
    if (!e && f->lockstep && f->reader.source.loop)
        e = err_say(why, ERR_USAGE, "--loop and --lockstep exclude each other: frame numbers must increase");
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

static json_t *number_or_null(bool is, int64_t number)
{
    return is ? json_integer((json_int_t)number) : json_null();
}

static void print_summary(const struct feeder_report *r, const char *end, double seconds, const char *message)
{
    json_t *clock = r->has_clock ? json_pack("{s:I, s:I}", "server_ahead_us", (json_int_t)r->ahead_us, "uncertain_us",
                                             (json_int_t)r->uncertain_us)
                                 : json_null();
    json_t *j =
        json_pack("{s:s, s:s, s:I, s:I, s:I, s:I, s:I, s:I, s:o, s:o, s:I, s:i, s:f, s:o}", "end", end, "message",
                  message, "sent", (json_int_t)r->sent, "used", (json_int_t)r->used, "superseded",
                  (json_int_t)r->superseded, "refused", (json_int_t)r->refused, "lost", (json_int_t)r->lost, "passed",
                  (json_int_t)r->passed, "resumed_after", number_or_null(r->resumed, (int64_t)r->resume_after),
                  "last_frame", number_or_null(r->has_last, (int64_t)r->last), "bytes", (json_int_t)r->bytes,
                  "connections", (int)r->connections, "seconds", seconds, "clock", clock);
    if (!j)
        return;
    json_dumpf(j, stdout, JSON_REAL_PRECISION(6));
    fputs("\n", stdout);
    json_decref(j);
}

static int run(const struct feeder_desc *d, struct feeder *f, bool json, struct reason *why)
{
    struct feeder_report r;
    const double start_s = clock_seconds();
    const enum connection_end end = feeder_run(f, why);

    feeder_report(f, &r);
    if (end != CONNECTION_DONE)
        log_error("%s", why->text);
    if (json)
        print_summary(&r, end_name(end), clock_seconds() - start_s, end == CONNECTION_DONE ? "" : why->text);
    else
        log_info("%" PRIu64 " frames used, %" PRIu64 " superseded, %" PRIu64 " refused, %" PRIu64 " lost", r.used,
                 r.superseded, r.refused, r.lost);
    if (end == CONNECTION_DONE && d->lockstep && r.complete && r.resumed && r.sent == 0)
        log_warning("nothing was sent: the server already has all frames of sequence %s up to %" PRIu64
                    "; use another --sequence to start a new one",
                    d->sequence, r.resume_after);
    if (end == CONNECTION_REFUSED)
        return EXIT_REFUSED;
    const bool whole = !d->lockstep || r.complete;
    return end == CONNECTION_DONE && whole && r.refused + r.lost == 0 && !r.pictures_lost ? 0 : 1;
}

int main(int argc, char **argv)
{
    struct options options = {
        .program = "relight-feed",
        .synopsis = "[--to ws://HOST:PORT] [--rate N | --lockstep] [flags] SOURCE",
        .about =
            "Streams environment frames to a relightd: a file, a directory, a printf or glob pattern, watch:DIR, or\n"
            "sky:key=value,... Reconnects and continues when the connection is lost; Ctrl-C ends it cleanly.\n"
            "Exit code: 0 all frames were used or superseded by newer ones, 1 some were refused, lost or not sent, or\n"
            "in lockstep pictures were lost,\n"
            "2 wrong usage, 3 refused by the server (role, token, version, or already taken).",
        .rows = rows,
        .operand_max = 1,
    };
    struct feeder_desc d = { .stops = &stops_asked };
    struct feeder *f = NULL;
    struct reason why = { "" };
    bool done;

    log_init("relight-feed", LOG_INFO);
    enum err e = options_parse(&options, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    if (!e)
        e = read_options(&options, &d, &why);
    if (!e && d.connection.quiet)
        log_init("relight-feed", LOG_ERROR);
    sigaction(SIGINT, &(struct sigaction){ .sa_handler = ask_to_stop }, NULL);
    sigaction(SIGTERM, &(struct sigaction){ .sa_handler = ask_to_stop }, NULL);
    sigaction(SIGPIPE, &(struct sigaction){ .sa_handler = SIG_IGN }, NULL);
    if (!e)
        e = feeder_create(&d, &f, &why);
    int code = err_exit_code(e);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    else
        code = run(&d, f, options_on(&options, "json"), &why);
    feeder_destroy(f);
    return code;
}
