#include "env/cube.h"

static double corner_integral(double u, double v)
{
    return atan2(u * v, sqrt(u * u + v * v + 1.0));
}

double cube_solid_angle(double u0, double v0, double u1, double v1)
{
    return corner_integral(u1, v1) - corner_integral(u0, v1) - corner_integral(u1, v0) + corner_integral(u0, v0);
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
