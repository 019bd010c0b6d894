/* Splits an image into layers, one per class of light. The layers use the settings, counts and random numbers of the
 * whole image, so that
 *     direct + indirect + caustics + background = the image without its filter,     sun + sky = direct
 * up to rounding. One thread of control, that of the relighter. */
#pragma once

#include "light/frame/relight.h"

enum light_layer {
    LAYER_DIRECT,     /* E S* D L */
    LAYER_INDIRECT,   /* indirect light, and the light that the cache cannot separate from it */
    LAYER_CAUSTICS,   /* with stored paths, also indirect light that begins with a caustic */
    LAYER_BACKGROUND, /* the sky, also in mirrors and through glass */
    LAYER_SUN,        /* direct light from the sun's texels, if the sky has a sun (sky/tables/sky_table.h) */
    LAYER_SKY,        /* the rest of direct light */
    LAYER_ERROR,      /* [height][width]: standard error (noise, not bias) of the unfiltered image's luminance */
    LAYER_COUNT,
};

struct layers {
    float *light[LAYER_COUNT]; /* [height][width][3], except LAYER_ERROR */
    float *unfiltered;         /* [height][width][3]: the sum of the first four */

    /* The environment with everything but its sun set to black. */
    struct texel *sun;
    uint32_t sun_n;
    float *scratch; /* [height][width][3] */
};

/* False when out of memory; call layers_finish even then. */
bool layers_init(struct layers *l, const struct prepared_scene *set);
void layers_finish(struct layers *l); /* zeroed memory is allowed */

/* The standard error at a pixel: from the mean of the squared differences of luminance over 5 x 5 pixels around. An
 * image with half the samples has twice the variance, so the difference has three times the image's variance.
 * whole, half: float[height][width][3]. */
float layers_error(const float *whole, const float *half, uint32_t width, uint32_t height, uint32_t x, uint32_t y);

/* As relighter_run, for methods other than references, with all layers. e is restored when it returns.
 */
MUST_CHECK enum err relighter_run_layers(struct relighter *r, struct environment *e, const struct relight_desc *desc,
                                         struct layers *l, float *rgb, struct relight_stats *stats);
