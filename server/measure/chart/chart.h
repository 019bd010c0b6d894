/* The whole chart: every scene under every sky in every class of light. Files are written after each panel, so that an
 * interrupted run leaves a shorter chart. Main thread; uses all OpenMP threads. */
#pragma once

#include "base/err.h"
#include "import/reader/reader.h"
#include "job/ranks/ranks.h"

#include <stdbool.h>
#include <stdint.h>

struct kernels;

struct chart_desc {
    struct scene_reading reading; /* of reading one */
    const char *scenes;     /* scene files or "builtin", separated by semicolons; each may begin with a title and an
                             * equals sign */
    const char *sources;    /* sources, likewise; the first frame of each is used */
    const char *out;        /* folder, made if missing */
    const char *cache;      /* folder of references; NULL: the user's cache folder */
    const char *techniques; /* names separated by commas; NULL: all */
    const char *budgets;    /* ascending numbers separated by commas */
    char *const *arguments; /* of the command line, for the page; NULL at their end */
    const struct kernels *kernels;
    uint32_t width, height, seeds;
    uint32_t edge_rays; /* as in set_desc, likewise every_pixel */
    bool every_pixel;
    uint32_t truth_samples; /* of each reference, per pixel */
    bool progress;          /* a line on standard error, if that is a terminal */
    /* NULL: one process. Otherwise the ranks of a job first share out the references of all panels, for which they need
     * the same cache folder; then rank 0 measures times alone, on `threads` threads, and writes the files. chart_run is
     * then collective; other ranks return when the references are there. */
    struct ranks *ranks;
    int threads;
};

/* Writes chart.csv, runs.csv, index.html and the charts' SVG files, by a script (script.h). ERR_USAGE: a list is
 * invalid, which is found before the work, as is ERR_IO: no python3. Errors of scenes and sources, ERR_IO, ERR_NOMEM.
 */
MUST_CHECK enum err chart_run(const struct chart_desc *desc, struct reason *why);

/* "4,8,16" into at most `room` numbers, ascending and at least two. ERR_USAGE. */
MUST_CHECK enum err chart_read_budgets(const char *list, uint32_t *out, uint32_t room, uint32_t *count,
                                       struct reason *why);

/* The next element of a list into title and spec: "noon=sky:hour=12" has the title "noon"; by default a file's title is
 * its name without folder and ending, and that of other sources the whole spec. Advances *list; false at its end. */
bool chart_next_item(const char **list, char title[128], char spec[4096]);
