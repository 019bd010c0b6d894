/* Shared by the pilot's files: pilot.c makes the frame, pilot_probe.c measures parts on groups of pixels,
 * pilot_choose.c decides, pilot_report.c fills the statistics. Thread: as pilot.h. */
#pragma once

#include "light/frame/pilot.h"
#include "light/frame/relight_passes.h"
#include "light/plan/pilot_allot.h"
#include "light/plan/pilot_measure.h"

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
