/* Images of a year: heat maps over day and hour, values of sensors in plan, luminance in false colour.
 * Thread: any, on separate files. */
#pragma once

#include "base/err.h"
#include "year/ledger.h"
#include "year/paint.h"
#include "year/points.h"

#include <stdint.h>

/* Days to the right, hours downwards from midnight; dark hours are grey. column: of the rows. span: hours of a row. */
MUST_CHECK enum err map_year(const struct ledger *l, enum ledger_column column, double span, const char *title,
                             const struct paint_scale *scale, const char *path, struct reason *why);

/* Sensors as squares where they are, seen along the normal of the first: value: [points->count]. */
MUST_CHECK enum err map_sensors(const struct points *points, const double *value, const char *title,
                                const struct paint_scale *scale, const char *path, struct reason *why);

/* cdm2: [height][width]; lines separate the steps of the legend. */
MUST_CHECK enum err map_luminance(const float *cdm2, uint32_t width, uint32_t height, const char *title,
                                  const struct paint_scale *scale, const char *path, struct reason *why);
