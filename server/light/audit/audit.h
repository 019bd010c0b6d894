/* Estimates the error of a displayed image d: traces a few pixels again, independently of how the image was rendered,
 * and compares them. The estimated relMSE against the truth t includes every kind of error: noise, a filter's or
 * cache's bias, samples that pixels share.
 *
 * Pixel i is drawn with probability p_i, and its light estimated without bias four times, e1 to e4. They are
 * independent of each other and of d, so for each pair
 *
 *     E[(d - e1) (d - e2)] = (d - t)^2,     relMSE = E[(d - e1) (d - e2) / (x^2 + 1e-2 m^2) / (N p_i)]
 *
 * with the N pixels' mean m of d, and x an estimate of t from the other two: d, moved to (e3 + e4) / 2 as far as their
 * difference is more than the noise of that mean [James and Stein 1961]. An x that knew of e1 or e2 would count noise
 * as an error. The result is the mean over all pairs and draws, and the scatter over the draws gives its standard
 * error.
 *
 * The estimates tell of t, not of d: under the same sky they are kept, and judge the next images too. One thread of
 * control. All random numbers follow from the seed, the key and the number of rounds since audit_forget. */
#pragma once

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#define AUDIT_PARTS 4 /* answers of one pixel: two are left where two are taken out */

struct audit_question { /* one estimate of one pixel's light */
    uint32_t pixel, paths;
    uint64_t seed;
};

struct audit_light {
    double rgb[3], variance[3]; /* an unbiased estimate, and the variance that its paths show */
    uint64_t rays;
};

struct audit_desc {
    void (*trace)(void *self, const struct audit_question *q, struct audit_light *out); /* on all OpenMP threads */
    void *self;
    const float
        *half[2];        /* float[height][width][3]: two independent images of which d is a filtered mean; NULL: none */
    const uint8_t *mask; /* [height][width]: 0 where d has no error; NULL: nowhere */
    uint64_t key;        /* of the truth: skies, and classes of light, with the same key have the same */
    double like_last;    /* 0..1: how much answers to the last image, of another truth, tell of this one's error */
    bool bounds;         /* state upper bounds only */
    double uneven; /* the variance of errors over draws, relative to their mean's square, that a bound allows for */
    double hidden; /* at least so many times the error found count as one standard error: what no guide points at */
    uint64_t seed;
    uint64_t rays;             /* no round begins after so many of this image */
    const atomic_bool *cancel; /* may be NULL */
};

struct audit_result {
    double error, deviation; /* relMSE, and its standard error; both 0: no pixel was drawn */
    double states;           /* the error as stated; 0: not known to AUDIT_DOUBT */
    double at_most;          /* if it is not known, but bounded: error plus two standard errors; else 0 */
    bool older;              /* answers to images before this one count */
    uint32_t pixels, paths;  /* judged, older ones by their weight; paths of each estimate of the last round */
    uint64_t rays;           /* traced for this image */
};

/* The largest standard error of a stated one, relative to it. Rounds end at AUDIT_ENOUGH. */
#define AUDIT_DOUBT 0.12
#define AUDIT_ENOUGH 0.10

struct audit;

/* Needs 24 bytes per pixel, and 2 MB. NULL when out of memory. */
struct audit *audit_create(uint32_t width, uint32_t height);
void audit_destroy(struct audit *a); /* NULL is allowed */

/* The next image has another truth, or must not depend on those before. */
void audit_forget(struct audit *a);

/* rgb: d, float[height][width][3]. */
void audit_image(struct audit *a, const struct audit_desc *desc, const float *rgb, struct audit_result *out);
