/* server/film/pilot_parts.h */
/* What the pilot's files share: pilot.c makes the frame, pilot_probe.c goes ahead of it, pilot_choose.c decides,
 * pilot_edges.c says whether edges are to be smooth, pilot_allot.c who gets how many samples, pilot_say.c puts all into
 * words. */
#ifndef FILM_PILOT_PARTS_H
#define FILM_PILOT_PARTS_H

#include "budget.h"
#include "pilot.h"
#include "pilot_allot.h"
#include "pilot_measure.h"
#include "pilot_model.h"

#define UNIT_PARTICLES 2048.0 /* the light tracer's n: two halves of whole batches */

/* A way to make a part of the picture: what is measured, timed and chosen among. */
enum {
    WAY_MATTE = 0,                               /* + technique */
    WAY_GLOSSY = WAY_MATTE + PILOT_TECHNIQUES,   /* + technique */
    WAY_EYE_ALL = WAY_GLOSSY + PILOT_TECHNIQUES, /* eye paths for all that is neither direct nor background, */
    WAY_EYE_REST,                                /* for what light that is aimed at mirrors and glass leaves, */
    WAY_EYE_BEHIND,                              /* for what no light path reaches */
    WAY_AIMED,                                   /* the light tracer */
    WAY_WHOLE,
    WAYS,
    WAY_NONE = WAYS,
};

struct technique {
    const char *name;
    struct direct_desc desc;
    bool by_sun; /* it differs from the one before it only where there is a sun */
};
extern const struct technique techniques[PILOT_TECHNIQUES];

struct route {                /* how one way of eye paths or light tracer goes */
    uint32_t classes, behind; /* PATH_* */
};

struct choice {                /* what a frame is made by */
    uint32_t route;            /* ROUTES: none yet */
    uint32_t way[PILOT_PARTS]; /* WAY_NONE: left out */
    double n[PILOT_PARTS];
};

#define ROUTES                                                                                                         \
    3 /* the ways by which a frame may have its other light, together: eye paths; particles aimed at mirrors           \
       * and glass, and eye paths; particles, and eye paths where none can come */
extern const uint32_t pilot_routes[ROUTES][3]; /* from PILOT_EYE on */

struct pilot {
    const struct set *set;
    struct pilot_desc desc;
    struct direct *direct[SURFACE_KINDS], *probe; /* of the picture; of what goes ahead of it */
    struct direct *tables[SURFACE_KINDS];         /* which of them the last picture had */
    struct light_tracer *light;
    const struct gbuffer *gbuffer; /* in use: the set's, or the thin one */
    struct gbuffer *thin;
    struct groups groups, spare_groups;                                 /* of the one in use, of the other */
    struct allotment allot[PILOT_EYE + 1], spare_allot[PILOT_EYE + 1];  /* likewise */
    uint32_t allot_readings[PILOT_EYE + 1], allot_turns[PILOT_EYE + 1]; /* since it was last dealt */
    float (*point_error)[PACKET];                                       /* [packet_count]: scratch */
    uint8_t *kept;      /* [packet_count of the set's]: points that the thin one has too */
    double edge_points; /* share of the points that are in pixels with several */
    uint8_t *mask;
    float *lo_direct, *lo_eye, *lo_other, *lo_sum; /* [packet_count][3][16] */
    float *spread[2];                              /* [height][width][3]: of yardsticks */
    float *half[2];                                /* [height][width][3]: of the light tracer */
    struct scratch *scratch;                       /* of the eye paths */

    /* Of the wish and the scene, made anew when they change. */
    uint32_t classes; /* of the other light: asked for, and to be found in the scene */
    bool with_direct;
    enum plan_estimator caustics_by, indirect_by;
    double peakedness; /* of the sky that the readings began with; 0: black, or there was none yet */
    uint32_t eye_wish;
    uint64_t particles_wish;
    bool there[WAYS];
    struct route route[WAYS];

    struct model model[WAYS];
    /* Groups are not equally hard. Ways are compared on the same one, where what is in use is read first. */
    struct {
        const struct group *group;
        bool read;   /* what is in use, on it */
        double hard; /* its error there over that in the mean */
    } here[SURFACE_KINDS];
    const struct group *seen_on[WAYS]; /* the last reading's */
    /* What a whole picture takes over what its groups let expect: threads that share little work wait for each other.
     */
    double base_times[SURFACE_KINDS], unit_times[SURFACE_KINDS];
    double pace;    /* times are as much longer than they were */
    double late[3]; /* of the last pictures: time over what was expected */
    double other_s; /* from points to pixels, and what the pilot reckons */
    uint64_t picture_pass;
    struct choice choice;
    bool begun;                             /* there has been a frame */
    uint32_t group_turn[SURFACE_KINDS + 1]; /* whose turn it is: of matte, of glossy surfaces, of both */
    uint64_t pass;                          /* of the pilot's own numbers */
    uint32_t next_way;                      /* of those not in use, to be probed next */
    double bank_s;                          /* time that the pilot may still take */
    double frame_s;                         /* a frame's, smoothed */
    uint64_t frames;                        /* since the sky changed */
    uint64_t runs;                          /* all */
    double energy[CUBE_FACES];              /* of the sky that the readings began with */
    struct direct_stats direct_stats[SURFACE_KINDS];
    struct pair edge[SURFACE_KINDS]; /* rolling sums, of what either kind holds */

    /* Of the frame that is being made. */
    const struct environment *environment;
    const struct relight_desc *wish_light;
    struct yardstick yardstick;
    double picture_s, pilot_s;
    double picture_noise;      /* the error that the choice is expected to leave */
    double ran_s[PILOT_PARTS]; /* seconds of each part */
    struct budget budget;
    struct pilot_wish solved; /* what the choice was made for */
    double more;              /* pilot_stats.more, of then */
    struct budget_way ways[PILOT_PARTS][WAYS];
    uint32_t of_way[PILOT_PARTS][WAYS]; /* which way a budget's way is */
    uint32_t way_count[PILOT_PARTS];
    char sentence[PLAN_LEFT_OUT_MAX][160];
};

/* The clock, or the price of what has been done since `start`. */
double pilot_now(const struct pilot *p);
double pilot_spent(const struct pilot *p, double start, const struct pilot_work *work);

enum pilot_part pilot_part_of(uint32_t way);

/* Numbers of the pilot's own, that no picture has. */
uint64_t pilot_pass(struct pilot *p);

/* How n of a way in the mean over the picture are dealt among packets. */
struct allot_wish pilot_deal(uint32_t way, double n);

/* Direct light by a technique, of some packets; n samples a point, in the mean over all of the kind. */
MUST_CHECK enum err pilot_direct(struct pilot *p, struct direct *d, uint32_t way, double n, uint64_t pass, bool keep,
                                 const struct packet_list *only, float *lo, struct direct_stats *stats);
MUST_CHECK enum err pilot_eye(struct pilot *p, uint32_t way, double n, uint64_t pass, const struct packet_list *only,
                              float *lo, struct eye_paths_stats *stats);
/* The two halves of n x UNIT_PARTICLES particles, into half[0] and half[1]. */
MUST_CHECK enum err pilot_light(struct pilot *p, uint32_t way, double n, uint64_t pass,
                                struct light_tracer_stats *stats);

/* What the two halves say, beside a picture without them. */
void pilot_read_light(struct pilot *p, uint32_t way, double n, const float *rgb);

/* ---- pilot_probe.c ---- */

/* Whether the sky is another than the one that the readings are of; then they are made old. */
void pilot_look_at_sky(struct pilot *p);
/* After the picture: measures what is in use, then, as far as the time allows, what is not. */
MUST_CHECK enum err pilot_probe(struct pilot *p, const struct pilot_wish *wish);
/* Deals samples by two pictures of direct light with numbers of their own, of which lo_direct has one. */
void pilot_allot_all(struct pilot *p, const float *other);
/* What a first frame may take longer; without a time to keep to, until each way has been seen. */
double pilot_first_s(const struct pilot_wish *wish);
/* Share of the frame that goes to probes. */
double pilot_share(const struct pilot *p);

/* ---- pilot_choose.c ---- */

void pilot_take_wish(struct pilot *p, const struct relight_desc *light);
/* Which ways there are, by wish, scene and sky. */
void pilot_set_routes(struct pilot *p);
/* Above this peakedness (facts.h) what lobe rays find behind mirrors and glass cannot be judged by probes: a sun is met
 * once in so many thousand rays that they never see it, and the picture does. */
#define PEAKED_MOST 100.0
void pilot_choose(struct pilot *p, const struct pilot_wish *wish);
/* The error that is expected of the choice. */
double pilot_error(const struct pilot *p);
/* What a part that is left out would bring, squared and relative; 0: not there or not known. */
double pilot_missing(const struct pilot *p, enum pilot_part part);

/* Half of its samples by light, half by lobes. */
bool pilot_halves(uint32_t way);
/* The error that is expected of the choice's route in another time. */
double pilot_error_at(struct pilot *p, double seconds);

/* ---- pilot_edges.c ---- */

bool pilot_edges_init(struct pilot *p);
void pilot_edges_finish(struct pilot *p);
/* One point a pixel is in use. */
bool pilot_edges_are_jagged(const struct pilot *p);
/* relMSE that one point instead of several leaves. */
double pilot_edge_error(const struct pilot *p);
/* Goes over to that, or back: groups, times and counts follow. */
void pilot_edges_take(struct pilot *p, bool jagged);
/* Whether it is time to. After a choice, for what it had left. */
bool pilot_edges_turn(struct pilot *p, const struct pilot_wish *left);

/* ---- pilot_say.c ---- */

void pilot_say(struct pilot *p, const struct pilot_wish *wish, struct relight_stats *stats, struct pilot_stats *out);

#endif
