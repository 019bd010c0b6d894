/* What is measured of the server while it runs, and its text for Prometheus (exposition format 0.0.4). Histograms are
 * counted by any thread without a lock; the text is made by the service thread. */
#ifndef STREAM_METRICS_H
#define STREAM_METRICS_H

#include "message.h"
#include "server.h"

#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#define METRICS_BOUNDS 13
#define METRICS_KINDS (PROTOCOL_H264 + 5) /* of pictures: H.264's by size alone, whatever their rate */

struct histogram {
    atomic_uint_fast64_t bucket[METRICS_BOUNDS + 1]; /* each by itself; the last is above all bounds */
    atomic_uint_fast64_t sum_ns;
};

struct metrics {
    struct histogram timing[SERVER_TIMINGS];
    struct histogram encode[METRICS_KINDS];          /* SERVER_ENCODE, by kind of picture */
    atomic_uint_fast64_t faults[FAULT_CODES];        /* protocol errors */
    atomic_uint_fast64_t published[METRICS_KINDS];   /* pictures, by kind */
    atomic_uint_fast64_t sent[METRICS_KINDS];        /* whole, to any viewer */
    atomic_uint_fast64_t skipped_slow, skipped_rate; /* by a viewer that was slow, or wished for fewer */
    atomic_uint_fast64_t scrapes;

    atomic_int_fast64_t loop_us;      /* when the service thread was last seen, on viewer_now_us's clock */
    atomic_int_fast64_t loop_most_us; /* the longest that one piece of its work has taken */
    atomic_int_fast64_t loop_late_us; /* the latest that its tick has been */
    int64_t tick_due_us;              /* service thread's own */

    atomic_int_fast64_t beat_ms;    /* of server_beat, on clock_ms; 0: never */
    atomic_int_fast64_t worked_ms;  /* when its thread was last seen to use a processor */
    atomic_int_fast64_t beat_clock; /* the thread's clockid_t; {beat_ms > 0} */
    int64_t worked_ns;              /* of that clock, service thread's own */
};

/* Negative and absurd times count as 0 and as the highest. */
void histogram_add(struct histogram *h, double seconds);

/* A growing text; what does not fit into memory is left out, and `failed` says so. */
struct metrics_text {
    char *text;
    size_t size, room;
    bool failed;
};
void metrics_print(struct metrics_text *t, const char *format, ...) PRINTF_LIKE(2, 3);

struct server;

/* The kind among METRICS_KINDS of one among STREAM_KINDS. */
unsigned metrics_kind(unsigned kind);

/* Thread: service. The whole text, to be freed by mem_free; NULL when out of memory. */
char *metrics_text(struct server *s, size_t *size);

/* Thread: service. Twice a second, when it was to come so. */
void metrics_tick(struct server *s, int64_t now_us, int64_t every_us);

/* Thread: service. One piece of its work is over. */
void metrics_worked(struct server *s, int64_t begun_us);

#endif
