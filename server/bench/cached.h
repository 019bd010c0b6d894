/* What the rows of the cache of light transport share: the cache is made once, by the first of them. Inside this room
 * only; main thread. */
#ifndef BENCH_CACHED_H
#define BENCH_CACHED_H

#include "bench/bench_parts.h"

#define CACHED_SAMPLES 64 /* N of `cached` and of `mis` beside it, whatever the other rows have */

/* Two references of one sky, of different random numbers, so that an error is what a picture is off from both: their
 * noise does not count as its own. */
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
    bool refused;              /* there is none: why */
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

/* Makes the cache where it is not there yet. Where there is none the row says why, and *out is NULL. ERR_NOMEM. */
MUST_CHECK enum err cached_get(struct bench *b, struct bench_row *row, struct cached **out);
void cached_destroy(struct cached *c); /* NULL is allowed */

/* Both references under e, where they are not there yet, by METHOD_AUTO: as many samples as some 20 seconds allow, at
 * most 2048. ERR_NOMEM. */
MUST_CHECK enum err cached_truth_make(struct cached *c, const struct environment *e, struct cached_truth *t);
void cached_truth_finish(struct cached_truth *t);

/* relMSE (metrics.h) of x against both, their errors multiplied crosswise. */
double cached_rel_mse(const struct cached *c, const struct cached_truth *t, const float *x);

#endif
