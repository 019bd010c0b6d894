/* server/relightd_options.c */
#include "relightd_config.h"

#include "options.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

static const struct option_row table[] = {
    { "", NULL, "what is lit, and by what", NULL },
    { "scene", "FILE", "scene to light: .json, .gltf or .glb; left out: the built-in one", NULL },
    { "camera", "NAME", "camera of the scene; left out: the first", NULL },
    { "source", "S", "file, directory, printf or glob pattern, watch:DIR, push:, or sky:key=value,...", "sky:" },
    { "frames", "A-B", "only the frames with these numbers", NULL },
    { "once", NULL, "stop after the last frame and keep its picture; else begin again", NULL },
    { "rate", "N", "frames per second that the source gives; 0: as fast as they are shown", "0" },
    { "layout", "L", "of the environment: auto, latlong, latlong-bottom, cube, hcross, vcross, ball, fisheye", "auto" },
    { "rotate", "DEGREES", "turns the environment about the vertical axis", "0" },
    { "scale", "STOPS", "makes the environment 2^STOPS times as bright", "0" },
    { "", NULL, "how", NULL },
    { "size", "WxH", "of the pictures, in pixels", "640x360" },
    { "fps", "N", "pictures per second at most; with --method auto and no --samples each is as good as its time allows",
      "30" },
    { "error", "E", "with --method auto: no better than this (relMSE), in less time where that is enough", NULL },
    { "converge", "E",
      "when no new frame comes, the picture goes on to the unbiased one until its relMSE is E; off: it stays", "3e-5" },
    { "converge-passes", "N", "or until so many passes of --samples samples have been made of it", "4096" },
    { "reseed", NULL, "other random numbers in each frame, so that the noise moves", NULL },
    { "edge-rays", "K", "K x K camera rays where geometry has edges, 1 to 16", "4" },
    { "cache-wait", NULL, "of --method cached: the first picture waits until all is computed", NULL },
    { "cpu", "LEVEL", "v3, v4 or baseline; left out: the best this CPU has", NULL },
    { "threads", "N", "for shading; 0: as many as there are processors", "0" },
    { "", NULL, "what goes out, and where", NULL },
    { "bind", "ADDRESS", "address to listen on; other than loopback only with tokens", "127.0.0.1" },
    { "port", "P", "port to listen on; 0: any free one", "8080" },
    { "tls-cert", "FILE", "certificate in PEM, with those that vouch for it: serves HTTPS alone, with --tls-key",
      NULL },
    { "tls-key", "FILE", "its private key in PEM, without a password", NULL },
    { "web", "DIR", "folder of the page; left out: the one that came with the program", NULL },
    { "tone", "CURVE", "filmic, reinhard or linear", "filmic" },
    { "quality", "Q", "of JPEG where a viewer does not say, 1 to 100", "85" },
    { "h264-mbit", "N", "million bits a second, at most, of H.264; 0: half a bit for a pixel of each picture", "0" },
    { "no-h264", NULL, "offers no H.264 to viewers, where the program was built with it", NULL },
    { "", NULL, "who may do what", NULL },
    { "token-viewer", "T", "what viewers must know", NULL },
    { "token-controller", "T", "what controllers must know", NULL },
    { "token-producer", "T", "what producers must know", NULL },
    { "token-viewer-file", "FILE", "holds that token, which then stands in no list of processes", NULL },
    { "token-controller-file", "FILE", "likewise", NULL },
    { "token-producer-file", "FILE", "likewise", NULL },
    { "token-metrics-file", "FILE", "likewise", NULL },
    { "token-metrics", "T",
      "what whoever reads /metrics must know; left out: on loopback nothing, else the viewers' token", NULL },
    { "host", "NAMES", "names that are answered to beside this machine's own, with commas between: a proxy's", NULL },
    { "behind-proxy", NULL, "a proxy on this machine says in X-Forwarded-For who comes; his limits then count", NULL },
    { "max-connections", "N", "WebSockets at once", "128" },
    { "max-per-address", "N", "of these from one address; left out: 32, and no limit for this machine's own", NULL },
    { "max-frame-mib", "N", "largest environment frame taken over the network", "256" },
    { "max-frame-side", "N",
      "longest side of its picture, in texels, up to 16384; twice the side takes four times the memory", "8192" },
    { "decoder", "PROGRAM", "decodes what producers send; left out: the relight-decoder that came with this program",
      NULL },
    { "decode-seconds", "N", "for one file, after which it is refused", "10" },
    { "no-sandbox", NULL, "decodes what producers send in this process, where a bad file can do harm", NULL },
    { "", NULL, "what is said and kept", NULL },
    { "log", "FORM", "of the log on standard error: plain, text (key=value, with time) or json", "plain" },
    { "log-level", "LEVEL", "error, warning, info or debug", "info" },
    { "state", "DIR", "keeps what controllers set in DIR/state.json, so that it comes back", NULL },
    { "", NULL, "where all this may stand as well", NULL },
    { "config", "FILE", "a JSON object whose keys are these flags without dashes; what stands here goes before it",
      NULL },
    { "check-config", NULL, "says whether what was given makes sense, or all that does not, and ends", NULL },
    { NULL, NULL, NULL, NULL },
};
#define MIB_MOST 2047 /* of --max-frame-mib */
#define LOG_BURST 20  /* lines of a kind within */
#define LOG_WINDOW_MS 10000

static const char samples_default[] = "16";

static enum err read_source(const struct options *o, struct daemon *d, struct reason *why)
{
    struct source_desc *s = &d->source_desc;
    enum err e;

    s->spec = options_get(o, "source");
    s->loop = !options_on(o, "once");
    d->push = strcmp(s->spec, "push:") == 0;
    e = options_range(o, "frames", &s->has_range, &s->first, &s->last, why);
    if (e)
        return e;
    d->computed_sky = strncmp(s->spec, "sky:", 4) == 0;
    if (d->computed_sky)
        e = sky_parse(s->spec + 4, &d->sky, why);
    if (!e)
        e = options_double(o, "rate", 0.0, 1000.0, &d->rate, why);
    if (!e)
        e = layout_parse(options_get(o, "layout"), &d->layout, why);
    if (!e)
        e = options_double(o, "rotate", -3600.0, 3600.0, &d->said.rotation_degrees, why);
    if (!e)
        e = options_double(o, "scale", -60.0, 60.0, &d->said.scale_stops, why);
    return e;
}

static enum err read_converge(const struct options *o, struct daemon *d, struct reason *why)
{
    enum err e = options_u64(o, "converge-passes", 2, 1u << 20, &d->converge.passes, why);

    if (!e && strcmp(options_get(o, "converge"), "off") != 0)
        e = options_double(o, "converge", 1e-9, 10.0, &d->converge.error, why);
    return e;
}

static enum err read_light(const struct options *o, struct daemon *d, struct reason *why)
{
    uint64_t edge = 0;
    struct environment_desc environment = { 0 };
    enum err e = light_options_read(o, &d->light, &d->set_desc, &environment, why);

    if (!e && method_is_reference(d->light.direct.method))
        e = err_say(why, ERR_USAGE, "--method %s is a reference, for relight-render: a live picture cannot wait for it",
                    method_name(d->light.direct.method));
    if (!e)
        e = options_size(o, "size", &d->set_desc.width, &d->set_desc.height, why);
    if (!e)
        e = options_u64(o, "edge-rays", 1, 16, &edge, why);
    if (!e)
        e = options_u64(o, "threads", 0, 1024, &d->threads, why);
    if (!e)
        e = options_double(o, "fps", 0.01, 1000.0, &d->said.fps, why);
    if (!e && options_get(o, "error"))
        e = options_double(o, "error", 1e-9, 10.0, &d->said.error, why);
    if (!e)
        e = read_converge(o, d, why);
    if (!e)
        e = kernels_select(options_get(o, "cpu"), &d->kernels, why);
    d->said.method = d->light.direct.method;
    d->said.samples = d->light.direct.samples;
    d->said.classes = d->light.classes;
    d->said.exposure_auto = true;
    d->said.counted = options_get(o, "samples") != samples_default;
    if (!e && d->said.error > 0.0 && (d->said.counted || d->said.method != METHOD_AUTO))
        e = err_say(why, ERR_USAGE, "--error is for --method auto without --samples");
    d->importance = environment.importance;
    d->reseed = options_on(o, "reseed");
    d->light.cache_background = !options_on(o, "cache-wait");
    d->set_desc.scene = options_get(o, "scene");
    d->set_desc.camera = options_get(o, "camera");
    d->set_desc.edge_rays = (uint32_t)edge;
    d->set_desc.progress = true;
    return e;
}

static enum err read_network(const struct options *o, struct daemon *d, struct reason *why)
{
    uint64_t port = 0, quality = 0, mib = 0, side = 0, connections = 0, per_address = 0;
    double patience = 0.0;
    enum err e = options_u64(o, "port", 0, 65535, &port, why);

    if (!e)
        e = options_u64(o, "quality", 1, 100, &quality, why);
    if (!e)
        e = options_u64(o, "max-frame-mib", 1, MIB_MOST, &mib, why);
    if (!e)
        e = options_u64(o, "max-frame-side", 1, IMAGE_MAX_SIDE, &side, why);
    if (!e)
        e = options_double(o, "decode-seconds", 0.1, 3600.0, &patience, why);
    if (!e)
        e = options_u64(o, "max-connections", 1, 4096, &connections, why);
    if (!e && options_get(o, "max-per-address"))
        e = options_u64(o, "max-per-address", 1, 4096, &per_address, why);
    if (!e)
        e = tone_parse(options_get(o, "tone"), &d->said.tone, why);
    if (!e)
        e = options_double(o, "h264-mbit", 0.0, 1000.0, &d->h264_bits, why);
    d->h264_bits *= 1e6;
    atomic_init(&d->quality, (int)quality);
    d->server_desc.address = options_get(o, "bind");
    d->server_desc.port = (uint16_t)port;
    d->server_desc.web_dir = options_get(o, "web");
    d->server_desc.push = d->push;
    d->server_desc.h264 = h264_available() && !options_on(o, "no-h264");
    d->server_desc.max_frame_bytes = (size_t)mib << 20;
    d->most_side = d->push ? (uint32_t)side : 0;
    d->server_desc.max_connections = (uint32_t)connections;
    d->no_sandbox = options_on(o, "no-sandbox");
    d->decoder_desc.program = options_get(o, "decoder");
    d->decoder_desc.patience_ms = (uint32_t)(1e3 * patience);
    d->decoder_desc.file_bytes = (size_t)MIB_MOST << 20; /* address space: --max-frame-mib may change */
    d->server_desc.max_per_address = (uint32_t)per_address;
    d->server_desc.behind_proxy = options_on(o, "behind-proxy");
    d->server_desc.hosts = options_get(o, "host");
    d->server_desc.tokens[SERVER_VIEWER] = options_get(o, "token-viewer");
    d->server_desc.tokens[SERVER_CONTROLLER] = options_get(o, "token-controller");
    d->server_desc.tokens[SERVER_PRODUCER] = options_get(o, "token-producer");
    d->server_desc.token_metrics = options_get(o, "token-metrics");
    d->server_desc.tls_cert = options_get(o, "tls-cert");
    d->server_desc.tls_key = options_get(o, "tls-key");
    /* With a token for every role the whole world may be listened to. */
    d->server_desc.allow_remote = d->server_desc.tokens[SERVER_VIEWER] && d->server_desc.tokens[SERVER_CONTROLLER] &&
                                  d->server_desc.tokens[SERVER_PRODUCER];
    return e;
}

static enum err read_log(const struct options *o, struct daemon *d, struct reason *why)
{
    enum err e = log_parse_form(options_get(o, "log"), &d->log.form, why);

    if (!e)
        e = log_parse_level(options_get(o, "log-level"), &d->log.level, why);
    d->log.burst = LOG_BURST;
    d->log.window_ms = LOG_WINDOW_MS;
    d->state_dir = options_get(o, "state");
    return e;
}

void daemon_flags_init(struct daemon_flags *f)
{
    assert(sizeof(table) <= sizeof(f->rows));
    memcpy(f->rows, table, sizeof(table));
    light_options_init(f->light, samples_default, "direct");
    f->options = (struct options){
        .program = "relightd",
        .synopsis = "[--scene FILE] [--source S] [flags]",
        .about = "Lights a scene by a live stream of sky frames and shows it in a browser.\n"
                 "Without flags: the built-in scene under a computed sky, on http://127.0.0.1:8080/",
        .epilogue_title = "keys of sky:, with their defaults",
        .epilogue = sky_help,
        .rows = f->rows,
        .shared = f->light,
    };
}

enum err daemon_understand(const struct options *o, struct daemon *d, struct reason *why)
{
    enum err e = read_source(o, d, why);

    if (!e)
        e = read_light(o, d, why);
    if (!e)
        e = read_network(o, d, why);
    if (!e)
        e = read_log(o, d, why);
    d->settings = d->said;
    return e;
}
