#include "net/stream/internal.h"

#include "base/log.h"
#include "base/process.h"
#include "base/text.h"

#include <math.h>
#include <string.h>

/* Seconds. The network thread's pieces of work are so short that their bounds are scaled. */
static const double bounds[METRICS_BOUNDS] = { 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5 };
#define LOOP_SCALE 0.02 /* 10 us to 100 ms */

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
    /* One table of bounds serves all: loop times are stored divided by the scale. */
    histogram_add(&s->metrics.timing[timing], timing == SERVER_LOOP ? seconds / LOOP_SCALE : seconds);
}

/* ---- The text ---- */

static void head(struct text *t, const char *name, const char *help)
{
    const size_t length = strcspn(name, "{");
    const bool counts = length > 6 && strncmp(name + length - 6, "_total", 6) == 0;

    text_add(t, "# HELP %.*s %s\n# TYPE %.*s %s\n", (int)length, name, help, (int)length, name,
             counts ? "counter" : "gauge");
}

static void histogram_head(struct text *t, const char *name, const char *help)
{
    text_add(t, "# HELP %s %s\n# TYPE %s histogram\n", name, help, name);
}

/* One sample per row, from the struct that the table is of. */
static void print_table(struct text *t, const struct figure *table, const void *from)
{
    for (const struct figure *row = table; row->json || row->metric; row++) {
        const void *at = (const char *)from + row->offset;
        if (!row->metric)
            continue;
        if (row->help)
            head(t, row->metric, row->help);
        if (row->type == FIGURE_U64)
            text_add(t, "%s %llu\n", row->metric, (unsigned long long)*(const uint64_t *)at);
        else if (row->type == FIGURE_U32)
            text_add(t, "%s %u\n", row->metric, *(const uint32_t *)at);
        else if (row->type == FIGURE_BOOL)
            text_add(t, "%s %d\n", row->metric, *(const bool *)at);
        else if (row->type == FIGURE_DOUBLE || *(const double *)at > 0.0)
            text_add(t, "%s %.15g\n", row->metric, isfinite(*(const double *)at) ? *(const double *)at : 0.0);
    }
}

static uint64_t load(const atomic_uint_fast64_t *counter)
{
    return atomic_load_explicit(counter, memory_order_relaxed);
}

/* labels: "stage=\"shade\"" or "". Buckets are cumulative and the count is their sum, so that both agree although other
 * threads count meanwhile. */
static void histogram(struct text *t, const char *name, const char *labels, const struct histogram *h, double scale)
{
    const char *comma = labels[0] ? "," : "", *open = labels[0] ? "{" : "", *close = labels[0] ? "}" : "";
    uint64_t sum = 0;

    for (int i = 0; i < METRICS_BOUNDS; i++) {
        sum += load(&h->bucket[i]);
        text_add(t, "%s_bucket{%s%sle=\"%g\"} %llu\n", name, labels, comma, scale * bounds[i], (unsigned long long)sum);
    }
    sum += load(&h->bucket[METRICS_BOUNDS]);
    text_add(t, "%s_bucket{%s%sle=\"+Inf\"} %llu\n%s_sum%s%s%s %.9g\n%s_count%s%s%s %llu\n", name, labels, comma,
             (unsigned long long)sum, name, open, labels, close, 1e-9 * scale * (double)load(&h->sum_ns), name, open,
             labels, close, (unsigned long long)sum);
}

static const char *const kinds[METRICS_KINDS] = {
    [PROTOCOL_JPEG] = "format=\"jpeg\",size=\"whole\"",
    [PROTOCOL_EXR_HALF] = "format=\"exr_half\",size=\"whole\"",
    [PROTOCOL_EXR_FLOAT] = "format=\"exr_float\",size=\"whole\"",
    [PROTOCOL_H264] = "format=\"h264\",size=\"whole\"",
    [PROTOCOL_CHANGES] = "format=\"changes\",size=\"whole\"",
    [STREAM_JPEG_HALF] = "format=\"jpeg\",size=\"half\"",
    [STREAM_JPEG_QUARTER] = "format=\"jpeg\",size=\"quarter\"",
    [STREAM_TRACKS] = "format=\"h264\",size=\"half\"",
    [STREAM_TRACKS + 1] = "format=\"h264\",size=\"quarter\"",
    [METRICS_KINDS - 1] = "format=\"rendition\",size=\"any\"",
};
_Static_assert(METRICS_KINDS == STREAM_TRACKS + SERVER_SCALES, "a kind of image has no counter");

unsigned metrics_kind(unsigned kind)
{
    if (kind >= STREAM_RENDITIONS)
        return METRICS_KINDS - 1;
    const unsigned scale = kind < STREAM_TRACKS ? 0 : server_track_scale(kind - STREAM_TRACKS);

    return kind < STREAM_TRACKS ? kind : scale == 0 ? PROTOCOL_H264 : STREAM_TRACKS - 1 + scale;
}

static void by_kind(struct text *t, const char *name, const char *help, const atomic_uint_fast64_t *value)
{
    head(t, name, help);
    for (int k = PROTOCOL_JPEG; k < METRICS_KINDS; k++)
        text_add(t, "%s{%s} %llu\n", name, kinds[k], (unsigned long long)load(&value[k]));
}

static void print_times(struct text *t, const struct metrics *m)
{
    static const char *const stages[] = { "stage=\"decode\"", "stage=\"queue\"", "stage=\"shade\"" };
    static const char *const parts[] = { "part=\"capture_to_published\"", "part=\"published_to_sent\"",
                                         "part=\"published_to_displayed\"" };

    histogram_head(t, "relightd_stage_seconds", "Time that a frame spends in each stage.");
    for (int k = SERVER_DECODE; k <= SERVER_SHADE; k++)
        histogram(t, "relightd_stage_seconds", stages[k], &m->timing[k], 1.0);
    histogram_head(t, "relightd_encode_seconds", "Time to encode an image, tone curve included.");
    for (int k = PROTOCOL_JPEG; k < METRICS_KINDS; k++)
        if (load(&m->published[k]) > 0)
            histogram(t, "relightd_encode_seconds", kinds[k], &m->encode[k], 1.0);
    histogram_head(t, "relightd_latency_seconds", "Time from capture to display, by part.");
    for (int k = SERVER_CAPTURED; k <= SERVER_DISPLAYED; k++)
        histogram(t, "relightd_latency_seconds", parts[k - SERVER_CAPTURED], &m->timing[k], 1.0);
    histogram_head(t, "relightd_loop_seconds", "Duration of single tasks of the network thread.");
    histogram(t, "relightd_loop_seconds", "", &m->timing[SERVER_LOOP], LOOP_SCALE);
}

/* The network's and the process's numbers at the moment of a scrape. */
struct snapshot {
    struct server_counters counters;
    struct server_health health;
    struct log_counts lines;
    struct server_figures figures;
    uint64_t skipped_slow, skipped_rate, scrapes;
    double loop_most_s, loop_late_s;
    /* Connections by role; the last: no hello yet. Subscriptions by kind of image. */
    uint32_t role[SERVER_ROLES + 1], kind[METRICS_KINDS], paused, recorders, outbox, unacked, sending, max_connections;
    uint32_t arriving;                      /* connections before hello */
    uint32_t snapshots, streams;            /* requests for images by plain HTTP */
    uint32_t pushed, controls, inspections; /* waiting for a thread */
    double processor_s, resident_bytes, virtual_bytes, started_s, threads, open_files, most_files;
};

#define ROW(metric, help, type, field)                                                                                 \
    {                                                                                                                  \
        NULL, metric, help, FIGURE_##type, offsetof(struct snapshot, field)                                            \
    }
#define SKIPPED "relightd_pictures_skipped_total"
#define LOST "relightd_producer_frames_lost_total"
#define CONNECTIONS "relightd_connections"
#define QUEUE "relightd_queue_length"
#define LINES "relightd_log_lines_total"

static const struct figure table[] = {
    ROW("relightd_alive", "As /healthz.", BOOL, health.alive),
    ROW("relightd_ready", "As /readyz.", BOOL, health.ready),
    ROW("relightd_scrapes_total", "Answers to /metrics, this one included.", U64, scrapes),
    ROW(LINES "{level=\"error\"}", "Log lines, including suppressed ones.", U64, lines.lines[LOG_ERROR]),
    ROW(LINES "{level=\"warning\"}", NULL, U64, lines.lines[LOG_WARNING]),
    ROW(LINES "{level=\"info\"}", NULL, U64, lines.lines[LOG_INFO]),
    ROW(LINES "{level=\"debug\"}", NULL, U64, lines.lines[LOG_DEBUG]),
    ROW("relightd_log_lines_held_total", "Log lines suppressed because too many of one kind came.", U64,
        lines.suppressed),
    ROW("process_cpu_seconds_total", "Processor time of all threads.", DOUBLE, processor_s),
    ROW("process_resident_memory_bytes", "Resident memory.", KNOWN, resident_bytes),
    ROW("process_virtual_memory_bytes", "Virtual memory.", KNOWN, virtual_bytes),
    ROW("process_start_time_seconds", "Start of the process, in seconds since 1970.", KNOWN, started_s),
    ROW("relightd_threads", "Threads of the process.", KNOWN, threads),
    ROW("process_open_fds", "Open file descriptors.", KNOWN, open_files),
    ROW("process_max_fds", "Maximum number of open file descriptors.", KNOWN, most_files),

    ROW("relightd_producer_frames_received_total", "Frames received whole from producers.", U64,
        counters.frames_received),
    ROW(LOST "{reason=\"superseded\"}", "Frames from producers that became no image.", U64, counters.frames_superseded),
    ROW(LOST "{reason=\"refused\"}", NULL, U64, counters.frames_refused),
    ROW(LOST "{reason=\"repeated\"}", NULL, U64, counters.frames_repeated),
    ROW(LOST "{reason=\"cut\"}", NULL, U64, counters.frames_cut),
    ROW("relightd_producer_received_bytes_total", "Bytes of frames from producers, whole or not.", U64,
        counters.frame_bytes),

    ROW(SKIPPED "{reason=\"slow\"}", "Images that a viewer did not get.", U64, skipped_slow),
    ROW(SKIPPED "{reason=\"rate\"}", NULL, U64, skipped_rate),
    ROW("relightd_pictures_acknowledged_total", "Images that viewers acknowledged.", U64, counters.acked),
    ROW("relightd_sent_bytes_total", "Bytes of images passed to the kernel.", U64, counters.bytes),
    ROW("relightd_loop_max_seconds", "Longest single task of the network thread.", DOUBLE, loop_most_s),
    ROW("relightd_loop_tick_delay_max_seconds", "Longest delay of its half-second tick.", DOUBLE, loop_late_s),

    ROW("relightd_connections_total", "WebSocket connections accepted.", U64, counters.connections),
    ROW("relightd_connections_refused_total", "Requests and connections refused.", U64, counters.refused),
    ROW("relightd_connections_stalled_total", "Connections closed because they took no bytes.", U64, counters.stalled),
    ROW("relightd_connections_crowded_total", "Connections refused because their address had too many.", U64,
        counters.crowded),
    ROW("relightd_wrong_tokens_total", "Wrong tokens checked.", U64, counters.wrong_tokens),
    ROW("relightd_connections_too_fast_total", "Connections closed because they sent too many messages.", U64,
        counters.too_fast),
    ROW(CONNECTIONS "{role=\"viewer\"}", "WebSocket connections by role; none: no hello yet.", U32,
        role[SERVER_VIEWER]),
    ROW(CONNECTIONS "{role=\"controller\"}", NULL, U32, role[SERVER_CONTROLLER]),
    ROW(CONNECTIONS "{role=\"producer\"}", NULL, U32, role[SERVER_PRODUCER]),
    ROW(CONNECTIONS "{role=\"recorder\"}", NULL, U32, role[SERVER_RECORDER]),
    ROW(CONNECTIONS "{role=\"none\"}", NULL, U32, role[SERVER_ROLES]),
    ROW("relightd_http_watchers{kind=\"snapshot\"}", "Requests for images by plain HTTP that are being answered.", U32,
        snapshots),
    ROW("relightd_http_watchers{kind=\"stream\"}", NULL, U32, streams),
    ROW("relightd_connections_max", "Maximum number of WebSocket connections and requests for images.", U32,
        max_connections),
    ROW("relightd_connections_arriving", "TCP connections before hello, including browsers that load the page.", U32,
        arriving),
    ROW("relightd_viewers_paused", "Paused subscriptions.", U32, paused),
    ROW("relightd_recorders", "Recorders of lockstep sequences.", U32, recorders),
    ROW("relightd_pictures_sending", "Images partly sent.", U32, sending),
    ROW("relightd_pictures_unacknowledged", "Images begun but not acknowledged.", U32, unacked),
    ROW("relightd_messages_waiting", "Text messages waiting for their connection.", U32, outbox),
    ROW(QUEUE "{queue=\"received\"}", "Items waiting for a thread.", U32, pushed),
    ROW(QUEUE "{queue=\"decoded\"}", NULL, U32, figures.frames_waiting),
    ROW(QUEUE "{queue=\"shaded\"}", NULL, U32, figures.images_waiting),
    ROW(QUEUE "{queue=\"control\"}", NULL, U32, controls),
    ROW(QUEUE "{queue=\"probes\"}", NULL, U32, inspections),
    { NULL, NULL, NULL, FIGURE_BOOL, 0 },
};

/* {lock} */
static void count_connections(struct server *s, struct snapshot *n)
{
    for (const struct websocket *ws = s->websockets; ws; ws = ws->next) {
        n->role[ws->greeted ? ws->role : SERVER_ROLES]++;
        n->outbox += ws->outbox_count;
        n->unacked += ws->unacked_count;
        n->sending += ws->current != NULL;
        n->recorders += ws->recorder;
        if (ws->subscribed && ws->wish.subscribe.paused)
            n->paused++;
        else if (ws->subscribed)
            n->kind[metrics_kind(ws->kind)]++;
    }
    for (const struct watcher *w = s->watchers; w; w = w->next) {
        n->kind[metrics_kind(w->kind)]++;
        n->sending += w->current != NULL;
        n->snapshots += !watcher_streams(w);
        n->streams += watcher_streams(w);
    }
}

static void take_process(struct snapshot *n)
{
    struct process_usage p;

    process_usage(&p);
    n->processor_s = p.processor_s;
    n->open_files = (double)p.open_files;
    n->most_files = (double)p.max_files;
    if (p.resident_bytes < 0)
        return;
    n->resident_bytes = (double)p.resident_bytes;
    n->virtual_bytes = (double)p.virtual_bytes;
    n->started_s = p.started_s;
    n->threads = (double)p.threads;
}

static void take_snapshot(struct server *s, struct snapshot *n)
{
    const struct metrics *m = &s->metrics;

    server_counters(s, &n->counters);
    server_health(s, &n->health);
    log_counts(&n->lines);
    take_process(n);
    n->skipped_slow = load(&m->skipped_slow);
    n->skipped_rate = load(&m->skipped_rate);
    n->scrapes = load(&m->scrapes);
    n->loop_most_s = 1e-6 * (double)atomic_load(&m->loop_most_us);
    n->loop_late_s = 1e-6 * (double)atomic_load(&m->loop_late_us);
    n->max_connections = s->limits.most_admitted;
    n->arriving = s->limits.connections[CONNECTION_ARRIVING];
    pthread_mutex_lock(&s->lock);
    count_connections(s, n);
    n->figures = s->figures;
    n->pushed = s->ingest.live.full + s->ingest.lockstep.full;
    n->controls = s->control.waiting_count;
    n->inspections = s->inspections.waiting_count;
    pthread_mutex_unlock(&s->lock);
}

static void print_kinds(struct text *t, const struct server *s, const struct snapshot *n)
{
    by_kind(t, "relightd_pictures_published_total", "Images encoded and offered to viewers.", s->metrics.published);
    by_kind(t, "relightd_pictures_sent_total", "Images passed whole to the kernel, for any viewer.", s->metrics.sent);
    head(t, "relightd_viewers", "Subscriptions that are not paused, by format.");
    for (int k = PROTOCOL_JPEG; k < METRICS_KINDS; k++)
        text_add(t, "relightd_viewers{%s} %u\n", kinds[k], n->kind[k]);
    head(t, "relightd_limits_reached_total", "How often a limit for clients was reached.");
    for (int k = 0; k < LIMITS; k++)
        text_add(t, "relightd_limits_reached_total{limit=\"%s\"} %llu\n", limit_name((enum limit)k),
                 (unsigned long long)atomic_load(&s->limits.reached[k].reached));
    head(t, "relightd_protocol_errors_total", "Protocol errors of clients, by the error code of PROTOCOL.md 8.");
    for (int f = FAULT_NONE + 1; f < FAULT_CODES; f++)
        text_add(t, "relightd_protocol_errors_total{code=\"%s\"} %llu\n", fault_name((enum fault_code)f),
                 (unsigned long long)load(&s->metrics.faults[f]));
}

static void print_states(struct text *t, const struct server *s, const struct server_figures *f)
{
    static const char *const states[] = { "waiting", "live", "paused", "ended", "failed" };

    head(t, "relightd_build_info", "Always 1; the labels describe the build.");
    text_add(t, "relightd_build_info{version=\"%s\",protocol=\"%s\",minor=\"%d\",h264=\"%d\"} 1\n", RELIGHT_VERSION,
             PROTOCOL_NAME, PROTOCOL_MINOR, s->h264);
    if (s->tls) {
        head(t, "relightd_tls_certificate_expires_seconds", "Expiry of the certificate, in seconds since 1970.");
        text_add(t, "relightd_tls_certificate_expires_seconds %lld\n", (long long)tls_expires_s(s->tls));
    }
    head(t, "relightd_source_state", "1 for the current state of the source.");
    for (int k = SERVER_WAITING; k <= SERVER_FAILED; k++)
        text_add(t, "relightd_source_state{state=\"%s\"} %d\n", states[k], (int)f->source == k);
    if (f->since_us > 0) {
        head(t, "relightd_source_state_since_seconds", "Start of that state, in seconds since 1970.");
        text_add(t, "relightd_source_state_since_seconds %.15g\n", 1e-6 * (double)f->since_us);
    }
}

/* Where live images are published. */
static void print_publish(struct text *t, const struct server_figures *f)
{
    static const struct {
        const char *name, *help;
        size_t offset;
    } counts[] = {
        { "relightd_publish_frames_total", "Images passed on to a target of --publish.",
          offsetof(struct server_publish, frames) },
        { "relightd_publish_bytes_total", "Bytes of these.", offsetof(struct server_publish, bytes) },
        { "relightd_publish_dropped_total", "Images left out because the target was slow.",
          offsetof(struct server_publish, dropped) },
        { "relightd_publish_retries_total", "Failures of a target, each followed by another attempt.",
          offsetof(struct server_publish, retries) },
    };

    if (f->publish_count == 0)
        return;
    head(t, "relightd_publish_state", "1 for the current state of a target of --publish.");
    for (uint32_t i = 0; i < f->publish_count; i++)
        for (int k = 0; k <= SERVER_PUBLISH_RETRYING; k++)
            text_add(t, "relightd_publish_state{target=\"%u\",to=\"%s\",state=\"%s\"} %d\n", i + 1, f->publish[i].to,
                     server_publish_state_name((enum server_publish_state)k), (int)f->publish[i].state == k);
    for (size_t c = 0; c < sizeof(counts) / sizeof(counts[0]); c++) {
        head(t, counts[c].name, counts[c].help);
        for (uint32_t i = 0; i < f->publish_count; i++)
            text_add(t, "%s{target=\"%u\",to=\"%s\"} %llu\n", counts[c].name, i + 1, f->publish[i].to,
                     (unsigned long long)*(const uint64_t *)((const char *)&f->publish[i] + counts[c].offset));
    }
}

char *metrics_text(struct server *s, size_t *size)
{
    struct text t = { .bytes = NULL };
    struct snapshot n = { 0 };

    atomic_fetch_add(&s->metrics.scrapes, 1);
    take_snapshot(s, &n);
    print_states(&t, s, &n.figures);
    print_table(&t, table, &n);
    print_table(&t, server_figure_table, &n.figures);
    print_publish(&t, &n.figures);
    print_kinds(&t, s, &n);
    print_times(&t, &s->metrics);
    if (t.failed) {
        text_finish(&t);
        return NULL;
    }
    *size = t.size;
    return t.bytes;
}
