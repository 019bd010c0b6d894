#include "metrics.h"

#include "clock.h"
#include "internal.h"
#include "log.h"
#include "mem.h"
#include "process.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

/* Seconds. Pieces of work of the network's thread are fifty times as short as what is done for a picture. */
static const double bounds[METRICS_BOUNDS] = { 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5 };
#define LOOP_SCALE 0.02

void histogram_add(struct histogram *h, double seconds)
{
    const double s = seconds > 0.0 ? fmin(seconds, 1e6) : 0.0; /* NaN too */
    int i = 0;

    while (i < METRICS_BOUNDS && s > bounds[i])
        i++;
    atomic_fetch_add_explicit(&h->bucket[i], 1, memory_order_relaxed);
    atomic_fetch_add_explicit(&h->sum_ns, (uint64_t)(1e9 * s), memory_order_relaxed);
}

void server_observe(struct server *s, enum server_timing timing, double seconds)
{
    /* The table of bounds is one: what is kept of the loop is fifty times what it took. */
    histogram_add(&s->metrics.timing[timing], timing == SERVER_LOOP ? seconds / LOOP_SCALE : seconds);
}

void server_set_figures(struct server *s, const struct server_figures *figures)
{
    pthread_mutex_lock(&s->lock);
    s->figures = *figures;
    pthread_mutex_unlock(&s->lock);
}

/* ---- Life ---- */

void server_beat(struct server *s)
{
    struct metrics *m = &s->metrics;
    clockid_t clock = 0;

    if (atomic_load(&m->beat_ms) == 0 && pthread_getcpuclockid(pthread_self(), &clock) == 0)
        atomic_store(&m->beat_clock, clock);
    atomic_store(&m->beat_ms, clock_ms());
}

void metrics_tick(struct server *s, int64_t now_us, int64_t every_us)
{
    struct metrics *m = &s->metrics;
    struct timespec t;

    if (m->tick_due_us > 0 && now_us - m->tick_due_us > atomic_load(&m->loop_late_us))
        atomic_store(&m->loop_late_us, now_us - m->tick_due_us);
    m->tick_due_us = now_us + every_us;
    atomic_store(&m->loop_us, now_us);
    if (atomic_load(&m->beat_ms) == 0 || atomic_load(&s->stopping) ||
        clock_gettime((clockid_t)atomic_load(&m->beat_clock), &t) != 0)
        return;
    const int64_t worked_ns = (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
    if (worked_ns != m->worked_ns)
        atomic_store(&m->worked_ms, clock_ms());
    m->worked_ns = worked_ns;
}

void metrics_worked(struct server *s, int64_t begun_us)
{
    const int64_t took_us = viewer_now_us() - begun_us;

    server_observe(s, SERVER_LOOP, 1e-6 * (double)took_us);
    if (took_us > atomic_load(&s->metrics.loop_most_us))
        atomic_store(&s->metrics.loop_most_us, took_us);
}

void server_health(struct server *s, struct server_health *out)
{
    struct metrics *m = &s->metrics;
    const int64_t now_ms = clock_ms(), beat_ms = atomic_load(&m->beat_ms), worked_ms = atomic_load(&m->worked_ms);
    const char *reason = NULL;

    out->loop_ms = (viewer_now_us() - atomic_load(&m->loop_us)) / 1000;
    out->beat_ms = beat_ms ? now_ms - beat_ms : -1;
    if (out->loop_ms >= SERVER_BEAT_MS)
        reason = "the network's thread is late";
    else if (out->beat_ms >= SERVER_BUSY_MS || (out->beat_ms >= SERVER_BEAT_MS && now_ms - worked_ms >= SERVER_BEAT_MS))
        reason = "the thread that makes pictures does nothing";
    out->alive = !reason;
    pthread_mutex_lock(&s->lock);
    if (reason)
        ;
    else if (atomic_load(&s->stopping))
        reason = "the server is going away";
    else if (!s->figures.loaded)
        reason = "the scene is being prepared";
    else if (s->published == 0 && s->source == SERVER_FAILED)
        reason = "no frame of the sky could be used yet";
    else if (s->published == 0 && !s->push) /* else a producer's frame can be taken */
        reason = "the first picture is being made";
    pthread_mutex_unlock(&s->lock);
    out->ready = !reason;
    out->reason = reason ? reason : "ok";
}

/* ---- The text ---- */

void metrics_print(struct metrics_text *t, const char *format, ...)
{
    va_list args, again;

    va_start(args, format);
    va_copy(again, args);
    const size_t left = t->room - t->size;
    int n = t->failed ? 0 : vsnprintf(t->text ? t->text + t->size : NULL, left, format, args);
    if (!t->failed && (n < 0 || (size_t)n >= left)) {
        const size_t room = 2 * t->room + (size_t)(n > 0 ? n : 0) + 16384;
        char *text = mem_grow(t->text, t->size, room, 1);
        t->failed = n < 0 || !text;
        if (text) {
            t->text = text;
            t->room = room;
            n = vsnprintf(text + t->size, room - t->size, format, again);
        }
    }
    if (!t->failed)
        t->size += (size_t)n;
    va_end(again);
    va_end(args);
}

static void head(struct metrics_text *t, const char *name, const char *type, const char *help)
{
    metrics_print(t, "# HELP %s %s\n# TYPE %s %s\n", name, help, name, type);
}

static void one(struct metrics_text *t, const char *name, const char *type, const char *help, double value)
{
    head(t, name, type, help);
    metrics_print(t, "%s %.15g\n", name, value);
}

static void count(struct metrics_text *t, const char *name, const char *help, uint64_t value)
{
    head(t, name, "counter", help);
    metrics_print(t, "%s %llu\n", name, (unsigned long long)value);
}

static uint64_t load(const atomic_uint_fast64_t *counter)
{
    return atomic_load_explicit(counter, memory_order_relaxed);
}

/* labels: "stage=\"shade\"" or "". Buckets are cumulative, and the count is their sum, so that the two agree though
 * somebody counts meanwhile. */
static void histogram(struct metrics_text *t, const char *name, const char *labels, const struct histogram *h,
                      double scale)
{
    const char *comma = labels[0] ? "," : "", *open = labels[0] ? "{" : "", *close = labels[0] ? "}" : "";
    uint64_t sum = 0;

    for (int i = 0; i < METRICS_BOUNDS; i++) {
        sum += load(&h->bucket[i]);
        metrics_print(t, "%s_bucket{%s%sle=\"%g\"} %llu\n", name, labels, comma, scale * bounds[i],
                      (unsigned long long)sum);
    }
    sum += load(&h->bucket[METRICS_BOUNDS]);
    metrics_print(t, "%s_bucket{%s%sle=\"+Inf\"} %llu\n%s_sum%s%s%s %.9g\n%s_count%s%s%s %llu\n", name, labels, comma,
                  (unsigned long long)sum, name, open, labels, close, 1e-9 * scale * (double)load(&h->sum_ns), name,
                  open, labels, close, (unsigned long long)sum);
}

void server_set_decoder(struct server *s, const struct server_decoder *decoder)
{
    pthread_mutex_lock(&s->lock);
    s->decoder = *decoder;
    pthread_mutex_unlock(&s->lock);
}

static void tell_decoder(struct metrics_text *t, const struct server_decoder *d)
{
    static const char failed[] = "relightd_decoder_failures_total";

    one(t, "relightd_decoder_separate", "gauge", "1: producers' files are decoded in a process of its own.",
        d->separate);
    one(t, "relightd_decoder_confined", "gauge", "1: which the kernel holds to a few system calls.", d->confined);
    count(t, "relightd_decoder_files_total", "Files of producers that were to be decoded there.", d->files);
    count(t, "relightd_decoder_starts_total", "Processes that were started for it.", d->starts);
    head(t, failed, "counter", "Files that cost their decoder, or that it was not given since too many had.");
    metrics_print(t, "%s{reason=\"died\"} %llu\n", failed, (unsigned long long)d->died);
    metrics_print(t, "%s{reason=\"hung\"} %llu\n", failed, (unsigned long long)d->hung);
    metrics_print(t, "%s{reason=\"nonsense\"} %llu\n", failed, (unsigned long long)d->lied);
    metrics_print(t, "%s{reason=\"waiting\"} %llu\n", failed, (unsigned long long)d->waited);
}

static void tell_frames(struct metrics_text *t, const struct server_figures *f, const struct server_counters *c)
{
    count(t, "relightd_frames_received_total", "Environment frames that came, from whatever source.", f->received);
    head(t, "relightd_frames_total", "counter", "Environment frames by what became of them.");
    metrics_print(t, "relightd_frames_total{fate=\"shaded\",reason=\"\"} %llu\n", (unsigned long long)f->used);
    metrics_print(t, "relightd_frames_total{fate=\"dropped\",reason=\"superseded\"} %llu\n",
                  (unsigned long long)f->superseded);
    metrics_print(t, "relightd_frames_total{fate=\"refused\",reason=\"unreadable\"} %llu\n",
                  (unsigned long long)f->refused[SERVER_UNREADABLE]);
    metrics_print(t, "relightd_frames_total{fate=\"refused\",reason=\"unusable\"} %llu\n",
                  (unsigned long long)f->refused[SERVER_UNUSABLE]);
    count(t, "relightd_texels_repaired_total", "NaN, infinite and negative texels that were set to something sane.",
          f->repaired);
    count(t, "relightd_producer_frames_received_total", "Environment frames received whole from producers.",
          c->frames_received);
    head(t, "relightd_producer_frames_lost_total", "counter",
         "Frames of producers that became no picture, as the network saw it.");
    metrics_print(t, "relightd_producer_frames_lost_total{reason=\"superseded\"} %llu\n",
                  (unsigned long long)c->frames_superseded);
    metrics_print(t, "relightd_producer_frames_lost_total{reason=\"refused\"} %llu\n",
                  (unsigned long long)c->frames_refused);
    metrics_print(t, "relightd_producer_frames_lost_total{reason=\"repeated\"} %llu\n",
                  (unsigned long long)c->frames_repeated);
    metrics_print(t, "relightd_producer_frames_lost_total{reason=\"cut\"} %llu\n", (unsigned long long)c->frames_cut);
    count(t, "relightd_producer_received_bytes_total", "Bytes of frames from producers, whole or not.", c->frame_bytes);
}

static const char *const kinds[METRICS_KINDS] = {
    [PROTOCOL_JPEG] = "format=\"jpeg\",size=\"whole\"",
    [PROTOCOL_EXR_HALF] = "format=\"exr_half\",size=\"whole\"",
    [PROTOCOL_EXR_FLOAT] = "format=\"exr_float\",size=\"whole\"",
    [PROTOCOL_H264] = "format=\"h264\",size=\"whole\"",
    [STREAM_JPEG_HALF] = "format=\"jpeg\",size=\"half\"",
    [STREAM_JPEG_QUARTER] = "format=\"jpeg\",size=\"quarter\"",
    [STREAM_TRACKS] = "format=\"h264\",size=\"half\"",
    [STREAM_TRACKS + 1] = "format=\"h264\",size=\"quarter\"",
};
_Static_assert(METRICS_KINDS == STREAM_TRACKS + SERVER_SCALES - 1, "a kind of picture has no counter");

unsigned metrics_kind(unsigned kind)
{
    const unsigned scale = kind < STREAM_TRACKS ? 0 : server_track_scale(kind - STREAM_TRACKS);

    return kind < STREAM_TRACKS ? kind : scale == 0 ? PROTOCOL_H264 : STREAM_TRACKS - 1 + scale;
}

static void by_kind(struct metrics_text *t, const char *name, const char *type, const char *help,
                    const atomic_uint_fast64_t *value)
{
    head(t, name, type, help);
    for (int k = PROTOCOL_JPEG; k < METRICS_KINDS; k++)
        metrics_print(t, "%s{%s} %llu\n", name, kinds[k], (unsigned long long)load(&value[k]));
}

static void tell_pictures(struct metrics_text *t, const struct metrics *m, const struct server_counters *c)
{
    by_kind(t, "relightd_pictures_published_total", "counter", "Pictures encoded and offered to viewers.",
            m->published);
    by_kind(t, "relightd_pictures_sent_total", "counter", "Pictures handed whole to the kernel, for any viewer.",
            m->sent);
    head(t, "relightd_pictures_skipped_total", "counter", "Pictures that a viewer did not get.");
    metrics_print(t, "relightd_pictures_skipped_total{reason=\"slow\"} %llu\n",
                  (unsigned long long)load(&m->skipped_slow));
    metrics_print(t, "relightd_pictures_skipped_total{reason=\"rate\"} %llu\n",
                  (unsigned long long)load(&m->skipped_rate));
    count(t, "relightd_pictures_acknowledged_total", "Pictures that viewers said they show, or have stored.", c->acked);
    count(t, "relightd_sent_bytes_total", "Bytes of pictures handed to the kernel.", c->bytes);
}

static void tell_times(struct metrics_text *t, const struct metrics *m)
{
    static const char *const stages[] = { "stage=\"decode\"", "stage=\"queue\"", "stage=\"shade\"" };
    static const char *const parts[] = { "part=\"capture_to_published\"", "part=\"published_to_sent\"",
                                         "part=\"published_to_displayed\"" };

    head(t, "relightd_stage_seconds", "histogram", "What the stages of a picture take, once a frame.");
    for (int k = SERVER_DECODE; k <= SERVER_SHADE; k++)
        histogram(t, "relightd_stage_seconds", stages[k], &m->timing[k], 1.0);
    head(t, "relightd_encode_seconds", "histogram", "What encoding a picture takes, tone curve included.");
    for (int k = PROTOCOL_JPEG; k < METRICS_KINDS; k++)
        if (load(&m->published[k]) > 0)
            histogram(t, "relightd_encode_seconds", kinds[k], &m->encode[k], 1.0);
    head(t, "relightd_latency_seconds", "histogram", "How old pictures are, in parts of their way.");
    for (int k = SERVER_CAPTURED; k <= SERVER_DISPLAYED; k++)
        histogram(t, "relightd_latency_seconds", parts[k - SERVER_CAPTURED], &m->timing[k], 1.0);
    head(t, "relightd_loop_seconds", "histogram", "What single pieces of work of the network thread take.");
    histogram(t, "relightd_loop_seconds", "", &m->timing[SERVER_LOOP], LOOP_SCALE);
    one(t, "relightd_loop_max_seconds", "gauge", "The longest of these since the start.",
        1e-6 * (double)atomic_load(&m->loop_most_us));
    one(t, "relightd_loop_tick_delay_max_seconds", "gauge", "The latest that the loop's half-second tick has come.",
        1e-6 * (double)atomic_load(&m->loop_late_us));
}

/* What only a walk over the connections tells. */
struct crowd {
    unsigned role[SERVER_ROLES + 1]; /* the last: no hello yet */
    unsigned kind[METRICS_KINDS], paused, recorders;
    unsigned outbox, unacked, sending;
};

static void gather(struct server *s, struct crowd *c)
{
    pthread_mutex_lock(&s->lock);
    for (const struct viewer *v = s->viewers; v; v = v->next) {
        c->role[v->greeted ? v->role : SERVER_ROLES]++;
        c->outbox += v->outbox_count;
        c->unacked += v->unacked_count;
        c->sending += v->current != NULL;
        c->recorders += v->recorder;
        if (v->subscribed && v->wish.subscribe.paused)
            c->paused++;
        else if (v->subscribed)
            c->kind[metrics_kind(v->kind)]++;
    }
    pthread_mutex_unlock(&s->lock);
}

static void tell_crowd(struct metrics_text *t, struct server *s, const struct server_counters *c)
{
    static const char *const roles[] = { "viewer", "controller", "producer", "none" };
    struct crowd crowd = { { 0 }, { 0 }, 0, 0, 0, 0, 0 };

    gather(s, &crowd);
    count(t, "relightd_connections_total", "WebSocket connections accepted.", c->connections);
    count(t, "relightd_connections_refused_total", "Requests and connections turned away.", c->refused);
    count(t, "relightd_connections_stalled_total", "Connections cut since they took no bytes.", c->stalled);
    count(t, "relightd_connections_crowded_total", "Of those refused, since their address had too many.", c->crowded);
    count(t, "relightd_wrong_tokens_total", "Wrong tokens that were looked at.", c->wrong_tokens);
    count(t, "relightd_connections_too_fast_total", "Connections cut since they sent too many messages.", c->too_fast);
    head(t, "relightd_connections", "gauge", "WebSocket connections by role; none: no hello yet.");
    for (int r = 0; r <= SERVER_ROLES; r++)
        metrics_print(t, "relightd_connections{role=\"%s\"} %u\n", roles[r], crowd.role[r]);
    one(t, "relightd_connections_max", "gauge", "WebSocket connections that are allowed at once.", s->max_connections);
    head(t, "relightd_viewers", "gauge", "Subscriptions that are not paused, by what they get.");
    for (int k = PROTOCOL_JPEG; k < METRICS_KINDS; k++)
        metrics_print(t, "relightd_viewers{%s} %u\n", kinds[k], crowd.kind[k]);
    one(t, "relightd_viewers_paused", "gauge", "Subscriptions that are paused.", crowd.paused);
    one(t, "relightd_recorders", "gauge", "Recorders of lockstep sequences.", crowd.recorders);
    one(t, "relightd_pictures_sending", "gauge", "Pictures that are partly sent.", crowd.sending);
    one(t, "relightd_pictures_unacknowledged", "gauge", "Pictures begun that viewers have not acknowledged.",
        crowd.unacked);
    one(t, "relightd_messages_waiting", "gauge", "Text messages that wait for their connection.", crowd.outbox);
    head(t, "relightd_protocol_errors_total", "counter", "Mistakes of clients, by the error code of PROTOCOL.md 8.");
    for (int f = FAULT_NONE + 1; f < FAULT_CODES; f++)
        metrics_print(t, "relightd_protocol_errors_total{code=\"%s\"} %llu\n", fault_name((enum fault_code)f),
                      (unsigned long long)load(&s->metrics.faults[f]));
}

static void tell_queues(struct metrics_text *t, struct server *s, const struct server_figures *f)
{
    pthread_mutex_lock(&s->lock);
    const unsigned pushed = s->ingest.live.full + s->ingest.lockstep.full, control = s->control.waiting_count,
                   probes = s->probes.waiting_count;
    pthread_mutex_unlock(&s->lock);
    head(t, "relightd_queue_length", "gauge", "What waits for a thread to take it.");
    metrics_print(t, "relightd_queue_length{queue=\"received\"} %u\n", pushed);
    metrics_print(t, "relightd_queue_length{queue=\"decoded\"} %u\n", f->frames_waiting);
    metrics_print(t, "relightd_queue_length{queue=\"shaded\"} %u\n", f->pictures_waiting);
    metrics_print(t, "relightd_queue_length{queue=\"control\"} %u\n", control);
    metrics_print(t, "relightd_queue_length{queue=\"probes\"} %u\n", probes);
}

static void tell_light(struct metrics_text *t, const struct server_figures *f)
{
    head(t, "relightd_rays_total", "counter", "Rays traced, by what for.");
    metrics_print(t, "relightd_rays_total{part=\"direct\"} %llu\n", (unsigned long long)f->direct_rays);
    metrics_print(t, "relightd_rays_total{part=\"eye_paths\"} %llu\n", (unsigned long long)f->eye_rays);
    metrics_print(t, "relightd_rays_total{part=\"light_tracer\"} %llu\n", (unsigned long long)f->light_rays);
    metrics_print(t, "relightd_rays_total{part=\"cache\"} %llu\n", (unsigned long long)f->cache_rays);
    head(t, "relightd_light_samples_total", "counter", "Light samples: drawn, in use, and of these with light.");
    metrics_print(t, "relightd_light_samples_total{state=\"generated\"} %llu\n", (unsigned long long)f->generated);
    metrics_print(t, "relightd_light_samples_total{state=\"chosen\"} %llu\n", (unsigned long long)f->chosen);
    metrics_print(t, "relightd_light_samples_total{state=\"effective\"} %llu\n", (unsigned long long)f->effective);
    count(t, "relightd_finer_passes_total", "Passes by which standing pictures were made better.", f->finer);
    head(t, "relightd_picture_error_ratio", "gauge", "Of the last picture: relMSE, as estimated; absent: unknown.");
    if (f->error > 0.0)
        metrics_print(t, "relightd_picture_error_ratio %.9g\n", f->error);
    one(t, "relightd_pictures_per_second", "gauge", "Pictures made, smoothed.", isfinite(f->fps) ? f->fps : 0.0);
    one(t, "relightd_frame_number", "gauge", "Number of the environment frame that is shown.", (double)f->frame);
    one(t, "relightd_cache_bytes", "gauge", "Memory of the transport cache; 0: there is none.", (double)f->cache_bytes);
    one(t, "relightd_cache_computed_ratio", "gauge", "Share of it that is there.", f->cache_share);
}

static void tell_source(struct metrics_text *t, struct server *s)
{
    static const char *const states[] = { "waiting", "live", "paused", "ended", "failed" };

    pthread_mutex_lock(&s->lock);
    const enum server_source now = s->source;
    const int64_t since_us = s->source_us;
    pthread_mutex_unlock(&s->lock);
    head(t, "relightd_source_state", "gauge", "1 for the state that the source is in.");
    for (int k = SERVER_WAITING; k <= SERVER_FAILED; k++)
        metrics_print(t, "relightd_source_state{state=\"%s\"} %d\n", states[k], (int)now == k);
    if (since_us > 0)
        one(t, "relightd_source_state_since_seconds", "gauge", "Since when, in seconds since 1970.",
            1e-6 * (double)since_us);
}

static void tell_process(struct metrics_text *t, struct server *s)
{
    static const char *const levels[LOG_LEVELS] = { "error", "warning", "info", "debug" };
    struct log_counts lines;
    struct process_usage p;
    struct server_health health;

    process_usage(&p);
    server_health(s, &health);
    head(t, "relightd_build_info", "gauge", "1; what runs here is in the labels.");
    metrics_print(t, "relightd_build_info{version=\"%s\",protocol=\"%s\",minor=\"%d\",h264=\"%d\"} 1\n",
                  RELIGHT_VERSION, PROTOCOL_NAME, PROTOCOL_MINOR, s->h264);
    one(t, "relightd_alive", "gauge", "As /healthz.", health.alive);
    one(t, "relightd_ready", "gauge", "As /readyz.", health.ready);
    if (s->tls) {
        head(t, "relightd_tls_certificate_expires_seconds", "gauge",
             "When the certificate's time is over, in seconds since 1970.");
        metrics_print(t, "relightd_tls_certificate_expires_seconds %lld\n", (long long)tls_expires_s(s->tls));
    }
    count(t, "relightd_scrapes_total", "Answers like this one, this one included.", load(&s->metrics.scrapes));
    log_counts(&lines);
    head(t, "relightd_log_lines_total", "counter", "Lines of the log, those held back included.");
    for (int k = LOG_ERROR; k < LOG_LEVELS; k++)
        metrics_print(t, "relightd_log_lines_total{level=\"%s\"} %llu\n", levels[k],
                      (unsigned long long)lines.lines[k]);
    count(t, "relightd_log_lines_held_total", "Lines that were held back as too many of a kind.", lines.held);
    one(t, "process_cpu_seconds_total", "counter", "Processor time of all threads.", p.processor_s);
    if (p.resident_bytes >= 0) {
        one(t, "process_resident_memory_bytes", "gauge", "Memory that is held.", (double)p.resident_bytes);
        one(t, "process_virtual_memory_bytes", "gauge", "Addresses that are mapped.", (double)p.virtual_bytes);
        one(t, "process_start_time_seconds", "gauge", "Start, in seconds since 1970.", p.started_s);
        one(t, "relightd_threads", "gauge", "Threads of the process.", (double)p.threads);
    }
    if (p.open_files >= 0)
        one(t, "process_open_fds", "gauge", "Descriptors that are open.", (double)p.open_files);
    if (p.most_files > 0)
        one(t, "process_max_fds", "gauge", "Descriptors that may be open.", (double)p.most_files);
}

char *metrics_text(struct server *s, size_t *size)
{
    struct metrics_text t = { 0 };
    struct server_counters c;

    atomic_fetch_add(&s->metrics.scrapes, 1);
    server_counters(s, &c);
    pthread_mutex_lock(&s->lock);
    const struct server_figures f = s->figures;
    const struct server_decoder decoder = s->decoder;
    pthread_mutex_unlock(&s->lock);
    tell_process(&t, s);
    tell_source(&t, s);
    tell_frames(&t, &f, &c);
    tell_decoder(&t, &decoder);
    tell_pictures(&t, &s->metrics, &c);
    tell_times(&t, &s->metrics);
    tell_crowd(&t, s, &c);
    tell_queues(&t, s, &f);
    tell_light(&t, &f);
    if (t.failed) {
        mem_free(t.text);
        return NULL;
    }
    *size = t.size;
    return t.text;
}
