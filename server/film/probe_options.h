/* --probe, --probe-samples and --probe-preset, in a table of options that has them. Main thread. */
#ifndef FILM_PROBE_OPTIONS_H
#define FILM_PROBE_OPTIONS_H

#include "options.h"
#include "probe_report.h"

/* *asked: there is a question, about a pixel of a picture of that size. ERR_USAGE names the flag. */
MUST_CHECK enum err probe_options_read(const struct options *o, uint32_t width, uint32_t height, bool *asked,
                                       struct probe_question *out, struct reason *why);

#endif
