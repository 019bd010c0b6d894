/* The server's main program: a sky comes in, images go out. Three threads form a pipeline:
 *     ingest   source or producer -> decode -> cube map and sampling tables       ingest.h
 *     shade    (main) light at the shade points -> linear image; refines it     shade.h
 *     encode   exposure -> tone curve -> JPEG, H.264 or EXR                       encode.h
 * A handoff of three slots connects two threads (shared.h): the newest wins, and no thread waits for a copy. The
 * network thread belongs to net/stream/server.h; service_manager.h and service_manager.h monitor the process. */
#include "relightd/daemon/encode.h"
#include "relightd/daemon/ingest.h"
#include "relightd/daemon/job.h"
#include "relightd/daemon/service_manager.h"
#include "relightd/daemon/settings.h"
#include "relightd/daemon/shade.h"
#include "relightd/daemon/shared.h"

#include "base/log.h"
#include "base/process.h"
#include "base/progress.h"
#include "job/ranks/ranks.h"

#include <omp.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define OWN_THREADS 6     /* network, ingest, encode, housekeeping, service manager, and one for a camera or a cache */
#define PUBLISH_THREADS 4 /* of each target: its own, and those of the SRT library */
#define STOP_S 5          /* from the signal to the end, whatever is in progress */

/* Signal handlers can reach nothing else; struct shared points to them. */
static atomic_bool stop_asked;
static atomic_bool reload_asked;
static atomic_bool new_work;
static atomic_bool stopped; /* in good order: only libraries' exit handlers are left */

struct daemon {
    struct shared shared;
    struct ingest_thread *ingest;
    struct shade_thread *shade;
    struct encode_thread *encode;
    struct housekeeping_thread housekeeping;
    struct service_thread service;
    struct state_file state;
    struct job job;
    bool left_behind; /* a thread that cannot be ended is still there */
};

/* ---- Signals ---- */

static void on_stop(int signal_number)
{
    (void)signal_number;
    atomic_store(&stop_asked, true); /* lock-free, so a handler may */
    atomic_store(&new_work, true);
    alarm(STOP_S);
}

/* Loading a scene or a large frame cannot be interrupted. Exiting during it loses nothing: files are renamed when
 * complete, and the network thread has notified every client. */
static void on_alarm(int signal_number)
{
    static const char words[] = "relightd: warning: stopped while work was still running\n";

    (void)signal_number;
    if (!atomic_load(&stopped) && write(STDERR_FILENO, words, sizeof(words) - 1) < 0)
        _exit(1);
    _exit(0);
}

static void on_reload(int signal_number)
{
    (void)signal_number;
    atomic_store(&reload_asked, true);
    atomic_store(&new_work, true);
}

static void handle_signals(void)
{
    /* A second signal of the same kind ends the program at once. */
    sigaction(SIGINT, &(struct sigaction){ .sa_handler = on_stop, .sa_flags = (int)SA_RESETHAND }, NULL);
    sigaction(SIGTERM, &(struct sigaction){ .sa_handler = on_stop, .sa_flags = (int)SA_RESETHAND }, NULL);
    sigaction(SIGALRM, &(struct sigaction){ .sa_handler = on_alarm }, NULL);
    sigaction(SIGHUP, &(struct sigaction){ .sa_handler = on_reload }, NULL);
    sigaction(SIGPIPE, &(struct sigaction){ .sa_handler = SIG_IGN }, NULL);
}

/* ---- Begin, run, end ---- */

/* Opens the port and the source first: if one fails, say so before the long work. */
static enum err open_outside(struct daemon *d, struct reason *why)
{
    struct shared *s = &d->shared;
    enum err e = server_create(&s->config.server_desc, &s->server, why);

    s->settings.server = s->server;
    if (!e && server_port(s->server) == 0)
        e = err_say(why, ERR_IO, "no socket could be opened to listen on");
    if (!e)
        e = ingest_thread_create(s, &d->ingest, why);
    if (e)
        return e;
    status_begin(&s->status, s);
    status_set_source(&s->status, SERVER_WAITING, "the scene is being prepared");
    return service_manager_start(&d->service, s, why);
}

static enum err load_scene(struct daemon *d, struct reason *why)
{
    struct shared *s = &d->shared;
    enum err e = ingest_thread_start(d->ingest, why); /* beside it, the first frame */

    if (!e)
        e = shade_thread_create(s, &d->shade, why);
    if (!e)
        e = encode_thread_create(s, &d->encode, why);
    return e;
}

/* Computes what the method needs, and restores the settings of the last run. */
static enum err prepare(struct daemon *d, struct reason *why)
{
    struct shared *s = &d->shared;
    enum err e = job_lead(&d->job, s, d->shade, why);

    if (!e)
        e = shade_thread_prepare(d->shade, why);
    if (e)
        return e;
    const struct prepared_scene *set = d->shade->set;
    s->settings.scene = set->scene;
    s->settings.estimate = shade_thread_estimate;
    s->settings.estimate_user = d->shade;
    status_set_cameras(&s->status, &s->settings, set->camera);
    status_set_view(&s->status, set->placed);
    settings_set_camera(&s->settings, set->camera);
    state_open(&d->state, &s->config, &s->settings, set->camera);
    settings_send(&s->settings);
    status_set_source(&s->status, SERVER_WAITING,
                      s->config.push ? "no producer has sent a frame yet" : "the first frame of the sky is being read");
    return ERR_OK;
}

static enum err run(struct daemon *d, struct reason *why)
{
    struct shared *s = &d->shared;
    enum err e = publisher_create(s->config.publish, s->config.publish_urls.count, &s->publisher, why);

    if (!e)
        ingest_thread_go_on(d->ingest);
    if (!e)
        e = encode_thread_start(d->encode, why);
    if (!e)
        e = housekeeping_start(&d->housekeeping, s, &d->state, why);
    if (e)
        return e;
    char page[320];
    links_page(&s->config.server_desc, server_port(s->server), page, sizeof(page));
    log_info("listening on %s", server_url(s->server));
    if (strcmp(page, server_url(s->server)) != 0)
        log_info("the page is at %s", page);
    struct server_desc known = s->config.server_desc;
    known.port = server_port(s->server);
    if (s->config.tells_links && links_print(&known, stdout, isatty(STDOUT_FILENO) == 1, why) == ERR_OK)
        fflush(stdout);
    return shade_thread_run(d->shade, why);
}

static void tear_down(struct daemon *d)
{
    struct shared *s = &d->shared;

    job_leave(&d->job);
    if (s->server)
        server_drain(s->server);
    shared_close(s);
    ingest_thread_destroy(d->ingest);
    encode_thread_destroy(d->encode);
    service_manager_stop(&d->service);
    housekeeping_join(&d->housekeeping);
    d->left_behind = !publisher_destroy(s->publisher);
    if (d->left_behind)
        log_warning("publishing did not stop in time and was abandoned");
    state_close(&d->state);
    progress_show(stderr, "");
    server_destroy(s->server);
    shade_thread_destroy(d->shade);
    shared_finish(s);
}

/* Those of OpenMP and of Embree's TBB, which abort the program where one is missing, and our own. */
static enum err check_threads(const struct daemon *d, struct reason *why)
{
    const unsigned count = (unsigned)omp_get_max_threads() + (unsigned)omp_get_num_procs() + OWN_THREADS +
                           PUBLISH_THREADS * d->shared.config.publish_urls.count;

    return threads_can_start(count, why) ? ERR_OK : ERR_NOMEM;
}

static enum err serve(struct daemon *d, struct reason *why)
{
    enum err e = shared_init(&d->shared, why);

    if (!e)
        e = open_outside(d, why);
    if (!e)
        e = load_scene(d, why);
    e = ranks_agree(d->shared.ranks, e, why);
    if (!e)
        e = prepare(d, why);
    if (!e)
        e = run(d, why);
    tear_down(d);
    return e;
}

int main(int argc, char **argv)
{
    static struct daemon d; /* zeroed, and too large for a stack */
    struct shared *s = &d.shared;
    struct reason why = { "" };
    bool done = false;
    uint32_t rank = 0;

    process_settle(argv);
    log_init("relightd", LOG_INFO);
    handle_signals();
    s->stop = &stop_asked;
    s->reload = &reload_asked;
    s->new_work = &new_work;
    enum err e = daemon_config_read(&s->config, &s->readings, argc, argv, &done, &why);
    s->config.server_desc.new_work = &new_work;
    s->config.server_desc.leave = &stop_asked;
    if (!e && !done) {
        log_configure(&s->config.log);
        e = job_join(&d.job, s, argc, argv, &why);
        if (!e)
            e = ranks_agree(s->ranks, check_threads(&d, &why), &why);
        if (!e)
            e = ranks_index(s->ranks) > 0 ? job_serve(&d.job, s, &why) : serve(&d, &why);
        rank = ranks_index(s->ranks);
        ranks_destroy(s->ranks);
    }
    config_readings_finish(&s->readings);
    if (e && !(d.job.joined && !why.text[0])) /* else another rank reports it */
        log_error("%s", why.text[0] ? why.text : err_text(e));
    else if (!done && rank == 0)
        log_info("stopped");
    log_flush(true);
    atomic_store(&stopped, true);
    /* Out of memory or threads, libraries may wait in their exit handlers for threads that they never had. */
    if (e || d.left_behind) {
        fflush(NULL);
        _exit(err_exit_code(e));
    }
    return 0;
}
