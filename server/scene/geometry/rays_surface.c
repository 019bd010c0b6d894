/* The surface at a hit. */
#include "scene/geometry/embree.h"
#include "scene/geometry/mesh_read.h"

#include <math.h>

/* fmax, which minds NaN, is a call. */
static inline double larger(double a, double b)
{
    return a > b ? a : b;
}

/* Bounds the distance of a point, computed on a triangle and rounded to float, from the triangle's plane as a ray query
 * sees it, along the unit normal n: a running error bound [Higham 2002, section 3.3] with u = 2^-24 per rounding.
 *  - The point: each coordinate is rounded once when stored and once when offset: 2 u |n_i| |p_i|.
 *  - The query computes (v - o).N with N = e1 x e2 in float. Rounding v - o gives u |n_i| D_i, where D_i is the largest
 *    distance of a vertex along axis i; the dot product adds at most 3 u |n_i| D_i; each component of N has an error of
 *    at most 4 u A_i, A = |e1| x |e2| with plus instead of minus: 4 u A_i D_i / |N|.
 * The bound is doubled for triangles in the same plane whose vertices are further away. It vanishes with the point's
 * height for planes perpendicular to an axis, so that a huge ground plane does not need a huge offset. */
static inline double plane_doubt(const double v[3][3], const double p[3], const double n[3], double n_length)
{
    const double u = 0x1p-24;
    double doubt = 0.0;
    double e1[3], e2[3];

    for (int i = 0; i < 3; i++) {
        e1[i] = fabs(v[1][i] - v[0][i]);
        e2[i] = fabs(v[2][i] - v[0][i]);
    }
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const double area = e1[j] * e2[k] + e1[k] * e2[j];
        const double reach = larger(fabs(v[0][i] - p[i]), larger(fabs(v[1][i] - p[i]), fabs(v[2][i] - p[i])));
        doubt += u * (2.0 * fabs(n[i]) * fabs(p[i]) + 4.0 * fabs(n[i]) * reach + 4.0 * area * reach / n_length);
    }
    return 2.0 * doubt;
}

/* The point of a triangle and its unit normal, n; returns the normal's length before. */
static inline double plane_at(const double v[3][3], const double weight[3], double p[3], double n[3])
{
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        p[i] = weight[0] * v[0][i] + weight[1] * v[1][i] + weight[2] * v[2][i];
        n[i] = (v[1][j] - v[0][j]) * (v[2][k] - v[0][k]) - (v[1][k] - v[0][k]) * (v[2][j] - v[0][j]);
    }
    const double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int i = 0; i < 3; i++)
        n[i] /= length; /* > 0: meshes contain no degenerate triangles */
    return length;
}

/* The same as plane_doubt for a placed mesh. A query takes the ray's origin o to the arrays' space: o' = A o + b, with
 * the inverse A = adj(M) / det(M) of the matrix and b = -A t, all in float:
 *  - A_ij has an error of at most 11 u q G_ij, G = adj(M) with plus instead of minus, over |det(M)|, and q >= 1 the
 * same for the determinant; its effect is that on o - t, since A makes b, too;
 *  - rounding b and the sums gives u A_ij (4 |o_j| + 7 |t_j|).
 * There it meets the triangle with the doubt of plane_doubt. With w = M^T n, a displacement d' there is n.M d' = w.d'
 * along the normal here, where the triangle's unit normal is w / |w|. Not inlined, so that other meshes pay nothing. */
__attribute__((noinline)) static double placed_doubt(const struct mesh *m, uint32_t triangle, const double weight[3],
                                                     const double p[3], const double n[3])
{
    const uint32_t *t = m->indices + 3 * (size_t)triangle;
    const float(*matrix)[4] = m->place.matrix;
    const double u = 0x1p-24;
    double v[3][3], at[3], normal[3], det = 0.0, det_abs = 0.0, doubt = 0.0, w2 = 0.0;
    double cofactor[3][3], cofactor_abs[3][3]; /* A_ij = cofactor[j][i] / det */

    for (int j = 0; j < 3; j++)
        for (int i = 0; i < 3; i++) {
            const float *a = matrix[(j + 1) % 3], *b = matrix[(j + 2) % 3];
            const int i1 = (i + 1) % 3, i2 = (i + 2) % 3;
            const double plus = (double)a[i1] * b[i2], minus = (double)a[i2] * b[i1];
            cofactor[j][i] = plus - minus;
            cofactor_abs[j][i] = fabs(plus) + fabs(minus);
        }
    for (int i = 0; i < 3; i++) {
        det += matrix[0][i] * cofactor[0][i];
        det_abs += fabs((double)matrix[0][i]) * cofactor_abs[0][i];
        for (int k = 0; k < 3; k++)
            v[k][i] = m->positions[3 * (size_t)t[k] + (size_t)i];
    }
    const double q = det_abs / fabs(det);
    for (int i = 0; i < 3; i++) {
        const double w = matrix[0][i] * n[0] + matrix[1][i] * n[1] + matrix[2][i] * n[2];
        double moved = 0.0;
        for (int j = 0; j < 3; j++)
            moved += fabs(cofactor[j][i]) * (4.0 * fabs(p[j]) + 7.0 * fabs((double)matrix[j][3])) +
                     11.0 * q * cofactor_abs[j][i] * fabs(p[j] - matrix[j][3]);
        doubt += u * (2.0 * fabs(n[i]) * fabs(p[i]) + fabs(w) * moved / fabs(det));
        w2 += w * w;
    }
    const double length = plane_at((const double(*)[3])v, weight, at, normal);
    return 2.0 * doubt + sqrt(w2) * plane_doubt((const double(*)[3])v, at, normal, length);
}

/* The interpolated normal, or `geometric` if there is none. */
static struct vec3 shading_normal(const struct mesh *m, const uint32_t *t, const double weight[3],
                                  struct vec3 geometric)
{
    double n[3] = { 0.0, 0.0, 0.0 };

    if (!m->normals)
        return geometric;
    for (int k = 0; k < 3; k++) {
        const struct vec3 vn = mesh_normal(m, t[k]);
        n[0] += weight[k] * vn.x;
        n[1] += weight[k] * vn.y;
        n[2] += weight[k] * vn.z;
    }
    const double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (!(length > 1e-3))
        return geometric;
    const struct vec3 s = vec3_make((float)(n[0] / length), (float)(n[1] / length), (float)(n[2] / length));
    return vec3_dot(s, geometric) < 0.0f ? vec3_scale(s, -1.0f) : s;
}

static inline void interpolate_uvs(const float *uvs, const uint32_t *t, const double weight[3], float out[2])
{
    out[0] = out[1] = 0.0f;
    for (int k = 0; uvs && k < 3; k++) {
        out[0] += (float)weight[k] * uvs[2 * (size_t)t[k]];
        out[1] += (float)weight[k] * uvs[2 * (size_t)t[k] + 1];
    }
}

void rays_surface(const struct rays *r, const struct hit *h, struct vec3 towards, struct surface *out)
{
    const struct mesh *m = &r->scene->meshes[h->mesh];
    const uint32_t *t = m->indices + 3 * (size_t)h->triangle;
    const double weight[3] = { 1.0 - (double)h->u - (double)h->v, h->u, h->v };
    double v[3][3], p[3], n[3];

    mesh_corners(m, h->triangle, v);
    const double length = plane_at((const double(*)[3])v, weight, p, n);
    for (int i = 0; i < 3; i++)
        n[i] *= mesh_side(m);
    const double side = n[0] * towards.x + n[1] * towards.y + n[2] * towards.z < 0.0 ? -1.0 : 1.0;

    out->position = vec3_make((float)p[0], (float)p[1], (float)p[2]);
    out->geometric = vec3_make((float)(side * n[0]), (float)(side * n[1]), (float)(side * n[2]));
    out->outside = side > 0.0;
    out->shading = shading_normal(m, t, weight, out->geometric);
    /* nonzero even if the bound is 0, so that the origin is off the plane and no product is denormal */
    out->offset = (float)((m->placed ? placed_doubt(m, h->triangle, weight, p, n)
                                     : plane_doubt((const double(*)[3])v, p, n, length)) +
                          1e-18);
    interpolate_uvs(m->uvs, t, weight, out->uv);
    interpolate_uvs(m->more_uvs, t, weight, out->more_uv);
    out->colour = m->colours ? vec3_make(0.0f, 0.0f, 0.0f) : vec3_make(1.0f, 1.0f, 1.0f);
    for (int k = 0; m->colours && k < 3; k++) {
        const float *c = m->colours + 4 * (size_t)t[k];
        out->colour = vec3_add(out->colour, vec3_scale(vec3_make(c[0], c[1], c[2]), (float)weight[k]));
    }
}
