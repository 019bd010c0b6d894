/* server/chart/plot.h */
/* Charts by gnuplot: error over time, both logarithmic, a line for each technique with its 10-90 % band, and a guide of
 * the slope that more samples alone give. One thread at a time. */
#ifndef CHART_PLOT_H
#define CHART_PLOT_H

#include "chart/panel.h"
#include "chart/text.h"

/* ERR_UNSUPPORTED, with the package's name, where gnuplot cannot be run. */
MUST_CHECK enum err plot_check(struct reason *why);

/* The script that draws a panel into the file `svg`. */
void plot_script(struct text *t, const struct panel *p, enum error_kind kind, const char *svg);

/* Draws it. ERR_IO, ERR_NOMEM, ERR_UNSUPPORTED. */
MUST_CHECK enum err plot_draw(const struct panel *p, enum error_kind kind, const char *svg, struct reason *why);

/* Runs a script of gnuplot's that writes the file `svg`; it stands beside that file as long as it takes. Errors as
 * above. */
MUST_CHECK enum err plot_run(const struct text *script, const char *svg, struct reason *why);

/* A string of gnuplot's, within single quotes; and a value of a logarithmic axis, NaN where it has no place for it. */
void plot_add_quoted(struct text *t, const char *plain);
void plot_add_value(struct text *t, double v);

/* Adds an SVG file of gnuplot's to a page: its names get a prefix, so that several may stand in one page, and its ink
 * is the page's. ERR_IO, ERR_FORMAT. */
MUST_CHECK enum err plot_inline(struct text *t, const char *svg, const char *prefix, const char *label,
                                struct reason *why);

#endif
