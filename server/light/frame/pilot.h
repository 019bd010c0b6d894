/* METHOD_AUTO with a time or an error: the estimators of the rules (light/plan/plan.h), with counts by measurement. The
 * frame's time is divided so that the error is least (light/plan/pilot_measure.h). No part is ever left out.
 *
 * Measurements. The pilot shades a group of pixels, spread over the image, twice with its own random numbers. Half of
 * the squared difference is the variance of each, relative as relMSE is. Groups take turns. The differences within a
 * group show which pixels are difficult: they get more samples and eye paths (light/plan/pilot_measure.h). Particles
 * run in two halves, whose mean is the image and whose difference gives the error. The clock times whole images.
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

#include "light/frame/frame_plan.h"
#include "light/frame/relight.h"
#include "light/plan/pilot_measure.h"

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

/* Shared by the pilot's files: pilot.c makes the frame, pilot_probe.c measures parts on groups of pixels,
 * pilot_choose.c decides, pilot_report.c fills the statistics. Thread: as pilot.h. */

#define UNIT_PARTICLES 2048.0 /* n of particles: two halves of whole batches */

struct pilot {
    struct relighter *relighter;
    struct passes *passes; /* the relighter's */
    const struct prepared_scene *set;
    struct pilot_desc desc;
    struct groups groups;
    struct allotment allot[PILOT_EYE + 1]; /* samples, and eye paths, among packets */
    uint32_t allot_readings[PILOT_EYE + 1],
        allot_turns[PILOT_EYE + 1]; /* groups read since the shares changed; number of changes of the shares */
    float (*point_error)[PACKET];   /* [packet_count]: scratch */
    float *pair[2];                 /* [packet_count][3][16]: scratch */
    float *spread[2];               /* [height][width][3]: scratch */
    uint8_t *mask;                  /* [height][width]: resolve_mask */

    /* By request, scene and sky. */
    struct relight_desc wanted; /* the request that `plan` and `rule` belong to, without its borrowed pointers */
    struct plan plan;           /* by the rules, */
    struct eye_paths_desc eye;  /* as passes; paths 0: none */
    struct light_tracer_desc light_by[2]; /* of PILOT_AIMED and PILOT_WHOLE; particles 0: none */
    bool background;
    bool offered[PILOT_PARTS]; /* requested, and present in the scene */
    double energy[CUBE_FACES]; /* of the sky that the readings belong to */

    struct model model[PILOT_PARTS];
    double n[PILOT_PARTS];          /* chosen */
    bool denoised;                  /* likewise */
    struct budget budget;           /* of the choice */
    bool begun;                     /* the first frame has measured */
    double other_s;                 /* seconds from points to pixels, and of the filter; smoothed */
    double frame_s;                 /* seconds of a frame; smoothed */
    double bank_s;                  /* seconds left for measurements; negative: overdrawn */
    uint32_t next_part, next_group; /* to measure next */
    uint64_t pass;                  /* for the pilot's own random numbers */
    uint64_t frames;                /* since the sky changed */
    uint64_t runs;

    /* Of the current frame. */
    const struct environment *environment;
    const struct relight_desc *light;
    struct yardstick yardstick;
    double image_s, pilot_s;
    double ran_s[PILOT_PARTS];
};

/* Seconds of some work, from the price list or, without one, from the clock. */
double pilot_seconds(const struct pilot *p, const struct pilot_work *work, double by_clock);
uint64_t pilot_pass(struct pilot *p); /* a pass number that no image uses */

/* A pass with a mean count of n over the image. The per-packet counts of direct light and eye paths, which the result
 * borrows, stay valid until the next call for the same part. */
struct direct_desc pilot_direct(struct pilot *p, double n, uint64_t pass, const struct packet_list *only);
struct eye_paths_desc pilot_eye(struct pilot *p, double n, uint64_t pass, const struct packet_list *only);
struct frame_plan pilot_passes(struct pilot *p, uint64_t pass); /* the choice, as passes of the relighter */
struct allot_count pilot_count(enum pilot_part part, double n);

/* ---- pilot_probe.c ---- */

/* Whether e has about the energy of a sky before, in all and by faces. */
bool pilot_same_sky(const double before[CUBE_FACES], const struct environment *e);
/* Adds the reading from two halves of n units of particles. */
void pilot_read_light(struct pilot *p, enum pilot_part part, double n, float *const half[2]);
/* Measures direct light or eye paths on the whole image, n per point: finds where it is difficult. Errors are those
 * of the passes. */
MUST_CHECK enum err pilot_probe_whole(struct pilot *p, enum pilot_part part, double n);
/* Measures one part after the other within the time for measurements. Errors are those of the passes. */
MUST_CHECK enum err pilot_probe(struct pilot *p, const struct budget_target *target);
/* Share of a frame's time that goes to measurements. */
double pilot_share(const struct pilot *p);

/* ---- pilot_choose.c ---- */

/* Follows request and sky: plans by the rules, resets the models whose estimators have changed, and ages the others'
 * readings if the sky has. */
void pilot_follow(struct pilot *p);
void pilot_choose_first(struct pilot *p, bool denoised); /* counts of the quick image */
/* Sets the counts and their budget. */
void pilot_choose(struct pilot *p, const struct budget_target *target);
double pilot_error(const struct pilot *p); /* expected relMSE of the choice, without a filter */

/* ---- pilot_report.c ---- */

/* Audits the frame and fills its statistics. */
void pilot_report(struct pilot *p, const struct budget_target *target, const float *rgb, struct relight_stats *stats,
                  struct pilot_stats *out);
