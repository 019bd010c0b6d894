/* --probe, --probe-samples and --probe-preset, in a table of options that has them. Main thread. */
#ifndef SETTINGS_PROBE_OPTIONS_H
#define SETTINGS_PROBE_OPTIONS_H

#include "base/options.h"
#include "probe/probe_report.h"

/* *asked: there is a question, about a pixel of a picture of that size. ERR_USAGE names the flag. */
MUST_CHECK enum err probe_options_read(const struct options *o, uint32_t width, uint32_t height, bool *asked,
                                       struct probe_request *out, struct reason *why);

#endif
