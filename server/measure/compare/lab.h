/* Display-linear Rec.709 to CIE XYZ and CIE 1976 (L*a*b*), white D65. Any thread. */
#pragma once

#include <math.h>

struct lab {
    double l, a, b;
};

/* CIE 1976 (L*a*b*) [CIE 15:2004, 8.2.1]: f(t). */
static inline double lab_root(double t)
{
    const double d = 6.0 / 29.0;
    return t > d * d * d ? cbrt(t) : t / (3.0 * d * d) + 4.0 / 29.0;
}

/* X, Y and Z over those of white. The rows add up to the white point's X and Z, so that white is (1, 1, 1). */
static inline void lab_xyz(const double c[3], double xyz[3])
{
    xyz[0] = (0.4123907993 * c[0] + 0.3575843394 * c[1] + 0.1804807884 * c[2]) / 0.9504559271;
    xyz[1] = 0.2126390059 * c[0] + 0.7151686788 * c[1] + 0.0721923154 * c[2];
    xyz[2] = (0.0193308187 * c[0] + 0.1191947798 * c[1] + 0.9505321522 * c[2]) / 1.0890577508;
}

static inline struct lab lab_from(const double c[3])
{
    double xyz[3];

    lab_xyz(c, xyz);
    const double fx = lab_root(xyz[0]), fy = lab_root(xyz[1]), fz = lab_root(xyz[2]);
    return (struct lab){ 116.0 * fy - 16.0, 500.0 * (fx - fy), 200.0 * (fy - fz) };
}
