/* Matrices as Radiance's programs write them, with three components. gendaymtx's of skies have a row for each patch of
 * reinhart.h and a column for each time step, W sr^-1 m^-2. Thread: any. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

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
