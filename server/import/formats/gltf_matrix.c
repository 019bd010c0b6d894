#include "import/formats/gltf.h"

void gltf_compose(const double t[3], const double r[4], const double s[3], double out[16])
{
    const double length2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3];
    const double k = length2 > 0.0 ? 2.0 / length2 : 0.0; /* a quaternion of zeros turns nothing */
    const double x = r[0], y = r[1], z = r[2], w = r[3];
    const double turn[9] = {
        1.0 - k * (y * y + z * z), k * (x * y + w * z),       k * (x * z - w * y),
        k * (x * y - w * z),       1.0 - k * (x * x + z * z), k * (y * z + w * x),
        k * (x * z + w * y),       k * (y * z - w * x),       1.0 - k * (x * x + y * y),
    };

    for (int column = 0; column < 3; column++) {
        for (int row = 0; row < 3; row++)
            out[4 * column + row] = turn[3 * column + row] * s[column];
        out[4 * column + 3] = 0.0;
        out[12 + column] = t[column];
    }
    out[15] = 1.0;
}

enum err gltf_node_matrix(const struct gltf *g, const struct gltf_at *node, double out[16])
{
    double t[3] = { 0.0 }, r[4] = { [3] = 1.0 }, s[3] = { 1.0, 1.0, 1.0 };

    if (json_object_get(node->value, "matrix")) {
        const enum err e = gltf_numbers(g, node, "matrix", 16, out);
        if (!e && (out[3] != 0.0 || out[7] != 0.0 || out[11] != 0.0 || out[15] != 1.0))
            return gltf_fault(g, node, ERR_FORMAT, "matrix is not affine: its last row must be 0 0 0 1");
        return e;
    }
    enum err e = gltf_numbers(g, node, "translation", 3, t);
    if (!e)
        e = gltf_numbers(g, node, "rotation", 4, r);
    if (!e)
        e = gltf_numbers(g, node, "scale", 3, s);
    if (!e)
        gltf_compose(t, r, s, out);
    return e;
}
