/* Measurements of the running server, and their text for Prometheus (exposition format 0.0.4). Any thread adds to
 * histograms without a lock; the service thread formats the text. */
#pragma once

#include "net/message/message.h"
#include "net/stream/server.h"

#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#define METRICS_BOUNDS 13                    /* 0.5 ms to 5 s */
#define METRICS_KINDS (PROTOCOL_CHANGES + 6) /* of images: H.264 by size only, not by rate; renditions as one */

struct histogram {
    atomic_uint_fast64_t bucket[METRICS_BOUNDS + 1]; /* not cumulative; the last is above all bounds */
    atomic_uint_fast64_t sum_ns;
};

struct metrics {
    struct histogram timing[SERVER_TIMINGS];
    struct histogram encode[METRICS_KINDS];          /* SERVER_ENCODE, by kind of image */
    atomic_uint_fast64_t faults[FAULT_CODES];        /* protocol errors */
    atomic_uint_fast64_t published[METRICS_KINDS];   /* images, by kind */
    atomic_uint_fast64_t sent[METRICS_KINDS];        /* whole, to any viewer */
    atomic_uint_fast64_t skipped_slow, skipped_rate; /* because a viewer was slow, or limits its rate */
    atomic_uint_fast64_t scrapes;

    atomic_int_fast64_t loop_us;      /* last tick of the service thread (stream_now_us) */
    atomic_int_fast64_t loop_most_us; /* its longest piece of work */
    atomic_int_fast64_t loop_late_us; /* the longest delay of its tick */
    int64_t tick_due_us;              /* private to the service thread */

    atomic_int_fast64_t beat_ms;    /* of server_beat, on clock_ms; 0: never */
    atomic_int_fast64_t worked_ms;  /* when its thread last used a processor */
    atomic_int_fast64_t beat_clock; /* the thread's clockid_t; {beat_ms > 0} */
    int64_t worked_ns;              /* of that clock, service thread's own */
};

/* Adds one time. Negative times and NaN count as 0. Any thread. */
void histogram_add(struct histogram *h, double seconds);

struct server;

/* Maps a kind of STREAM_KINDS to one of METRICS_KINDS. */
unsigned metrics_kind(unsigned kind);

/* Thread: service. The whole text, freed by mem_free; NULL: out of memory. */
char *metrics_text(struct server *s, size_t *size);

/* Thread: service. The half-second tick; every_us: its period. */
void metrics_tick(struct server *s, int64_t now_us, int64_t every_us);

/* Thread: service. Reports the end of work that began at begun_us. */
void metrics_worked(struct server *s, int64_t begun_us);
