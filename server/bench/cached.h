/* The cache and the references that the rows of the light-transport cache share; the first row builds them. Private
 * to this room; main thread. */
#pragma once

#include "bench/bench_parts.h"
#include "chart/judge.h"

#define CACHED_SAMPLES 64 /* N_s of `cached` and of `mis` beside it, whatever the other rows use */

/* Two references of one sky with different random numbers: the product of a picture's differences from both is free of
 * their noise. */
struct cached_truth {
    float *half[2];   /* [height][width][3]; NULL: not made yet */
    uint32_t samples; /* of both together, per shade point */
};

struct cached {
    struct relighter *relighter;
    struct relight_desc light;  /* direct light and the background */
    struct relight_stats stats; /* of a frame under the bench's sky */
    struct reason why;
    double seconds;            /* that the cache took */
    bool refused;              /* there is none; `why` has the reason */
    bool bright;               /* the sky has a bright part */
    float *rgb;                /* [height][width][3]: room for a picture */
    uint8_t *mask;             /* [height][width]: pixels with shade points */
    size_t values;             /* in rgb */
    struct cached_truth truth; /* of the bench's sky */

    struct environment *clamped; /* the sky without its bright part, where it has one */
    bool judged;                 /* the next are there: of the picture under the sky without its bright part */
    double rel_mse, delta_e;     /* both crosswise; roots of mean squares within tiles, */
    double delta_e_whole;        /* and over the whole picture */
    double mean_delta_e;         /* against the mean of both references, */
    double noise;                /* and what that mean has of it by itself */
    uint32_t judged_samples;
};

/* The cache, built on the first call. If there can be none the row says why, and *out is NULL. ERR_NOMEM. */
MUST_CHECK enum err cached_get(struct bench *b, struct bench_row *row, struct cached **out);
void cached_destroy(struct cached *c); /* NULL is allowed */

/* Computes both references under e by METHOD_AUTO, unless *t has them: as many samples as some 20 seconds allow, at
 * most 2048. ERR_NOMEM. */
MUST_CHECK enum err cached_truth_make(struct cached *c, const struct environment *e, struct cached_truth *t);
void cached_truth_finish(struct cached_truth *t);

/* relMSE of x against both (chart/judge.h). ERR_NOMEM. */
MUST_CHECK enum err cached_rel_mse(const struct bench *b, const struct cached_truth *t, const float *x, double *out);
