/* The sun of a captured sky: taken out of its image, and put back elsewhere as a disc of the same energy.
 *
 * Images are lat-long, float[height][width][3], linear Rec.709, oriented as `latlong` in sky/tables/layout.h. The sun
 * are the texels brighter than 16 times the mean of the sky clamped at that level (the level of sky/tables/sky_table.h)
 * within a few degrees of the brightest one, as far as they are brighter than a ring around them:
 *
 *     energy = sum of (L - ring) dw,
 *
 * and its direction that of a disc of 0.533 degrees whose light in these texels has the same middle. Light that is
 * spread far wider has a radius of its own, of a uniform disc: r^2 / 2 is its mean square distance from the middle, to
 * which a texel of side s adds s^2 / 6.
 *
 * Thread: one per struct; functions of their arguments otherwise. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct sun_texel {
    uint32_t at;  /* index of the texel */
    float rgb[3]; /* what it was */
};

struct sun_patch {
    bool found;
    double direction[3];      /* unit */
    double energy[3];         /* radiance x sr */
    double radius;            /* radians; that of the real sun, if it is near it */
    double others;            /* light as bright elsewhere, over the sun's: another sun, a row of lamps */
    struct sun_texel *texels; /* owned; [count]: those that were changed */
    uint32_t count, capacity;
};

/* Takes the sun out of the image: its texels become the ring around it at most. Without a sun, out->found is false and
 * the image is unchanged. Memory is reused. ERR_NOMEM: the image is unchanged, too. */
MUST_CHECK enum err sun_patch_take(float *rgb, uint32_t width, uint32_t height, struct sun_patch *out);
void sun_patch_finish(struct sun_patch *p); /* frees; zeroed memory is allowed */

/* Puts the texels that were changed back as they were: the image is that before sun_patch_take, bit for bit. */
void sun_patch_restore(const struct sun_patch *p, float *rgb);

/* Adds a uniform disc of this energy. */
void sun_put(float *rgb, uint32_t width, uint32_t height, const double direction[3], double radius,
             const double energy[3]);

/* ---- Its way ---- */

struct sun_mark { /* where it was seen, and when */
    double seconds, direction[3];
};

#define SUN_MARKS 4

/* The direction at a time by the polynomial through `count` marks, at least one: a few minutes of the sun's circle are
 * a parabola within a thousandth of a degree. Outside the marks it goes on. */
void sun_way(const struct sun_mark *marks, uint32_t count, double seconds, double direction[3]);
