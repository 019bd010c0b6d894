/* The shade thread, which is the main thread. It renders frame after frame, refines the image while no new frame
 * arrives, changes cameras and answers queries about pixels. */
#pragma once

#include "base/err.h"

#include <stdbool.h>

struct environment;
struct prepared_scene;
struct relight_desc;
struct relighter;
struct settings;
struct shade_thread;
struct shared;

/* Loads the scene and computes the view. shared must outlive the thread. On any error *out is NULL and *why explains
 * it. Errors are those of set_create; ERR_NOMEM. */
MUST_CHECK enum err shade_thread_create(struct shared *shared, struct shade_thread **out, struct reason *why);

/* The scene before the current camera. Owned by t. */
const struct prepared_scene *shade_thread_set(const struct shade_thread *t);

/* The relighter of the first view, which stays in a job. Owned by t. */
struct relighter *shade_thread_relighter(struct shade_thread *t);

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
