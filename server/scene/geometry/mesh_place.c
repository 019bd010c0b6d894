/* Placed meshes: their arrays are in object space, so that instances can share them. */
#include "scene/geometry/mesh_read.h"
#include "scene/geometry/scene_build.h"

#include <math.h>

#define STRETCH_MAX 1000.0 /* bounds the condition of a matrix */
#define SCALE_LEAST 1e-6   /* and its scales */
#define SCALE_MOST 1e6

static const struct box no_box = { { INFINITY, INFINITY, INFINITY }, { -INFINITY, -INFINITY, -INFINITY } };

static void grow(struct box *b, float x, float y, float z)
{
    b->low = vec3_make(fminf(b->low.x, x), fminf(b->low.y, y), fminf(b->low.z, z));
    b->high = vec3_make(fmaxf(b->high.x, x), fmaxf(b->high.y, y), fmaxf(b->high.z, z));
}

static void grow_by_vertices(const struct mesh *m, struct box *b)
{
    for (size_t i = 0; i < 3 * (size_t)m->triangle_count; i++) {
        const float *p = m->positions + 3 * (size_t)m->indices[i];
        grow(b, p[0], p[1], p[2]);
    }
}

/* The box of the arrays' box: the mesh is within. */
static struct box box_of_bounds(const struct box *bounds, const struct placement *place)
{
    struct box b = no_box;

    for (int i = 0; i < 8; i++) {
        const float corner[3] = { i & 1 ? bounds->high.x : bounds->low.x, i & 2 ? bounds->high.y : bounds->low.y,
                                  i & 4 ? bounds->high.z : bounds->low.z };
        double p[3];
        placement_point(place, corner, p);
        grow(&b, (float)p[0], (float)p[1], (float)p[2]);
    }
    return b;
}

static bool is_within(const struct box *b, const struct box *of)
{
    return b->low.x >= of->low.x && b->low.y >= of->low.y && b->low.z >= of->low.z && b->high.x <= of->high.x &&
           b->high.y <= of->high.y && b->high.z <= of->high.z;
}

void mesh_grow_box(const struct mesh *m, struct box *b)
{
    if (!m->placed) {
        grow_by_vertices(m, b);
        return;
    }
    const struct box around = box_of_bounds(&m->bounds, &m->place);
    if (is_within(&around, b)) /* of a thousand trees only those at the edge are looked at in detail */
        return;
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        double p[3];
        mesh_position(m, v, p);
        grow(b, (float)p[0], (float)p[1], (float)p[2]);
    }
}

/* Fills p->normals with cofactors, whose largest becomes 1, and p->side. Returns the determinant. */
static double invert(struct placement *p)
{
    double c[3][3], most = 0.0, determinant = 0.0;

    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            const float *a = p->matrix[(i + 1) % 3], *b = p->matrix[(i + 2) % 3];
            const int k1 = (k + 1) % 3, k2 = (k + 2) % 3;
            c[i][k] = (double)a[k1] * b[k2] - (double)a[k2] * b[k1];
            most = fmax(most, fabs(c[i][k]));
        }
    for (int k = 0; k < 3; k++)
        determinant += p->matrix[0][k] * c[0][k];
    p->side = determinant < 0.0 ? -1.0f : 1.0f;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            p->normals[i][k] = (float)(p->side * c[i][k] / most);
    return determinant;
}

/* False for NaN, too. The product of the norms of a matrix and its inverse bounds its stretch; 3 is the least. */
static bool suits(const struct placement *p, double determinant)
{
    double norm2 = 0.0, cofactors2 = 0.0;

    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            const float *a = p->matrix[(i + 1) % 3], *b = p->matrix[(i + 2) % 3];
            const int k1 = (k + 1) % 3, k2 = (k + 2) % 3;
            const double c = (double)a[k1] * b[k2] - (double)a[k2] * b[k1];
            norm2 += (double)p->matrix[i][k] * p->matrix[i][k];
            cofactors2 += c * c;
        }
    const double norm = sqrt(norm2), inverse = sqrt(cofactors2) / fabs(determinant);
    return norm * inverse <= 3.0 * STRETCH_MAX && norm <= SCALE_MOST && inverse <= 1.0 / SCALE_LEAST;
}

enum err mesh_place(struct mesh *m, const float matrix[3][4])
{
    const struct box limits = { { -MESH_COORDINATE_MAX, -MESH_COORDINATE_MAX, -MESH_COORDINATE_MAX },
                                { MESH_COORDINATE_MAX, MESH_COORDINATE_MAX, MESH_COORDINATE_MAX } };
    struct placement p;
    struct box bounds = no_box;

    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 4; k++)
            p.matrix[i][k] = matrix[i][k];
    if (!suits(&p, invert(&p)))
        return ERR_RANGE;
    for (int i = 0; i < 3; i++) {
        if (!(fabsf(matrix[i][3]) <= MESH_COORDINATE_MAX))
            return ERR_RANGE;
    }
    if (m->placed)
        bounds = m->bounds;
    else
        grow_by_vertices(m, &bounds);
    const struct box around = box_of_bounds(&bounds, &p);
    if (!is_within(&around, &limits))
        return ERR_RANGE;
    m->placed = true;
    m->bounds = bounds;
    m->place = p;
    return ERR_OK;
}

/* A unit vector, or (0, 0, 0). */
static struct vec3 unit(const double v[3])
{
    const double length = sqrt(dot3(v, v)), scale = length > 0.0 ? 1.0 / length : 0.0;

    return vec3_make((float)(v[0] * scale), (float)(v[1] * scale), (float)(v[2] * scale));
}

struct vec3 placement_normal(const struct placement *p, const float n[3])
{
    double v[3];

    for (int i = 0; i < 3; i++)
        v[i] = (double)p->normals[i][0] * n[0] + (double)p->normals[i][1] * n[1] + (double)p->normals[i][2] * n[2];
    return unit(v);
}

void mesh_tangent(const struct mesh *m, uint32_t vertex, float out[4])
{
    const float *t = m->tangents + 4 * (size_t)vertex;
    struct vec3 turned = { t[0], t[1], t[2] };
    double v[3];

    if (m->placed) {
        for (int i = 0; i < 3; i++) {
            const float *row = m->place.matrix[i];
            v[i] = (double)row[0] * t[0] + (double)row[1] * t[1] + (double)row[2] * t[2];
        }
        turned = unit(v);
    }
    out[0] = turned.x;
    out[1] = turned.y;
    out[2] = turned.z;
    out[3] = m->placed ? t[3] * m->place.side : t[3];
}

double mesh_volume_scale(const struct mesh *m)
{
    struct placement p = m->place;

    return m->placed ? fabs(invert(&p)) : 1.0;
}
