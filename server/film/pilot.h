/* server/film/pilot.h */
/* Model no more than a scene needs: a pilot goes ahead of the picture, measures what each way of making it costs and
 * leaves, and spends the frame's time where it lowers the error most (plan/budget.h).
 *
 * What it measures. A group of the picture's pixels, spread over it, is shaded twice with other random numbers; half of
 * the squared difference is the variance of either, relative as relMSE is. The picture itself is one of the two where
 * its own way is measured. Groups take turns. Light tracing runs in two halves, whose mean is the picture and whose
 * difference tells the error, at no loss. The product of the two, instead of their difference, is what leaving the part
 * out would cost. Ways are compared on the same groups. Where in a group they differ tells where it is hard. Times are
 * the clock's. A first frame may take 0.3 s longer for this; then three tenths of the time go to it, until each way has
 * been seen, and later a twentieth.
 *
 * What it chooses. Direct light: one of several techniques (pilot_technique_name) and a number of samples, for matte
 * and for glossy surfaces apart, more of them where it is hard (pilot_allot.h). The rest: eye paths, the light tracer
 * for caustics with eye paths, the light tracer for both; each of them with a count, or left out where that is less
 * harm than what it costs. Smooth edges: all shade points of a pixel, or one.
 *
 * Choices follow a clock: with a pilot the same input does not give the same bits. One thread of control. */
#ifndef FILM_PILOT_H
#define FILM_PILOT_H

#include "relight.h"

struct pilot;

enum pilot_part {
    PILOT_MATTE,  /* direct light on surfaces that scatter evenly */
    PILOT_GLOSSY, /* and on the others */
    PILOT_EYE,    /* eye paths */
    PILOT_AIMED,  /* the light tracer, aimed at mirrors and glass */
    PILOT_WHOLE,  /* the light tracer, for the whole scene */
    PILOT_PARTS,
};

/* What has been done, for whoever says what it took. */
struct pilot_work {
    enum pilot_part part; /* PILOT_PARTS: from points to pixels */
    uint64_t points, rays;
    double n; /* samples or paths a point, particles */
};

struct pilot_desc {
    double (*price)(const struct pilot_work *work); /* seconds, instead of the clock's: for tests; NULL: the clock */
};

struct pilot_wish {
    double seconds; /* for a picture, all in relighter's work; 0: none is wished for */
    double error;   /* relMSE; 0: none. One of the two is given; of both, the error within the time */
};

struct pilot_part_stats {
    bool there;       /* the scene has such a part and it was asked for */
    const char *name; /* of the technique; "" where it is left out */
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
    bool met;             /* the wish can be met, as far as is known */
    uint32_t readings;    /* on which the least known part of it stands, made since its way was chosen */
    double more;          /* relMSE, expected if the time were doubled */
    double edge_points;   /* share of the shade points that stand in pixels with several */
    double edge_error;    /* relMSE, what one shade point instead of several in these pixels would cost, */
    bool jagged;          /* and does: all time went to samples (in `error`) */
    uint64_t frames;      /* since the sky last changed by much, this one included */
};

/* set and kernels must outlive it. NULL when out of memory. */
struct pilot *pilot_create(const struct set *set, const struct kernels *kernels, const struct pilot_desc *desc);
void pilot_destroy(struct pilot *p); /* NULL is allowed */

/* As relighter_run. Of light->direct it takes seed, pass, interleave, no_visibility, cancel and why; particles and
 * eye_paths, where given, and estimators other than PLAN_AUTO are kept to. stats->plan says what was chosen; its
 * sentences are the pilot's and stand until the next run. Cancelled frames teach nothing. */
MUST_CHECK enum err pilot_run(struct pilot *p, const struct environment *e, const struct relight_desc *light,
                              const struct pilot_wish *wish, float *rgb, struct relight_stats *stats,
                              struct pilot_stats *pilot_stats);

#define PILOT_TECHNIQUES 7 /* of direct light */

const char *pilot_technique_name(uint32_t technique);
const char *pilot_part_name(enum pilot_part part);

#endif
