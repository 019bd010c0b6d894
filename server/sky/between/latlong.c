#include "sky/between/latlong.h"

#include "sky/tables/layout.h"

#include <math.h>
#include <string.h>

#define LOOKS 3u /* along each side of a texel */

static bool is_latlong(enum layout layout)
{
    return layout == LAYOUT_LATLONG || layout == LAYOUT_LATLONG_BOTTOM_FIRST;
}

static void look_up(const struct environment *e, uint32_t width, uint32_t height, uint32_t x, uint32_t y, float out[3])
{
    memset(out, 0, 3 * sizeof(*out));
    for (uint32_t k = 0; k < LOOKS * LOOKS; k++) {
        double w[3];
        float rgb[3];
        texel_direction(width, height, x + (k % LOOKS + 0.5) / LOOKS, y + (k / LOOKS + 0.5) / LOOKS, w);
        environment_lookup(e, (struct vec3){ (float)w[0], (float)w[1], (float)w[2] }, rgb);
        for (int c = 0; c < 3; c++)
            out[c] += rgb[c] / (LOOKS * LOOKS);
    }
}

void latlong_copy(const struct environment *e, enum layout layout, uint32_t width, uint32_t height, float *out)
{
    const size_t row = 3 * (size_t)width;

#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < height; y++) {
        const uint32_t from = layout == LAYOUT_LATLONG ? y : height - 1 - y;
        if (is_latlong(layout))
            memcpy(out + y * row, e->image.rgb + from * row, row * sizeof(*out));
        for (uint32_t x = 0; x < width && !is_latlong(layout); x++)
            look_up(e, width, height, x, y, out + y * row + 3 * (size_t)x);
    }
}

enum err latlong_size(struct environment *e, enum layout *layout, uint32_t *width, uint32_t *height, struct reason *why)
{
    const struct image *im = &e->image;

    *layout = e->layout != LAYOUT_AUTO ? e->layout : im->layout;
    const enum err result = *layout == LAYOUT_AUTO ? layout_guess(im->width, im->height, e->name, layout, why)
                                                   : layout_fits(*layout, im->width, im->height, e->name, why);
    if (result)
        return result;
    *width = im->width;
    *height = im->height;
    if (is_latlong(*layout))
        return ERR_OK;
    *height = (uint32_t)(2.0 * ceil(0.5 * sqrt(0.5 * im->width * im->height)));
    *width = 2 * *height;
    return environment_rebuild(e, why);
}
