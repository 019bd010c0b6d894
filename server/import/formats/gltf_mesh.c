/* Primitives of glTF as meshes. */
#include "import/formats/gltf.h"

#include "base/mem.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum mode { /* of a primitive; below are points and lines */
            MODE_TRIANGLES = 4,
            MODE_STRIP,
            MODE_FAN,
};

/* ---- Triangles ---- */

static size_t count_triangles(size_t mode, size_t corners)
{
    if (mode == MODE_TRIANGLES)
        return corners / 3;
    return corners < 3 ? 0 : corners - 2;
}

/* Triangle i of a strip or fan, counter-clockwise; false: two corners are the same, which strips use as a joint. */
static bool spread_triangle(size_t mode, const uint32_t *corners, size_t i, uint32_t t[3])
{
    t[0] = corners[mode == MODE_FAN ? 0 : i];
    t[1] = corners[i + (mode == MODE_STRIP && i % 2 ? 2 : 1)];
    t[2] = corners[i + (mode == MODE_STRIP && i % 2 ? 1 : 2)];
    return t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
}

static enum err spread(size_t mode, uint32_t **corners, struct mesh *m)
{
    uint32_t kept = 0;

    if (mode == MODE_TRIANGLES) {
        m->indices = *corners;
        *corners = NULL;
        return ERR_OK;
    }
    m->indices = mem_alloc_raw(m->triangle_count, 3 * sizeof(*m->indices));
    if (!m->indices)
        return ERR_NOMEM;
    for (size_t i = 0; i < m->triangle_count; i++)
        kept += spread_triangle(mode, *corners, i, m->indices + 3 * (size_t)kept);
    m->triangle_count = kept;
    return ERR_OK;
}

/* Primitives often share vertices of which each uses a range: only that range is read. */
static enum err find_range(struct gltf *g, struct primitive *p, const uint32_t *corners, size_t count)
{
    uint32_t low = UINT32_MAX, high = 0;

    for (size_t i = 0; i < count; i++) {
        low = corners[i] < low ? corners[i] : low;
        high = corners[i] > high ? corners[i] : high;
    }
    if (high >= p->positions.count)
        return gltf_fault(g, &p->indices, ERR_FORMAT, "refers to vertex %" PRIu32 " of %zu", high, p->positions.count);
    p->first = low;
    p->count = (size_t)high - low + 1;
    return ERR_OK;
}

static enum err read_corners(struct gltf *g, struct primitive *p, uint32_t **out, size_t *count)
{
    struct gltf_accessor a = { .count = p->positions.count };

    const bool listed = p->indices.value || p->draco;

    enum err e = listed ? primitive_accessor(g, p, &p->indices, 1, 1, &a) : ERR_OK;
    if (e)
        return e;
    *count = a.count;
    *out = mem_alloc_raw(a.count, sizeof(**out));
    if (!*out)
        return ERR_NOMEM;
    if (listed)
        return gltf_accessor_indices(g, &p->indices, &a, *out);
    for (size_t i = 0; i < a.count; i++)
        (*out)[i] = (uint32_t)i;
    return ERR_OK;
}

static enum err read_triangles(struct gltf *g, struct primitive *p, size_t mode, struct mesh *m)
{
    uint32_t *corners = NULL;
    size_t count = 0;

    enum err e = read_corners(g, p, &corners, &count);
    const size_t triangles = count_triangles(mode, count);
    m->triangle_count = (uint32_t)triangles; /* below MESH_ELEMENTS_MAX, as all counts are */
    if (!e && triangles > 0)
        e = find_range(g, p, corners, count);
    if (!e && triangles > 0)
        e = spread(mode, &corners, m);
    for (size_t i = 0; i < 3 * (size_t)m->triangle_count && !e; i++)
        m->indices[i] -= (uint32_t)p->first;
    mem_free(corners);
    return e;
}

/* ---- Vertices ---- */

enum err primitive_accessor(struct gltf *g, const struct primitive *p, const struct gltf_at *at, size_t least,
                            size_t most, struct gltf_accessor *out)
{
    bool found;

    const enum err e = primitive_draco_accessor(g, p, at, out, &found);
    if (e || !found)
        return e ? e : gltf_accessor_vector(g, at, least, most, out);
    return gltf_accessor_width(g, at, least, most, out);
}

enum err primitive_attribute(struct gltf *g, const struct primitive *p, const struct gltf_at *at, size_t least,
                             size_t most, struct gltf_accessor *out)
{
    const enum err e = primitive_accessor(g, p, at, least, most, out);

    if (!e && out->count < p->positions.count)
        return gltf_fault(g, at, ERR_FORMAT, "accessors[%zu] has %zu elements for %zu vertices", out->index, out->count,
                          p->positions.count);
    return e;
}

static enum err read_floats(struct gltf *g, const struct primitive *p, const struct gltf_at *at, size_t width,
                            float **out)
{
    struct gltf_accessor a;

    const enum err e = primitive_attribute(g, p, at, width, width, &a);
    if (e)
        return e;
    *out = mem_alloc_raw(width * p->count + 1, sizeof(**out)); /* one more, see struct mesh */
    if (!*out)
        return ERR_NOMEM;
    (*out)[width * p->count] = 0.0f;
    gltf_accessor_floats(&a, p->first, p->count, width, *out);
    return ERR_OK;
}

static enum err read_uvs(struct gltf *g, const struct primitive *p, const struct gltf_surface *surface, float **out)
{
    const double *t = surface->transform;
    char name[32];

    if (surface->uv_set == GLTF_NONE)
        return ERR_OK;
    snprintf(name, sizeof(name), "TEXCOORD_%zu", surface->uv_set);
    const struct gltf_at at = gltf_key(&p->attributes, name);
    const enum err e = at.value ? read_floats(g, p, &at, 2, out) : ERR_OK;
    for (size_t i = 0; i < p->count && !e && *out; i++) {
        float *uv = *out + 2 * i;
        const double u = uv[0], v = uv[1];
        uv[0] = (float)(t[0] * u + t[1] * v + t[2]);
        uv[1] = 1.0f - (float)(t[3] * u + t[4] * v + t[5]);
    }
    return e;
}

/* TANGENT, where a normal map wants it and the vertices stay where the file has them. */
static enum err read_tangents(struct gltf *g, const struct primitive *p, struct mesh *m)
{
    const struct gltf_at at = gltf_key(&p->attributes, "TANGENT"), targets = gltf_key(p->at, "targets");

    if (!(g->scene->materials[m->material].maps & MAP_NORMAL) || !m->normals || !at.value || targets.value ||
        p->skin->count > 0)
        return ERR_OK;
    const enum err e = read_floats(g, p, &at, 4, &m->tangents);
    for (size_t i = 3; i < 4 * p->count && !e; i += 4)
        m->tangents[i] = m->tangents[i] < 0.0f ? -1.0f : 1.0f;
    return e;
}

/* COLOR_0, which multiplies the base colour and its alpha; three components: the alpha is 1. */
static enum err read_colours(struct gltf *g, const struct primitive *p, struct mesh *m)
{
    const struct gltf_at at = gltf_key(&p->attributes, "COLOR_0");
    struct gltf_accessor a;

    if (!at.value)
        return ERR_OK;
    const enum err e = primitive_attribute(g, p, &at, 3, 4, &a);
    if (e)
        return e;
    m->colours = mem_alloc_raw(p->count, 4 * sizeof(*m->colours));
    if (!m->colours)
        return ERR_NOMEM;
    gltf_accessor_floats(&a, p->first, p->count, a.components, m->colours);
    for (size_t i = p->count; i-- > 0 && a.components == 3;) {
        memmove(m->colours + 4 * i, m->colours + 3 * i, 3 * sizeof(*m->colours));
        m->colours[4 * i + 3] = 1.0f;
    }
    for (size_t i = 0; i < 4 * p->count; i++)
        m->colours[i] = m->colours[i] > 0.0f ? fminf(m->colours[i], 1.0f) : 0.0f; /* NaN becomes 0 */
    return ERR_OK;
}

/* The material, and how it wants its two sets of texture coordinates; NULL: it wants none. */
static enum err find_material(struct gltf *g, const struct primitive *p, struct mesh *m,
                              const struct gltf_surface **surface)
{
    size_t index;

    *surface = NULL;
    m->material = g->desc->material;
    if (m->material != MATERIAL_NONE)
        return ERR_OK;
    const enum err e = gltf_index(g, p->at, "material", GLTF_MATERIALS, &index);
    if (e || index == GLTF_NONE)
        return e ? e : gltf_plain_material(g, &m->material);
    m->material = g->first_material + (uint32_t)index;
    *surface = g->surfaces[index];
    return ERR_OK;
}

static enum err read_vertices(struct gltf *g, const struct primitive *p, struct mesh *m)
{
    const struct gltf_at position = gltf_key(&p->attributes, "POSITION");
    const struct gltf_at normal = gltf_key(&p->attributes, "NORMAL");
    const struct gltf_surface *surface;

    m->vertex_count = (uint32_t)p->count;
    enum err e = find_material(g, p, m, &surface);
    if (!e)
        e = read_floats(g, p, &position, 3, &m->positions);
    if (!e && normal.value && g->desc->normals != NORMALS_FLAT)
        e = read_floats(g, p, &normal, 3, &m->normals);
    if (!e && surface)
        e = read_uvs(g, p, &surface[0], &m->uvs);
    if (!e && surface)
        e = read_uvs(g, p, &surface[1], &m->more_uvs);
    if (!e && (g->scene->materials[m->material].second & MAP_NORMAL ? m->more_uvs : m->uvs))
        e = read_tangents(g, p, m);
    if (!e && g->desc->material == MATERIAL_NONE)
        e = read_colours(g, p, m);
    return e ? e : primitive_deform(g, p, m);
}

/* ---- Transforms ---- */

void gltf_transform_point(const double m[16], float p[3])
{
    const double x = p[0], y = p[1], z = p[2];

    for (int row = 0; row < 3; row++)
        p[row] = (float)(m[row] * x + m[4 + row] * y + m[8 + row] * z + m[12 + row]);
}

void gltf_transform_normal(const double c[9], double side, float n[3])
{
    double v[3];

    for (int row = 0; row < 3; row++)
        v[row] = side * (c[row] * n[0] + c[3 + row] * n[1] + c[6 + row] * n[2]);
    const double length = sqrt(dot3(v, v));
    const double scale = isfinite(length) && length > 0.0 ? 1.0 / length : 0.0;
    for (int row = 0; row < 3; row++)
        n[row] = scale > 0.0 ? (float)(v[row] * scale) : 0.0f;
}

void mesh_turn_over(struct mesh *m)
{
    for (size_t i = 0; i < m->triangle_count; i++) {
        uint32_t *t = m->indices + 3 * i;
        const uint32_t second = t[1];
        t[1] = t[2];
        t[2] = second;
    }
}

/* Takes over nothing. */
static enum err read_primitive(struct gltf *g, struct primitive *p, size_t mode, struct mesh *m)
{
    const struct gltf_at position = gltf_key(&p->attributes, "POSITION");

    enum err e = primitive_draco_begin(g, p);
    if (!e)
        e = primitive_accessor(g, p, &position, 3, 3, &p->positions);
    if (!e)
        e = read_triangles(g, p, p->draco ? MODE_TRIANGLES : mode, m);
    return e || m->triangle_count == 0 ? e : read_vertices(g, p, m);
}

/* The node's name, else the mesh's. */
static void name_mesh(const struct primitive *p, char out[sizeof(((struct mesh *)NULL)->name)])
{
    const char *node = gltf_string(p->node, "name"), *own = gltf_string(p->mesh, "name");

    snprintf(out, sizeof(((struct mesh *)NULL)->name), "%.63s", node && node[0] ? node : own ? own : "");
}

static enum err add_primitive(struct gltf *g, struct primitive *p, const struct places *places,
                              const struct sharing *with)
{
    struct mesh m = { .name = "" };
    size_t mode;

    enum err e = gltf_size(g, p->at, "mode", MODE_TRIANGLES, &mode);
    if (!e && mode > MODE_FAN)
        e = gltf_fault(g, p->at, ERR_FORMAT, "mode is %zu, not within 0 to 6", mode);
    if (e || !gltf_key(&p->attributes, "POSITION").value)
        return e; /* without positions it shows nothing */
    if (mode < MODE_TRIANGLES) {
        if (!g->uses[p->mesh->index].skipped)
            gltf_note(&g->skipped, p->mesh->index);
        g->uses[p->mesh->index].skipped = true;
        return ERR_OK;
    }
    name_mesh(p, m.name);
    e = read_primitive(g, p, mode, &m);
    primitive_draco_end(p);
    if (!e && m.triangle_count > 0)
        return place_all(g, &m, places, with);
    mesh_finish(&m);
    return e;
}

enum err gltf_add_mesh(struct gltf *g, size_t mesh, const struct gltf_at *node, const double world[16])
{
    static const double identity[16] = { [0] = 1.0, [5] = 1.0, [10] = 1.0, [15] = 1.0 };
    const struct gltf_at at = gltf_element(g, GLTF_MESHES, mesh), list = gltf_key(&at, "primitives");
    struct places places = { 0 };
    char name[sizeof(((struct mesh *)NULL)->name)];
    struct sharing with;
    struct skin skin = { 0 };

    enum err e = skin_load(g, node, &skin);
    if (!e) /* joints place a skin; the node does not */
        e = places_load(g, node, skin.count > 0 ? identity : world, &places);
    for (size_t i = 0; i < json_array_size(list.value) && !e; i++) {
        const struct gltf_at item = gltf_item(&list, i);
        struct primitive p = { .at = &item, .mesh = &at, .node = node, .skin = &skin };
        p.attributes = gltf_key(&item, "attributes");
        p.indices = gltf_key(&item, "indices");
        name_mesh(&p, name);
        e = sharing_find(g, mesh, node, i, &with);
        if (!e && with.slot && *with.slot)
            e = place_again(g, *with.slot - 1, name, &places);
        else if (!e)
            e = add_primitive(g, &p, &places, &with);
    }
    places_finish(&places);
    mem_free(skin.matrices);
    return e;
}
