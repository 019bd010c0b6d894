#include "image/codec/primaries.h"

#include <assert.h>
#include <math.h>

#define COORDINATE_MAX 10.0 /* primaries may be imaginary (ACES AP0's blue has y < 0), but not this far out */
#define MIN_AREA 1e-4       /* twice the minimum area of the primaries' triangle; Rec.709's is 0.22 */
#define LEAST_WHITE_Y 1e-3

const struct chromaticities colour_rec709 = { /* [ITU-R BT.709-6, 1.3 and 1.4] */
                                              { 0.6400, 0.3300 },
                                              { 0.3000, 0.6000 },
                                              { 0.1500, 0.0600 },
                                              { 0.3127, 0.3290 }
};

/* XYZ to the cone responses that the adaptation scales [Lam 1985]. */
static const double bradford[9] = {
    0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296,
};

static void multiply(const double a[9], const double b[9], double out[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

static void apply(const double m[9], const double v[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = m[3 * i] * v[0] + m[3 * i + 1] * v[1] + m[3 * i + 2] * v[2];
}

/* By cofactors. Returns the determinant; leaves *out unchanged if it is 0. */
static double invert(const double m[9], double out[9])
{
    double c[9];

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int r0 = (j + 1) % 3, r1 = (j + 2) % 3, c0 = (i + 1) % 3, c1 = (i + 2) % 3;
            c[3 * i + j] = m[3 * r0 + c0] * m[3 * r1 + c1] - m[3 * r0 + c1] * m[3 * r1 + c0];
        }
    const double det = m[0] * c[0] + m[1] * c[3] + m[2] * c[6];
    for (int i = 0; i < 9 && det != 0.0; i++)
        out[i] = c[i] / det;
    return det;
}

/* XYZ of a chromaticity at Y = 1. */
static void xyz_of(const double xy[2], double out[3])
{
    out[0] = xy[0] / xy[1];
    out[1] = 1.0;
    out[2] = (1.0 - xy[0] - xy[1]) / xy[1];
}

static bool coordinates_are_sane(const struct chromaticities *c)
{
    const double *const points[] = { c->red, c->green, c->blue, c->white };

    for (int p = 0; p < 4; p++)
        for (int i = 0; i < 2; i++)
            if (!(fabs(points[p][i]) <= COORDINATE_MAX)) /* also rejects NaN */
                return false;
    return c->white[1] >= LEAST_WHITE_Y;
}

/* The columns are the primaries (x, y, 1 - x - y), scaled so that (1, 1, 1) gives the white point at Y = 1 [SMPTE RP
 * 177, 3.3]. */
static enum err rgb_to_xyz(const struct chromaticities *c, double out[9])
{
    const double *const primaries[] = { c->red, c->green, c->blue };
    double p[9], inverse[9] = { 0 }, white[3], scale[3];

    if (!coordinates_are_sane(c))
        return ERR_RANGE;
    for (int j = 0; j < 3; j++) {
        p[j] = primaries[j][0];
        p[3 + j] = primaries[j][1];
        p[6 + j] = 1.0 - primaries[j][0] - primaries[j][1];
    }
    if (fabs(invert(p, inverse)) < MIN_AREA)
        return ERR_RANGE;
    xyz_of(c->white, white);
    apply(inverse, white, scale);
    for (int j = 0; j < 3; j++) {
        if (scale[j] <= 0.0)
            return ERR_RANGE;
        for (int i = 0; i < 3; i++)
            out[3 * i + j] = p[3 * i + j] * scale[j];
    }
    return ERR_OK;
}

/* Adapts XYZ from one white point to another by scaling the cone responses. */
static enum err adapt(const double from[2], const double to[2], double out[9])
{
    double a[3], b[3], cones_from[3], cones_to[3], scaled[9], inverse[9];

    xyz_of(from, a);
    xyz_of(to, b);
    apply(bradford, a, cones_from);
    apply(bradford, b, cones_to);
    for (int i = 0; i < 3; i++) {
        if (cones_from[i] <= 0.0)
            return ERR_RANGE;
        for (int j = 0; j < 3; j++)
            scaled[3 * i + j] = bradford[3 * i + j] * cones_to[i] / cones_from[i];
    }
    (void)invert(bradford, inverse);
    multiply(inverse, scaled, out);
    return ERR_OK;
}

static enum err xyz_under_white_to_rec709(const double white[2], double out[9])
{
    double to_xyz[9], from_xyz[9], adapted[9];
    enum err e = rgb_to_xyz(&colour_rec709, to_xyz);

    assert(!e);
    (void)invert(to_xyz, from_xyz);
    e = adapt(white, colour_rec709.white, adapted);
    if (!e)
        multiply(from_xyz, adapted, out);
    return e;
}

bool colour_same(const struct chromaticities *a, const struct chromaticities *b, double tolerance)
{
    const double *const of_a[] = { a->red, a->green, a->blue, a->white };
    const double *const of_b[] = { b->red, b->green, b->blue, b->white };

    for (int p = 0; p < 4; p++)
        for (int i = 0; i < 2; i++)
            if (!(fabs(of_a[p][i] - of_b[p][i]) <= tolerance))
                return false;
    return true;
}

enum err colour_to_rec709(const struct chromaticities *from, double out[9])
{
    double to_xyz[9], from_xyz[9];
    enum err e = rgb_to_xyz(from, to_xyz);

    if (!e)
        e = xyz_under_white_to_rec709(from->white, from_xyz);
    if (!e)
        multiply(from_xyz, to_xyz, out);
    return e;
}

void colour_xyz_to_rec709(double out[9])
{
    static const double equal_energy[2] = { 1.0 / 3.0, 1.0 / 3.0 };
    const enum err e = xyz_under_white_to_rec709(equal_energy, out);

    assert(!e);
    (void)e;
}
