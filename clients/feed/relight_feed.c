/* Streams a source of frames to a relightd started with --source push:. This file is the command line; feeder.h talks
 * to the server, and reader.h reads ahead on a separate thread. */
#include "base/log.h"
#include "base/setting_table.h"
#include "clients/common/client.h"
#include "clients/common/message.h"
#include "clients/feed/feeder.h"
#include "clients/feed/reader.h"

#include <inttypes.h>
#include <string.h>

struct feed {
    struct feeder_desc feeder;
    const char *out; /* NULL: frames are sent */
    bool json;
};

#define FRAMES .section = "Frames"
#define BEHAVIOUR .section = "Behaviour"
#define AT(field) SETTING_AT(feed, field)

static const struct setting_choice raw_choices[] = {
    { "half", RAW_HALF, "16-bit floats", 0 },
    { "float", RAW_FLOAT, "32-bit floats", 0 },
    { NULL, 0, NULL, 0 },
};

static const struct setting rows[] = {
    { "to", "URL", "ws://HOST:PORT, or wss:// with TLS, of a relightd started with --source push:",
      "ws://127.0.0.1:8080", .section = "Connection", TEXT, AT(feeder.connection.url) },
    { "frames", "A-B", "only the frames with these numbers (one number: that frame)", NULL, FRAMES,
      .type = SETTING_FRAMES, AT(feeder.reader.source.frames) },
    { "loop", NULL, "restart after the last frame", NULL, FRAMES, SWITCH, AT(feeder.reader.source.loop) },
    { "layout", "L", "layout of the environment map", "auto", FRAMES, CHOICE(layout_choices),
      AT(feeder.reader.parcel.layout) },
    { "layer", "NAME", "layer or part of OpenEXR maps, which are then decoded here; default: the server's choice", NULL,
      FRAMES, TEXT, AT(feeder.reader.parcel.layer) },
    { "source-transfer", "T", "transfer function of a video, instead of the one that it declares", "auto", FRAMES,
      .needs = NEEDS_VIDEO, CHOICE(signal_transfer_choices), AT(feeder.reader.source.colour.transfer) },
    { "source-peak", "CDM2",
      "cd/m^2 of a video's white (HLG: of its peak; PQ: clipping level); 0: 203, HLG 1000, PQ as coded", "0", FRAMES,
      .needs = NEEDS_VIDEO, REAL(0.0, 1e6), AT(feeder.reader.source.colour.peak_cdm2) },
    { "source-ca", "FILE",
      "PEM file of the certificate authorities to trust for https://, rtsps:// and rtmps:// sources, instead of the "
      "system's; none: accept any certificate",
      NULL, FRAMES, .needs = NEEDS_VIDEO, TEXT, AT(feeder.reader.source.ca) },
    { "raw", "FORM", "decode files here and send texels, as computed skies always are", NULL, FRAMES,
      CHOICE(raw_choices), AT(feeder.reader.parcel.raw) },
    { "out", "PATTERN", "write the frames as .exr files, with %d or %04d for the frame number, instead of sending them",
      NULL, FRAMES, TEXT, AT(out) },
    { "rate", "N", "frames per second; 0: as fast as the server accepts them", "0", BEHAVIOUR, REAL(0.0, 1000.0),
      AT(feeder.rate) },
    { "lockstep", NULL, "exactly one image per frame, stored by relight-record --recorder", NULL, BEHAVIOUR, SWITCH,
      AT(feeder.lockstep) },
    { "sequence", "NAME", "name of the lockstep sequence", "default", BEHAVIOUR, TEXT, AT(feeder.sequence) },
    { "json", NULL, "print a summary as one JSON object on standard output", NULL, .section = "Messages", SWITCH,
      AT(json) },
    { .name = NULL },
};

/* What only sending knows. */
static enum err check_out(const struct command *c, struct reason *why)
{
    static const char *const others[] = { "to", "loop", "rate", "lockstep", "sequence", "json" };

    for (size_t k = 0; k < sizeof(others) / sizeof(others[0]); k++)
        if (command_given(c, others[k]))
            return err_say(why, ERR_USAGE, "--out writes files and --%s sends frames: give one of them", others[k]);
    return ERR_OK;
}

static enum err check_options(const struct command *c, struct feeder_desc *f, struct reason *why)
{
    struct source_desc *source = &f->reader.source;

    if (c->operand_count != 1)
        return err_say(why, ERR_USAGE, "SOURCE is missing (see relight-feed --help)");
    source->spec = c->operands[0];
    source->wait = true;
    f->watched = strncmp(source->spec, "watch:", 6) == 0;
    if (f->lockstep && source->loop)
        return err_say(why, ERR_USAGE, "--loop and --lockstep exclude each other: frame numbers must increase");
    if (f->lockstep && f->rate > 0.0)
        return err_say(why, ERR_USAGE, "--rate and --lockstep exclude each other: the recorder sets the pace");
    if (!message_is_sequence_name(f->sequence))
        return err_say(why, ERR_USAGE, "--sequence '%s' is not 1 to 64 letters, digits, '.', '_' or '-'", f->sequence);
    return ERR_OK;
}

static const char *end_name(enum connection_end end)
{
    if (end == CONNECTION_DONE)
        return client_interrupted() ? "interrupted" : "done";
    return end == CONNECTION_LOST ? "lost" : "refused";
}

static void print_summary(const struct feeder_report *r, enum connection_end end, const char *message)
{
    client_print(json_pack("{s:s, s:s, s:I, s:I, s:I, s:I, s:I, s:I, s:o, s:o, s:I}", "end", end_name(end), "message",
                           message, "sent", (json_int_t)r->sent, "used", (json_int_t)r->used, "superseded",
                           (json_int_t)r->superseded, "refused", (json_int_t)r->refused, "lost", (json_int_t)r->lost,
                           "passed", (json_int_t)r->passed, "resumed_after", client_number(r->resumed, r->resume_after),
                           "last_frame", client_number(r->has_last, r->last), "bytes", (json_int_t)r->bytes),
                 r->connection);
}

static int run(const struct feed *feed, struct feeder *f, struct reason *why)
{
    const struct feeder_desc *d = &feed->feeder;
    struct feeder_report r;
    const enum connection_end end = feeder_run(f, why);

    feeder_report(f, &r);
    if (end != CONNECTION_DONE)
        log_error("%s", why->text);
    if (feed->json)
        print_summary(&r, end, end == CONNECTION_DONE ? "" : why->text);
    else
        log_info("%" PRIu64 " frames used, %" PRIu64 " superseded, %" PRIu64 " refused, %" PRIu64 " lost", r.used,
                 r.superseded, r.refused, r.lost);
    if (end == CONNECTION_DONE && d->lockstep && r.complete && r.resumed && r.sent == 0)
        log_warning("nothing was sent: the server already has all frames of sequence %s up to %" PRIu64
                    "; use another --sequence to start a new one",
                    d->sequence, r.resume_after);
    return client_exit_code(end, (!d->lockstep || r.complete) && r.refused + r.lost == 0 && !r.images_lost);
}

int main(int argc, char **argv)
{
    struct feed feed = { .json = false };
    struct command command = {
        .name = "relight-feed",
        .synopsis = "[--to ws://HOST:PORT | --out PATTERN.exr] [--rate N | --lockstep] [flags] SOURCE",
        .about =
            "Streams environment frames to a relightd: a file, a directory, a printf or glob pattern, watch:DIR or\n"
            "sky:key=value,... With --out, writes them as EXR files instead.\n"
            "Reconnects and continues when the connection is lost; Ctrl-C ends it cleanly.\n"
            "Exit code: 0 all frames were used or superseded by newer ones, 1 some were refused, lost or not sent,\n"
            "or images were lost in lockstep, 2 wrong usage, 3 refused by the server (role, token, version, or\n"
            "already taken).",
        .epilogue_title = "videos and live streams as SOURCE",
        .epilogue = source_has_video() ? "  a file, rtsp://, rtmp://, srt://, http(s)://, v4l2:/dev/video0\n" : NULL,
        .lacks = source_has_video() ? 0 : NEEDS_VIDEO,
        .lists = { { rows, &feed }, { client_rows, &feed.feeder.connection } },
        .operand_max = 1,
    };
    struct feeder *f = NULL;
    struct reason why = { "" };
    bool done;
    enum err e = client_start(&command, argc, argv, &done, &why);

    if (!e && done)
        return 0;
    if (!e)
        e = check_options(&command, &feed.feeder, &why);
    if (!e && feed.out) {
        feed.feeder.reader.source.wait = false; /* whoever waits for files wants to know that there are none */
        e = check_out(&command, &why);
    }
    if (!e)
        e = feed.out ? files_write(&feed.feeder.reader, feed.out, &why) : feeder_create(&feed.feeder, &f, &why);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    const int code = e || feed.out ? err_exit_code(e) : run(&feed, f, &why);
    feeder_destroy(f);
    return code;
}
