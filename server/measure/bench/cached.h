/* The cache of light transport and the references that --speed judges it by. Private to this room; main thread. */
#pragma once

#include "measure/bench/bench_internal.h"
#include "measure/chart/judge.h"

#define CACHED_SAMPLES 64 /* N_s of `cached` and of `mis` beside it, whatever the other rows use */

/* Two references of one sky and the same shading points with different random numbers: the product of an image's
 * differences from both is free of their noise. */
struct cached_truth {
    float *half[2]; /* [height][width][3] */
};

struct cached {
    struct relighter *relighter;
    struct relight_desc light;  /* direct light and the background */
    struct relight_stats stats; /* of the last frame */
    struct reason why;
    float *rgb;    /* [height][width][3]: room for an image */
    uint8_t *mask; /* [height][width]: pixels with shade points */
    size_t values; /* in rgb */
};

/* Builds the cache of direct light and lights the bench's sky. ERR_NOMEM; ERR_RANGE: there can be none. */
MUST_CHECK enum err cached_create(struct bench *b, struct cached **out, struct reason *why);
void cached_destroy(struct cached *c); /* NULL is allowed */

/* Computes both references under e by METHOD_AUTO: as many samples as some 20 seconds allow, at most 2048. ERR_NOMEM;
 * finish it all the same. */
MUST_CHECK enum err cached_truth_make(struct cached *c, const struct environment *e, struct cached_truth *t);
void cached_truth_finish(struct cached_truth *t);

/* relMSE of x over pixels with shade points against two references (measure/chart/judge.h). ERR_NOMEM. */
MUST_CHECK enum err cached_rel_mse(const struct bench *b, const struct cached *c, float *const half[2], const float *x,
                                   double *out);

/* The bias of direct light (rows_bias.c): figures, or why there are none. ERR_NOMEM, and errors of the stages.
 * cached_bias: the errors under the bench's sky without its sun, if it has one: the relMSE, and the roots of
 * mean squares of delta E within tiles. cached_seams: per cent of the border pixels of blocks whose compression shows.
 * cached_motion: how uneven a turning sky changes, in 8-bit codes. */
MUST_CHECK enum err cached_bias(struct bench *b, struct cached *c, bool sun, struct bench_row *rel_mse,
                                struct bench_row *delta_e);
MUST_CHECK enum err cached_seams(struct bench *b, struct bench_row *row);
MUST_CHECK enum err cached_motion(struct bench *b, struct cached *c, struct bench_row *row);
