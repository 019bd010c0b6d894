/* The shade thread, which is the main thread: lights the scene with one frame after another, refines the picture while
 * no frame comes, changes cameras and answers questions about pixels. */
#ifndef DAEMON_SHADE_H
#define DAEMON_SHADE_H

#include "base/err.h"

struct relighter;
struct scene;
struct settings;
struct shade_thread;
struct shared;

/* Loads the scene and computes the view. shared must outlive the thread. On any error *out is NULL and *why says why:
 * as set_create; ERR_NOMEM. */
MUST_CHECK enum err shade_thread_create(struct shared *shared, struct shade_thread **out, struct reason *why);

/* The scene, and the camera that pictures are made by. Owned by t. */
const struct scene *shade_thread_scene(const struct shade_thread *t);
const char *shade_thread_camera(const struct shade_thread *t);
const char *shade_thread_view(const struct shade_thread *t); /* the same as a free view */

/* The one of the first view, which stays in a job. Owned by t. */
struct relighter *shade_thread_relighter(struct shade_thread *t);

/* Computes what the method needs before its first frame (a cache of light transport). Errors as relighter_prepare. */
MUST_CHECK enum err shade_thread_prepare(struct shade_thread *t, struct reason *why);

/* Seconds that a picture would take with these settings; 0: unknown, or within the limit in any case. */
double shade_thread_estimate(void *t, const struct settings *s);

/* Makes pictures until shared->stop. ERR_NOMEM: *why says for what. */
MUST_CHECK enum err shade_thread_run(struct shade_thread *t, struct reason *why);

/* One turn of that loop, of at most some 30 ms unless a picture is made: applies controls, answers one question about a
 * pixel, then lights a new frame, runs a refinement pass or waits. */
MUST_CHECK enum err shade_thread_turn(struct shade_thread *t, struct reason *why);

/* After the encode thread has ended; NULL is allowed. */
void shade_thread_destroy(struct shade_thread *t);

#endif
