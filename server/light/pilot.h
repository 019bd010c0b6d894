/* server/light/pilot.h */
/* METHOD_AUTO with a time or an error: measures time and error of each way to make the parts of the picture, and
 * divides the frame's time so that the error is least (choose/budget.h). The relighter runs the choice.
 *
 * Measurements. A group of pixels, spread over the picture, is shaded twice with random numbers of the pilot's own.
 * Half of the squared difference is the variance of either, relative as relMSE is; the product is the error of leaving
 * the part out. Groups take turns, and all ways are measured on the same ones. The differences within a group show
 * which pixels are hard. Particles run in two halves, whose mean is the picture and whose difference gives the error.
 * The clock gives the times. The first frame may take 0.3 s longer; then three tenths of the time are for measurements
 * until each way is known, and later a twentieth.
 *
 * Choices. Direct light: a technique and a number of samples, more of them where it is hard (choose/pilot_allot.h). The
 * rest: eye paths; particles aimed at mirrors and glass, with eye paths; particles for the whole scene; each with a
 * count, or left out if its time gains more elsewhere.
 *
 * Choices depend on the clock, so that the same input does not give the same bits. One thread of control, that of the
 * relighter. */
#ifndef LIGHT_PILOT_H
#define LIGHT_PILOT_H

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
    enum pilot_part part; /* PILOT_PARTS: from points to pixels */
    uint64_t points, rays;
    double n; /* samples or paths a point, particles */
};

struct pilot_desc {
    double (*price)(const struct pilot_work *work); /* seconds, instead of the clock's: for tests; NULL: the clock */
};

struct pilot_target { /* one of the two is above 0; with both, the error is lowered within the time only */
    double seconds;   /* for a picture, the pilot's work included; 0: none */
    double error;     /* relMSE; 0: none */
};

struct pilot_part_stats {
    bool there;       /* the scene has such a part and it was requested */
    const char *name; /* how it is made; static; "" where it is left out */
    double n;         /* samples a point, paths a point, in the mean; particles; 0: left out */
    double seconds, expected_seconds;
    double error; /* estimated part of relMSE: its variance, or the error of leaving it out */
};

struct pilot_stats {
    struct pilot_part_stats part[PILOT_PARTS];
    uint32_t samples;     /* N_s of direct light, the mean over the shade points */
    double seconds;       /* the picture and the pilot */
    double pilot_seconds; /* of these */
    double error;         /* relMSE, estimated: sum over the parts */
    bool met;             /* the target is met, as far as is known */
    uint32_t readings;    /* of the part with the fewest, under this sky */
    double more;          /* relMSE expected in twice the time */
    uint64_t frames;      /* since the sky last changed much, including this one */
};

/* r must outlive it and keep its set; desc is copied, NULL: the clock. NULL when out of memory. */
struct pilot *pilot_create(struct relighter *r, const struct pilot_desc *desc);
void pilot_destroy(struct pilot *p); /* NULL is allowed */

/* As relighter_run: rgb float[height][width][3]. It uses seed, pass, interleave, no_visibility, cancel and why of
 * light->direct, and keeps to particles, eye_paths and estimators that are given. stats->plan has the choice; its
 * sentences are valid until the next run. Cancelled frames teach nothing. Errors are those of relighter_run. */
MUST_CHECK enum err pilot_run(struct pilot *p, const struct environment *e, const struct relight_desc *light,
                              const struct pilot_target *target, float *rgb, struct relight_stats *stats,
                              struct pilot_stats *measured);

const char *pilot_part_name(enum pilot_part part); /* for reports; static. Any thread. */

#endif
