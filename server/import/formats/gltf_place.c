/* Places meshes in the world, as copies or as instances that share arrays. */
#include "import/formats/gltf.h"

#include "base/mem.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* A direction in the surface; it becomes unit, or 0. */
static void transform_tangent(const double m[16], double side, float t[4])
{
    double v[3];

    for (int row = 0; row < 3; row++)
        v[row] = m[row] * t[0] + m[4 + row] * t[1] + m[8 + row] * t[2];
    const double length = sqrt(dot3(v, v));
    const double scale = isfinite(length) && length > 0.0 ? 1.0 / length : 0.0;
    for (int row = 0; row < 3; row++)
        t[row] = scale > 0.0 ? (float)(v[row] * scale) : 0.0f;
    t[3] *= (float)side;
}

/* A reflection turns triangles inside out: the winding is restored. */
static void transform(struct mesh *m, const double matrix[16])
{
    double c[9];
    const double side = matrix_cofactors(matrix, c) < 0.0 ? -1.0 : 1.0;

    for (size_t i = 0; i < m->vertex_count; i++) {
        gltf_transform_point(matrix, m->positions + 3 * i);
        if (m->normals)
            gltf_transform_normal(c, side, m->normals + 3 * i);
        if (m->tangents)
            transform_tangent(matrix, side, m->tangents + 4 * i);
    }
    if (side < 0.0)
        mesh_turn_over(m);
}

/* Makes a mesh ready to be added: without degenerate triangles, with what its material needs. */
static enum err complete(struct gltf *g, struct mesh *m)
{
    const struct material *material = &g->scene->materials[m->material];

    g->dropped += mesh_drop_degenerate(m);
    enum err e = mesh_join_vertices(m);
    if (!e && g->desc->normals == NORMALS_SMOOTH && !m->normals)
        e = mesh_make_normals(m);
    if (!e && !m->tangents && (material->maps & MAP_NORMAL))
        e = mesh_make_tangents(m, material->second & MAP_NORMAL);
    return e;
}

/* Takes over the arrays of *m, also on error. */
static enum err place(struct gltf *g, struct mesh *m, const double matrix[16])
{
    transform(m, matrix);
    enum err e = complete(g, m);
    if (!e && m->triangle_count > 0)
        e = scene_add_mesh(g->scene, m);
    else
        mesh_finish(m);
    if (e)
        mesh_finish(m);
    return e;
}

static void *copy_of(const void *array, size_t count, size_t size)
{
    void *out = array ? mem_alloc_raw(count, size) : NULL;

    if (out)
        memcpy(out, array, count * size);
    return out;
}

static enum err copy_mesh(const struct mesh *m, struct mesh *out)
{
    const size_t n = m->vertex_count;

    *out = *m;
    out->positions = copy_of(m->positions, 3 * n + 1, sizeof(float));
    out->normals = copy_of(m->normals, 3 * n, sizeof(float));
    out->uvs = copy_of(m->uvs, 2 * n, sizeof(float));
    out->more_uvs = copy_of(m->more_uvs, 2 * n, sizeof(float));
    out->tangents = copy_of(m->tangents, 4 * n, sizeof(float));
    out->colours = copy_of(m->colours, 4 * n, sizeof(float));
    out->indices = copy_of(m->indices, m->triangle_count, 3 * sizeof(uint32_t));
    if (out->positions && (out->normals || !m->normals) && (out->uvs || !m->uvs) && (out->more_uvs || !m->more_uvs) &&
        (out->tangents || !m->tangents) && (out->colours || !m->colours) && out->indices)
        return ERR_OK;
    mesh_finish(out);
    return ERR_NOMEM;
}

static enum err place_copy(struct gltf *g, const struct mesh *m, const double matrix[16])
{
    struct mesh copy;

    const enum err e = copy_mesh(m, &copy);
    return e ? e : place(g, &copy, matrix);
}

/* One copy per place; takes over the arrays of *m, also on error. */
static enum err place_copies(struct gltf *g, struct mesh *m, const struct places *places)
{
    enum err e = places->count > 1 ? mesh_join_vertices(m) : ERR_OK;

    for (size_t i = 0; i + 1 < places->count && !e; i++)
        e = place_copy(g, m, places->matrices[i]);
    if (!e && places->count > 0)
        return place(g, m, places->matrices[places->count - 1]);
    mesh_finish(m);
    return e;
}

/* A mesh where mesh_place refuses it becomes a copy. */
static enum err place_instance(struct gltf *g, uint32_t mesh, const char *name, const double matrix[16])
{
    float rows[3][4];

    matrix_rows(matrix, rows);
    const enum err e = scene_add_instance(g->scene, mesh, name, (const float(*)[4])rows);
    if (e != ERR_RANGE)
        return e;
    struct mesh own = g->scene->meshes[mesh];
    own.source = 0;
    own.placed = false;
    snprintf(own.name, sizeof(own.name), "%.63s", name);
    return place_copy(g, &own, matrix);
}

enum err place_again(struct gltf *g, uint32_t mesh, const char *name, const struct places *places)
{
    enum err e = ERR_OK;

    for (size_t i = 0; i < places->count && !e; i++)
        e = place_instance(g, mesh, name, places->matrices[i]);
    return e;
}

/* The first place that suits gets the arrays; takes them over, also on error. */
static enum err place_shared(struct gltf *g, struct mesh *m, const struct places *places, uint32_t *slot)
{
    float rows[3][4];
    size_t i = 0;

    enum err e = complete(g, m);
    for (; i < places->count && *slot == 0 && m->triangle_count > 0 && !e; i++) {
        matrix_rows(places->matrices[i], rows);
        e = mesh_place(m, (const float(*)[4])rows);
        if (e == ERR_RANGE) {
            e = place_copy(g, m, places->matrices[i]);
        } else if (!e) {
            e = scene_add_mesh(g->scene, m);
            *slot = e ? 0 : (uint32_t)g->scene->mesh_count;
        }
    }
    if (*slot == 0)
        mesh_finish(m);
    for (; i < places->count && !e; i++)
        e = place_instance(g, *slot - 1, m->name, places->matrices[i]);
    return e;
}

enum err place_all(struct gltf *g, struct mesh *m, const struct places *places, const struct sharing *with)
{
    if (with->slot && instances_pay(with->uses, m->triangle_count))
        return place_shared(g, m, places, with->slot);
    return place_copies(g, m, places);
}
