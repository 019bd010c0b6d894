/* The shade thread's own data. Only shade.c, refine.c, camera.c and probe.c include this. */
#ifndef DAEMON_SHADE_PARTS_H
#define DAEMON_SHADE_PARTS_H

#include "daemon/cost.h"
#include "daemon/shade.h"
#include "daemon/shared.h"

#include "base/progress.h"
#include "light/decide.h"
#include "light/relight.h"
#include "light/relight_lamps.h"
#include "light/still.h"
#include "probe/probe_report.h"

#include <pthread.h>
#include <stdatomic.h>

/* The picture shown and what it was made from. */
struct shown_picture {
    const struct ingested *in;   /* the shade thread holds this slot until it takes the next frame */
    const struct shaded *latest; /* the newest picture of it: nobody writes to it until the next one is begun */
    struct relight_desc light;
    struct protocol_picture header;
    double shown_s, interval_s; /* when it was made (clock_seconds), and how long after the one before */
};

/* Refinement of a still image: unbiased passes of the same frame. */
struct refinement {
    struct still *still; /* NULL until it is needed */
    struct shown_picture shown;
    bool known; /* shown is the picture on display, and of the present view */
    bool open;  /* passes may run */
    bool begun;
    double pass_s;                /* time that the passes took */
    double published_s, logged_s; /* when a picture was last published, an end last logged; 0: never */
    uint64_t published_passes;    /* passes in that picture; 0: none was published */
};

/* Another camera's view, computed on a thread of its own. */
struct camera_build {
    pthread_t thread;
    bool running;
    atomic_bool done;
    char name[64];
    char view[64]; /* the camera of the scene, or the free view, that this is */
    bool coarse;   /* with one ray per pixel, to be shown soon */
    struct progress line;
    struct set *set; /* the result; NULL: it failed */
    struct reason why;
};

/* The last answer to a question about the sky alone. */
struct sky_answer {
    char *text; /* NULL: none */
    uint64_t frame;
    double made_s, rotation;
};

/* The part of the scene's own lamps, lamps.c. */
struct shown_lamps {
    struct relight_lamps *first, *other; /* of first_set, and of another view shown; NULL: not begun */
    float *sky;                          /* the sky's part of the newest picture; NULL: the scene has no lamps */
    uint32_t samples;                    /* of the part in the newest picture */
    double published_s;                  /* when that was */
    bool failed;                         /* no memory or thread: do not try again */
};

struct shade_thread {
    struct shared *shared;
    struct set *set;                   /* the view shown */
    struct set *first_set;             /* the one of the command line; owns the scene and rays of all views */
    struct relighter *relighter;       /* of set */
    struct relighter *first_relighter; /* of first_set, which lockstep sequences use; NULL: not needed now */
    struct camera_build camera;
    bool coarse_view;       /* `set` is coarse: a finer one follows while its camera stays */
    struct decider decider; /* what auto has learnt of `set`, for `relighter` */
    struct shown_lamps lamps;
    struct prober *prober; /* NULL until it is needed */
    struct sky_answer sky;
    struct refinement refine;
    const struct shaded *last; /* the last picture published; NULL: none */
    uint64_t display_version;  /* of the settings with which it was published */
    uint64_t pictures;         /* made outside lockstep sequences */
    struct cost cost;          /* of pictures, as far as measured */
    unsigned cuts;             /* pictures in a row that new settings cancelled */
    double cut_s;              /* when the last one was (clock_seconds); 0: a picture was finished since */
    bool cut_new_view;         /* it was the first of another camera */
    int held;                  /* slot of the frame that is shown, or HANDOFF_NONE */
    double begun_s, shaded_s;  /* when the last picture was due, and when it was done; 0: none yet */
};

/* Shade thread, all of what follows. */

/* ---- refine.c ---- */

/* A picture of a new frame was published: it may be refined while no newer frame comes. */
void refine_open(struct shade_thread *t, const struct shown_picture *shown);
/* A newer frame is being taken. */
void refine_close(struct shade_thread *t);
/* The view has changed: the picture on display no longer fits it. */
void refine_forget(struct shade_thread *t);
/* Publishes the current picture again, for another tone curve or exposure. Does nothing for a lockstep picture. */
void refine_republish(struct shade_thread *t);
/* Whether a pass should run now: the source is quiet, someone watches, and the error is still too large. */
bool refine_is_due(struct shade_thread *t);
/* Runs one pass, and publishes the picture when that pays. new_work ends it early and discards it. ERR_NOMEM. */
MUST_CHECK enum err refine_pass(struct shade_thread *t, struct reason *why);

/* ---- lamps.c ---- */

/* Keeps memory for the sky's part if the scene has lamps. False: out of memory. */
bool lamps_create_canvas(struct shade_thread *t);
/* A picture of the sky's light alone was made: keeps it. */
void lamps_take_sky(struct shade_thread *t, const float *rgb);
/* The newest picture without lamps; NULL: the scene has none. */
const float *lamps_sky(const struct shade_thread *t);
/* Adds the lamps as far as they are computed; lockstep pictures, which are of the first view, wait for all of it. */
void lamps_add(struct shade_thread *t, bool lockstep, double scale, float *rgb);
/* Whether the picture on display should be published again, with better lamps. */
bool lamps_have_news(const struct shade_thread *t);
/* Whether refinement of the sky's part should wait for them. */
bool lamps_come_first(const struct shade_thread *t);
/* The part at a pixel of the view shown. */
void lamps_pixel(const struct shade_thread *t, uint32_t x, uint32_t y, struct probe_lamps *out);
/* The view shown changes; the end. */
void lamps_leave_view(struct shade_thread *t);
void lamps_finish(struct shade_thread *t);

/* ---- picture_limit.c ---- */

/* Seconds that a picture of that view would take with these settings; 0: unknown, or within the limit in any case.
 * Makes one to measure if none was made yet. */
double picture_seconds(struct shade_thread *t, const struct set *set, const struct settings *s);
/* Brackets the making of a picture, whose cancel flag is shared->watch.cancel; lockstep pictures have shared->stop. The
 * end says whether a new setting cancelled it, so that it must not be published. */
void picture_begin(struct shade_thread *t, bool lockstep);
bool picture_end(struct shade_thread *t);

/* ---- camera.c ---- */

/* Starts, continues or finishes a change to the camera in the settings. True when t->set and t->relighter have just
 * become those of another camera, so that the current frame must be lit again. */
bool camera_follow_settings(struct shade_thread *t);
void camera_finish(struct shade_thread *t); /* frees all views and relighters */

/* ---- probe.c ---- */

/* A picture is about to be published: sends its radiance to those who follow a pixel. */
void probe_report_picture(struct shade_thread *t, const struct shaded *picture);
/* Answers at most one question about a pixel, and all about the sky. */
void probe_result(struct shade_thread *t);
void probe_finish(struct shade_thread *t);

#endif
