/* METHOD_AUTO with a time or an error: measures time and error of each technique for each part of the picture, and
 * divides the frame's time so that the error is minimal (choose/budget.h). The relighter runs the choice.
 *
 * Measurements. The pilot shades a group of pixels, spread over the picture, twice with its own random numbers. Half of
 * the squared difference is the variance of each, relative as relMSE is; the product is the error of omitting the part.
 * Groups take turns, and all techniques are measured on the same groups. The differences within a group show which
 * pixels are difficult. Particles run in two halves, whose mean is the picture and whose difference gives the error.
 * The clock gives the times. The first frame may take 0.3 s longer. Measurements then take three tenths of the time
 * until every technique is known, then a twentieth, and a fiftieth once there are many readings.
 *
 * Choices. Direct light: a technique and a number of samples, with more samples where pixels are difficult
 * (choose/pilot_allot.h). Other light: eye paths; particles aimed at mirrors and glass, with eye paths; particles for
 * the whole scene; each with a count, or omitted if its time is better spent elsewhere.
 *
 * Choices depend on the clock, so the same input does not give the same bits. Thread: the relighter's. */
#pragma once

#include "light/relight.h"

struct pilot;

enum pilot_part {
    PILOT_DIRECT, /* direct light */
    PILOT_EYE,    /* eye paths */
    PILOT_AIMED,  /* particles, aimed at mirrors and glass */
    PILOT_WHOLE,  /* particles, for the whole scene */
    PILOT_PARTS,
};

struct pilot_work {       /* what was computed */
    enum pilot_part part; /* PILOT_PARTS: the resolve from points to pixels */
    uint64_t points, rays;
    double n; /* samples or paths a point, particles */
};

struct pilot_desc {
    double (*price)(const struct pilot_work *work); /* replaces the clock's seconds in tests; NULL: use the clock */
};

struct pilot_target { /* at least one is above 0; with both, the error is lowered within the time only */
    double seconds;   /* for a picture, including the pilot's work; 0: no limit */
    double error;     /* relMSE; 0: none */
};

struct pilot_part_stats {
    bool there;       /* the scene has this part and the request includes it */
    const char *name; /* of the technique; static; "" if omitted */
    double n;         /* mean samples or paths per point; or particles; 0: omitted */
    double seconds, expected_seconds;
    double error; /* estimated share of relMSE: its variance, or the error of omitting it */
};

struct pilot_stats {
    struct pilot_part_stats part[PILOT_PARTS];
    uint32_t samples;     /* N_s of direct light, averaged over the shade points */
    double seconds;       /* of the picture and the pilot */
    double pilot_seconds; /* of these, the pilot's */
    double error;         /* relMSE, estimated: sum over the parts */
    bool met;             /* time suffices, and neither `error` nor the audit's estimate is above the target's */
    uint32_t readings;    /* of the least measured part, under this sky */
    double more;          /* expected relMSE in twice the time */
    uint64_t frames;      /* since the sky last changed much, including this one */
};

/* r must outlive the pilot and keep its set. desc is copied; NULL: use the clock. NULL when out of memory. */
struct pilot *pilot_create(struct relighter *r, const struct pilot_desc *desc);
void pilot_destroy(struct pilot *p); /* NULL is allowed */

/* As relighter_run: rgb float[height][width][3]. It uses seed, pass, interleave, no_visibility, cancel and why of
 * light->direct, and respects explicit particles, eye_paths and estimators. stats->plan receives the choice; its
 * sentences are valid until the next run. Cancelled frames are not measured. Errors are those of relighter_run. */
MUST_CHECK enum err pilot_run(struct pilot *p, const struct environment *e, const struct relight_desc *light,
                              const struct pilot_target *target, float *rgb, struct relight_stats *stats,
                              struct pilot_stats *measured);

const char *pilot_part_name(enum pilot_part part); /* for reports; static. Any thread. */
