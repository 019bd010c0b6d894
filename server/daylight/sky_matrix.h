/* server/daylight/sky_matrix.h */
/* Matrices of skies as Radiance's gendaymtx writes them: a row for each patch of reinhart.h, a column for each time
 * step, three components each, W sr^-1 m^-2. Thread: any. */
#ifndef DAYLIGHT_SKY_MATRIX_H
#define DAYLIGHT_SKY_MATRIX_H

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct sky_matrix {
    uint32_t mf;    /* 1, 2 or 4 */
    size_t patches; /* reinhart_count(mf) */
    size_t steps;
    float (*radiance)[3]; /* [steps][patches] */
};

/* Reads a file with a header (gendaymtx without -h), as ascii, float or double. ERR_IO; ERR_FORMAT names the header's
 * line or the number that is wrong; ERR_RANGE: above 2 GB; ERR_NOMEM. On an error *out is empty. */
MUST_CHECK enum err sky_matrix_read(const char *path, struct sky_matrix *out, struct reason *why);
void sky_matrix_finish(struct sky_matrix *m); /* zeroed memory is allowed */

/* Whether any patch of a step has light. */
bool sky_matrix_is_lit(const struct sky_matrix *m, size_t step);

#endif
