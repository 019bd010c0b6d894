/* server/light/pilot_parts.h */
/* Shared by the pilot's files: pilot.c makes the frame, pilot_probe.c measures ways on groups of pixels, pilot_choose.c
 * decides, pilot_report.c fills the statistics. One thread of control, as pilot.h. */
#ifndef LIGHT_PILOT_PARTS_H
#define LIGHT_PILOT_PARTS_H

#include "choose/budget.h"
#include "choose/pilot_allot.h"
#include "choose/pilot_measure.h"
#include "choose/pilot_model.h"
#include "light/pilot.h"
#include "light/relight_passes.h"

#define UNIT_PARTICLES 2048.0 /* n of particles: two halves of whole batches */
#define TECHNIQUES 3          /* of direct light */
#define ROUTES 3              /* combinations of ways for all but direct light */

/* A way to make a part of the picture. */
enum {
    WAY_DIRECT = 0,           /* + technique */
    WAY_EYE_ALL = TECHNIQUES, /* eye paths for all but direct light and background, */
    WAY_EYE_REST,             /* beside particles aimed at mirrors and glass, */
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
        allot_turns[PILOT_EYE + 1]; /* groups read since the shares changed; number of changes */
    float (*point_error)[PACKET];   /* [packet_count]: scratch */
    float *pair[2];                 /* [packet_count][3][16]: scratch */
    float *spread[2];               /* [height][width][3]: scratch */
    uint8_t *mask;                  /* [height][width]: resolve_mask */

    /* Of the request, the scene and the sky; models are reset when they change. */
    uint32_t classes; /* PATH_* but direct light, requested and present in the scene */
    bool with_direct;
    enum plan_estimator caustics_by, indirect_by;
    uint32_t eye_paths;        /* requested; 0: to be chosen */
    uint64_t particles;        /* likewise */
    double energy[CUBE_FACES]; /* of the sky of the readings, */
    double peakedness;         /* and facts_peakedness; 0: black, or there was none yet */
    bool offered[WAYS];        /* may be chosen here */
    struct way_classes find[WAYS];

    struct model model[WAYS];
    struct choice choice;
    struct budget budget;          /* of the choice */
    double more;                   /* pilot_stats.more */
    bool begun;                    /* the first frame has measured */
    double group_times;            /* a picture's time over that extrapolated from a group; smoothed; 0: unknown */
    double other_s;                /* seconds from points to pixels; smoothed */
    double frame_s;                /* seconds of a frame; smoothed */
    double bank_s;                 /* seconds left for measurements; below 0: overdrawn */
    uint32_t next_way, next_group; /* to be measured */
    uint64_t pass;                 /* of the pilot's own numbers */
    uint64_t frames;               /* since the sky changed */
    uint64_t runs;

    /* Of the frame that is being made. */
    const struct environment *environment;
    const struct relight_desc *light;
    struct yardstick yardstick;
    double picture_s, pilot_s;
    double ran_s[PILOT_PARTS];
    char sentence[PLAN_LEFT_OUT_MAX][160];
};

/* Seconds of some work by the price list or, without one, by the clock. */
double pilot_seconds(const struct pilot *p, const struct pilot_work *work, double by_clock);
enum pilot_part pilot_part_of(uint32_t way); /* WAY_*, not WAY_NONE */
uint64_t pilot_pass(struct pilot *p);        /* a number whose random numbers no picture uses */

/* A pass by a way, n in the mean over the picture; the counts of direct light and eye paths, which the description
 * refers to, stay until the next call for the same part. */
struct direct_desc pilot_direct(struct pilot *p, uint32_t way, double n, uint64_t pass, const struct packet_list *only);
struct eye_paths_desc pilot_eye(struct pilot *p, uint32_t way, double n, uint64_t pass, const struct packet_list *only);
struct light_tracer_desc pilot_light(struct pilot *p, uint32_t way, double n, uint64_t pass);
struct allot_count pilot_count(const struct pilot *p, uint32_t way, double n);

/* ---- pilot_probe.c ---- */

/* Ages the readings if the sky differs from theirs. */
void pilot_look_at_sky(struct pilot *p);
/* Adds the reading of two halves of n units of particles. */
void pilot_read_light(struct pilot *p, uint32_t way, double n, float *const half[2]);
/* Measures direct light on the whole picture, n samples per point: where it is hard. Errors are those of direct_shade.
 */
MUST_CHECK enum err pilot_probe_first(struct pilot *p, double n);
/* Measures one way after the other within the time for measurements. Errors are those of the passes. */
MUST_CHECK enum err pilot_probe(struct pilot *p, const struct pilot_target *target);
/* Seconds that the first frame may take longer; INFINITY: until each way is known. */
double pilot_first_s(const struct pilot_target *target);
/* Share of a frame that goes to measurements. */
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
double pilot_error(const struct pilot *p); /* relMSE expected of the choice */
/* relMSE of leaving the part out; 0: it is not left out, or nothing is known of it. */
double pilot_missing(const struct pilot *p, enum pilot_part part);

/* ---- pilot_report.c ---- */

/* Fills the statistics of the frame. */
void pilot_report(struct pilot *p, struct relight_stats *stats, struct pilot_stats *out);

#endif
