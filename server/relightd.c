/* server/relightd.c */
/* The server, from top to bottom: a sky comes in, pictures go out. Four threads hand on to the next, a fifth looks on:
 *     ingest   source or producer -> decode -> cube map and tables
 *     shade    (main) direct light at the shade points -> linear picture; when nothing comes, a better one
 *     encode   exposure -> tone curve -> JPEG or H.264, or EXR for those who need the numbers
 *     network  belongs to stream/server.h
 *     watch    status line, held-back log lines, what is kept for the next start
 * Between two of them stands a handoff of three slots: the newest wins, nobody waits for a copy. */
#include "relightd.h"

#include "clock.h"
#include "log.h"
#include "mem.h"
#include "resample_table.h"
#include "threads.h"

#include <omp.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>

#define TURN 0.9     /* of the time between two pictures that one may take to shade, */
#define SHARED 0.75  /* and while the cache is computed beside them: it costs how good they are, not when they come */
#define LEAVE_S 5    /* from the signal to the end, whatever is under way */
#define LISTEN_MS 30 /* between two looks at what controllers ask for, while no frame comes */

/* Set by the signal handler, which can reach nothing else; shading looks at it from packet to packet. */
static atomic_bool stop_asked;
/* SIGHUP: what it was told is to be read again. */
static atomic_bool reload_asked;
/* Something else is to be done than to make a picture better that stands still (relightd_still.c). */
static atomic_bool stirred;

static void ask_to_stop(int signal_number)
{
    (void)signal_number;
    atomic_store(&stop_asked, true); /* lock-free, so a handler may */
    atomic_store(&stirred, true);
    alarm(LEAVE_S);
}

/* A scene that is being loaded, or a large frame, cannot be stopped half way. Nothing is lost by leaving it: files are
 * renamed when they are whole, and the network's thread has told everybody. */
static void leave_now(int signal_number)
{
    static const char words[] =
        "relightd: warning: stopped in the middle of what was under way, since that did not end\n";

    (void)signal_number;
    if (write(STDERR_FILENO, words, sizeof(words) - 1) < 0)
        _exit(1);
    _exit(0);
}

static void ask_to_reload(int signal_number)
{
    (void)signal_number;
    atomic_store(&reload_asked, true);
    atomic_store(&stirred, true);
}

bool daemon_is_stopping(struct daemon *d)
{
    return stop_asked || handoff_is_closed(&d->frames);
}

static void nap_ms(int64_t ms)
{
    nanosleep(&(struct timespec){ .tv_nsec = (long)ms * 1000000 }, NULL);
}

/* ---- Shade ---- */

/* A lockstep sequence is to come out the same whenever it is made: its counts are those that were said. */
static bool is_piloted(const struct settings *now, const struct ingested *in)
{
    return now->method == METHOD_AUTO && !now->counted && !in->ticket.lockstep;
}

/* Seconds that a picture by the pilot may take. */
static double turn_of(struct daemon *d, const struct settings *now)
{
    const bool shared = d->buyer.begun && relighter_follow(d->relighter) < 1.0;

    return (shared ? SHARED : TURN) / now->fps;
}

/* The picture's time is the whole of its turn but for a margin: what else is done for it goes on beside, on other
 * threads, and makes the measured times longer where it is in the way. */
static enum err run_pilot(struct daemon *d, const struct environment *e, const struct relight_desc *desc,
                          const struct settings *now, float *rgb, struct relight_stats *stats, struct pilot_stats *out)
{
    const struct pilot_wish wish = { .seconds = turn_of(d, now), .error = now->error };

    if (!d->pilot)
        d->pilot = pilot_create(d->set, d->kernels, NULL);
    return d->pilot ? pilot_run(d->pilot, e, desc, &wish, rgb, stats, out) : ERR_NOMEM;
}

/* What the settings make of what was said on the command line. */
static struct relight_desc light_now(struct daemon *d, const struct ingested *in, const struct settings *now,
                                     struct reason *why)
{
    struct relight_desc desc = d->light;

    desc.classes = now->classes;
    desc.direct.method = now->method;
    desc.direct.samples = now->samples;
    desc.direct.pass = d->reseed ? in->environment->number : 0;
    desc.turn = in->ticket.lockstep ? in->environment->number : d->turn++; /* frames that were dropped cost nothing */
    desc.direct.cancel = &stop_asked;
    desc.direct.why = why;
    desc.cache_keep = true;
    desc.cache_background = desc.cache_background && !in->ticket.lockstep;
    return desc;
}

static struct protocol_picture header_of(const struct daemon *d, const struct ingested *in, double queued_ms,
                                         const struct relight_stats *stats, uint32_t samples)
{
    return (struct protocol_picture){
        .frame = in->environment->number,
        .capture_us = in->environment->capture_us,
        .queued_us = (uint32_t)(1e3 * queued_ms),
        .decoded_us = (uint32_t)(1e3 * in->decode_ms),
        .shaded_us = (uint32_t)(1e3 * (stats->shade_ms + stats->eye_ms + stats->light_ms + stats->resolve_ms)),
        .width = d->set_desc.width,
        .height = d->set_desc.height,
        .samples = samples,
    };
}

/* A lockstep sequence is made as was said, by the camera that was said. */
static enum err shade_frame(struct daemon *d, const struct ingested *in, bool anew, double *last_s, struct reason *why)
{
    const struct environment *e = in->environment;
    const int slot = handoff_begin(&d->pictures);
    struct shaded *out = &d->shaded[slot];
    const struct settings now = in->ticket.lockstep ? d->said : daemon_settings(d);
    struct relighter *relighter = in->ticket.lockstep ? d->first_relighter : d->relighter;
    struct relight_desc desc = light_now(d, in, &now, why);
    struct relight_stats stats;
    struct pilot_stats pilot = { 0 };
    const bool by_pilot = is_piloted(&now, in), piloted = by_pilot && !(d->buyer.ready && buyer_may(&desc));
    if (by_pilot && !piloted) {
        desc = buyer_light(&desc);
        desc.cache_background = true;
    }
    const double queued_ms = (double)(clock_ms() - in->ready_ms);

    d->looks = now.looks;
    d->latest = NULL; /* this may be its slot, and its frame is gone */
    const enum err result = piloted ? run_pilot(d, e, &desc, &now, out->rgb, &stats, &pilot)
                                    : relighter_run(relighter, e, &desc, out->rgb, &stats);
    if (result == ERR_UNSUPPORTED || result == ERR_RANGE) { /* this layout, or this size: the picture before stays */
        server_frame_fate(d->server, &in->ticket, SERVER_REFUSED, why->text);
        daemon_tell_unusable(d, why->text);
        return ERR_OK;
    }
    if (result)
        return err_say(why, result, "%s: no memory for the light samples", e->name);
    if (stop_asked) /* half a picture is none */
        return ERR_OK;
    const struct protocol_picture header = /* the slot is the encoder's once published */
        header_of(d, in, queued_ms, &stats, piloted ? pilot.samples : desc.direct.samples);
    out->header = header;
    out->ticket = in->ticket;
    out->anew = anew;
    daemon_probe_picture(d, out);
    const int dropped = handoff_publish(&d->pictures, slot);
    if (dropped != HANDOFF_NONE)
        server_frame_fate(d->server, &d->shaded[dropped].ticket, SERVER_SUPERSEDED, NULL);
    const double shaded_s = clock_seconds();
    daemon_tell_shaded(d, &(struct shaded_news){ in, header, &desc, &stats, piloted ? &pilot : NULL,
                                                 *last_s > 0.0 ? shaded_s - *last_s : 0.0 });
    if (piloted && buyer_may(&desc))
        buyer_step(&d->buyer, d->relighter, d->set, &desc, &stats, &pilot, &(struct buyer_wish){ 0, now.error, true });
    if (by_pilot && !piloted)
        buyer_watch(&d->buyer, stats.cache_refused);
    daemon_still_open(d, &(struct still_frame){ in, out, desc, header, shaded_s, shaded_s - *last_s });
    *last_s = shaded_s;
    return ERR_OK;
}

/* Seconds between pictures: with nobody watching, one a second keeps the last one fresh for whoever comes; a recorder
 * waits for every frame, as fast as they can be made. */
static double pace_s(struct daemon *d)
{
    struct server_demand demand;

    server_demand(d->server, &demand);
    if (demand.recorder)
        return 0.0;
    return demand.viewers ? 1.0 / daemon_settings(d).fps : 1.0;
}

/* What controllers have asked for, as far as it is a matter of this thread. A new view is that of the frame in `held`,
 * which a lockstep sequence's never is. */
static enum err obey(struct daemon *d, int held, double *last_s, struct reason *why)
{
    if (atomic_exchange(&reload_asked, false))
        daemon_reload(d);
    daemon_take_control(d);
    if (daemon_camera_follow(d) && held != HANDOFF_NONE && !d->ingested[held].ticket.lockstep) {
        const enum err e = shade_frame(d, &d->ingested[held], true, last_s, why);
        if (e)
            return e;
    }
    if (atomic_exchange(&d->show_again, false) || daemon_settings(d).looks != d->looks)
        daemon_still_show(d);
    return ERR_OK;
}

static enum err shade_all(struct daemon *d, struct reason *why)
{
    double begun_s = 0.0, last_s = 0.0;
    int held = HANDOFF_NONE; /* the frame that is shown, until the next one is taken */
    enum err e = ERR_OK;

    while (!e && !stop_asked) {
        server_beat(d->server);
        atomic_store(&stirred, false); /* what came before is seen below; what comes from here on ends a pass */
        e = obey(d, held, &last_s, why);
        if (e)
            break;
        daemon_probe_answer(d);
        const double due_s = begun_s + pace_s(d), now_s = clock_seconds();
        if (now_s < due_s) {
            nap_ms(2);
            continue;
        }
        const bool still = daemon_still_is_due(d);
        if (!handoff_wait_newer(&d->frames, still ? 0 : LISTEN_MS)) {
            if (still && !stop_asked)
                e = daemon_still_pass(d, why);
            continue;
        }
        daemon_still_close(d);
        if (held != HANDOFF_NONE)
            handoff_release(&d->frames, held);
        held = handoff_take(&d->frames, 0);
        if (held == HANDOFF_NONE) /* closed */
            continue;
        /* On the grid of the wished rate, unless it was missed by more than a picture. */
        begun_s = now_s - due_s < pace_s(d) ? due_s : now_s;
        e = shade_frame(d, &d->ingested[held], false, &last_s, why);
    }
    return e;
}

/* ---- Wiring ---- */

static enum err allocate(struct daemon *d, struct reason *why)
{
    const size_t pixels = (size_t)d->set_desc.width * d->set_desc.height;
    bool all;

    d->first_relighter = d->relighter = relighter_create(d->set, d->kernels);
    d->jpeg = jpeg_encoder_create();
    d->small = mem_alloc(pixels / 4 + 1, 3 * sizeof(float));
    d->tables = resample_tables_create();
    all = d->tables && d->small;
    for (int scale = 0; scale < SERVER_SCALES && all; scale++) {
        d->display[scale] = mem_alloc((pixels >> 2 * scale) + 1, 3);
        all = d->display[scale] != NULL;
    }
    for (int i = 0; i < HANDOFF_SLOTS && all; i++) {
        d->ingested[i].environment = environment_create(
            &(struct environment_desc){ .layout = d->layout, .importance = d->importance, .tables = d->tables });
        d->shaded[i].rgb = mem_alloc(pixels, 3 * sizeof(float));
        all = all && d->ingested[i].environment && d->shaded[i].rgb;
    }
    exposure_init(&d->exposure);
    if (!all || !d->relighter || !d->jpeg)
        return err_say(why, ERR_NOMEM, "no memory for pictures of %ux%u", d->set_desc.width, d->set_desc.height);
    return ERR_OK;
}

/* What the method needs before its first frame: until that is there nothing is shown, and whoever looks is told why. */
static enum err prepare(struct daemon *d, struct reason *why)
{
    struct relight_desc light = d->light;
    double ms;

    if ((light.direct.method == METHOD_CACHED && !light.cache_background) || light.caustics == PLAN_STORED)
        daemon_tell_source(d, SERVER_WAITING, "light transport is being computed");
    light.direct.cancel = &stop_asked;
    light.direct.why = why;
    return relighter_prepare(d->relighter, &light, d->set_desc.progress, &ms);
}

/* The port first: if it is taken, say so before the long work; then the source, for the same reason. */
static enum err set_up(struct daemon *d, struct reason *why)
{
    enum err e = server_create(&d->server_desc, &d->server, why);

    if (!e && !d->push)
        e = source_open(&d->source_desc, &d->source, why);
    if (!e)
        e = daemon_decoder_begin(d, &stop_asked, why);
    if (e)
        return e;
    if (!d->push) {
        d->kind = source_kind(d->source);
        d->length = source_count(d->source);
    }
    daemon_tell_start(d);
    daemon_tell_source(d, SERVER_WAITING, "the scene is being prepared");
    e = daemon_service_begin(d, why);
    if (!e)
        e = set_create(&d->set_desc, &d->first_set, why);
    d->set = d->first_set;
    if (!e)
        e = allocate(d, why);
    if (!e)
        e = prepare(d, why);
    if (!e) {
        daemon_tell_cameras(d);
        daemon_tell_control(d, d->set->camera);
        daemon_state_open(d);
        daemon_tell_control(d, daemon_settings(d).camera);
    }
    if (!e)
        daemon_tell_source(d, SERVER_WAITING,
                           d->push ? "no producer has sent a frame yet" : "the first frame of the sky is being read");
    return e;
}

static enum err run(struct daemon *d, struct reason *why)
{
    d->ingesting = pthread_create(&d->ingest_thread, NULL, daemon_ingest_main, d) == 0;
    d->encoding = pthread_create(&d->encode_thread, NULL, daemon_encode_main, d) == 0;
    d->watching = pthread_create(&d->watch_thread, NULL, daemon_watch_main, d) == 0;
    if (!d->ingesting || !d->encoding || !d->watching)
        return err_say(why, ERR_NOMEM, "a thread could not be started");
    log_info("listening on %s", server_url(d->server));
    return shade_all(d, why);
}

static void tear_down(struct daemon *d)
{
    if (d->server)
        server_drain(d->server);
    handoff_close(&d->frames);
    handoff_close(&d->pictures);
    if (d->ingesting)
        pthread_join(d->ingest_thread, NULL);
    daemon_decoder_end(d);
    if (d->encoding)
        pthread_join(d->encode_thread, NULL);
    daemon_service_end(d);
    if (d->watching)
        pthread_join(d->watch_thread, NULL);
    daemon_state_close(d);
    progress_show(stderr, "");
    server_destroy(d->server);
    for (int i = 0; i < HANDOFF_SLOTS; i++) {
        environment_destroy(d->ingested[i].environment);
        mem_free(d->shaded[i].rgb);
    }
    resample_tables_destroy(d->tables);
    for (int scale = 0; scale < SERVER_SCALES; scale++)
        mem_free(d->display[scale]);
    mem_free(d->small);
    daemon_video_finish(d);
    jpeg_encoder_destroy(d->jpeg);
    pilot_destroy(d->pilot);
    still_destroy(d->still);
    prober_destroy(d->prober);
    mem_free(d->sky_text);
    daemon_camera_finish(d);
    source_close(d->source);
    handoff_finish(&d->frames);
    handoff_finish(&d->pictures);
    pthread_mutex_destroy(&d->settings_lock);
    pthread_mutex_destroy(&d->status_lock);
    daemon_config_finish(d);
}

int main(int argc, char **argv)
{
    static struct daemon d; /* zeroed, and too large for a stack */
    struct reason why = { "" };
    bool done = false;

    threads_wait_passively(argv);
    log_init("relightd", LOG_INFO);
    handoff_init(&d.frames);
    handoff_init(&d.pictures);
    pthread_mutex_init(&d.settings_lock, NULL);
    pthread_mutex_init(&d.status_lock, NULL);
    /* The second signal of a kind ends the program at once, whatever it is doing. */
    sigaction(SIGINT, &(struct sigaction){ .sa_handler = ask_to_stop, .sa_flags = (int)SA_RESETHAND }, NULL);
    sigaction(SIGTERM, &(struct sigaction){ .sa_handler = ask_to_stop, .sa_flags = (int)SA_RESETHAND }, NULL);
    sigaction(SIGALRM, &(struct sigaction){ .sa_handler = leave_now }, NULL);
    sigaction(SIGHUP, &(struct sigaction){ .sa_handler = ask_to_reload }, NULL);
    sigaction(SIGPIPE, &(struct sigaction){ .sa_handler = SIG_IGN }, NULL);
    d.stirred = d.server_desc.stirred = &stirred;
    d.server_desc.leave = &stop_asked;
    enum err e = daemon_read_options(&d, argc, argv, &done, &why);
    if (!e && !done) {
        log_configure(&d.log);
        e = set_up(&d, &why);
    }
    if (!e && !done)
        e = run(&d, &why);
    tear_down(&d);
    if (e)
        log_error("%s", why.text[0] ? why.text : err_text(e));
    else if (!done)
        log_info("stopped");
    log_flush(true);
    return err_exit_code(e);
}
