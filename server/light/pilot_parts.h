/* server/light/pilot_parts.h */
/* What the pilot's files share: pilot.c makes the frame, pilot_probe.c measures ways on groups of pixels,
 * pilot_choose.c decides, pilot_report.c puts it into words. One thread of control, as pilot.h. */
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
#define ROUTES 3              /* ways by which a frame may have its other light, together */

/* A way to make a part of the picture: what is measured, timed and chosen among. */
enum {
    WAY_DIRECT = 0,           /* + technique */
    WAY_EYE_ALL = TECHNIQUES, /* eye paths for all that is neither direct nor background, */
    WAY_EYE_REST,             /* for what light that is aimed at mirrors and glass leaves, */
    WAY_EYE_BEHIND,           /* for what no light path reaches */
    WAY_AIMED,                /* particles */
    WAY_WHOLE,
    WAYS,
    WAY_NONE = WAYS,
};

struct technique {
    const char *name;
    struct direct_desc desc;
};
extern const struct technique techniques[TECHNIQUES];
extern const uint32_t pilot_routes[ROUTES][3]; /* ways of PILOT_EYE, PILOT_AIMED, PILOT_WHOLE */

struct way_classes {
    uint32_t classes, behind; /* PATH_*, at points seen directly and at those behind mirrors and glass */
};

struct choice {                /* what a frame is made by */
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
    struct allotment allot[PILOT_EYE + 1];                              /* samples, and eye paths, among packets */
    uint32_t allot_readings[PILOT_EYE + 1], allot_turns[PILOT_EYE + 1]; /* groups read since shares changed; changes */
    float (*point_error)[PACKET];                                       /* [packet_count]: scratch */
    float *pair[2];                                                     /* [packet_count][3][16]: scratch */
    float *spread[2];                                                   /* [height][width][3]: scratch */
    uint8_t *mask;                                                      /* [height][width]: resolve_mask */

    /* Of the request, the scene and the sky; models are made anew when they change. */
    uint32_t classes; /* of the other light: asked for, and to be found in the scene */
    bool with_direct;
    enum plan_estimator caustics_by, indirect_by;
    uint32_t eye_paths;        /* asked for; 0: open */
    uint64_t particles;        /* likewise */
    double energy[CUBE_FACES]; /* of the sky that the readings are of, */
    double peakedness;         /* and facts_peakedness; 0: black, or there was none yet */
    bool offered[WAYS];        /* may be chosen here */
    struct way_classes find[WAYS];

    struct model model[WAYS];
    struct choice choice;
    struct budget budget;          /* of the choice */
    double more;                   /* pilot_stats.more */
    bool begun;                    /* the first frame has measured */
    double group_times;            /* a picture's time over what a group's time lets expect; smoothed; 0: not known */
    double other_s;                /* seconds from points to pixels; smoothed */
    double frame_s;                /* seconds of a frame; smoothed */
    double bank_s;                 /* seconds that the pilot may still take; below 0: it has taken more */
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

/* Seconds of some work, by the price list or, where there is none, as the clock had them. */
double pilot_seconds(const struct pilot *p, const struct pilot_work *work, double by_clock);
enum pilot_part pilot_part_of(uint32_t way);
uint64_t pilot_pass(struct pilot *p); /* of random numbers that no picture has */

/* A pass by a way, n in the mean over the picture; the counts of direct light and eye paths, which the description
 * refers to, stay until the next call for the same part. */
struct direct_desc pilot_direct(struct pilot *p, uint32_t way, double n, uint64_t pass, const struct packet_list *only);
struct eye_paths_desc pilot_eye(struct pilot *p, uint32_t way, double n, uint64_t pass, const struct packet_list *only);
struct light_tracer_desc pilot_light(struct pilot *p, uint32_t way, double n, uint64_t pass);
struct allot_count pilot_count(const struct pilot *p, uint32_t way, double n);

/* ---- pilot_probe.c ---- */

/* Notes whether the sky is another than the one that the readings are of; then they are made old. */
void pilot_look_at_sky(struct pilot *p);
/* What two halves of n units of particles say, against the yardstick. */
void pilot_read_light(struct pilot *p, uint32_t way, double n, float *const half[2]);
/* Direct light of the whole picture, before anything is known: n samples a point. */
MUST_CHECK enum err pilot_probe_first(struct pilot *p, double n);
/* After a picture: measures one way after the other, as far as the time allows. */
MUST_CHECK enum err pilot_probe(struct pilot *p, const struct pilot_target *target);
/* Seconds that a first frame may take longer; INFINITY: until each way is known. */
double pilot_first_s(const struct pilot_target *target);
/* Share of a frame that goes to measurements. */
double pilot_share(const struct pilot *p);

/* ---- pilot_choose.c ---- */

/* Above this peakedness what lobe rays find behind mirrors and glass cannot be judged by measurements: they meet a sun
 * once in so many thousand that they never see it, and the picture does. */
#define PEAKED_MOST 100.0
void pilot_take_request(struct pilot *p, const struct relight_desc *light);
void pilot_offer_ways(struct pilot *p); /* by request, scene and sky */
void pilot_choose(struct pilot *p, const struct pilot_target *target);
double pilot_error(const struct pilot *p); /* relMSE expected of the choice */
/* What a part that is left out would bring, squared and relative; 0: it is not, or nothing is known of it. */
double pilot_missing(const struct pilot *p, enum pilot_part part);

/* ---- pilot_report.c ---- */

void pilot_report(struct pilot *p, struct relight_stats *stats, struct pilot_stats *out);

#endif
