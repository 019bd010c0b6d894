#include "base/vec.h"
#include "scene/geometry/scene_build.h"

#include "base/mem.h"

#include <math.h>
#include <string.h>

/* A triangle whose height is less than this share of its longest side counts as degenerate. */
#define FLATNESS 1e-10

void mesh_finish(struct mesh *m)
{
    if (m->source == 0) {
        mem_free(m->positions);
        mem_free(m->normals);
        mem_free(m->uvs);
        mem_free(m->more_uvs);
        mem_free(m->tangents);
        mem_free(m->colours);
        mem_free(m->indices);
    }
    *m = (struct mesh){ 0 };
}

static struct vec3d cross(struct vec3d a, struct vec3d b)
{
    return (struct vec3d){ a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x };
}

static bool is_triangle(const struct mesh *m, const uint32_t index[3])
{
    const float *p[3];

    for (int k = 0; k < 3; k++) {
        if (index[k] >= m->vertex_count)
            return false;
        p[k] = m->positions + 3 * (size_t)index[k];
        for (int axis = 0; axis < 3; axis++) {
            if (!(fabsf(p[k][axis]) <= MESH_COORDINATE_MAX))
                return false;
        }
    }
    const struct vec3d a = vec3d_between(p[0], p[1]), b = vec3d_between(p[0], p[2]), c = vec3d_between(p[1], p[2]);
    const struct vec3d n = cross(a, b);
    const double longest2 = fmax(vec3d_dot(a, a), fmax(vec3d_dot(b, b), vec3d_dot(c, c)));
    return sqrt(vec3d_dot(n, n)) > FLATNESS * longest2;
}

uint32_t mesh_drop_degenerate(struct mesh *m)
{
    uint32_t kept = 0;

    for (uint32_t i = 0; i < m->triangle_count; i++) {
        const uint32_t *t = m->indices + 3 * (size_t)i;
        if (is_triangle(m, t))
            memmove(m->indices + 3 * (size_t)kept++, t, 3 * sizeof(*t));
    }
    const uint32_t dropped = m->triangle_count - kept;
    m->triangle_count = kept;
    return dropped;
}

/* Finds equal vertices by open addressing over the first vertex of each group. */
struct welder {
    const struct mesh *mesh;
    bool all;        /* compare positions, normals and texture coordinates; else only positions */
    uint32_t *slots; /* vertex + 1, or 0 if free */
    size_t mask;
};

static bool welder_init(struct welder *w, const struct mesh *m, bool all)
{
    size_t slots = 16;

    while (slots < 2 * (size_t)m->vertex_count)
        slots *= 2;
    *w = (struct welder){ m, all, mem_alloc(slots, sizeof(*w->slots)), slots - 1 };
    return w->slots != NULL;
}

static uint64_t hash_floats(uint64_t h, const float *v, int count)
{
    for (int k = 0; v && k < count; k++) {
        const float x = v[k] + 0.0f; /* -0 and 0 are the same position */
        uint32_t bits;
        memcpy(&bits, &x, sizeof(bits));
        h = (h ^ bits) * 0x9e3779b97f4a7c15u;
        h ^= h >> 29;
    }
    return h;
}

static bool same_floats(const float *array, uint32_t a, uint32_t b, size_t count)
{
    for (size_t k = 0; array && k < count; k++) {
        if (array[count * a + k] != array[count * b + k])
            return false;
    }
    return true;
}

static bool same_vertex(const struct welder *w, uint32_t a, uint32_t b)
{
    const struct mesh *m = w->mesh;
    return same_floats(m->positions, a, b, 3) &&
           (!w->all ||
            (same_floats(m->normals, a, b, 3) && same_floats(m->uvs, a, b, 2) && same_floats(m->more_uvs, a, b, 2) &&
             same_floats(m->tangents, a, b, 4) && same_floats(m->colours, a, b, 4)));
}

/* The first equal vertex among those looked up so far. */
static uint32_t weld(struct welder *w, uint32_t vertex)
{
    const struct mesh *m = w->mesh;
    uint64_t h = hash_floats(0, m->positions + 3 * (size_t)vertex, 3);

    if (w->all) {
        h = hash_floats(h, m->normals ? m->normals + 3 * (size_t)vertex : NULL, 3);
        h = hash_floats(h, m->uvs ? m->uvs + 2 * (size_t)vertex : NULL, 2);
        h = hash_floats(h, m->more_uvs ? m->more_uvs + 2 * (size_t)vertex : NULL, 2);
        h = hash_floats(h, m->tangents ? m->tangents + 4 * (size_t)vertex : NULL, 4);
        h = hash_floats(h, m->colours ? m->colours + 4 * (size_t)vertex : NULL, 4);
    }
    for (size_t i = h & w->mask;; i = (i + 1) & w->mask) {
        if (w->slots[i] == 0)
            w->slots[i] = vertex + 1;
        if (same_vertex(w, w->slots[i] - 1, vertex) || w->slots[i] == vertex + 1)
            return w->slots[i] - 1;
    }
}

static void move_vertex(struct mesh *m, uint32_t from, uint32_t to)
{
    memmove(m->positions + 3 * (size_t)to, m->positions + 3 * (size_t)from, 3 * sizeof(float));
    if (m->normals)
        memmove(m->normals + 3 * (size_t)to, m->normals + 3 * (size_t)from, 3 * sizeof(float));
    if (m->uvs)
        memmove(m->uvs + 2 * (size_t)to, m->uvs + 2 * (size_t)from, 2 * sizeof(float));
    if (m->more_uvs)
        memmove(m->more_uvs + 2 * (size_t)to, m->more_uvs + 2 * (size_t)from, 2 * sizeof(float));
    if (m->tangents)
        memmove(m->tangents + 4 * (size_t)to, m->tangents + 4 * (size_t)from, 4 * sizeof(float));
    if (m->colours)
        memmove(m->colours + 4 * (size_t)to, m->colours + 4 * (size_t)from, 4 * sizeof(float));
}

enum err mesh_join_vertices(struct mesh *m)
{
    uint32_t *place =
        mem_alloc(m->vertex_count, sizeof(*place)); /* new index of a group's first vertex, plus 1; 0: unused */
    struct welder w;
    uint32_t kept = 0;
    enum err e = welder_init(&w, m, true) && place ? ERR_OK : ERR_NOMEM;

    for (size_t i = 0; i < 3 * (size_t)m->triangle_count && !e; i++) {
        m->indices[i] = weld(&w, m->indices[i]);
        place[m->indices[i]] = 1;
    }
    for (uint32_t v = 0; v < m->vertex_count && !e; v++) {
        if (place[v]) { /* kept <= v: does not overwrite a vertex that is still needed */
            move_vertex(m, v, kept);
            place[v] = ++kept;
        }
    }
    for (size_t i = 0; i < 3 * (size_t)m->triangle_count && !e; i++)
        m->indices[i] = place[m->indices[i]] - 1;
    if (!e)
        m->vertex_count = kept;
    mem_free(w.slots);
    mem_free(place);
    return e;
}

static double angle_between(struct vec3d a, struct vec3d b)
{
    const struct vec3d n = cross(a, b);
    return atan2(sqrt(vec3d_dot(n, n)), vec3d_dot(a, b));
}

/* Adds each triangle's unit normal, weighted by its angle, to the sums at its three positions. */
static void add_up_normals(const struct mesh *m, struct welder *w, struct vec3d *sums)
{
    for (uint32_t i = 0; i < m->triangle_count; i++) {
        const uint32_t *t = m->indices + 3 * (size_t)i;
        const float *p[3];
        for (int k = 0; k < 3; k++)
            p[k] = m->positions + 3 * (size_t)t[k];
        const struct vec3d n = cross(vec3d_between(p[0], p[1]), vec3d_between(p[0], p[2]));
        const double length = sqrt(vec3d_dot(n, n));
        for (int k = 0; k < 3; k++) {
            const double angle =
                angle_between(vec3d_between(p[k], p[(k + 1) % 3]), vec3d_between(p[k], p[(k + 2) % 3]));
            struct vec3d *sum = &sums[weld(w, t[k])];
            sum->x += angle * n.x / length;
            sum->y += angle * n.y / length;
            sum->z += angle * n.z / length;
        }
    }
}

enum err mesh_make_normals(struct mesh *m)
{
    struct welder w;
    struct vec3d *sums = mem_alloc(m->vertex_count, sizeof(*sums));
    float *normals = mem_alloc(m->vertex_count, 3 * sizeof(*normals));
    enum err e = welder_init(&w, m, false) && sums && normals ? ERR_OK : ERR_NOMEM;

    if (!e) {
        add_up_normals(m, &w, sums);
        for (size_t i = 0; i < 3 * (size_t)m->triangle_count; i++) {
            const uint32_t v = m->indices[i];
            const struct vec3d n = sums[weld(&w, v)];
            const double length = sqrt(vec3d_dot(n, n));
            /* If the triangles cancel out, no normal is stored and the geometric one is used. */
            const double scale = length > 1e-6 ? 1.0 / length : 0.0;
            normals[3 * (size_t)v] = (float)(n.x * scale);
            normals[3 * (size_t)v + 1] = (float)(n.y * scale);
            normals[3 * (size_t)v + 2] = (float)(n.z * scale);
        }
        mem_free(m->normals);
        m->normals = normals;
        normals = NULL;
    }
    mem_free(normals);
    mem_free(sums);
    mem_free(w.slots);
    return e;
}
