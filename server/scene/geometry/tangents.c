#include "base/vec.h"
#include "scene/geometry/scene_build.h"

#include "base/mem.h"

#include <math.h>
#include <string.h>

/* ---- Directions ---- */

static struct vec3d sum(struct vec3d a, struct vec3d b, double scale)
{
    return (struct vec3d){ a.x + scale * b.x, a.y + scale * b.y, a.z + scale * b.z };
}

/* Unit, or (0, 0, 0) for what has practically no length. */
static struct vec3d unit(struct vec3d v)
{
    const double length = sqrt(vec3d_dot(v, v)), scale = length > 0.0 && isfinite(length) ? 1.0 / length : 0.0;
    return (struct vec3d){ v.x * scale, v.y * scale, v.z * scale };
}

static double angle_at(const float *corner, const float *a, const float *b)
{
    const struct vec3d u = unit(vec3d_between(corner, a)), v = unit(vec3d_between(corner, b));
    return acos(fmin(fmax(vec3d_dot(u, v), -1.0), 1.0));
}

/* The direction of rising u on a triangle, and the side on which v rises: 1 counter-clockwise, -1 clockwise, 0 if the
 * texture coordinates enclose no area. */
static int u_direction(const struct mesh *m, const float *q, const uint32_t *t, struct vec3d *out)
{
    const float *p = m->positions;
    const struct vec3d e1 = vec3d_between(p + 3 * (size_t)t[0], p + 3 * (size_t)t[1]),
                       e2 = vec3d_between(p + 3 * (size_t)t[0], p + 3 * (size_t)t[2]);
    const double u0 = q[2 * (size_t)t[0]], v0 = q[2 * (size_t)t[0] + 1];
    const double u1 = q[2 * (size_t)t[1]] - u0, v1 = q[2 * (size_t)t[1] + 1] - v0;
    const double u2 = q[2 * (size_t)t[2]] - u0, v2 = q[2 * (size_t)t[2] + 1] - v0, area = u1 * v2 - u2 * v1;
    const int side = area > 0.0 ? 1 : area < 0.0 ? -1 : 0;

    *out = unit((struct vec3d){ side * (e1.x * v2 - e2.x * v1), side * (e1.y * v2 - e2.y * v1),
                                side * (e1.z * v2 - e2.z * v1) });
    return side;
}

/* ---- Vertices of two sides ---- */

struct split {
    int8_t *side;    /* [vertex_count]: of each vertex; 0: not yet used */
    uint32_t *other; /* its copy for the other side; 0: none */
    uint32_t count;  /* vertices, with copies */
};

/* The vertex that a triangle of this side uses in place of v. */
static uint32_t vertex_of(struct split *s, uint32_t v, int side)
{
    if (s->side[v] == 0)
        s->side[v] = (int8_t)side;
    if (side == 0 || s->side[v] == side)
        return v;
    if (s->other[v] == 0)
        s->other[v] = s->count++;
    return s->other[v];
}

static bool grow(float **array, uint32_t from, uint32_t to, size_t width, size_t spare)
{
    if (!*array)
        return true;
    float *grown = mem_grow(*array, width * from + spare, width * to + spare, sizeof(*grown));
    if (grown)
        *array = grown;
    return grown;
}

static void copy_vertex(float *array, uint32_t from, uint32_t to, size_t width)
{
    if (array)
        memcpy(array + width * to, array + width * from, width * sizeof(*array));
}

/* Makes room for the copies and fills them. Triangles still use the old vertices. */
static enum err add_copies(struct mesh *m, const struct split *s)
{
    const uint32_t before = m->vertex_count;

    if (s->count == before)
        return ERR_OK;
    if (s->count > MESH_ELEMENTS_MAX || !grow(&m->positions, before, s->count, 3, 1) ||
        !grow(&m->normals, before, s->count, 3, 0) || !grow(&m->uvs, before, s->count, 2, 0) ||
        !grow(&m->more_uvs, before, s->count, 2, 0) || !grow(&m->colours, before, s->count, 4, 0))
        return ERR_NOMEM;
    for (uint32_t v = 0; v < before; v++) {
        if (s->other[v] == 0)
            continue;
        copy_vertex(m->positions, v, s->other[v], 3);
        copy_vertex(m->normals, v, s->other[v], 3);
        copy_vertex(m->uvs, v, s->other[v], 2);
        copy_vertex(m->more_uvs, v, s->other[v], 2);
        copy_vertex(m->colours, v, s->other[v], 4);
    }
    m->vertex_count = s->count;
    return ERR_OK;
}

static enum err split_sides(struct mesh *m, const float *uvs)
{
    const uint32_t count = m->vertex_count;
    struct split s = { .side = mem_alloc(count, sizeof(*s.side)),
                       .other = mem_alloc(count, sizeof(*s.other)),
                       .count = count };
    uint32_t *indices = mem_alloc_raw(m->triangle_count, 3 * sizeof(*indices));
    enum err e = s.side && s.other && indices ? ERR_OK : ERR_NOMEM;

    for (size_t i = 0; i < m->triangle_count && !e; i++) {
        struct vec3d along;
        const int side = u_direction(m, uvs, m->indices + 3 * i, &along);
        for (size_t k = 0; k < 3; k++)
            indices[3 * i + k] = vertex_of(&s, m->indices[3 * i + k], side);
    }
    if (!e)
        e = add_copies(m, &s);
    if (!e) {
        mem_free(m->indices);
        m->indices = indices;
        indices = NULL;
    }
    mem_free(s.side);
    mem_free(s.other);
    mem_free(indices);
    return e;
}

/* ---- Means ---- */

/* Adds the directions on the triangles to the sums at their corners, each in the corner's plane, and notes the sides.
 */
static void add_up(const struct mesh *m, const float *uvs, struct vec3d *sums, float *tangents)
{
    for (size_t i = 0; i < m->triangle_count; i++) {
        const uint32_t *t = m->indices + 3 * i;
        struct vec3d along;
        const int side = u_direction(m, uvs, t, &along);
        for (int k = 0; k < 3 && side != 0; k++) {
            const size_t v = t[k];
            const float *p = m->positions, *n = m->normals ? m->normals + 3 * v : NULL;
            const struct vec3d normal = n ? (struct vec3d){ n[0], n[1], n[2] } : (struct vec3d){ 0 };
            const struct vec3d flat = unit(sum(along, normal, -vec3d_dot(along, normal)));
            sums[v] =
                sum(sums[v], flat, angle_at(p + 3 * v, p + 3 * (size_t)t[(k + 1) % 3], p + 3 * (size_t)t[(k + 2) % 3]));
            tangents[4 * v + 3] = (float)side;
        }
    }
}

enum err mesh_make_tangents(struct mesh *m, bool second)
{
    struct vec3d *sums = NULL;
    float *tangents = NULL;
    enum err e = ERR_OK;

    if (!(second ? m->more_uvs : m->uvs))
        return ERR_OK;
    mem_free(m->tangents);
    m->tangents = NULL;
    e = split_sides(m, second ? m->more_uvs : m->uvs);
    if (e)
        return e;
    sums = mem_alloc(m->vertex_count, sizeof(*sums));
    tangents = mem_alloc(m->vertex_count, 4 * sizeof(*tangents));
    if (sums && tangents) {
        add_up(m, second ? m->more_uvs : m->uvs, sums, tangents); /* splitting may have moved them */
        for (size_t v = 0; v < m->vertex_count; v++) {
            const struct vec3d t = unit(sums[v]);
            tangents[4 * v] = (float)t.x;
            tangents[4 * v + 1] = (float)t.y;
            tangents[4 * v + 2] = (float)t.z;
        }
        m->tangents = tangents;
        tangents = NULL;
    } else {
        e = ERR_NOMEM;
    }
    mem_free(tangents);
    mem_free(sums);
    return e;
}
