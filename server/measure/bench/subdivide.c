#include "measure/bench/bench.h"

#include "base/mem.h"
#include "scene/geometry/scene.h"

#include <math.h>
#include <string.h>

/* Appends the middle of an edge. The edge's other triangle gets a vertex of its own, in the same place. */
static uint32_t add_middle(struct mesh *m, uint32_t a, uint32_t b)
{
    const size_t made = m->vertex_count++;

    for (size_t i = 0; i < 3; i++)
        m->positions[3 * made + i] = 0.5f * m->positions[3 * (size_t)a + i] + 0.5f * m->positions[3 * (size_t)b + i];
    for (size_t i = 0; m->uvs && i < 2; i++)
        m->uvs[2 * made + i] = 0.5f * (m->uvs[2 * (size_t)a + i] + m->uvs[2 * (size_t)b + i]);
    for (size_t i = 0; m->more_uvs && i < 2; i++)
        m->more_uvs[2 * made + i] = 0.5f * (m->more_uvs[2 * (size_t)a + i] + m->more_uvs[2 * (size_t)b + i]);
    for (size_t i = 0; m->colours && i < 4; i++)
        m->colours[4 * made + i] = 0.5f * (m->colours[4 * (size_t)a + i] + m->colours[4 * (size_t)b + i]);
    if (m->normals) {
        float n[3], square = 0.0f;
        for (size_t i = 0; i < 3; i++) {
            n[i] = m->normals[3 * (size_t)a + i] + m->normals[3 * (size_t)b + i];
            square += n[i] * n[i];
        }
        const float scale = square > 1e-6f ? 1.0f / sqrtf(square) : 0.0f;
        for (size_t i = 0; i < 3; i++)
            m->normals[3 * made + i] = n[i] * scale;
    }
    return (uint32_t)made;
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
static void split_all(struct mesh *m, const struct mesh *from)
{
    uint32_t *to = m->indices;

    for (size_t t = 0; t < from->triangle_count; t++) {
        const uint32_t *v = from->indices + 3 * t;
        const uint32_t ab = add_middle(m, v[0], v[1]), bc = add_middle(m, v[1], v[2]), ca = add_middle(m, v[2], v[0]);
        const uint32_t four[12] = { v[0], ab, ca, ab, v[1], bc, ca, bc, v[2], ab, bc, ca };
        for (size_t k = 0; k < 12; k += 3)
            if (has_area(m, four + k)) {
                memcpy(to, four + k, 3 * sizeof(*to));
                to += 3;
            }
    }
    m->triangle_count = (uint32_t)((size_t)(to - m->indices) / 3);
}

static void free_mesh(struct mesh *m)
{
    mem_free(m->positions);
    mem_free(m->normals);
    mem_free(m->uvs);
    mem_free(m->more_uvs);
    mem_free(m->colours);
    mem_free(m->indices);
}

static enum err subdivide_mesh(struct mesh *m)
{
    const size_t vertices = (size_t)m->vertex_count + 3 * (size_t)m->triangle_count;
    struct mesh fine = *m;

    if (vertices > UINT32_MAX || m->triangle_count > UINT32_MAX / 4)
        return ERR_RANGE;
    fine.positions = mem_alloc(3 * vertices + 1, sizeof(float));
    fine.normals = m->normals ? mem_alloc(3 * vertices, sizeof(float)) : NULL;
    fine.uvs = m->uvs ? mem_alloc(2 * vertices, sizeof(float)) : NULL;
    fine.more_uvs = m->more_uvs ? mem_alloc(2 * vertices, sizeof(float)) : NULL;
    fine.colours = m->colours ? mem_alloc(4 * vertices, sizeof(float)) : NULL;
    fine.indices = mem_alloc(4 * (size_t)m->triangle_count, 3 * sizeof(uint32_t));
    const bool enough = fine.positions && (!m->normals || fine.normals) && (!m->uvs || fine.uvs) &&
                        (!m->more_uvs || fine.more_uvs) && (!m->colours || fine.colours) && fine.indices;
    if (enough) {
        memcpy(fine.positions, m->positions, 3 * (size_t)m->vertex_count * sizeof(float));
        if (m->normals)
            memcpy(fine.normals, m->normals, 3 * (size_t)m->vertex_count * sizeof(float));
        if (m->uvs)
            memcpy(fine.uvs, m->uvs, 2 * (size_t)m->vertex_count * sizeof(float));
        if (m->more_uvs)
            memcpy(fine.more_uvs, m->more_uvs, 2 * (size_t)m->vertex_count * sizeof(float));
        if (m->colours)
            memcpy(fine.colours, m->colours, 4 * (size_t)m->vertex_count * sizeof(float));
        split_all(&fine, m);
    }
    free_mesh(enough ? m : &fine);
    if (enough)
        *m = fine;
    return enough ? ERR_OK : ERR_NOMEM;
}

/* An instance follows its source, which comes before it. */
static enum err share_again(const struct scene *s, struct mesh *m)
{
    const struct placement place = m->place;
    const uint32_t source = m->source;

    *m = s->meshes[source - 1];
    m->source = source;
    m->place = place;
    return ERR_OK;
}

enum err subdivide(struct scene *s, int times)
{
    enum err e = ERR_OK;

    for (int k = 0; k < times; k++)
        for (size_t i = 0; i < s->mesh_count && !e; i++)
            e = s->meshes[i].source ? share_again(s, &s->meshes[i]) : subdivide_mesh(&s->meshes[i]);
    s->triangle_count = 0;
    for (size_t i = 0; i < s->mesh_count; i++)
        s->triangle_count += s->meshes[i].triangle_count;
    return e;
}
