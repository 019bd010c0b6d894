#include "bench/bench_parts.h"

#include "base/mem.h"
#include "scene/scene.h"

#include <math.h>
#include <string.h>

/* The middles of edges so far: a hash table with open addressing, by the edge's two vertices. */
struct edges {
    uint64_t *key; /* (low << 32 | high) + 1; 0: free */
    uint32_t *middle;
    size_t room; /* a power of two */
};

struct growing { /* the mesh that is being made */
    struct mesh mesh;
    struct edges edges;
};

/* The middle of an edge: a new vertex, or the one made for the edge's other triangle. */
static uint32_t middle_of(struct growing *g, uint32_t a, uint32_t b)
{
    const uint64_t key = ((uint64_t)(a < b ? a : b) << 32 | (a < b ? b : a)) + 1;
    struct mesh *m = &g->mesh;
    size_t at = (size_t)(key * 0x9e3779b97f4a7c15u >> 20) & (g->edges.room - 1);

    for (; g->edges.key[at] != 0; at = (at + 1) & (g->edges.room - 1))
        if (g->edges.key[at] == key)
            return g->edges.middle[at];
    const uint32_t made = m->vertex_count++;
    g->edges.key[at] = key;
    g->edges.middle[at] = made;
    for (size_t i = 0; i < 3; i++)
        m->positions[3 * (size_t)made + i] =
            0.5f * m->positions[3 * (size_t)a + i] + 0.5f * m->positions[3 * (size_t)b + i];
    for (size_t i = 0; m->uvs && i < 2; i++)
        m->uvs[2 * (size_t)made + i] = 0.5f * (m->uvs[2 * (size_t)a + i] + m->uvs[2 * (size_t)b + i]);
    if (m->normals) {
        float n[3], square = 0.0f;
        for (size_t i = 0; i < 3; i++) {
            n[i] = m->normals[3 * (size_t)a + i] + m->normals[3 * (size_t)b + i];
            square += n[i] * n[i];
        }
        const float scale = square > 1e-6f ? 1.0f / sqrtf(square) : 0.0f;
        for (size_t i = 0; i < 3; i++)
            m->normals[3 * (size_t)made + i] = n[i] * scale;
    }
    return made;
}

/* In double the products of floats are exact, so that this is too. */
static bool has_area(const struct mesh *m, const uint32_t v[3])
{
    double e[2][3];

    for (size_t i = 0; i < 3; i++)
        for (size_t k = 0; k < 2; k++)
            e[k][i] = (double)m->positions[3 * (size_t)v[k + 1] + i] - m->positions[3 * (size_t)v[0] + i];
    return e[0][1] * e[1][2] != e[0][2] * e[1][1] || e[0][2] * e[1][0] != e[0][0] * e[1][2] ||
           e[0][0] * e[1][1] != e[0][1] * e[1][0];
}

/* Leaves out triangles that rounding has degenerated: no ray could hit them, and they have no normal. */
static void split_all(struct growing *g, const struct mesh *from)
{
    uint32_t *to = g->mesh.indices;

    for (size_t t = 0; t < from->triangle_count; t++) {
        const uint32_t *v = from->indices + 3 * t;
        const uint32_t ab = middle_of(g, v[0], v[1]), bc = middle_of(g, v[1], v[2]), ca = middle_of(g, v[2], v[0]);
        const uint32_t four[12] = { v[0], ab, ca, ab, v[1], bc, ca, bc, v[2], ab, bc, ca };
        for (size_t k = 0; k < 12; k += 3)
            if (has_area(&g->mesh, four + k)) {
                memcpy(to, four + k, 3 * sizeof(*to));
                to += 3;
            }
    }
    g->mesh.triangle_count = (uint32_t)((size_t)(to - g->mesh.indices) / 3);
}

static void free_mesh(struct mesh *m)
{
    mem_free(m->positions);
    mem_free(m->normals);
    mem_free(m->uvs);
    mem_free(m->indices);
}

static enum err subdivide_mesh(struct mesh *m)
{
    const size_t most = (size_t)m->vertex_count + 3 * (size_t)m->triangle_count; /* no edge shared */
    struct growing g = { .mesh = *m, .edges.room = 16 };

    if (most > UINT32_MAX || m->triangle_count > UINT32_MAX / 4)
        return ERR_RANGE;
    while (g.edges.room < 6 * (size_t)m->triangle_count)
        g.edges.room *= 2;
    g.mesh.positions = mem_alloc(3 * most + 1, sizeof(float));
    g.mesh.normals = m->normals ? mem_alloc(3 * most, sizeof(float)) : NULL;
    g.mesh.uvs = m->uvs ? mem_alloc(2 * most, sizeof(float)) : NULL;
    g.mesh.indices = mem_alloc(4 * (size_t)m->triangle_count, 3 * sizeof(uint32_t));
    g.edges.key = mem_alloc(g.edges.room, sizeof(*g.edges.key));
    g.edges.middle = mem_alloc(g.edges.room, sizeof(*g.edges.middle));
    const bool enough = g.mesh.positions && (!m->normals || g.mesh.normals) && (!m->uvs || g.mesh.uvs) &&
                        g.mesh.indices && g.edges.key && g.edges.middle;
    if (enough) {
        memcpy(g.mesh.positions, m->positions, 3 * (size_t)m->vertex_count * sizeof(float));
        if (m->normals)
            memcpy(g.mesh.normals, m->normals, 3 * (size_t)m->vertex_count * sizeof(float));
        if (m->uvs)
            memcpy(g.mesh.uvs, m->uvs, 2 * (size_t)m->vertex_count * sizeof(float));
        split_all(&g, m);
    }
    mem_free(g.edges.key);
    mem_free(g.edges.middle);
    free_mesh(enough ? m : &g.mesh);
    if (enough)
        *m = g.mesh;
    return enough ? ERR_OK : ERR_NOMEM;
}

enum err subdivide(struct scene *s, int times)
{
    enum err e = ERR_OK;

    for (int k = 0; k < times; k++)
        for (size_t i = 0; i < s->mesh_count && !e; i++)
            e = subdivide_mesh(&s->meshes[i]);
    s->triangle_count = 0;
    for (size_t i = 0; i < s->mesh_count; i++)
        s->triangle_count += s->meshes[i].triangle_count;
    return e;
}
