#include "relightd/daemon/config.h"

#include "base/setting_table.h"
#include "image/video/h264.h"
#include "image/video/movie.h"
#include "job/ranks/ranks.h"
#include "net/publish/publish.h"

#include <string.h>

#define MIB_MOST 2047 /* of --max-frame-mib */
#define LOG_BURST 20  /* lines of a kind within */
#define LOG_WINDOW_MS 10000

#define SCENE .section = "Scene and environment"
#define RENDERING .section = "Rendering"
#define NETWORK .section = "Network"
#define ACCESS .section = "Access and limits"
#define LOGS .section = "Log and state"
#define FILES .section = "Configuration"
#define AT(field) SETTING_AT(daemon_config, field)

static const struct setting_choice off_choices[] = {
    { "off", 0, NULL, 0 },
    { NULL, 0, NULL, 0 },
};

static const struct setting_choice part_choices[] = {
    { "auto", PART_AUTO, "half between ranks of a job, float in one process", 0 },
    { "half", PART_HALF, "half floats; one process rounds light to them, too", 0 },
    { "float", PART_FLOAT, "floats", 0 },
    { NULL, 0, NULL, 0 },
};

static const struct setting_choice delay_choices[] = {
    { "auto", -1, NULL, 0 },
    { NULL, 0, NULL, 0 },
};

/* The flags that relightd alone has. */
static const struct setting table[] = {
    { "rate", "N", "frames per second from the source; 0: as fast as they are shown", "0", SCENE, REAL(0.0, 1000.0),
      AT(rate) },
    { "between-delay", "SECONDS",
      "images between skies that come by themselves are so far behind: auto, one interval; 0: the newest sky at once, "
      "its sun moved on",
      "auto", EXPERT, SCENE, REAL(0.0, 600.0), OR_WORD(delay_choices), AT(between_delay) },
    { "converge", "E", "refine a still image until its relMSE is E; off: no refinement", "3e-5", EXPERT, RENDERING,
      REAL(1e-9, 10.0), OR_WORD(off_choices), AT(converge.error) },
    { "converge-passes", "N", "or until it has had this many passes of --samples samples", "4096", EXPERT, RENDERING,
      WHOLE(2, 1u << 20), AT(converge.passes) },
    { "max-picture-seconds", "N", "refuse controllers' settings that would make an image take longer", "10", EXPERT,
      RENDERING, REAL(0.1, 86400.0), AT(image_s) },
    { "part-floats", "F", "under mpirun: number format in which ranks send light", "auto", EXPERT, RENDERING,
      .needs = NEEDS_MPI, CHOICE(part_choices), AT(part_floats) },
    { "bind", "ADDRESS", "address to listen on; all but loopback need tokens", "127.0.0.1", NETWORK, TEXT,
      AT(server_desc.address) },
    { "port", "P", "port to listen on; 0: any free one", "8080", NETWORK, WHOLE(0, 65535), AT(server_desc.port) },
    { "tls-cert", "FILE",
      "PEM certificate, followed by its intermediate certificates (full chain); with --tls-key: HTTPS only", NULL,
      NETWORK, TEXT, AT(server_desc.tls_cert) },
    { "tls-key", "FILE", "its private key in PEM, without a password", NULL, NETWORK, TEXT, AT(server_desc.tls_key) },
    { "tls-self-signed", "DIR",
      "HTTPS only, with a self-signed certificate for this machine's names and addresses, kept in DIR", NULL, NETWORK,
      TEXT },
    { "share", "DIR",
      "for other machines: keep tokens for all roles and a certificate in DIR, made at the first start, listen on all "
      "addresses, and print the links",
      NULL, NETWORK, TEXT },
    { "web", "DIR", "folder of the viewer page; default: the one installed with the program", NULL, EXPERT, NETWORK,
      TEXT, AT(server_desc.web_dir) },
    { "h264-mbit", "N", "maximum bit rate of H.264, in Mbit/s; 0: half a bit per pixel of each frame", "0", EXPERT,
      NETWORK, .needs = NEEDS_VIEWER_H264, REAL(0.0, 1000.0), .scale = 1e6, AT(h264_bits) },
    { "no-h264", NULL, "do not offer H.264 to viewers", NULL, EXPERT, NETWORK, .needs = NEEDS_VIEWER_H264, SWITCH_OFF,
      AT(server_desc.h264) },
    { "publish", "URL",
      "publish live images as H.264, to rtmp://, rtsp://, srt://, hls:DIR (for a web server) or record:DIR; may be "
      "given several times",
      NULL, NETWORK, .needs = NEEDS_MOVIES, TEXTS, AT(publish_urls) },
    { "token-viewer", "T", "token required from viewers", NULL, EXPERT, ACCESS, TEXT,
      AT(server_desc.tokens[SERVER_VIEWER]), .reload = RELOAD_SERVER },
    { "token-controller", "T", "token required from controllers", NULL, EXPERT, ACCESS, TEXT,
      AT(server_desc.tokens[SERVER_CONTROLLER]), .reload = RELOAD_SERVER },
    { "token-producer", "T", "token required from producers", NULL, EXPERT, ACCESS, TEXT,
      AT(server_desc.tokens[SERVER_PRODUCER]), .reload = RELOAD_SERVER },
    { "token-recorder", "T", "token required from recorders of lockstep sequences", NULL, EXPERT, ACCESS, TEXT,
      AT(server_desc.tokens[SERVER_RECORDER]), .reload = RELOAD_SERVER },
    { "token-metrics", "T", "token required to read /metrics; default: none on loopback, else the viewers' token", NULL,
      EXPERT, ACCESS, TEXT, AT(server_desc.token_metrics), .reload = RELOAD_SERVER },
    { "token-viewer-file", "FILE", "file with that token, which keeps it out of process lists", NULL, ACCESS, TEXT,
      .reload = RELOAD_SERVER },
    { "token-controller-file", "FILE", "file with that token", NULL, ACCESS, TEXT, .reload = RELOAD_SERVER },
    { "token-producer-file", "FILE", "file with that token", NULL, ACCESS, TEXT, .reload = RELOAD_SERVER },
    { "token-recorder-file", "FILE", "file with that token", NULL, EXPERT, ACCESS, TEXT, .reload = RELOAD_SERVER },
    { "token-metrics-file", "FILE", "file with that token", NULL, EXPERT, ACCESS, TEXT, .reload = RELOAD_SERVER },
    { "public-name", "NAMES",
      "names by which browsers and clients reach this server, separated by commas; not needed for localhost and "
      "numeric addresses",
      NULL, ACCESS, TEXT, AT(server_desc.public_names), .reload = RELOAD_SERVER },
    { "embed-from", "ORIGINS",
      "sites whose pages may show /embed in a frame, such as https://example.org, separated by commas; default: none",
      NULL, EXPERT, ACCESS, TEXT, AT(server_desc.embed_from), .reload = RELOAD_SERVER },
    { "behind-proxy", NULL, "trust X-Forwarded-For from the proxy: limits then apply to the clients that it names",
      NULL, EXPERT, ACCESS, SWITCH, AT(server_desc.behind_proxy), .reload = RELOAD_SERVER },
    { "proxy-address", "ADDRESS", "numeric address of that proxy; default: 127.0.0.1 or ::1", NULL, EXPERT, ACCESS,
      TEXT, AT(server_desc.proxy), .reload = RELOAD_SERVER },
    { "max-connections", "N", "maximum number of WebSockets", "128", EXPERT, ACCESS, WHOLE(1, 4096),
      AT(server_desc.max_connections) },
    { "max-per-address", "N", "of these from one address; default: 32, and no limit for this machine", NULL, EXPERT,
      ACCESS, WHOLE(1, 4096), AT(server_desc.max_per_address), .reload = RELOAD_SERVER },
    { "max-frame-mib", "N", "largest environment frame accepted over the network, in MiB", "256", EXPERT, ACCESS,
      WHOLE(1, MIB_MOST), .scale = 1 << 20, AT(server_desc.max_frame_bytes), .reload = RELOAD_SERVER },
    { "max-frame-side", "N", "longest side of such a frame in texels, up to 16384; memory grows with its square",
      "8192", EXPERT, ACCESS, WHOLE(1, IMAGE_MAX_SIDE), AT(max_side) },
    { "decoder", "PROGRAM", "program that decodes producers' files; default: the installed relight-decoder", NULL,
      EXPERT, ACCESS, TEXT, AT(decoder_desc.program) },
    { "decode-seconds", "N", "time limit for decoding one file", "10", EXPERT, ACCESS, REAL(0.1, 3600.0),
      AT(decode_seconds) },
    { "no-sandbox", NULL, "decode producers' files in this process, where a malicious file can do harm", NULL, EXPERT,
      ACCESS, SWITCH, AT(no_sandbox) },
    { "log", "FORM", "format of the log on standard error", "plain", EXPERT, LOGS, CHOICE(log_forms), AT(log.form) },
    { "log-level", "LEVEL", "least important messages to log", "info", EXPERT, LOGS, CHOICE(log_levels),
      AT(log.level) },
    { "state", "DIR", "keep what controllers set in DIR/state.json across restarts", NULL, LOGS, TEXT, AT(state_dir) },
    { "config", "FILE", "JSON object whose keys are these flags without dashes; command-line flags override the file",
      NULL, FILES, TEXT },
    { "check-config", NULL, "check flags and configuration, report all faults and exit", NULL, FILES, SWITCH },
    { "show-link", NULL, "print links with tokens for each role, on a terminal with QR codes, and exit", NULL, FILES,
      SWITCH },
    { .name = NULL },
};

void daemon_flags_init(struct daemon_flags *f)
{
    f->command = (struct command){
        .name = "relightd",
        .elsewhere = "flags for files and denoising, such as --out, are those of relight-render",
        .synopsis = "[--scene FILE] [--source S] [flags]",
        .about = "Lights a scene with a live stream of environment maps and shows it in a browser.\n"
                 "Without flags: the built-in scene under a computed sky, on http://127.0.0.1:8080/",
        .epilogue_title = "keys of sky:, with their defaults",
        .epilogue = sky_help,
        .program = FOR_RELIGHTD,
        .lists = { { settings_table, NULL }, { table, NULL } },
    };
    f->command.lacks = (source_has_video() ? 0 : NEEDS_VIDEO) | (h264_built() ? 0 : NEEDS_VIEWER_H264) |
                       (movie_available() ? 0 : NEEDS_MOVIES) | (ranks_available() ? 0 : NEEDS_MPI);
    command_begin(&f->command);
    command_default(&f->command, "samples", "16");
    command_default(&f->command, "allow-bias", "1e-2");
}

static enum err read_publish(struct daemon_config *d, struct reason *why)
{
    enum err e = d->publish_urls.count > 0 ? publish_available(why) : ERR_OK;

    for (uint32_t i = 0; i < d->publish_urls.count && !e; i++) {
        e = publish_target_parse(d->publish_urls.text[i], &d->publish[i], why);
        for (uint32_t k = 0; k < i && !e; k++)
            if (strcmp(d->publish_urls.text[i], d->publish_urls.text[k]) == 0 ||
                (d->publish[i].folder[0] && strcmp(d->publish[i].folder, d->publish[k].folder) == 0))
                e = err_say(why, ERR_USAGE, "--publish %s: given twice", d->publish[i].name);
    }
    return e == ERR_UNSUPPORTED ? ERR_USAGE : e;
}

enum err daemon_config_from_flags(struct daemon_flags *f, struct daemon_config *d, struct reason *why)
{
    struct command *c = &f->command;
    struct server_desc *server = &d->server_desc;
    struct setup *s = &d->setup;

    c->lists[0].values = s;
    c->lists[1].values = d;
    enum err e = command_read(c, why);
    if (!e)
        e = setup_complete(s, why);
    s->initial.counted = command_given(c, "samples");
    if (!e && s->initial.error > 0.0 && (s->initial.counted || s->initial.method != METHOD_AUTO))
        e = err_say(why, ERR_USAGE, "--error needs --method auto without --samples");
    if (e)
        return e;
    d->push = strcmp(s->source_desc.spec, "push:") == 0;
    d->computed_sky = strncmp(s->source_desc.spec, "sky:", 4) == 0;
    if (d->computed_sky)
        e = sky_parse(s->source_desc.spec + 4, &d->sky, why);
    if (!e)
        e = read_publish(d, why);
    s->set_desc.progress = true;
    server->push = d->push;
    server->h264 &= h264_built(); /* loaded for the first viewer; if that fails, viewers go back to JPEG */
    server->controls = settings_table;
    /* With a token for every role any address is allowed. */
    server->allow_remote =
        server->tokens[SERVER_VIEWER] && server->tokens[SERVER_CONTROLLER] && server->tokens[SERVER_PRODUCER];
    d->max_side = d->push ? d->max_side : 0;
    d->decoder_desc.timeout_ms = (uint32_t)(1e3 * d->decode_seconds);
    d->decoder_desc.file_bytes = (size_t)MIB_MOST << 20; /* address space: --max-frame-mib may change */
    d->log.burst = LOG_BURST;
    d->log.window_ms = LOG_WINDOW_MS;
    return e;
}
