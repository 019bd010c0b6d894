/* server/light/pilot.h */
/* METHOD_AUTO with a time or an error: measures what each way of making the picture costs and leaves, and spends the
 * frame's time where it lowers the error most (choose/budget.h). The relighter runs what the pilot chose.
 *
 * What it measures. A group of the picture's pixels, spread over it, is shaded twice with numbers of the pilot's own;
 * half of the squared difference is the variance of either, relative as relMSE is, and the product is what leaving the
 * part out would cost. Groups take turns, and all ways are measured on the same ones. Where in a group they differ
 * tells where it is hard. Particles run in two halves, whose mean is the picture and whose difference tells the error.
 * Times are the clock's. A first frame may take 0.3 s longer for this; then three tenths of the time go to it until
 * each way is known, and later a twentieth.
 *
 * What it chooses. Direct light: a technique and a number of samples, more of them where it is hard
 * (choose/pilot_allot.h). The rest: eye paths; particles aimed at mirrors and glass, with eye paths; particles for the
 * whole scene; each with a count, or left out where that is less harm than what it costs.
 *
 * Choices follow a clock: with a pilot the same input does not give the same bits. One thread of control, that of the
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

struct pilot_target { /* one of the two is above 0; of both, the error within the time */
    double seconds;   /* for a picture, the pilot's work included; 0: none */
    double error;     /* relMSE; 0: none */
};

struct pilot_part_stats {
    bool there;       /* the scene has such a part and it was asked for */
    const char *name; /* how it is made; static; "" where it is left out */
    double n;         /* samples a point, paths a point, in the mean; particles; 0: left out */
    double seconds, expected_seconds;
    double error; /* of relMSE, as estimated: its variance, or what leaving it out costs */
};

struct pilot_stats {
    struct pilot_part_stats part[PILOT_PARTS];
    uint32_t samples;     /* N_s of direct light, the mean over the shade points */
    double seconds;       /* the picture and the pilot */
    double pilot_seconds; /* of these */
    double error;         /* relMSE, estimated: sum over the parts */
    bool met;             /* the target is met, as far as is known */
    uint32_t readings;    /* on which the least known part of it stands, under this sky */
    double more;          /* relMSE, expected if the time were doubled */
    uint64_t frames;      /* since the sky last changed by much, this one included */
};

/* r must outlive it and keep its set; desc is copied, NULL: the clock. NULL when out of memory. */
struct pilot *pilot_create(struct relighter *r, const struct pilot_desc *desc);
void pilot_destroy(struct pilot *p); /* NULL is allowed */

/* As relighter_run: rgb float[height][width][3]. Of light->direct it takes seed, pass, interleave, no_visibility,
 * cancel and why; particles and eye_paths, where given, and estimators other than PLAN_AUTO are kept to. stats->plan
 * says what was chosen; its sentences are the pilot's and stand until the next run. Cancelled frames teach nothing.
 * Errors are those of relighter_run. */
MUST_CHECK enum err pilot_run(struct pilot *p, const struct environment *e, const struct relight_desc *light,
                              const struct pilot_target *target, float *rgb, struct relight_stats *stats,
                              struct pilot_stats *measured);

const char *pilot_part_name(enum pilot_part part); /* for reports; static. Any thread. */

#endif
