/* The sky with the sun anywhere: elevation -pi/2..pi/2, azimuth clockwise from north, radians. */
#pragma once

#include "sky/daylight/sky.h"

#include <assert.h>
#include <math.h>

static inline void sky_state_for_sun(const struct sky_desc *d, double elevation, double azimuth, struct sky_state *out)
{
    assert(fabs(elevation) <= 1.5707963267948966 + 1e-9);
    *out = (struct sky_state){ .sun_elevation = elevation };
    out->sun_direction[0] = -sin(azimuth) * cos(elevation);
    out->sun_direction[1] = sin(elevation);
    out->sun_direction[2] = cos(azimuth) * cos(elevation);
    sky_state_fill(d, out);
}
