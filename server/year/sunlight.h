/* The illuminance of sensors from the sun's disc alone, without reflections, as annual sunlight exposure requires.
 * Sixteen rays are spread over the disc; panes of thin glass weight each by their transmittance, for luminance.
 * Thread: one; all OpenMP threads are used. */
#pragma once

#include "scene/geometry/rays.h"
#include "scene/geometry/sensors.h"

#include <stdbool.h>
#include <stddef.h>

/* Whether rays pass surfaces at random: through thin glass and fractional coverage. */
bool sunlight_has_thin_glass(const struct scene *s);

/* sun: unit, towards its centre. normal_lux: its illuminance at normal incidence. lux: [count]. */
void sunlight_lux(const struct scene *scene, const struct rays *rays, const struct sensor *sensors, size_t count,
                  const double sun[3], double normal_lux, float *lux);
