/* server/relightd_status.c */
#include "relightd.h"

#include "light_options.h"
#include "clock.h"
#include "log.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define SMOOTH 0.2 /* share of a new reading in the figures that viewers are shown */

static double smooth(double old, double reading)
{
    return old > 0.0 ? old + SMOOTH * (reading - old) : reading;
}

/* {status_lock} */
static void tell_figures(struct daemon *d)
{
    struct server_figures *f = &d->figures;
    const struct server_status *s = &d->status;

    f->received = s->received;
    f->used = s->used;
    f->superseded = s->dropped;
    f->repaired = s->repaired;
    f->fps = s->fps;
    f->error = s->error;
    f->frame = s->frame;
    f->frames_waiting = handoff_wait_newer(&d->frames, 0);
    f->pictures_waiting = handoff_wait_newer(&d->pictures, 0);
    server_set_figures(d->server, f);
}

/* What a controller may ask for: names, one a line. */
static void add_line(char *text, size_t size, const char *name)
{
    const size_t used = strlen(text);
    if (used + 1 + strlen(name) < size) /* whole, or not at all */
        snprintf(text + used, size - used, "%s%s", used ? "\n" : "", name);
}

static void note_offers(struct daemon *d)
{
    for (int m = 0; m < METHOD_COUNT; m++)
        if (!method_is_reference((enum method)m))
            add_line(d->methods, sizeof(d->methods), method_name((enum method)m));
    for (int t = TONE_FILMIC; t <= TONE_LINEAR; t++)
        add_line(d->tones, sizeof(d->tones), tone_name((enum tone_curve)t));
    add_line(d->paths_known, sizeof(d->paths_known), paths_name(PATH_BACKGROUND | PATH_DIRECT));
    add_line(d->paths_known, sizeof(d->paths_known), paths_name(PATH_ALL));
}

void daemon_tell_cameras(struct daemon *d)
{
    const struct scene *scene = d->first_set->scene;

    pthread_mutex_lock(&d->status_lock);
    for (size_t i = 0; i < scene->camera_count; i++)
        add_line(d->cameras, sizeof(d->cameras), scene->cameras[i].name);
    d->figures.loaded = true;
    tell_figures(d);
    pthread_mutex_unlock(&d->status_lock);
    daemon_tell_camera(d, d->first_set->camera, 1.0);
}

void daemon_tell_start(struct daemon *d)
{
    static const char *const kinds[] = { [SOURCE_FILES] = "files", [SOURCE_WATCH] = "folder", [SOURCE_SKY] = "sky" };

    note_offers(d);
    pthread_mutex_lock(&d->status_lock);
    d->status = (struct server_status){
        .scene = d->set_desc.scene ? d->set_desc.scene : "the built-in scene",
        .sky = d->computed_sky ? "a computed sky"
               : d->push       ? "a sky sent by a producer"
                               : d->source_desc.spec,
        .method = method_recipe(d->said.method)->name,
        .samples = d->said.samples,
        .width = d->set_desc.width,
        .height = d->set_desc.height,
        .source = SERVER_WAITING,
        .detail = d->detail,
        .last_refusal = d->refusal,
        .sky_time = d->sky_time,
        .paths = d->paths,
        .left_out = d->left_out,
        .kind = d->push ? "producer" : kinds[d->kind],
        .length = d->length,
        .camera = d->camera_shown,
        .preparing = d->preparing,
        .cameras = d->cameras,
        .methods = d->methods,
        .tones = d->tones,
        .paths_known = d->paths_known,
    };
    pthread_mutex_unlock(&d->status_lock);
}

void daemon_tell_source(struct daemon *d, enum server_source source, const char *detail)
{
    pthread_mutex_lock(&d->status_lock);
    if (d->status.source != source || strcmp(d->detail, detail) != 0 || d->status.since_us == 0)
        d->status.since_us = clock_wall_us();
    d->status.source = source;
    snprintf(d->detail, sizeof(d->detail), "%s", detail);
    server_set_status(d->server, &d->status);
    pthread_mutex_unlock(&d->status_lock);
}

static void note_refusal(struct daemon *d, enum server_waste waste, const char *why)
{
    d->status.refused++;
    d->figures.refused[waste]++;
    snprintf(d->refusal, sizeof(d->refusal), "%s", why);
    tell_figures(d);
}

void daemon_tell_gone(struct daemon *d)
{
    char detail[96] = "the producer is gone, its last sky stays", time_of_day[16];
    const time_t now = (time_t)(clock_wall_us() / 1000000);
    struct tm t;

    if (gmtime_r(&now, &t) && strftime(time_of_day, sizeof(time_of_day), "%H:%M:%S", &t) > 0)
        snprintf(detail, sizeof(detail), "the producer is gone since %s UTC, its last sky stays", time_of_day);
    daemon_tell_source(d, SERVER_WAITING, detail);
}

void daemon_tell_refused(struct daemon *d, const char *why, bool log)
{
    if (log)
        log_warning("%s", why);
    pthread_mutex_lock(&d->status_lock);
    d->status.received++;
    note_refusal(d, SERVER_UNREADABLE, why);
    pthread_mutex_unlock(&d->status_lock);
    daemon_tell_source(d, SERVER_FAILED, why);
}

void daemon_tell_unusable(struct daemon *d, const char *why)
{
    log_warning("%s", why);
    pthread_mutex_lock(&d->status_lock);
    note_refusal(d, SERVER_UNUSABLE, why);
    pthread_mutex_unlock(&d->status_lock);
    daemon_tell_source(d, SERVER_FAILED, why);
}

/* Adds a phrase to those in text[size], which are parted by `between`. */
static void add_phrase(char *text, size_t size, const char *between, const char *phrase, const char *more)
{
    const size_t used = strlen(text);
    snprintf(text + used, size - used, "%s%s%s", used ? between : "", phrase, more);
}

/* What the plan chose and what it left out: "direct light, interreflection by eye paths". */
static void note_plan(struct daemon *d, const struct shaded_news *news)
{
    static const char *const changed[] = { "", " (anew where the sky has changed)", " (as before but for a gain)",
                                           " (as before)" };
    const struct relight_stats *s = news->stats;
    const struct pilot_stats *pilot = news->pilot;
    const struct plan *p = &s->plan;
    const char *how_much = s->cache_frame.kept > 0 ? changed[s->cache_frame.what] : "";

    d->paths[0] = d->left_out[0] = '\0';
    if (news->light->classes & PATH_DIRECT)
        add_phrase(d->paths, sizeof(d->paths), ", ", "direct light", s->direct.sun ? " with the sun apart" : how_much);
    for (int k = PILOT_MATTE; pilot && k <= PILOT_GLOSSY; k++)
        if (pilot->part[k].n > 0.0) {
            char how[32];
            snprintf(how, sizeof(how), "%s by %.0f sample%s of ", k == PILOT_MATTE ? "matte" : "glossy",
                     pilot->part[k].n, pilot->part[k].n < 1.5 ? "" : "s");
            add_phrase(d->paths, sizeof(d->paths), ", ", how, pilot->part[k].name);
        }
    if (p->caustics != PLAN_NONE)
        add_phrase(d->paths, sizeof(d->paths), ", ", "caustics by ", plan_estimator_name(p->caustics));
    if (p->indirect != PLAN_NONE)
        add_phrase(d->paths, sizeof(d->paths), ", ", "interreflection by ", plan_estimator_name(p->indirect));
    for (uint32_t k = 0; k < p->left_out_count; k++)
        add_phrase(d->left_out, sizeof(d->left_out), "; ", p->left_out[k], "");
}

void daemon_tell_received(struct daemon *d, const struct image_faults *faults, bool dropped)
{
    pthread_mutex_lock(&d->status_lock);
    d->status.received++;
    d->status.dropped += dropped;
    d->status.repaired += faults->nan + faults->infinite + faults->negative;
    tell_figures(d);
    pthread_mutex_unlock(&d->status_lock);
}

/* Where the sun stands in a computed sky, in words of the page. */
static void note_sun(struct daemon *d, const struct ingested *in)
{
    const uint64_t frame = in->environment->number;
    struct sky_state s;

    d->status.has_sun = d->status.has_hour = in->has_sky;
    if (!in->has_sky)
        return;
    sky_state_at(&in->sky, frame, &s);
    const double hours = in->sky.hour + in->sky.speed_hours * (double)frame, hour = hours - 24.0 * floor(hours / 24.0);
    const double azimuth = atan2(-s.sun_direction[0], s.sun_direction[2]) * 180.0 / PI; /* north +Z, east -X */
    d->status.hour = hour;
    d->status.sun_elevation = s.sun_elevation * 180.0 / PI;
    d->status.sun_azimuth = azimuth < 0.0 ? azimuth + 360.0 : azimuth;
    snprintf(d->sky_time, sizeof(d->sky_time), "%02u:%02u", (unsigned)hour % 24u, (unsigned)(hour * 60.0) % 60u);
}

/* {status_lock} Rays and samples of one picture, and what its stages took. */
static void note_work(struct daemon *d, const struct shaded_news *news)
{
    struct server_figures *f = &d->figures;
    const struct relight_stats *s = news->stats;
    const struct protocol_picture *p = &news->header;
    const uint64_t cache_rays = s->cache.rays + s->bounce.rays;

    f->direct_rays += s->direct.rays;
    f->eye_rays += s->eye.rays;
    f->light_rays += s->light.rays + s->stored.rays;
    f->cache_rays += s->cache_frame.rays + (cache_rays > d->cache_rays ? cache_rays - d->cache_rays : 0);
    d->cache_rays = cache_rays;
    f->generated += s->direct.generated;
    f->chosen += s->direct.chosen;
    f->effective += s->direct.effective;
    f->cache_bytes = s->cache.bytes;
    f->cache_share = s->cache_share;
    server_observe(d->server, SERVER_DECODE, 1e-6 * p->decoded_us);
    server_observe(d->server, SERVER_QUEUE, 1e-6 * p->queued_us);
    server_observe(d->server, SERVER_SHADE, 1e-6 * p->shaded_us);
}

void daemon_tell_shaded(struct daemon *d, const struct shaded_news *news)
{
    const struct protocol_picture *p = &news->header;
    const struct relight_stats *stats = news->stats;

    pthread_mutex_lock(&d->status_lock);
    struct server_status *s = &d->status;
    s->used++;
    s->frame = p->frame;
    s->position = news->in->position;
    /* What auto stands for where it is one thing. */
    s->method = stats->cache.bytes > 0                ? method_recipe(METHOD_CACHED)->name
                : news->pilot || stats->cache_refused ? "auto"
                                                      : method_recipe(news->light->direct.method)->name;
    s->samples = p->samples;
    s->queued_ms = smooth(s->queued_ms, 1e-3 * p->queued_us);
    s->decoded_ms = smooth(s->decoded_ms, 1e-3 * p->decoded_us);
    s->shaded_ms = smooth(s->shaded_ms, 1e-3 * p->shaded_us);
    if (news->interval_s > 0.0)
        s->fps = 1.0 / smooth(s->fps > 0.0 ? 1.0 / s->fps : 0.0, news->interval_s);
    note_sun(d, news->in);
    note_plan(d, news);
    note_work(d, news);
    s->error = news->pilot ? news->pilot->error : 0.0;
    s->computing = stats->cache_share > 0.0 && stats->cache_share < 1.0;
    s->computed = stats->cache_share;
    s->passes = 0;
    s->converged = false;
    tell_figures(d);
    server_set_status(d->server, s); /* it may be encoded by now, and nothing be told after it */
    pthread_mutex_unlock(&d->status_lock);
}

void daemon_tell_camera(struct daemon *d, const char *camera, double share)
{
    const bool there = share >= 1.0;

    pthread_mutex_lock(&d->status_lock);
    const bool news = there || strcmp(d->preparing, camera) != 0 || share >= d->status.prepared + 0.02;
    if (news) {
        snprintf(there ? d->camera_shown : d->preparing, sizeof(d->preparing), "%s", camera);
        if (there)
            d->preparing[0] = '\0';
        d->status.prepared = share;
        server_set_status(d->server, &d->status);
    }
    pthread_mutex_unlock(&d->status_lock);
}

void daemon_tell_finer(struct daemon *d, const struct still_stats *stats)
{
    pthread_mutex_lock(&d->status_lock);
    d->figures.finer += stats->passes > d->status.passes ? stats->passes - d->status.passes : 0;
    d->status.error = stats->error;
    d->status.passes = stats->passes;
    d->status.converged = stats->converged;
    tell_figures(d);
    pthread_mutex_unlock(&d->status_lock);
}

void daemon_tell_encoded(struct daemon *d, double ms)
{
    pthread_mutex_lock(&d->status_lock);
    d->status.encoded_ms = smooth(d->status.encoded_ms, ms);
    server_set_status(d->server, &d->status);
    pthread_mutex_unlock(&d->status_lock);
}

bool daemon_all_shown(struct daemon *d)
{
    pthread_mutex_lock(&d->status_lock);
    const struct server_status *s = &d->status;
    const bool all = s->used + s->dropped + s->refused >= s->received;
    pthread_mutex_unlock(&d->status_lock);
    return all;
}

double daemon_slack_ms(struct daemon *d)
{
    pthread_mutex_lock(&d->status_lock);
    const double slack = d->status.shaded_ms - d->status.decoded_ms;
    pthread_mutex_unlock(&d->status_lock);
    return slack > 0.0 ? slack : 0.0;
}
