/* server/relightd.c */
/* The server, from top to bottom: a sky comes in, pictures go out. Four threads, each handing on to the next:
 *     ingest   source -> decode -> cube map and tables
 *     shade    (main) direct light at the shade points -> linear picture
 *     encode   exposure -> tone curve -> JPEG
 *     network  belongs to stream/server.h
 * Between two of them stands a handoff of three slots: the newest wins, nobody waits for a copy. */
#include "clock.h"
#include "environment.h"
#include "film.h"
#include "handoff.h"
#include "jpeg.h"
#include "log.h"
#include "mem.h"
#include "options.h"
#include "relight.h"
#include "server.h"
#include "sky.h"
#include "source.h"

#include <inttypes.h>
#include <omp.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define SMOOTH 0.2 /* share of a new reading in the figures that viewers are shown */

/* What a frame was through before it reached the shade thread. */
struct ingested {
    struct environment *environment;
    double decode_ms;
    int64_t ready_ms; /* when it began to wait */
};

/* A linear picture on its way to the encoder. */
struct shaded {
    float *rgb;
    struct protocol_picture header;
};

struct daemon {
    /* Said on the command line, then only read. */
    struct direct_desc direct;
    bool reseed;
    double fps, rate; /* rate 0: each frame waits until the one before it is shaded */
    enum tone_curve tone;
    int quality;
    struct set_desc set_desc;
    struct source_desc source_desc;
    struct environment_desc environment_desc;
    struct server_desc server_desc;
    const struct kernels *kernels;
    bool computed_sky;
    struct sky_desc sky;

    struct set *set;
    struct source *source;
    struct relighter *relighter;
    struct jpeg_encoder *jpeg;
    struct exposure exposure;
    uint64_t exposed; /* encode thread: the frame to which exposure has adapted */
    uint8_t *display; /* encode thread */
    struct server *server;
    struct ingested ingested[HANDOFF_SLOTS];
    struct handoff frames;
    struct shaded shaded[HANDOFF_SLOTS];
    struct handoff pictures;
    pthread_t ingest_thread, encode_thread;
    bool ingesting, encoding; /* the threads run */

    pthread_mutex_t status_lock;
    struct server_status status; /* {status_lock} its strings point into what follows */
    char detail[sizeof(struct reason)], refusal[sizeof(struct reason)], sky_time[8]; /* {status_lock} */
};

/* Set by the signal handler, which can reach nothing else. */
static volatile sig_atomic_t stop_asked;

static void ask_to_stop(int signal_number)
{
    (void)signal_number;
    stop_asked = 1;
}

static bool stopping(struct daemon *d)
{
    return stop_asked || handoff_is_closed(&d->frames);
}

static double smooth(double old, double reading)
{
    return old > 0.0 ? old + SMOOTH * (reading - old) : reading;
}

static void sleep_until_ms(struct daemon *d, int64_t when_ms)
{
    /* In short naps, so that a signal is answered at once. */
    for (int64_t left = when_ms - clock_ms(); left > 0 && !stopping(d); left = when_ms - clock_ms()) {
        const int64_t nap = left < 50 ? left : 50;
        nanosleep(&(struct timespec){ .tv_nsec = (long)nap * 1000000 }, NULL);
    }
}

/* ---- What viewers are told ---- */

static void tell_source(struct daemon *d, enum server_source source, const char *detail)
{
    pthread_mutex_lock(&d->status_lock);
    d->status.source = source;
    snprintf(d->detail, sizeof(d->detail), "%s", detail);
    server_set_status(d->server, &d->status);
    pthread_mutex_unlock(&d->status_lock);
}

static void tell_refused(struct daemon *d, const char *why)
{
    log_warning("%s", why);
    pthread_mutex_lock(&d->status_lock);
    d->status.refused++;
    snprintf(d->refusal, sizeof(d->refusal), "%s", why);
    pthread_mutex_unlock(&d->status_lock);
    tell_source(d, SERVER_FAILED, why);
}

/* Where the sun stands in a computed sky, in words of the page. */
static void note_sun(struct daemon *d, uint64_t frame)
{
    struct sky_state s;

    if (!d->computed_sky)
        return;
    sky_state_at(&d->sky, frame, &s);
    const double hour = fmod(d->sky.hour + d->sky.speed_hours * (double)frame, 24.0);
    const double azimuth = atan2(-s.sun_direction[0], s.sun_direction[2]) * 180.0 / PI; /* north +Z, east -X */
    d->status.has_sun = true;
    d->status.sun_elevation = s.sun_elevation * 180.0 / PI;
    d->status.sun_azimuth = azimuth < 0.0 ? azimuth + 360.0 : azimuth;
    snprintf(d->sky_time, sizeof(d->sky_time), "%02u:%02u", (unsigned)hour % 24u, (unsigned)(hour * 60.0) % 60u);
}

/* ---- Ingest ---- */

static enum err ingest_frame(struct daemon *d, const struct frame *f, struct reason *why)
{
    const int slot = handoff_begin(&d->frames);
    struct ingested *in = &d->ingested[slot];
    const double start = clock_seconds();

    const enum err e = environment_update(in->environment, f, why);
    if (e)
        return e;
    const struct image_faults *faults = &in->environment->image.faults;
    in->decode_ms = 1e3 * (clock_seconds() - start);
    in->ready_ms = clock_ms();
    const bool dropped = handoff_publish(&d->frames, slot);
    pthread_mutex_lock(&d->status_lock);
    d->status.received++;
    d->status.dropped += dropped;
    d->status.repaired += faults->nan + faults->infinite + faults->negative;
    pthread_mutex_unlock(&d->status_lock);
    return ERR_OK;
}

static void *ingest_main(void *arg)
{
    struct daemon *d = arg;
    struct frame f = { 0 };
    struct reason why = { "" };
    const int64_t start = clock_ms();
    uint64_t count = 0;
    bool failed = false;

    omp_set_num_threads(1); /* the other processor is shading */
    while (!stopping(d)) {
        enum err e = source_next(d->source, &f, &why);
        if (e == ERR_END)
            break;
        if (!e && f.kind == FRAME_NONE)
            continue;
        if (!e)
            e = ingest_frame(d, &f, &why);
        if (e)
            tell_refused(d, why.text);
        else if (failed || count == 0)
            tell_source(d, SERVER_LIVE, "");
        failed = e != ERR_OK;
        count++;
        if (d->rate > 0.0)
            sleep_until_ms(d, start + (int64_t)(1e3 * (double)count / d->rate));
        else
            while (!failed && !handoff_wait_taken(&d->frames, 100) && !stopping(d))
                continue;
    }
    frame_finish(&f);
    if (!stopping(d) && !failed)
        tell_source(d, SERVER_ENDED, "the last frame was shown");
    return NULL;
}

/* ---- Encode ---- */

static void encode_picture(struct daemon *d, struct shaded *in)
{
    const uint32_t width = in->header.width, height = in->header.height;
    struct server_demand demand;
    const double start = clock_seconds();
    const uint8_t *bytes;
    size_t size;

    server_demand(d->server, &demand);
    const uint64_t frame = in->header.frame, passed = frame > d->exposed ? frame - d->exposed : 1;
    const double gain = exposure_step(&d->exposure, in->rgb, width, height, passed);
    d->exposed = frame;
    tone_map(in->rgb, width, height, gain, d->tone, d->display);
    const int quality = demand.jpeg_quality ? demand.jpeg_quality : d->quality;
    if (jpeg_encode(d->jpeg, d->display, width, height, quality, &bytes, &size)) {
        log_error("a picture of %ux%u could not be encoded", width, height);
        return;
    }
    in->header.gain = (float)gain;
    in->header.format = PROTOCOL_JPEG;
    const double ms = 1e3 * (clock_seconds() - start);
    in->header.encoded_us = (uint32_t)(1e3 * ms);
    struct picture *p = picture_create(&in->header, bytes, size);
    if (!p) {
        log_error("no memory for a picture of %zu bytes", size);
        return;
    }
    server_publish(d->server, p);
    pthread_mutex_lock(&d->status_lock);
    d->status.encoded_ms = smooth(d->status.encoded_ms, ms);
    server_set_status(d->server, &d->status);
    pthread_mutex_unlock(&d->status_lock);
}

static void *encode_main(void *arg)
{
    struct daemon *d = arg;

    omp_set_num_threads(1);
    while (!handoff_is_closed(&d->pictures)) {
        const int slot = handoff_take(&d->pictures, 200);
        if (slot == HANDOFF_NONE)
            continue;
        encode_picture(d, &d->shaded[slot]);
        handoff_release(&d->pictures, slot);
    }
    return NULL;
}

/* ---- Shade ---- */

static enum err shade_frame(struct daemon *d, const struct ingested *in, double *last_s, struct reason *why)
{
    const struct environment *e = in->environment;
    const int slot = handoff_begin(&d->pictures);
    struct shaded *out = &d->shaded[slot];
    struct relight_stats stats;
    const double queued_ms = (double)(clock_ms() - in->ready_ms);

    d->direct.pass = d->reseed ? e->number : 0;
    const enum err result = relighter_run(d->relighter, e, &d->direct, out->rgb, &stats);
    if (result)
        return err_say(why, result, "%s: no memory for the light samples", e->name);
    const double shaded_ms = stats.shade_ms + stats.resolve_ms, now_s = clock_seconds();
    out->header = (struct protocol_picture){
        .frame = e->number,
        .capture_us = e->capture_us,
        .queued_us = (uint32_t)(1e3 * queued_ms),
        .decoded_us = (uint32_t)(1e3 * in->decode_ms),
        .shaded_us = (uint32_t)(1e3 * shaded_ms),
        .width = d->set_desc.width,
        .height = d->set_desc.height,
        .samples = d->direct.samples,
    };
    handoff_publish(&d->pictures, slot);
    pthread_mutex_lock(&d->status_lock);
    d->status.used++;
    d->status.frame = e->number;
    d->status.queued_ms = smooth(d->status.queued_ms, queued_ms);
    d->status.decoded_ms = smooth(d->status.decoded_ms, in->decode_ms);
    d->status.shaded_ms = smooth(d->status.shaded_ms, shaded_ms);
    if (*last_s > 0.0)
        d->status.fps = 1.0 / smooth(d->status.fps > 0.0 ? 1.0 / d->status.fps : 0.0, now_s - *last_s);
    *last_s = now_s;
    note_sun(d, e->number);
    pthread_mutex_unlock(&d->status_lock);
    return ERR_OK;
}

/* With nobody watching, one picture a second keeps the last one fresh for whoever comes. */
static double pace_s(const struct daemon *d)
{
    struct server_demand demand;

    server_demand(d->server, &demand);
    return demand.viewers ? 1.0 / d->fps : 1.0;
}

static enum err shade_all(struct daemon *d, struct reason *why)
{
    double next_s = clock_seconds(), last_s = 0.0;
    enum err e = ERR_OK;

    while (!e && !stop_asked) {
        if (clock_seconds() < next_s && pace_s(d) + last_s > clock_seconds()) {
            nanosleep(&(struct timespec){ .tv_nsec = 2000000 }, NULL);
            continue;
        }
        const int slot = handoff_take(&d->frames, 100);
        if (slot == HANDOFF_NONE)
            continue;
        /* Held to the grid of the wished rate, and never behind it by more than a frame. */
        const double pace = pace_s(d), now = clock_seconds();
        next_s = next_s + pace > now ? next_s + pace : now + pace;
        e = shade_frame(d, &d->ingested[slot], &last_s, why);
        handoff_release(&d->frames, slot);
    }
    return e;
}

/* ---- Wiring ---- */

static struct option_row rows[] = {
    { "", NULL, "what is lit, and by what", NULL },
    { "scene", "FILE", "scene to light: .json, .gltf or .glb; left out: the built-in one", NULL },
    { "camera", "NAME", "camera of the scene; left out: the first", NULL },
    { "source", "S", "a file, directory, printf or glob pattern, watch:DIR, or sky:key=value,...", "sky:" },
    { "frames", "A-B", "only the frames with these numbers", NULL },
    { "once", NULL, "stop after the last frame and keep its picture; else begin again", NULL },
    { "rate", "N", "frames per second that the source gives; 0: as fast as they are shown", "0" },
    { "layout", "L", "of the environment: auto, latlong or latlong-bottom", "auto" },
    { "rotate", "DEGREES", "turns the environment about the vertical axis", "0" },
    { "scale", "STOPS", "makes the environment 2^STOPS times as bright", "0" },
    { "", NULL, "how", NULL },
    { "size", "WxH", "of the pictures, in pixels", "640x360" },
    { "method", "M", "uniform, brdf, light, faces-uniform, faces, mis or auto", "auto" },
    { "samples", "N", "N_s per shade point", "16" },
    { "fps", "N", "pictures per second at most", "30" },
    { "seed", "K", "of all random numbers", "0" },
    { "reseed", NULL, "other random numbers in each frame, so that the noise moves", NULL },
    { "no-visibility", NULL, "trace no shadows, as the paper", NULL },
    { "edge-rays", "K", "K x K camera rays where geometry has edges, 1 to 16", "4" },
    { "cpu", "LEVEL", "v3, v4 or baseline; left out: the best this CPU has", NULL },
    { "threads", "N", "for shading; 0: as many as there are processors", "0" },
    { "", NULL, "what goes out, and where", NULL },
    { "bind", "ADDRESS", "address to listen on", "127.0.0.1" },
    { "port", "P", "port to listen on; 0: any free one", "8080" },
    { "web", "DIR", "folder of the page; left out: the one that came with the program", NULL },
    { "tone", "CURVE", "filmic, reinhard or linear", "filmic" },
    { "quality", "Q", "of JPEG where a viewer does not say, 1 to 100", "85" },
    { NULL, NULL, NULL, NULL },
};

static enum err read_source_options(const struct options *o, struct daemon *d, struct reason *why)
{
    struct source_desc *s = &d->source_desc;
    const char *frames = options_get(o, "frames");
    int used = 0;
    enum err e = ERR_OK;

    s->spec = options_get(o, "source");
    s->loop = !options_on(o, "once");
    if (frames) {
        s->has_range = true;
        if (sscanf(frames, "%" SCNu64 "-%" SCNu64 "%n", &s->first, &s->last, &used) != 2 || frames[used] ||
            s->first > s->last)
            return err_say(why, ERR_USAGE, "--frames '%s' is not A-B with A <= B", frames);
    }
    d->computed_sky = strncmp(s->spec, "sky:", 4) == 0;
    if (d->computed_sky)
        e = sky_parse(s->spec + 4, &d->sky, why);
    if (!e)
        e = options_double(o, "rate", 0.0, 1000.0, &d->rate, why);
    if (!e)
        e = layout_parse(options_get(o, "layout"), &d->environment_desc.layout, why);
    if (!e)
        e = options_double(o, "rotate", -3600.0, 3600.0, &d->environment_desc.rotation_degrees, why);
    if (!e)
        e = options_double(o, "scale", -60.0, 60.0, &d->environment_desc.scale_stops, why);
    return e;
}

static enum err read_options(const struct options *o, struct daemon *d, struct reason *why)
{
    uint64_t samples = 0, edge = 0, port = 0, quality = 0, threads = 0;
    enum err e = read_source_options(o, d, why);

    if (!e)
        e = method_parse(options_get(o, "method"), &d->direct.method, why);
    if (!e)
        e = options_size(o, "size", &d->set_desc.width, &d->set_desc.height, why);
    if (!e)
        e = options_u64(o, "samples", 1, 1 << 20, &samples, why);
    if (!e)
        e = options_u64(o, "seed", 0, UINT64_MAX, &d->direct.seed, why);
    if (!e)
        e = options_u64(o, "edge-rays", 1, 16, &edge, why);
    if (!e)
        e = options_u64(o, "port", 0, 65535, &port, why);
    if (!e)
        e = options_u64(o, "quality", 1, 100, &quality, why);
    if (!e)
        e = options_u64(o, "threads", 0, 1024, &threads, why);
    if (!e)
        e = options_double(o, "fps", 0.01, 1000.0, &d->fps, why);
    if (!e)
        e = tone_parse(options_get(o, "tone"), &d->tone, why);
    if (!e)
        e = kernels_select(options_get(o, "cpu"), &d->kernels, why);
    d->direct.samples = (uint32_t)samples;
    d->direct.no_visibility = options_on(o, "no-visibility");
    d->reseed = options_on(o, "reseed");
    d->quality = (int)quality;
    d->set_desc.scene = options_get(o, "scene");
    d->set_desc.camera = options_get(o, "camera");
    d->set_desc.edge_rays = (uint32_t)edge;
    d->set_desc.progress = true;
    d->server_desc.address = options_get(o, "bind");
    d->server_desc.port = (uint16_t)port;
    d->server_desc.web_dir = options_get(o, "web");
    if (threads)
        omp_set_num_threads((int)threads);
    return e;
}

static enum err allocate(struct daemon *d, struct reason *why)
{
    const size_t pixels = (size_t)d->set_desc.width * d->set_desc.height;
    bool all = true;

    d->relighter = relighter_create(d->set, d->kernels);
    d->jpeg = jpeg_encoder_create();
    d->display = mem_alloc(pixels, 3);
    for (int i = 0; i < HANDOFF_SLOTS; i++) {
        d->ingested[i].environment = environment_create(&d->environment_desc);
        d->shaded[i].rgb = mem_alloc(pixels, 3 * sizeof(float));
        all = all && d->ingested[i].environment && d->shaded[i].rgb;
    }
    exposure_init(&d->exposure);
    if (!all || !d->relighter || !d->jpeg || !d->display)
        return err_say(why, ERR_NOMEM, "no memory for pictures of %ux%u", d->set_desc.width, d->set_desc.height);
    return ERR_OK;
}

/* The port first: if it is taken, say so before the long work; then the source, for the same reason. */
static enum err set_up(struct daemon *d, struct reason *why)
{
    enum err e = server_create(&d->server_desc, &d->server, why);

    if (!e)
        e = source_open(&d->source_desc, &d->source, why);
    if (e)
        return e;
    d->status = (struct server_status){
        .scene = d->set_desc.scene ? d->set_desc.scene : "the built-in scene",
        .sky = d->computed_sky ? "a computed sky" : d->source_desc.spec,
        .method = method_name(d->direct.method),
        .samples = d->direct.samples,
        .width = d->set_desc.width,
        .height = d->set_desc.height,
        .source = SERVER_WAITING,
        .detail = d->detail,
        .last_refusal = d->refusal,
        .sky_time = d->sky_time,
    };
    tell_source(d, SERVER_WAITING, "the scene is being prepared");
    e = set_create(&d->set_desc, &d->set, why);
    if (!e)
        e = allocate(d, why);
    if (!e)
        tell_source(d, SERVER_WAITING, "the first frame of the sky is being read");
    return e;
}

static enum err run(struct daemon *d, struct reason *why)
{
    d->ingesting = pthread_create(&d->ingest_thread, NULL, ingest_main, d) == 0;
    d->encoding = pthread_create(&d->encode_thread, NULL, encode_main, d) == 0;
    if (!d->ingesting || !d->encoding)
        return err_say(why, ERR_NOMEM, "a thread could not be started");
    log_info("listening on %s", server_url(d->server));
    return shade_all(d, why);
}

static void tear_down(struct daemon *d)
{
    handoff_close(&d->frames);
    handoff_close(&d->pictures);
    if (d->ingesting)
        pthread_join(d->ingest_thread, NULL);
    if (d->encoding)
        pthread_join(d->encode_thread, NULL);
    server_destroy(d->server);
    for (int i = 0; i < HANDOFF_SLOTS; i++) {
        environment_destroy(d->ingested[i].environment);
        mem_free(d->shaded[i].rgb);
    }
    mem_free(d->display);
    jpeg_encoder_destroy(d->jpeg);
    relighter_destroy(d->relighter);
    set_destroy(d->set);
    source_close(d->source);
    handoff_finish(&d->frames);
    handoff_finish(&d->pictures);
    pthread_mutex_destroy(&d->status_lock);
}

/* OpenMP's waiting threads spin by default and would take the processors from the other stages. The library reads the
 * variable as it is loaded, so it must stand before the program begins. */
static void wait_passively(char **argv)
{
    char path[4096]; /* the program's own, by name, so that it keeps it in lists of processes */

    if (getenv("OMP_WAIT_POLICY"))
        return;
    const ssize_t length = readlink("/proc/self/exe", path, sizeof(path) - 1);
    if (length <= 0)
        return;
    path[length] = '\0';
    setenv("OMP_WAIT_POLICY", "passive", 1);
    execv(path, argv);
    /* Where that cannot be done, spinning costs speed and nothing else. */
}

int main(int argc, char **argv)
{
    struct options options = {
        .program = "relightd",
        .synopsis = "[--scene FILE] [--source S] [flags]",
        .about = "Lights a scene by a live stream of sky frames and shows it in a browser.\n"
                 "Without flags: the built-in scene under a computed sky, on http://127.0.0.1:8080/",
        .rows = rows,
    };
    static struct daemon d; /* zeroed, and too large for a stack */
    struct reason why = { "" };
    bool done;

    wait_passively(argv);
    log_init("relightd", LOG_INFO);
    enum err e = options_parse(&options, argc, argv, &done, &why);
    if (!e && done)
        return 0;
    handoff_init(&d.frames);
    handoff_init(&d.pictures);
    pthread_mutex_init(&d.status_lock, NULL);
    sigaction(SIGINT, &(struct sigaction){ .sa_handler = ask_to_stop }, NULL);
    sigaction(SIGTERM, &(struct sigaction){ .sa_handler = ask_to_stop }, NULL);
    sigaction(SIGPIPE, &(struct sigaction){ .sa_handler = SIG_IGN }, NULL);
    if (!e)
        e = read_options(&options, &d, &why);
    if (!e)
        e = set_up(&d, &why);
    if (!e)
        e = run(&d, &why);
    tear_down(&d);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    else
        log_info("stopped");
    return err_exit_code(e);
}
