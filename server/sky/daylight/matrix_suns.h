/* The suns that Radiance's `gendaymtx -D FILE` writes beside a matrix of skies: for each time step with the sun above
 * the horizon
 *     void light solar114150  0 0 3 R G B
 *     solar114150 source sun114150  0 0 4 X Y Z 0.533
 * where the number is the minute of the year. In the matrix gendaymtx spreads the same sun over its nearest patches.
 * Thread: any. */
#pragma once

#include "base/err.h"
#include "sky/daylight/sky_matrix.h"

#include <stdbool.h>

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
