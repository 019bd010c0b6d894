/* Charts by gnuplot: error over time, both logarithmic, a line for each technique with its 10-90 % band, and a guide
 * with the slope that more samples give. One thread at a time. */
#pragma once

#include "base/text.h"
#include "measure/chart/panel.h"

/* ERR_UNSUPPORTED, with the package's name, where gnuplot cannot be run. */
MUST_CHECK enum err plot_check(struct reason *why);

/* Draws a panel into the file `svg`. ERR_IO, ERR_NOMEM, ERR_UNSUPPORTED. */
MUST_CHECK enum err plot_draw(const struct panel *p, enum error_kind kind, const char *svg, struct reason *why);

/* Adds an SVG file of gnuplot to a page: its identifiers get a prefix, so that they are unique in the page, and black
 * becomes the page's text colour. ERR_IO, ERR_FORMAT. */
MUST_CHECK enum err plot_inline(struct text *t, const char *svg, const char *prefix, const char *label,
                                struct reason *why);
