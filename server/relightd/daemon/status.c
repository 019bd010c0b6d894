#include "relightd/daemon/shared.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "light/frame/pilot.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

static const char *const panoramic[] = { "latlong", "latlong-rows", NULL };

void status_init(struct status_board *b, struct shared *shared)
{
    b->figures.not_offered = panoramic; /* until a sky is there */
    pthread_mutex_init(&b->lock, NULL);
    b->frames = &shared->frames.handoff;
    b->images = &shared->images.handoff;
}

void status_finish(struct status_board *b)
{
    pthread_mutex_destroy(&b->lock);
    mem_free(b->cameras);
}

/* {lock} */
static void send_figures(struct status_board *b)
{
    b->figures.frames_waiting = handoff_wait_newer(b->frames, 0);
    b->figures.images_waiting = handoff_wait_newer(b->images, 0);
    server_set_figures(b->server, &b->figures);
}

/* Copies text, and cuts it where it does not fit. */
static void copy(char *to, size_t size, const char *text)
{
    snprintf(to, size, "%s", text);
}
#define COPY(to, text) copy(to, sizeof(to), text)

/* Appends to text[size], with `between` where text is not empty. */
PRINTF_LIKE(4, 5) static void append(char *text, size_t size, const char *between, const char *format, ...)
{
    const size_t used = strlen(text), after = used + (used ? strlen(between) : 0);
    va_list args;

    if (after >= size)
        return;
    if (used)
        memcpy(text + used, between, after - used);
    va_start(args, format);
    vsnprintf(text + after, size - after, format, args);
    va_end(args);
}

/* Names of the scene's cameras and the saved views, in one block with their text; NULL: out of memory. */
static const char **list_cameras(struct settings_store *settings)
{
    const struct scene *scene = settings->scene;
    struct saved_view views[SAVED_VIEWS];
    const size_t saved = settings_views(settings, views), count = scene->camera_count + saved;
    const char **names = mem_alloc(1, (count + 1) * sizeof(*names) + count * sizeof(views[0].name));
    char *text = (char *)(names + count + 1);

    for (size_t i = 0; names && i < count; i++, text += sizeof(views[0].name)) {
        const bool own = i < scene->camera_count;
        copy(text, sizeof(views[0].name), own ? scene->cameras[i].name : views[i - scene->camera_count].name);
        names[i] = text;
    }
    return names;
}

void status_set_cameras(struct status_board *b, struct settings_store *settings, const char *shown)
{
    const char **names = list_cameras(settings);

    pthread_mutex_lock(&b->lock);
    const char **old = b->cameras;
    b->figures.cameras = b->cameras = names;
    b->figures.views = names ? names + settings->scene->camera_count : NULL; /* the last ones */
    b->figures.loaded = true;
    send_figures(b); /* after which the server reads the old list no more */
    mem_free(old);
    pthread_mutex_unlock(&b->lock);
    status_camera_progress(b, shown, 1.0);
}

void status_set_view(struct status_board *b, const char *view)
{
    pthread_mutex_lock(&b->lock);
    COPY(b->figures.view, view);
    send_figures(b);
    pthread_mutex_unlock(&b->lock);
}

/* {lock} */
static void set_kind(struct status_board *b, const struct shared *shared)
{
    static const char *const kinds[] = {
        [SOURCE_FILES] = "files", [SOURCE_WATCH] = "folder", [SOURCE_SKY] = "sky",
        [SOURCE_VIDEO] = "files", [SOURCE_LIVE] = "live",    [SOURCE_DAYLIGHT] = "daylight"
    };

    COPY(b->figures.kind, shared->config.push ? "producer" : kinds[shared->settings.source_kind]);
    b->figures.length = shared->settings.source_length;
}

void status_set_kind(struct status_board *b, const struct shared *shared)
{
    pthread_mutex_lock(&b->lock);
    set_kind(b, shared);
    send_figures(b);
    pthread_mutex_unlock(&b->lock);
}

void status_begin(struct status_board *b, const struct shared *shared)
{
    const struct daemon_config *c = &shared->config;
    struct server_figures *f = &b->figures;
    char name[sizeof(f->sky)];

    b->server = shared->server;
    pthread_mutex_lock(&b->lock);
    COPY(f->scene, c->setup.set_desc.scene ? c->setup.set_desc.scene : "the built-in scene");
    COPY(f->sky, c->computed_sky ? "a computed sky"
                 : c->push       ? "a sky sent by a producer"
                                 : source_name(c->setup.source_desc.spec, name, sizeof(name)));
    COPY(f->method, method_name(method_by_rule(c->setup.initial.method)));
    set_kind(b, shared);
    f->samples = c->setup.initial.samples;
    f->width = c->setup.set_desc.width;
    f->height = c->setup.set_desc.height;
    pthread_mutex_unlock(&b->lock);
}

/* {lock} */
static void set_source(struct status_board *b, enum server_source source, const char *detail)
{
    if (b->figures.source != source || strcmp(b->figures.detail, detail) != 0 || b->figures.since_us == 0)
        b->figures.since_us = clock_wall_us();
    b->figures.source = source;
    COPY(b->figures.detail, detail);
    send_figures(b);
}

/* {lock} A paused source stays paused in the status, so that producers do not wait in vain for it to take frames. */
static void set_failed(struct status_board *b, const char *why)
{
    b->figures.refused++;
    COPY(b->figures.last_refusal, why);
    if (b->figures.source != SERVER_PAUSED)
        set_source(b, SERVER_FAILED, why);
}

void status_set_source(struct status_board *b, enum server_source source, const char *detail)
{
    pthread_mutex_lock(&b->lock);
    set_source(b, source, detail);
    pthread_mutex_unlock(&b->lock);
}

void status_between(struct status_board *b, const char *what, double delay_s)
{
    pthread_mutex_lock(&b->lock);
    COPY(b->figures.between, what);
    b->figures.between_delay_s = delay_s;
    send_figures(b);
    pthread_mutex_unlock(&b->lock);
}

void status_producer_left(struct status_board *b)
{
    char detail[96] = "the producer disconnected; its last sky stays", time_of_day[16];
    const time_t now = (time_t)(clock_wall_us() / 1000000);
    struct tm t;

    if (gmtime_r(&now, &t) && strftime(time_of_day, sizeof(time_of_day), "%H:%M:%S", &t) > 0)
        snprintf(detail, sizeof(detail), "the producer disconnected at %s UTC; its last sky stays", time_of_day);
    status_set_source(b, SERVER_WAITING, detail);
}

void status_frame_unreadable(struct status_board *b, const char *why, bool log)
{
    if (log)
        log_warning("%s", why);
    pthread_mutex_lock(&b->lock);
    b->figures.received++;
    b->figures.unreadable++;
    set_failed(b, why);
    pthread_mutex_unlock(&b->lock);
}

void status_frame_unusable(struct status_board *b, const char *why)
{
    log_warning("%s", why);
    pthread_mutex_lock(&b->lock);
    b->figures.unusable++;
    set_failed(b, why);
    pthread_mutex_unlock(&b->lock);
}

/* What the plan chose and what it left out: "direct light, indirect light by eye paths". */
static void note_plan(struct server_figures *f, const struct image_report *report)
{
    static const char between[] = ", ";
    const struct relight_stats *s = report->stats;
    const struct pilot_stats *pilot = report->pilot;
    const struct plan *p = &s->plan;
    const size_t size = sizeof(f->paths);

    f->paths[0] = f->left_out[0] = '\0';
    if (report->light->classes & PATH_DIRECT)
        append(f->paths, size, between, "direct light%s", s->direct.sun ? " with a separate sun" : "");
    if (pilot && pilot->part[PILOT_DIRECT].n > 0.0)
        append(f->paths, size, between, "%.0f samples a point of %s", pilot->part[PILOT_DIRECT].n,
               pilot->part[PILOT_DIRECT].name);
    if (p->caustics != PLAN_NONE)
        append(f->paths, size, between, "caustics by %s", plan_estimator_name(p->caustics));
    if (p->indirect != PLAN_NONE)
        append(f->paths, size, between, "indirect light by %s", plan_estimator_name(p->indirect));
    for (uint32_t k = 0; k < p->left_out_count; k++)
        append(f->left_out, sizeof(f->left_out), "; ", "%s", p->left_out[k]);
    if (report->coarse)
        append(f->left_out, sizeof(f->left_out), "; ",
               "all camera rays but one per pixel (edges and glass are coarse until the view is complete)");
}

void status_frame_received(struct status_board *b, const struct image_faults *faults, bool replaced)
{
    pthread_mutex_lock(&b->lock);
    b->figures.received++;
    b->figures.dropped += replaced;
    b->figures.repaired += faults->nan + faults->infinite + faults->negative;
    send_figures(b);
    pthread_mutex_unlock(&b->lock);
}

/* Time, sun and place of a moment of a weather file. */
static void note_weather(struct server_figures *f, const struct ingested *in)
{
    const struct source_place *p = &in->place;

    f->hour = p->hour;
    f->day = p->day;
    f->latitude = p->latitude;
    f->longitude = p->longitude;
    f->zone = p->zone;
    f->north = p->north;
    f->units = p->units;
    f->sun_elevation = p->sun_elevation;
    f->sun_azimuth = p->sun_azimuth;
    snprintf(f->sky_time, sizeof(f->sky_time), "%02u:%02u", (unsigned)f->hour % 24u, (unsigned)(f->hour * 60.0) % 60u);
}

/* The sun of a computed sky. */
static void note_sun(struct server_figures *f, const struct ingested *in)
{
    const double frame = (double)in->environment->number;
    struct sky_state s;

    f->has_sun = f->has_hour = in->has_sky || in->has_place;
    f->has_place = in->has_place;
    if (in->has_place)
        note_weather(f, in);
    if (!in->has_sky && !in->has_place && in->has_sun) {
        f->has_sun = true;
        f->sun_elevation = in->sun.elevation;
        f->sun_azimuth = in->sun.azimuth;
    }
    if (!in->has_sky)
        return;
    sky_state_at(&in->sky, in->environment->number, &s);
    const double hours = in->sky.hour + in->sky.speed_hours * frame;
    const double azimuth = atan2(-s.sun_direction[0], s.sun_direction[2]) * 180.0 / PI; /* north +Z, east -X */
    f->hour = hours - 24.0 * floor(hours / 24.0);
    f->sun_elevation = s.sun_elevation * 180.0 / PI;
    f->sun_azimuth = azimuth < 0.0 ? azimuth + 360.0 : azimuth;
    snprintf(f->sky_time, sizeof(f->sky_time), "%02u:%02u", (unsigned)f->hour % 24u, (unsigned)(f->hour * 60.0) % 60u);
}

/* {lock} Rays and samples of one image, and what its stages took. */
static void note_work(struct status_board *b, const struct image_report *report)
{
    struct server_figures *f = &b->figures;
    const struct relight_stats *s = report->stats;
    const struct protocol_picture *p = &report->header;
    const uint64_t cache_rays = s->cache.rays + s->indirect.rays;

    f->direct_rays += s->direct.rays;
    f->eye_rays += s->eye.rays;
    f->light_rays += s->light.rays + s->stored.rays;
    f->cache_rays += s->cache_frame.rays + (cache_rays > b->cache_rays ? cache_rays - b->cache_rays : 0);
    b->cache_rays = cache_rays;
    f->generated += s->direct.generated;
    f->chosen += s->direct.chosen;
    f->effective += s->direct.effective;
    f->cache_bytes = s->cache.bytes;
    f->cache_share = s->cache_share;
    server_observe(b->server, SERVER_DECODE, 1e-6 * p->decoded_us);
    server_observe(b->server, SERVER_QUEUE, 1e-6 * p->queued_us);
    server_observe(b->server, SERVER_SHADE, 1e-6 * p->shaded_us);
}

void status_image_shaded(struct status_board *b, const struct image_report *report)
{
    const struct protocol_picture *p = &report->header;
    const struct relight_stats *stats = report->stats;

    pthread_mutex_lock(&b->lock);
    struct server_figures *s = &b->figures;
    const bool again = p->flags & PROTOCOL_PICTURE_FINER; /* of a frame that was counted before */
    s->used += !again;
    s->frame = p->frame;
    s->position = report->in->position;
    /* The method that auto chose, where it is a single one. */
    COPY(s->method, stats->cache.bytes > 0 ? method_name(METHOD_CACHED)
                    : report->pilot || stats->cache_refused
                        ? "auto"
                        : method_name(method_by_rule(report->light->direct.method)));
    s->samples = p->samples;
    if (!again) {
        s->queued_ms = smooth(s->queued_ms, 1e-3 * p->queued_us);
        s->decoded_ms = smooth(s->decoded_ms, 1e-3 * p->decoded_us);
    }
    b->uneven_ms = smooth(b->uneven_ms, fabs(1e-3 * p->shaded_us - s->shaded_ms));
    s->shaded_ms = smooth(s->shaded_ms, 1e-3 * p->shaded_us);
    if (report->interval_s > 0.0)
        s->fps = 1.0 / smooth(s->fps > 0.0 ? 1.0 / s->fps : 0.0, report->interval_s);
    note_sun(s, report->in);
    s->not_offered = environment_is_latlong(report->in->environment) ? NULL : panoramic; /* methods for lat-long maps */
    note_plan(s, report);
    note_work(b, report);
    s->audit_s += stats->audited.processor_s;
    s->error = stats->error > 0.0 ? stats->error : report->pilot ? report->pilot->error : 0.0;
    s->error_at_most = s->error > 0.0 ? 0.0 : stats->error_at_most;
    s->passes = 0;
    s->converged = false;
    send_figures(b);
    pthread_mutex_unlock(&b->lock);
}

void status_camera_progress(struct status_board *b, const char *camera, double share)
{
    const bool there = share >= 1.0;

    pthread_mutex_lock(&b->lock);
    const bool news = there || strcmp(b->figures.preparing, camera) != 0 || share >= b->figures.prepared + 0.02;
    if (news) {
        COPY(b->figures.preparing, there ? "" : camera);
        if (there)
            COPY(b->figures.camera, camera);
        b->figures.prepared = share;
        send_figures(b);
    }
    pthread_mutex_unlock(&b->lock);
}

void status_set_lamps(struct status_board *b, uint32_t samples, uint32_t wanted)
{
    pthread_mutex_lock(&b->lock);
    const bool news = b->figures.lamp_samples != samples || b->figures.lamp_samples_wanted != wanted;
    b->figures.lamp_samples = samples;
    b->figures.lamp_samples_wanted = wanted;
    if (news)
        send_figures(b);
    pthread_mutex_unlock(&b->lock);
}

void status_image_refined(struct status_board *b, const struct refiner_stats *stats)
{
    pthread_mutex_lock(&b->lock);
    b->figures.all_passes += stats->passes > b->figures.passes ? stats->passes - b->figures.passes : 0;
    b->figures.error = stats->error;
    b->figures.error_at_most = 0.0;
    b->figures.passes = stats->passes;
    b->figures.converged = stats->converged;
    send_figures(b);
    pthread_mutex_unlock(&b->lock);
}

void status_image_encoded(struct status_board *b, double ms)
{
    pthread_mutex_lock(&b->lock);
    b->figures.encoded_ms = smooth(b->figures.encoded_ms, ms);
    send_figures(b);
    pthread_mutex_unlock(&b->lock);
}

void status_image_late(struct status_board *b, double seconds, bool first)
{
    pthread_mutex_lock(&b->lock);
    b->figures.late += first;
    b->figures.late_s = seconds;
    send_figures(b);
    pthread_mutex_unlock(&b->lock);
}

bool status_all_frames_done(struct status_board *b)
{
    pthread_mutex_lock(&b->lock);
    const struct server_figures *s = &b->figures;
    const bool all = s->used + s->dropped + s->refused >= s->received;
    pthread_mutex_unlock(&b->lock);
    return all;
}

double status_shading_excess_ms(struct status_board *b)
{
    pthread_mutex_lock(&b->lock);
    const double slack = b->figures.shaded_ms - b->uneven_ms - b->figures.decoded_ms;
    pthread_mutex_unlock(&b->lock);
    return slack > 0.0 ? slack : 0.0;
}

void status_decoder(struct status_board *b, const struct decoder_counts *counts, bool confined)
{
    pthread_mutex_lock(&b->lock);
    struct server_figures *f = &b->figures;
    f->decoder_separate = true;
    f->decoder_confined = confined;
    f->decoder_files = counts->files;
    f->decoder_starts = counts->starts;
    f->decoder_died = counts->crashed;
    f->decoder_hung = counts->timed_out;
    f->decoder_lied = counts->invalid;
    f->decoder_waited = counts->refused;
    send_figures(b);
    pthread_mutex_unlock(&b->lock);
}

void status_set_publish(struct status_board *b, const struct server_publish *targets, uint32_t count)
{
    const size_t size = count * sizeof(*targets);

    pthread_mutex_lock(&b->lock);
    const bool news = b->figures.publish_count != count || memcmp(b->figures.publish, targets, size) != 0;
    memcpy(b->figures.publish, targets, size);
    b->figures.publish_count = count;
    if (news)
        send_figures(b);
    pthread_mutex_unlock(&b->lock);
}

static struct server_figures figures_now(struct status_board *b)
{
    pthread_mutex_lock(&b->lock);
    const struct server_figures f = b->figures;
    pthread_mutex_unlock(&b->lock);
    return f;
}

void status_line(struct status_board *b, uint32_t viewers, char *text, size_t size)
{
    static const char *const states[] = { "waiting", "", "paused", "ended", "the last frame was refused" };
    const struct server_figures f = figures_now(b);

    text[0] = '\0';
    if (!f.loaded || f.used == 0)
        return;
    append(text, size, "", "%.1f images/s, %u viewer%s", f.fps, viewers, viewers == 1 ? "" : "s");
    if (f.error > 0.0)
        append(text, size, ", ", "error %.1e", f.error);
    else if (f.error_at_most > 0.0)
        append(text, size, ", ", "error at most %.1e", f.error_at_most);
    if (f.cache_share > 0.0)
        append(text, size, ", ", "cache %.0f %%", 100.0 * f.cache_share);
    if (states[f.source][0])
        append(text, size, ", ", "%s", states[f.source]);
}

double status_cache_share(struct status_board *b)
{
    return figures_now(b).cache_share;
}

void status_sentence(struct status_board *b, uint32_t viewers, char *text, size_t size)
{
    const struct server_figures f = figures_now(b);

    if (f.source == SERVER_WAITING)
        snprintf(text, size, "Waiting: %s.", f.detail[0] ? f.detail : "nothing is loaded yet");
    else if (f.source == SERVER_FAILED)
        snprintf(text, size, "Showing an older frame to %u viewers: %s.", viewers, f.detail);
    else
        snprintf(text, size, "Showing frame %llu of %s to %u viewers, %.3g images a second.",
                 (unsigned long long)f.frame, f.sky, viewers, f.fps);
    for (char *p = text; *p; p++) /* a line end would start another assignment of the notify protocol */
        *p = *p == '\n' ? ' ' : *p;
}
