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

#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "scene/geometry/view.h"
#include "sky/tables/environment.h"

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

/* ---- Traced pixels ---- */

/* Path-traces the light of single pixels for audit.h, from the G-buffer's shade points like the image, but with
 * separate code and random numbers. Thread: any. */

/* Low-discrepancy numbers of paths' first events. */
#define AUDIT_NUMBERS_PATHS 256 /* more paths repeat them, shifted anew */
#define AUDIT_NUMBERS_PLACES 18 /* one pair for the start, four for each of two events */
struct audit_numbers {
    uint64_t at[AUDIT_NUMBERS_PATHS][AUDIT_NUMBERS_PLACES]; /* units of 2^-64 */
};

/* Fills all of *n, the same each time. */
void audit_numbers_fill(struct audit_numbers *n);

struct audit_world {
    const struct scene *scene;
    const struct rays *rays;
    const struct gbuffer *gbuffer; /* with all pixels; and packets, unless `whole` */
    const struct view *view;
    const struct environment *environment; /* complete */
    const struct audit_numbers *numbers;   /* filled */
    uint32_t classes, behind;              /* PATH_* at points seen directly, and seen in mirrors and through glass */
    bool background;                       /* the image has the sky */
    bool whole; /* the image is a reference's (light/frame/relighter.h), of `classes`: paths begin in the pixel */
    const double *bare_ground; /* of path_world; NULL: the scene has no ground. Only with `whole` */
};

/* audit_desc.trace; self: a struct audit_world. */
void audit_trace(void *world, const struct audit_question *q, struct audit_light *out);

/* ---- Its cost ---- */

/* How many rays the audits of a relighter's images may trace, and what they may take over from the images before.
 * One thread of control. */

struct purse { /* zeroed: nothing was lit */
    bool settled;
    double rays;               /* left of what live images have paid */
    double begun_s;            /* the process's processor time before the first image; 0: there was none */
    double spent_s, traced;    /* by audits: processor time, rays */
    double energy[CUBE_FACES]; /* of the last image's sky */
    uint64_t way;              /* in which the last image was made */
};

/* Rays for an image that pays `rays`: what live ones save up, once it is worth an audit, else 500,000 more. Small
 * images, and those of a cache, cost less than any audit. settled: by a finished cache; the first of them may trace
 * more. */
uint64_t purse_pay(struct purse *p, bool live, bool settled, double rays);

/* So many of these rays that audits take at most the share `most` of the processor time since the first image, by
 * what their rays took; 0 when too few are left for one. used_s: the process's processor time. */
uint64_t purse_limit(struct purse *p, double most, double used_s, uint64_t rays);

/* An image's audit has traced so many, in so much processor time. */
void purse_spend(struct purse *p, bool live, uint64_t rays, double seconds);

/* How much of what is known of the last image's error is true of this one's, 0..1: 0 unless it was made in the same
 * way, any number that tells ways apart, under nearly the same sky. */
double purse_like_last(struct purse *p, const struct environment *e, uint64_t way);
