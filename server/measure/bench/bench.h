/* Measures each stage of the pipeline, and the whole pipeline, against its bare limit in one process. Both are timed
 * in turns, and the report has medians over the rounds, so that a noisy machine does not decide the result. Main
 * thread. */
#pragma once

#include "base/err.h"
#include "import/reader/reader.h"
#include "light/estimators/method.h"

#include <stdbool.h>
#include <stdint.h>

#define BENCH_ROUNDS_MAX 99 /* bounds a table */

struct bench_desc {
    const char *scene;            /* a path; NULL: the built-in one */
    struct scene_reading reading; /* of reading it */
    const char *scene_fine;       /* the same with 16 times the triangles; NULL: made by halving edges twice */
    const char *source;           /* of the eight skies that repeated work takes in turns */
    const char *scenes, *sources; /* of bench_speed: lists as relight-chart's (measure/chart/chart.h) */
    const char *cpu;              /* level of the kernels; NULL: the best */
    uint32_t width, height;       /* of the images, pixels */
    enum method method;
    uint32_t samples;   /* N_s per shade point */
    uint32_t particles; /* of the light tracer */
    uint32_t viewers;
    int rounds;    /* 3..BENCH_ROUNDS_MAX */
    int threads;   /* 0: as many as there are processors */
    bool progress; /* show a progress line on standard error, if that is a terminal */
};

/* Two figures of one unit and their ratio ours / bare, which is the median of the rounds' own ratios. */
struct bench_row {
    double ours, bare, ratio; /* medians; bare 0: there is nothing to compare with, and the ratio is `ours` */
    int rounds;               /* over so many */
    char note[400];           /* what the second figure is, or why there is none */
    char skipped[160];        /* why the row could not be measured; "" where it was */
};

struct script;

/* Measures all rows and tells them to bench.py, which prints them. A row that cannot be measured says so and is no
 * error. Errors are those of the scene and the source, ERR_NOMEM and ERR_IO: of the script. */
MUST_CHECK enum err bench_run(const struct bench_desc *desc, struct script *to, struct reason *why);

/* What an image by the cache of light transport costs, of each scene under each source, at desc's size and at twice
 * its width and height, by the best kernels and by those for AVX2 (or by desc->cpu alone): bench.py gets
 * them one by one, and prints one table with the targets. Errors as bench_run's. */
MUST_CHECK enum err bench_speed(const struct bench_desc *desc, struct script *to, struct reason *why);
