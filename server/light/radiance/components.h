/* A scene's light as daylight coefficients [Tregenza and Waters 1983]: for each patch of Radiance's sky (reinhart.h)
 * the image under a sky that has a radiance of 1 there and 0 elsewhere. The image under any sky of such patches is
 * their sum, each times its patch's radiance, which is what Radiance's dctimestep makes of them.
 * docs/internals/transport-cache.md says how.
 *
 * With METHOD_CACHED all of a patch goes through the cells: what is exported is the operator itself. Seed, pass and
 * turn are the same for all patches. One thread; all OpenMP threads are used. */
#pragma once

#include "base/err.h"
#include "base/file_store.h"
#include "light/frame/relight.h"
#include "scene/geometry/view.h"

#include <stdbool.h>
#include <stdint.h>

struct components_desc { /* all but `out` and mf is borrowed */
    struct file_pattern out;
    uint32_t mf; /* 1, 2 or 4 */
    const struct prepared_scene *set;
    const struct kernels *kernels;
    const struct relight_desc *light;
    const struct environment_desc *environment; /* rotation turns the patches as it turns a sky; scale must be 0 */
    bool progress;
};

/* The value of --components into out->out. ERR_USAGE; ERR_IO where the folder cannot be written, which had better be
 * known before the work. */
MUST_CHECK enum err components_read(const char *text, struct components_desc *out, struct reason *why);

struct components;

/* What is borrowed must outlive it. Errors are those of relighter_prepare; on one *out is NULL. */
MUST_CHECK enum err components_create(const struct components_desc *desc, struct components **out, struct reason *why);
void components_destroy(struct components *c); /* NULL is allowed */

/* The image, float[height][width][3], under the sky with these radiances, float[reinhart_count][3]. */
MUST_CHECK enum err components_image(struct components *c, const float (*radiance)[3], float *rgb, struct reason *why);

/* One Radiance image a patch, with the patch's number in its name. */
MUST_CHECK enum err components_write(const struct components_desc *desc, struct reason *why);

/* ---- Radiance's VIEW line ---- */

/* A camera as Radiance's VIEW line, for the header of an image. Thread: any. */

#define RADIANCE_VIEW_LINE 512 /* a line takes less than 300 */

/* "VIEW= -vtv -vp ...\n" in Radiance's axes: x east, y north, z up. -vd and -vu need not be perpendicular.
 * "" for an equisolid fisheye, which Radiance does not support. */
void radiance_view_line(const struct view *v, char out[RADIANCE_VIEW_LINE]);
