/* Shared by the pilot's files: pilot.c makes the frame, pilot_probe.c measures techniques on groups of pixels,
 * pilot_choose.c decides, pilot_report.c fills the statistics. Thread: as pilot.h. */
#pragma once

#include "choose/budget.h"
#include "choose/pilot_allot.h"
#include "choose/pilot_measure.h"
#include "choose/pilot_model.h"
#include "light/pilot.h"
#include "light/relight_passes.h"

#define UNIT_PARTICLES 2048.0 /* n of particles: two halves of whole batches */
#define TECHNIQUES 3          /* of direct light */
#define ROUTES 3              /* combinations of techniques for everything but direct light */

/* A technique for a part of the picture. */
enum {
    WAY_DIRECT = 0,           /* + technique */
    WAY_EYE_ALL = TECHNIQUES, /* eye paths for everything but direct light and background, */
    WAY_EYE_REST,             /* in addition to particles aimed at mirrors and glass, */
    WAY_EYE_BEHIND,           /* for points that no light path reaches */
    WAY_AIMED,                /* particles aimed at mirrors and glass */
    WAY_WHOLE,
    WAYS,
    WAY_NONE = WAYS,
};

struct technique {
    const char *name;
    struct direct_desc desc;
};
extern const struct technique techniques[TECHNIQUES];
extern const uint32_t pilot_routes[ROUTES + 1][3]; /* ways of PILOT_EYE, PILOT_AIMED, PILOT_WHOLE; the last: none */

struct way_classes {
    uint32_t classes, behind; /* PATH_*, at points seen directly and at those behind mirrors and glass */
};

struct choice {                /* of one frame */
    uint32_t route;            /* ROUTES: none yet */
    uint32_t way[PILOT_PARTS]; /* WAY_NONE: left out */
    double n[PILOT_PARTS];
};

struct pilot {
    struct relighter *relighter;
    struct passes *passes; /* the relighter's */
    const struct set *set;
    struct pilot_desc desc;
    struct groups groups;
    struct allotment allot[PILOT_EYE + 1]; /* samples, and eye paths, among packets */
    uint32_t allot_readings[PILOT_EYE + 1],
        allot_turns[PILOT_EYE + 1]; /* groups read since the shares changed; number of changes of the shares */
    float (*point_error)[PACKET];   /* [packet_count]: scratch */
    float *pair[2];                 /* [packet_count][3][16]: scratch */
    float *spread[2];               /* [height][width][3]: scratch */
    uint8_t *mask;                  /* [height][width]: resolve_mask */

    /* Depends on request, scene and sky; models are reset when these change. */
    uint32_t classes; /* PATH_* except direct light, requested and present in the scene */
    bool with_direct;
    enum plan_estimator caustics_by, indirect_by;
    uint32_t eye_paths;        /* requested; 0: the pilot chooses */
    uint64_t particles;        /* likewise */
    double energy[CUBE_FACES]; /* of the sky that the readings belong to, */
    double peakedness;         /* its facts_peakedness; 0: black, or no readings yet */
    bool offered[WAYS];        /* available for the choice */
    struct way_classes find[WAYS];

    struct model model[WAYS];
    struct choice choice;
    struct budget budget;          /* of the choice */
    double more;                   /* pilot_stats.more */
    bool begun;                    /* the first frame has measured */
    double group_times;            /* time of a picture over the time extrapolated from a group; smoothed; 0: unknown */
    double other_s;                /* seconds from points to pixels; smoothed */
    double frame_s;                /* seconds of a frame; smoothed */
    double bank_s;                 /* seconds left for measurements; negative: overdrawn */
    uint32_t next_way, next_group; /* to measure next */
    uint64_t pass;                 /* for the pilot's own random numbers */
    uint64_t frames;               /* since the sky changed */
    uint64_t runs;

    /* Of the current frame. */
    const struct environment *environment;
    const struct relight_desc *light;
    struct yardstick yardstick;
    double picture_s, pilot_s;
    double ran_s[PILOT_PARTS];
    char sentence[PLAN_LEFT_OUT_MAX][160];
};

/* Seconds of some work, from the price list or, without one, from the clock. */
double pilot_seconds(const struct pilot *p, const struct pilot_work *work, double by_clock);
enum pilot_part pilot_part_of(uint32_t way); /* WAY_*, not WAY_NONE */
uint64_t pilot_pass(struct pilot *p);        /* a pass number that no picture uses */

/* A pass with one technique and a mean count of n over the picture. The per-packet counts of direct light and eye
 * paths, which the result borrows, stay valid until the next call for the same part. */
struct direct_desc pilot_direct(struct pilot *p, uint32_t way, double n, uint64_t pass, const struct packet_list *only);
struct eye_paths_desc pilot_eye(struct pilot *p, uint32_t way, double n, uint64_t pass, const struct packet_list *only);
struct light_tracer_desc pilot_light(struct pilot *p, uint32_t way, double n, uint64_t pass);
struct picture_passes pilot_passes(struct pilot *p, uint64_t pass); /* the choice, as passes of the relighter */
struct allot_count pilot_count(const struct pilot *p, uint32_t way, double n);

/* ---- pilot_probe.c ---- */

/* Ages the readings if the sky has changed since. */
void pilot_look_at_sky(struct pilot *p);
/* Whether e has about the energy of a sky before, in all and by faces. */
bool pilot_same_sky(const double before[CUBE_FACES], const struct environment *e);
/* Adds the reading from two halves of n units of particles. */
void pilot_read_light(struct pilot *p, uint32_t way, double n, float *const half[2]);
/* Measures direct light on the whole picture, n samples per point: finds where it is difficult. Errors are those of
 * direct_shade.
 */
MUST_CHECK enum err pilot_probe_first(struct pilot *p, double n);
/* Measures one technique after the other within the time for measurements. Errors are those of the passes. */
MUST_CHECK enum err pilot_probe(struct pilot *p, const struct pilot_target *target);
/* Share of a frame's time that goes to measurements. */
double pilot_share(const struct pilot *p);

/* ---- pilot_choose.c ---- */

/* Above this peakedness measurements cannot judge lobe rays behind mirrors and glass: they hit the sun so rarely that
 * only the picture shows it. */
#define PEAKED_MOST 100.0
/* Copies the request; resets the models if it has changed. */
void pilot_take_request(struct pilot *p, const struct relight_desc *light);
void pilot_offer_ways(struct pilot *p); /* by request, scene and sky */
/* Sets the choice, its budget and `more`. */
void pilot_choose(struct pilot *p, const struct pilot_target *target);
double pilot_error(const struct pilot *p); /* expected relMSE of the choice */
/* relMSE of omitting the part; 0: it is not omitted, or its error is unknown. */
double pilot_missing(const struct pilot *p, enum pilot_part part);

/* ---- pilot_report.c ---- */

/* Audits the frame and fills its statistics. */
void pilot_report(struct pilot *p, const struct pilot_target *target, const float *rgb, struct relight_stats *stats,
                  struct pilot_stats *out);
