/* The figures of relight-bench --speed: one scene at one size and CPU level. Private to the room. Main thread. */
#pragma once

#include "measure/bench/bench.h"

#define SPEED_SKIES 8
#define SPEED_TITLE 24

struct speed_sky { /* times in milliseconds */
    char title[SPEED_TITLE];
    double all_ms, direct_ms;       /* shading: by the clock, all threads */
    double bare_all, bare_direct;   /* 64 bare shadow rays at each shade point over that */
    double all_over_direct;         /* the median of the rounds' own ratios */
    double jpeg_all, jpeg_direct;   /* processor time, EXR to JPEG */
    double exr_direct;              /* EXR to float EXR, one thread */
    double error_direct, error_all; /* relMSE; below 0: not judged */
    double mis_direct, mis_all;     /* likewise, of `mis` with SPEED_MIS_SAMPLES */
    bool sun;                    /* has a sun */
    bool judged;                    /* the next are measured */
    struct bench_row bias, colour, seams, motion; /* of direct light without the sun */
};

#define SPEED_MIS_SAMPLES 256

struct speed_case {
    char scene[SPEED_TITLE];
    const char *level; /* of the kernels */
    uint32_t width, height;
    double wall_s, processor_s;      /* of the precomputation for all light */
    uint64_t direct_bytes, bytes;    /* of the caches: direct light, all */
    struct bench_row pixels, growth; /* four times the pixels, 16 times the triangles; no name: not measured */
    struct speed_sky skies[SPEED_SKIES];
    size_t count;
};

/* Measures desc's scene at its size by its level, under each of desc->sources. judge: errors, biases and growth too.
 * out: scene filled. Errors as bench_run's. */
MUST_CHECK enum err speed_measure(const struct bench_desc *desc, bool judge, struct speed_case *out,
                                  struct reason *why);
