/* Radiance's subdivision of the sky, which is Tregenza's 145 patches with each side cut by MF [Tregenza 1987; Reinhart
 * and Walkenhorst 2001], in the order of its reinhart.cal and gendaymtx: patch 0 is the ground, all of the lower
 * hemisphere; then come 7 MF rows from the horizon up, each 90 / (7 MF + 1/2) degrees high, whose first patch is
 * centred on north and whose next ones lie to the east; the last is the cap about the zenith. 146, 578 or 2306 in all.
 *
 * Radiance has X to the east, Y to the north and Z up. Here Y is up, north is +Z and east is -X (sky/source/sky.h), so
 * that (x, y, z) here  =  (-X, Z, Y) there. Patches are rectangles of a lat-long image. The one that reinhart_sky fills
 * has borders of texels at all of theirs, so that no texel is of two patches. Pure functions; any thread. */
#pragma once

#include <stdint.h>

struct reinhart_patch {
    double altitude;    /* of its middle, radians */
    double azimuth;     /* likewise, clockwise from north; 0 for ground and zenith */
    double solid_angle; /* sr */
    uint32_t row;       /* 0 at the horizon, 7 MF: the zenith; of the ground 0 */
};

/* mf: 1, 2 or 4, everywhere. */
uint32_t reinhart_count(uint32_t mf);
struct reinhart_patch reinhart_patch(uint32_t mf, uint32_t patch); /* patch < reinhart_count */

/* The MF whose sky has `count` patches; 0: none has. */
uint32_t reinhart_subdivision(uint64_t count);

/* A row of patches: altitudes of its edges, radians, its first patch and their number. row 7 MF is the zenith. */
struct reinhart_row {
    double bottom, top;
    uint32_t first, count;
};
struct reinhart_row reinhart_row(uint32_t mf, uint32_t row); /* row <= 7 MF */

/* Of the image. */
void reinhart_size(uint32_t mf, uint32_t *width, uint32_t *height);

/* The patch that texel (x, y) of the image is of. */
uint32_t reinhart_at(uint32_t mf, uint32_t x, uint32_t y);

/* The sky of those patches as an image: rgb float[height][width][3], lat-long (image/codec/frame.h).
 * radiance: float[reinhart_count][3]. */
void reinhart_sky(uint32_t mf, const float (*radiance)[3], float *rgb);
