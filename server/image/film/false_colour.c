#include "image/film/film.h"

#include <math.h>
#include <string.h>

void false_colour(double share, uint8_t rgb[3])
{
    static const uint8_t stops[9][3] = { { 18, 12, 60 },   { 42, 42, 134 },  { 24, 96, 172 },
                                         { 18, 146, 160 }, { 62, 184, 110 }, { 160, 212, 60 },
                                         { 248, 222, 60 }, { 246, 150, 46 }, { 206, 44, 44 } };

    if (isnan(share)) {
        memset(rgb, 150, 3);
        return;
    }
    const double at = 8.0 * fmin(1.0, fmax(0.0, share));
    const int k = at < 8.0 ? (int)at : 7;
    for (int i = 0; i < 3; i++)
        rgb[i] = (uint8_t)(stops[k][i] + (at - k) * (stops[k + 1][i] - stops[k][i]) + 0.5);
}

void false_colour_map(const float *values, uint32_t width, uint32_t height, double most, int steps, uint8_t *rgb)
{
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const float *v = values + (size_t)y * width + x;
            const double scale = steps / most, step = floor(scale * (double)*v);
            const bool edge = (x + 1 < width && floor(scale * (double)v[1]) != step) ||
                              (y + 1 < height && floor(scale * (double)v[width]) != step);
            uint8_t *to = rgb + 3 * ((size_t)y * width + x);
            false_colour(*v / most, to);
            for (int k = 0; k < 3 && edge && !isnan(*v); k++)
                to[k] = to[k] / 3;
        }
}

double false_colour_share(double exposed)
{
    if (!(exposed > FALSE_COLOUR_LEAST))
        return 0.0;
    return fmin(1.0, log(exposed / FALSE_COLOUR_LEAST) / log(FALSE_COLOUR_MOST / FALSE_COLOUR_LEAST));
}
