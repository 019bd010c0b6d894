/* Reads --probe, --probe-samples and --probe-preset from a program's flags. Main thread. */
#pragma once

#include "base/command.h"
#include "light/inspector/probe_report.h"

extern const struct setting_choice probe_presets[]; /* values of the field `figure` */

/* After command_read, which reads samples and preset. *asked: --probe is given; its pixel, of an image of that size,
 * goes to *out. ERR_USAGE names the flag. */
MUST_CHECK enum err probe_options_read(const struct command *c, uint32_t width, uint32_t height, bool *asked,
                                       struct probe_request *out, struct reason *why);
