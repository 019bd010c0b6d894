#include "scene/scene.h"

#include <math.h>

static uint32_t wrap(double x, uint32_t size)
{
    const double r = x - floor(x / size) * size;
    return r < size ? (uint32_t)r : 0;
}

struct vec3 texture_lookup(const struct texture *t, float u, float v)
{
    if (!isfinite(u) || !isfinite(v))
        u = v = 0.0f;
    const double x = (double)u * t->width - 0.5;
    const double y = (1.0 - (double)v) * t->height - 0.5;
    const float fx = (float)(x - floor(x)), fy = (float)(y - floor(y));
    const uint32_t x0 = wrap(floor(x), t->width), y0 = wrap(floor(y), t->height);
    const uint32_t x1 = (x0 + 1) % t->width, y1 = (y0 + 1) % t->height;
    const float weight[4] = { (1.0f - fx) * (1.0f - fy), fx * (1.0f - fy), (1.0f - fx) * fy, fx * fy };
    const size_t texel[4] = { (size_t)y0 * t->width + x0, (size_t)y0 * t->width + x1, (size_t)y1 * t->width + x0,
                              (size_t)y1 * t->width + x1 };
    struct vec3 sum = { 0 };

    for (int k = 0; k < 4; k++) {
        const float *rgb = t->rgb + 3 * texel[k];
        sum = vec3_add(sum, vec3_scale(vec3_make(rgb[0], rgb[1], rgb[2]), weight[k]));
    }
    return sum;
}
