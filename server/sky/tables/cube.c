#include "sky/tables/cube.h"

#include <stddef.h>

uint32_t cube_step_over(uint32_t face, int edge, int *i, int *j)
{
    double w[3];
    float u, v;

    if (*i >= 0 && *i < edge && *j >= 0 && *j < edge)
        return face;
    cube_direction(face, -1.0 + 2.0 / edge * (*j + 0.5), -1.0 + 2.0 / edge * (*i + 0.5), w);
    const float x[3] = { (float)w[0], (float)w[1], (float)w[2] };
    face = cube_locate(x, &u, &v);
    *i = (int)((v + 1.0f) * 0.5f * (float)edge);
    *j = (int)((u + 1.0f) * 0.5f * (float)edge);
    *i = *i < edge ? *i : edge - 1;
    *j = *j < edge ? *j : edge - 1;
    return face;
}

static double corner_integral(double u, double v)
{
    return atan2(u * v, sqrt(u * u + v * v + 1.0));
}

double cube_solid_angle(double u0, double v0, double u1, double v1)
{
    return corner_integral(u1, v1) - corner_integral(u0, v1) - corner_integral(u1, v0) + corner_integral(u0, v0);
}

/* First the corner integral at each texel's far corner, which is symmetric in u and v; then from the last texel on,
 * which needs those before it, the differences, as in cube_solid_angle. */
double cube_shared_solid_angle(uint32_t n, uint32_t i, uint32_t j, uint32_t m, uint32_t y, uint32_t x)
{
    const double wide = 2.0 / n, other = 2.0 / m;

    return cube_solid_angle(-1.0 + fmax(j * wide, x * other), -1.0 + fmax(i * wide, y * other),
                            -1.0 + fmin((j + 1) * wide, (x + 1) * other), -1.0 + fmin((i + 1) * wide, (y + 1) * other));
}

void cube_solid_angles(uint32_t n, double *out)
{
    const double step = 2.0 / n;

    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; j <= i; j++)
            out[(size_t)i * n + j] = out[(size_t)j * n + i] =
                corner_integral(-1.0 + step * (j + 1), -1.0 + step * (i + 1));
    for (uint32_t i = n; i-- > 0;) {
        const double v0 = -1.0 + step * i, v1 = -1.0 + step * (i + 1);
        double *row = out + (size_t)i * n, next_low = i ? row[-1] : corner_integral(-1.0 + step * n, v0);
        for (uint32_t j = n; j-- > 0;) {
            const double high = j ? row[j - 1] : corner_integral(-1.0, v1);
            const double low = i && j ? *(row + j - 1 - n) : corner_integral(-1.0 + step * j, v0);
            row[j] = row[j] - high - next_low + low;
            next_low = low;
        }
    }
}

void cube_corners(uint32_t face, float out[4][3])
{
    for (int k = 0; k < 4; k++) {
        double w[3];
        cube_direction(face, k & 1 ? 1.0 : -1.0, k & 2 ? 1.0 : -1.0, w);
        for (int c = 0; c < 3; c++)
            out[k][c] = (float)(w[c] / sqrt(3.0));
    }
}
