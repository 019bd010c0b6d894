/* METHOD_AUTO with a time or an error: the estimators of the rules (light/plan/plan.h), with counts by measurement. The
 * frame's time is divided so that the error is least (light/plan/budget.h). No part is ever left out.
 *
 * Measurements. The pilot shades a group of pixels, spread over the image, twice with its own random numbers. Half of
 * the squared difference is the variance of each, relative as relMSE is. Groups take turns. The differences within a
 * group show which pixels are difficult: they get more samples and eye paths (light/plan/pilot_allot.h). Particles run
 * in two halves, whose mean is the image and whose difference gives the error. The clock times whole images.
 *
 * The first frame begins with a quick image and measures the whole of it; both count as its time. If the time pays
 * for no more, the quick image is the frame. Later frames spend three tenths of their time on measurements until each
 * part has a few, then a twentieth, and a fiftieth once there are many.
 *
 * With a time, light besides direct light is denoised where so few samples would have more error than the filter
 * (PILOT_FILTER_ABOVE). With an error alone nothing is denoised.
 *
 * Counts depend on the clock, so the same input does not give the same bits. Thread: the relighter's. */
#pragma once

#include "light/frame/relight.h"
#include "light/plan/budget.h"

/* relMSE of the court's denoised images with few samples, in all light: a lower one is expected of the samples alone,
 * or they are filtered (docs/noise.md). */
#define PILOT_FILTER_ABOVE 0.02

struct pilot;

enum pilot_part {
    PILOT_DIRECT, /* direct light */
    PILOT_EYE,    /* eye paths */
    PILOT_AIMED,  /* particles, aimed at mirrors and glass */
    PILOT_WHOLE,  /* particles, for the whole scene */
    PILOT_PARTS,
};

struct pilot_work {       /* what was computed */
    enum pilot_part part; /* PILOT_PARTS: from points to pixels, and the filter */
    uint64_t points, rays;
    double n; /* samples or paths a point, particles */
};

struct pilot_desc {
    double (*price)(const struct pilot_work *work); /* replaces the clock's seconds in tests; NULL: use the clock */
};

struct pilot_part_stats {
    bool there;       /* the scene has this part and the request includes it */
    const char *name; /* of the estimator; static; "" if not there */
    double n;         /* mean samples or paths per point; or particles */
    double seconds;
    double error; /* estimated share of relMSE */
};

struct pilot_stats {
    struct pilot_part_stats part[PILOT_PARTS];
    uint32_t samples;     /* N_s of direct light, averaged over the shade points */
    double seconds;       /* of the image and the pilot */
    double pilot_seconds; /* of these, the pilot's */
    double error;         /* relMSE, estimated: sum over the parts, before a filter; 0: not measured yet */
    bool denoised;        /* the time pays for too few samples without a filter */
    bool in_time;         /* the fewest samples take no longer than the target's time */
    bool met;             /* in_time, and neither `error` nor the audit's estimate is above the target's */
    uint32_t readings;    /* of the least measured part, under this sky */
    uint64_t frames;      /* since the sky last changed much, including this one */
};

/* r must outlive the pilot and keep its set. desc is copied; NULL: use the clock. NULL when out of memory. */
struct pilot *pilot_create(struct relighter *r, const struct pilot_desc *desc);
void pilot_destroy(struct pilot *p); /* NULL is allowed */

/* As relighter_run: rgb float[height][width][3]. It uses seed, pass, no_visibility, cancel and why of
 * light->direct, and respects explicit particles, eye_paths and estimators. stats->plan receives the choice; its
 * sentences are valid until the next run. Cancelled frames are not measured. Errors are those of relighter_run. */
MUST_CHECK enum err pilot_run(struct pilot *p, const struct environment *e, const struct relight_desc *light,
                              const struct budget_target *target, float *rgb, struct relight_stats *stats,
                              struct pilot_stats *measured);

const char *pilot_part_name(enum pilot_part part); /* for reports; static. Any thread. */
