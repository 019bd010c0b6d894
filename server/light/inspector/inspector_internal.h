/* Divides the light of a pixel by the classes of paths.h. Direct light is the probe's reference, the background is
 * exact, and each other class has eye paths of its own (eye_paths.h) at the pixel's shading points, without a limit on
 * their light: unbiased. Thread: one at a time; runs on all OpenMP threads. */
#pragma once

#include "light/inspector/inspector.h"

/* Fills a->parts. Of *a it reads `reference`, which includes the background, and `background`. desc must not use the
 * preset. ERR_NOMEM. */
MUST_CHECK enum err inspect_divide(const struct inspect_desc *desc, struct inspect_result *a);
