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
#include "sky/tables/environment.h"

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

/* ---- Read back ---- */

/* --method components: daylight coefficients read back [Tregenza and Waters 1983]. A part is the image under a sky
 * whose radiance is 1 in one patch of Radiance's sky (sky/daylight/reinhart.h) and 0 elsewhere; the image under any sky
 * is the sum of the parts, each times its patch's mean radiance (below), as dctimestep makes it:
 *     rgb(x) = sum over p of L_p part_p(x).
 * They come from `relight-render --components`, or from Radiance's rcontrib and rfluxmtx: as one image a patch, or as
 * a view matrix, with a row for each pixel, from the top left, and a column for each patch.
 *
 * Parts are kept as half floats, which hold RGBE texels exactly, each under a scale of its own; below 2^-29 of a part's
 * largest value texels are 0. Thread: one. All OpenMP threads are used. */

struct parts;

struct parts_desc {
    const char *from;       /* a pattern, parts/%03d.hdr, with numbers from 0 on, or the name of a matrix */
    uint32_t width, height; /* of the image */
    uint64_t max_bytes;     /* as relight_desc.cache_bytes */
};

/* Reads them. The caller owns *out. ERR_USAGE: a wrong pattern, or files of another size than the image; ERR_FORMAT:
 * not as many as a sky has patches, and errors of decode_file and radiance_matrix_read: all name the file; ERR_RANGE:
 * above max_bytes; ERR_NOMEM. */
MUST_CHECK enum err parts_create(const struct parts_desc *desc, struct parts **out, struct reason *why);
void parts_destroy(struct parts *p); /* NULL is allowed */

/* For relight_desc.whole. It lights the first set that it is asked for and sets with the same camera; ERR_UNSUPPORTED:
 * another one. */
struct relight_whole parts_whole(struct parts *p);

uint64_t parts_bytes(const struct parts *p); /* memory of the texels */

/* The image under a sky: rgb float[height][width][3], radiance float[patches][3]. */
void parts_image(const struct parts *p, const float (*radiance)[3], float *rgb);

/* ---- Sky patches ---- */

/* An environment map as the patches of Radiance's sky (sky/daylight/reinhart.h), for sums of daylight coefficients.
 * Thread: any that may read the environment; all OpenMP threads are used. */

/* The mean radiance of each patch, gain and rotation included: the integral of L over the patch's solid angle, divided
 * by it. Of a lat-long map the integral of its texels is exact; of other layouts each texel of the cube map belongs to
 * the patch of its middle. radiance: float[reinhart_count(mf)][3]. ERR_NOMEM. */
MUST_CHECK enum err sky_patches(const struct environment *e, uint32_t mf, float (*radiance)[3]);
