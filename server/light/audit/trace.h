/* Path-traces the light of single pixels for audit.h, from the G-buffer's shade points like the image, but with
 * separate code and random numbers. Thread: any. */
#pragma once

#include "light/audit/audit.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "scene/geometry/view.h"
#include "sky/tables/environment.h"

/* Low-discrepancy numbers of paths' first events. */
#define AUDIT_NUMBERS_PATHS 256 /* more paths repeat them, shifted anew */
#define AUDIT_NUMBERS_PLACES 18 /* one pair for the start, four for each of two events */
struct audit_numbers {
    uint64_t at[AUDIT_NUMBERS_PATHS][AUDIT_NUMBERS_PLACES]; /* units of 2^-64 */
};

/* Fills all of *n, the same each time. */
void audit_numbers_fill(struct audit_numbers *n);

struct audit_world {
    const struct scene *scene;
    const struct rays *rays;
    const struct gbuffer *gbuffer; /* with all pixels; and packets, unless `whole` */
    const struct view *view;
    const struct environment *environment; /* complete */
    const struct audit_numbers *numbers;   /* filled */
    uint32_t classes, behind;              /* PATH_* at points seen directly, and seen in mirrors and through glass */
    bool background;                       /* the image has the sky */
    bool whole; /* the image is a reference's (light/frame/relighter.h), of `classes`: paths begin in the pixel */
    const double *bare_ground; /* of path_world; NULL: the scene has no ground. Only with `whole` */
};

/* audit_desc.trace; self: a struct audit_world. */
void audit_trace(void *world, const struct audit_question *q, struct audit_light *out);
