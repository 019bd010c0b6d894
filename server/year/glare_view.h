/* The daylight glare probability of a fisheye view's images. Thread: one per object. */
#pragma once

#include "scene/geometry/view.h"
#include "sky/daylight/glare.h"

struct glare_view;

/* *out is NULL for a view that is no fisheye: it does not see all that reaches the eye. ERR_NOMEM. */
MUST_CHECK enum err glare_view_create(const struct view *v, struct glare_view **out);
void glare_view_destroy(struct glare_view *g); /* NULL is allowed */

/* cdm2: [height][width]. ERR_NOMEM. */
MUST_CHECK enum err glare_view_measure(const struct glare_view *g, const float *cdm2, struct glare *out);
