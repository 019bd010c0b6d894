#include "measure/compare/error_map.h"

#include "base/luminance.h"
#include "base/vec.h"
#include "image/film/film.h"

#include <math.h>
#include <stdbool.h>

static double lab_cube(double f)
{
    return f > 6.0 / 29.0 ? f * f * f : 3.0 * (6.0 / 29.0) * (6.0 / 29.0) * (f - 4.0 / 29.0);
}

/* Lightness, chroma and hue angle (radians) of CIE 1976 to linear sRGB, which may leave 0..1. */
static void lch_to_linear(double l, double chroma, double hue, double out[3])
{
    const double fy = (l + 16.0) / 116.0;
    const double x = 0.95046 * lab_cube(fy + chroma * cos(hue) / 500.0);
    const double y = lab_cube(fy);
    const double z = 1.08906 * lab_cube(fy - chroma * sin(hue) / 200.0);
    out[0] = 3.2404542 * x - 1.5371385 * y - 0.4985314 * z;
    out[1] = -0.9692660 * x + 1.8760108 * y + 0.0415560 * z;
    out[2] = 0.0556434 * x - 0.2040259 * y + 1.0572252 * z;
}

static bool is_displayable(const double c[3])
{
    for (int k = 0; k < 3; k++)
        if (c[k] < -1e-4 || c[k] > 1.0 + 1e-4)
            return false;
    return true;
}

/* The colour at t in 0..1: lightness linear in t, so that equal steps look equal and the map survives a grey printer;
 * hue from blue-violet over red to yellow; as much chroma as is wanted and the display can show. */
void ramp_colour(double t, uint8_t rgb[3])
{
    t = fmin(fmax(t, 0.0), 1.0);
    const double l = 3.0 + 93.0 * t;
    const double hue = (285.0 + 180.0 * t) * PI / 180.0;
    double chroma = 85.0 * pow(sin(PI * (0.02 + 0.9 * t)), 0.7), c[3];

    lch_to_linear(l, chroma, hue, c);
    while (chroma > 0.0 && !is_displayable(c)) {
        chroma -= 0.5;
        lch_to_linear(l, fmax(chroma, 0.0), hue, c);
    }
    for (int k = 0; k < 3; k++)
        rgb[k] = (uint8_t)lround(255.0 * srgb_encode(fmin(fmax(c[k], 0.0), 1.0)));
}
