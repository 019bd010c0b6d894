/* Reads --probe, --probe-samples and --probe-preset from a program's flags. Main thread. */
#pragma once

#include "base/command.h"
#include "light/inspector/inspector_report.h"

extern const struct setting_choice inspect_presets[]; /* values of the field `figure` */

/* After command_read, which reads samples and preset. *asked: --probe is given; its pixel, of an image of that size,
 * goes to *out. ERR_USAGE names the flag. */
MUST_CHECK enum err inspect_options_read(const struct command *c, uint32_t width, uint32_t height, bool *asked,
                                         struct inspect_request *out, struct reason *why);
