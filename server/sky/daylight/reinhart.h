/* Radiance's subdivision of the sky, which is Tregenza's 145 patches with each side cut by MF [Tregenza 1987; Reinhart
 * and Walkenhorst 2001], in the order of its reinhart.cal and gendaymtx: patch 0 is the ground, all of the lower
 * hemisphere; then come 7 MF rows from the horizon up, each 90 / (7 MF + 1/2) degrees high, whose first patch is
 * centred on north and whose next ones lie to the east; the last is the cap about the zenith. 146, 578 or 2306 in all.
 *
 * Radiance has X to the east, Y to the north and Z up. Here Y is up, north is +Z and east is -X (sky/source/sky.h), so
 * that (x, y, z) here  =  (-X, Z, Y) there. Patches are rectangles of a lat-long image. The one that reinhart_sky fills
 * has borders of texels at all of theirs, so that no texel is of two patches. Pure functions; any thread. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
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

/* ---- Matrices ---- */

/* Matrices as Radiance's programs write them, with three components. gendaymtx's of skies have a row for each patch of
 * reinhart.h and a column for each time step, W sr^-1 m^-2. Thread: any. */

struct radiance_matrix {
    size_t rows, columns;
    float (*value)[3]; /* [columns][rows] */
};

/* Reads a file with a header, as ascii, float or double. rows: how many a file has whose header does not say, such as
 * one of rcontrib; 0: that is an error. ERR_IO; ERR_FORMAT names the header's line or the number that is wrong: a value
 * is from 0 to below 1e9; ERR_RANGE: above 2 GB; ERR_NOMEM. On an error *out is empty. The caller frees out->value with
 * mem_free. */
MUST_CHECK enum err radiance_matrix_read(const char *path, size_t rows, struct radiance_matrix *out,
                                         struct reason *why);

struct sky_matrix {
    uint32_t mf;    /* 1, 2 or 4 */
    size_t patches; /* reinhart_count(mf) */
    size_t steps;
    float (*radiance)[3]; /* [steps][patches] */
};

/* Likewise a sky's. Also ERR_FORMAT: not as many rows as a sky has patches. */
MUST_CHECK enum err sky_matrix_read(const char *path, struct sky_matrix *out, struct reason *why);
void sky_matrix_finish(struct sky_matrix *m); /* zeroed memory is allowed */

/* Whether any patch of a step has light. */
bool sky_matrix_is_lit(const struct sky_matrix *m, size_t step);

/* ---- Suns of a matrix ---- */

/* The suns that Radiance's `gendaymtx -D FILE` writes beside a matrix of skies: for each time step with the sun above
 * the horizon
 *     void light solar114150  0 0 3 R G B
 *     solar114150 source sun114150  0 0 4 X Y Z 0.533
 * where the number is the minute of the year. In the matrix gendaymtx spreads the same sun over its nearest patches.
 * Thread: any. */

struct matrix_sun {
    double normal; /* irradiance at normal incidence, W m^-2; 0: none in this step */
    double sun[3]; /* unit, towards it: Y up, north +Z, east -X */
    double minute; /* of the year, from 0; below 0: its name does not say */
};

/* Reads them into suns[m->steps]. The k-th sun is that of the k-th time step where there are as many (gendaymtx -u),
 * else of the k-th with light, where these are as many, else of its minute, where the steps are a year's hours or parts
 * of them. ERR_IO; ERR_FORMAT names the line, or that the numbers do not match; ERR_NOMEM. */
MUST_CHECK enum err matrix_suns_read(const char *path, const struct sky_matrix *m, struct matrix_sun *suns,
                                     struct reason *why);

/* Takes the suns out of the patches over which gendaymtx has spread them, so that they do not count twice. *taken:
 * false, with nothing changed, where some patch holds less than it would with them, as in a matrix of `gendaymtx -s`.
 * ERR_NOMEM. */
MUST_CHECK enum err matrix_suns_take_out(struct sky_matrix *m, const struct matrix_sun *suns, bool *taken);
