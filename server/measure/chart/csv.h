/* Every point of every panel as a row of CSV [RFC 4180] below a header row; times in milliseconds. Any thread. */
#pragma once

#include "base/text.h"
#include "measure/chart/panel.h"

/* One row for each technique at each budget. */
void csv_points(struct text *t, const struct panel *const *panels, size_t count);

/* One row for each run, from which the whole chart can be computed again. */
void csv_runs(struct text *t, const struct panel *const *panels, size_t count);
