/* The shade thread, which is the main thread. It renders frame after frame, refines the image while no new frame
 * arrives, changes cameras and answers queries about pixels. */
#pragma once

#include "base/err.h"
#include "base/progress.h"
#include "light/frame/changes.h"
#include "light/frame/decide.h"
#include "light/frame/refine.h"
#include "light/frame/relight.h"
#include "light/frame/relight_lamps.h"
#include "light/inspector/inspector.h"
#include "relightd/daemon/shared.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

struct relighter;
struct shade_thread;

/* Loads the scene and computes the view. shared must outlive the thread. On any error *out is NULL and *why explains
 * it. Errors are those of set_create; ERR_NOMEM. */
MUST_CHECK enum err shade_thread_create(struct shared *shared, struct shade_thread **out, struct reason *why);

/* A team_next (job/team/team.h) of a shade_thread: the next frame, if it is there and its image due. */
bool shade_thread_next(void *thread, const struct environment **e, const struct relight_desc **request);

/* Computes the data that the method needs before its first frame (a light transport cache). Errors are those of
 * relighter_prepare. */
MUST_CHECK enum err shade_thread_prepare(struct shade_thread *t, struct reason *why);

/* Seconds that an image would take with these settings; 0: unknown, or certainly within the limit. */
double shade_thread_estimate(void *t, const struct settings *s);

/* Makes images until shared->stop. ERR_NOMEM: *why names the purpose. */
MUST_CHECK enum err shade_thread_run(struct shade_thread *t, struct reason *why);

/* Runs one iteration of that loop, of at most some 30 ms unless it makes an image: applies controls, answers one query
 * about a pixel, then lights a new frame, runs a refinement pass or waits. */
MUST_CHECK enum err shade_thread_turn(struct shade_thread *t, struct reason *why);

/* Call it after the encode thread has ended. NULL is allowed. */
void shade_thread_destroy(struct shade_thread *t);

/* The shade thread's private data. Only the files of the shade thread use it. */

/* ---- cost.c ---- */

/* Estimates the cost of images from finished ones. Pure functions; the caller measures the time. Thread: one per
 * struct cost. */

struct cost {          /* seconds; zeroed: unknown */
    double sample_s;   /* per light sample of a shading point */
    double path_s;     /* per eye path; 0: unknown */
    double particle_s; /* per particle of the light tracer; 0: unknown */
    double fixed_s;    /* per image, independent of its samples */
};

/* Takes the cost of an image with this number of shading points and these sample counts. Do not pass images whose
 * counts the pilot chose. */
void cost_learn(struct cost *c, uint64_t points, const struct relight_desc *light, const struct relight_stats *stats);

/* Seconds that an image of a view with these facts would take with light's method, counts and paths, under the most
 * expensive sky. Unknown costs are estimated from known ones; 0: no cost is known. */
double cost_estimate(const struct cost *c, const struct plan_facts *facts, const struct relight_desc *light);

/* ---- The shade thread ---- */

/* The displayed image and its inputs. */
struct shown_image {
    const struct ingested *in;   /* the shade thread holds this slot until it takes the next frame */
    const struct shaded *latest; /* the newest image of the frame; nobody writes to it until the next one begins */
    struct relight_desc light;
    struct protocol_picture header;
    double shown_s, interval_s; /* when it was made (clock_seconds), and the time since the previous one */
};

/* Refinement of a still image: unbiased passes of the same frame. */
struct refinement {
    struct refiner *refiner; /* NULL until needed */
    struct shown_image shown;
    bool known; /* `shown` is the displayed image and belongs to the current view */
    bool open;  /* passes may run */
    bool begun;
    double pass_s;                /* total time of the passes */
    double published_s, logged_s; /* when an image was last published, and when the end was last logged; 0: never */
    uint64_t published_passes;    /* passes in the published image; 0: none was published */
};

/* Another camera's view, computed on a separate thread. */
struct camera_build {
    pthread_t thread;
    bool running;
    atomic_bool done;
    char name[64];
    char view[64]; /* the scene camera or free view of this build */
    bool coarse;   /* one ray per pixel, for quick display */
    bool complete; /* of first_set, which it is to replace */
    struct progress line;
    struct prepared_scene *set; /* the result; NULL: it failed */
    struct reason why;
};

/* The last answer to a query about the sky only. */
struct sky_answer {
    char *text; /* NULL: none */
    uint64_t frame;
    double made_s, rotation;
};

/* Light of the scene's own lamps (lamps.c). */
struct shown_lamps {
    struct relight_lamps *first, *other; /* of first_set, and of another displayed view; NULL: not started */
    struct relight_lamps *lockstep;      /* of first_set, in lockstep sequences; likewise */
    float *sky;                          /* the sky's part of the newest image; NULL: the scene has no lamps */
    uint32_t samples;                    /* of the part in the newest image */
    double published_s;                  /* the time of that image */
    bool failed;                         /* no memory or thread: do not retry */
};

/* What lighting one frame used and measured. */
struct lighting {
    struct settings settings;
    struct relight_desc asked; /* what the settings ask for */
    struct frame_request request;
    struct relight_stats stats;
    struct pilot_stats pilot; /* zeroed unless the decision was measured */
    bool again;               /* another image of a frame that stands still */
};

struct shade_thread {
    struct shared *shared;
    struct prepared_scene *set;        /* the displayed view */
    struct prepared_scene *first_set;  /* the command line's view; owns the scene and rays of all views */
    struct relighter *relighter;       /* of set */
    struct relighter *first_relighter; /* of first_set, for lockstep sequences; NULL: not needed now */
    struct parts *parts;               /* of METHOD_COMPONENTS; NULL: none */
    struct relight_whole whole;        /* theirs; the configuration's light points to it */
    struct camera_build camera;
    bool coarse_view;       /* `set` is coarse: a finer one follows while its camera stays selected */
    struct decider decider; /* auto's measurements of `set`, for `relighter` */
    struct shown_lamps lamps;
    struct changes changes;      /* from image to image, while somebody asks for them */
    struct inspector *inspector; /* NULL until needed */
    struct sky_answer sky;
    struct refinement refine;
    const struct shaded *last; /* the last published image; NULL: none */
    uint64_t display_version;  /* version of the settings it was published with */
    uint64_t images;           /* number made outside lockstep sequences */
    struct cost cost;          /* measured cost of images */
    unsigned cuts;             /* consecutive images cancelled by new settings */
    double cut_s;              /* time of the last one (clock_seconds); 0: an image was finished since */
    bool cut_new_view;         /* it was the first image of another camera */
    int held;                  /* slot of the displayed frame, or HANDOFF_NONE */
    int early;                 /* slot of the next one, which other ranks light already, or HANDOFF_NONE */
    struct lighting next;      /* of that one */
    double begun_s, shaded_s;  /* when the last image was due, and when it was finished; 0: none yet */
    double created_s;          /* clock_seconds */
};

/* Shade thread, all of what follows. */

/* ---- refine.c ---- */

/* Call it after publishing an image of a new frame: refinement may run while no newer frame arrives. Thread: shade, as
 * for all functions below. */
void refine_open(struct shade_thread *t, const struct shown_image *shown);
/* Call it when the view has changed, so that the displayed image no longer matches. */
void refine_forget(struct shade_thread *t);
/* Republishes the current image with another tone curve or exposure. Does nothing for a lockstep image. */
void refine_republish(struct shade_thread *t);
/* Whether a pass should run now: the source is idle, there are viewers, and the error is too large. */
bool refine_is_due(struct shade_thread *t);
/* Runs one pass, and publishes the image if it has improved enough. new_work ends the pass early and discards it.
 * ERR_NOMEM. */
MUST_CHECK enum err refine_pass(struct shade_thread *t, struct reason *why);

/* ---- lamps.c ---- */

/* Allocates memory for the sky's part if the scene has lamps. False: out of memory. */
bool lamps_create_canvas(struct shade_thread *t);
/* Copies a new image of the sky's light only. */
void lamps_take_sky(struct shade_thread *t, const float *rgb);
/* The newest image without lamps; NULL: the scene has none. */
const float *lamps_sky(const struct shade_thread *t);
/* Adds the lamps' light computed so far. Lockstep images, which use the first view, wait for all of it,
 * unfiltered. */
void lamps_add(struct shade_thread *t, bool lockstep, double scale, float *rgb);
/* Whether to republish the displayed image with better lamps. */
bool lamps_have_news(const struct shade_thread *t);
/* Whether refinement of the sky's part should wait for the lamps. */
bool lamps_come_first(const struct shade_thread *t);
/* The lamps' part at a pixel of the displayed view. */
void lamps_pixel(const struct shade_thread *t, uint32_t x, uint32_t y, struct probe_lamps *out);
/* Call it when the displayed view changes, and at the end. */
void lamps_leave_view(struct shade_thread *t);
/* Likewise when another set replaces first_set. */
void lamps_leave_first(struct shade_thread *t);
void lamps_finish(struct shade_thread *t);

/* ---- image_limit.c ---- */

/* Seconds that an image of that view would take with these settings; 0: unknown, or certainly within the limit.
 * Renders an image to measure if none was made yet. */
double image_seconds(struct shade_thread *t, const struct prepared_scene *set, const struct settings *s);
/* Bracket the making of an image, whose cancel flag is shared->watch.cancel; lockstep images use shared->stop.
 * image_end tells whether a new setting cancelled it, so that it must not be published. */
void image_begin(struct shade_thread *t, bool lockstep);
bool image_end(struct shade_thread *t);

/* ---- camera.c ---- */

/* Starts, continues or finishes a change to the camera in the settings. Returns true when t->set and t->relighter have
 * just changed to another camera, so that the current frame must be lit again. */
bool camera_follow_settings(struct shade_thread *t);
/* Whether the first image was shown by a coarse view and the complete one, which is being computed, needs all
 * processors. */
bool camera_is_completed(const struct shade_thread *t);
void camera_finish(struct shade_thread *t); /* frees all views and relighters */

/* ---- probe.c ---- */

/* Call it before publishing an image: sends its radiance to clients that follow a pixel. */
void inspect_report_image(struct shade_thread *t, const struct shaded *image);
/* Answers at most one query about a pixel, and all queries about the sky. */
void inspect_result(struct shade_thread *t);
void inspect_finish(struct shade_thread *t);
