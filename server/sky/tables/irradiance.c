#include "sky/tables/environment.h"

#include "sky/tables/cube.h"

#include <math.h>

static double over_top(double u, double v)
{
    const double a = sqrt(1.0 + u * u), b = sqrt(1.0 + v * v);

    return 0.5 * (v / b * atan(u / b) + u / a * atan(v / a));
}

static double over_side(double u, double v)
{
    const double b = sqrt(1.0 + v * v);

    return -0.5 * atan(u / b) / b;
}

void irradiance_weights(uint32_t n, double *out)
{
    const double step = 2.0 / n;

    for (uint32_t k = 0; k < n * n; k++) {
        const double u0 = -1.0 + step * (k % n), v0 = -1.0 + step * (k / n), u1 = u0 + step, v1 = v0 + step;
        const double above = fmax(v0, 0.0); /* with n = 1 the only texel is half below */
        out[k] = over_top(u1, v1) - over_top(u0, v1) - over_top(u1, v0) + over_top(u0, v0);
        out[n * n + k] =
            v1 <= 0.0 ? 0.0 : over_side(u1, v1) - over_side(u0, v1) - over_side(u1, above) + over_side(u0, above);
    }
}

void irradiance_upward(const struct environment *e, const double *weights, double rgb[3])
{
    const uint32_t n = e->n, up = 2; /* +Y; its opposite, 3, is below */

    rgb[0] = rgb[1] = rgb[2] = 0.0;
    for (uint32_t face = 0; face < CUBE_FACES; face++) {
        const bool columns = face < 2; /* whether columns run along Y, or rows do */
        for (uint32_t k = 0; k < n * n && face != up + 1; k++) {
            const struct texel *t = &e->texels[(size_t)face * n * n + k];
            const uint32_t side = columns ? k % n * n + k / n : k;
            const double w = face == up ? weights[k] : weights[n * n + side];
            rgb[0] += w * (double)t->r;
            rgb[1] += w * (double)t->g;
            rgb[2] += w * (double)t->b;
        }
    }
}
