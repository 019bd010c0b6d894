#include "light/denoise/denoise.h"

#include "base/mem.h"

#include <math.h>
#include <string.h>

#define REACH 2   /* pixels: a window of 5 x 5 */
#define LONE 4.0f /* times the brightest neighbour */

struct window { /* of pixels around one, within the image */
    uint32_t x0, x1, y0, y1;
};

static struct window around(uint32_t x, uint32_t y, uint32_t width, uint32_t height)
{
    return (struct window){
        .x0 = x > REACH ? x - REACH : 0,
        .x1 = x + REACH < width ? x + REACH : width - 1,
        .y0 = y > REACH ? y - REACH : 0,
        .y1 = y + REACH < height ? y + REACH : height - 1,
    };
}

static float light_of(const float *rgb)
{
    return rgb[0] + rgb[1] + rgb[2];
}

/* The share of a pixel's light that is in excess. */
static float excess_at(const float *rgb, uint32_t x, uint32_t y, uint32_t width, uint32_t height)
{
    const struct window w = around(x, y, width, height);
    const float own = light_of(rgb + 3 * ((size_t)y * width + x));
    float most = 0.0f;

    if (!(own > 0.0f))
        return 0.0f;
    for (uint32_t v = w.y0; v <= w.y1; v++)
        for (uint32_t u = w.x0; u <= w.x1; u++)
            if (u != x || v != y)
                most = fmaxf(most, light_of(rgb + 3 * ((size_t)v * width + u)));
    return fmaxf(0.0f, 1.0f - LONE * most / own);
}

static void spread(const float *from, float share, uint32_t x, uint32_t y, uint32_t width, uint32_t height, float *to)
{
    const struct window w = around(x, y, width, height);
    const float each = share / (float)((w.x1 - w.x0 + 1) * (w.y1 - w.y0 + 1));
    const float *rgb = from + 3 * ((size_t)y * width + x);

    for (size_t c = 0; c < 3; c++)
        to[3 * ((size_t)y * width + x) + c] -= share * rgb[c];
    for (uint32_t v = w.y0; v <= w.y1; v++)
        for (uint32_t u = w.x0; u <= w.x1; u++)
            for (size_t c = 0; c < 3; c++)
                to[3 * ((size_t)v * width + u) + c] += each * rgb[c];
}

enum err splats_spread(float *splats, uint32_t width, uint32_t height)
{
    const size_t values = 3 * (size_t)width * height;
    float *from = mem_alloc_raw(values, sizeof(*from));

    if (!from)
        return ERR_NOMEM;
    memcpy(from, splats, values * sizeof(*from));
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const float share = excess_at(from, x, y, width, height);
            if (share > 0.0f)
                spread(from, share, x, y, width, height, splats);
        }
    mem_free(from);
    return ERR_OK;
}
