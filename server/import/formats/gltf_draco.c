/* KHR_draco_mesh_compression: a primitive's indices and some of its attributes come from one compressed buffer view. */
#include "import/formats/gltf.h"

#include "base/mem.h"
#include "import/formats/draco_mesh.h"

struct gltf_draco {
    struct draco_mesh *mesh;
    struct gltf_at at, attributes;
    void *arrays[GLTF_DRACO_ARRAYS]; /* decompressed, for accessors */
    size_t count;
};

void primitive_draco_end(struct primitive *p)
{
    if (!p->draco)
        return;
    draco_mesh_destroy(p->draco->mesh);
    for (size_t i = 0; i < p->draco->count; i++)
        mem_free(p->draco->arrays[i]);
    mem_free(p->draco);
    p->draco = NULL;
}

enum err primitive_draco_begin(struct gltf *g, struct primitive *p)
{
    const struct gltf_at at = gltf_extension(p->at, "KHR_draco_mesh_compression");
    struct gltf_view view = { 0 };
    char why[128] = "";
    size_t index;

    if (!at.value)
        return ERR_OK;
    enum err e = gltf_index(g, &at, "bufferView", GLTF_BUFFER_VIEWS, &index);
    if (!e && index == GLTF_NONE)
        e = gltf_fault(g, &at, ERR_FORMAT, "names no bufferView");
    if (!e)
        e = gltf_view_bytes(g, index, &view);
    if (e)
        return e;
    p->draco = mem_alloc(1, sizeof(*p->draco));
    if (!p->draco)
        return ERR_NOMEM;
    p->draco->at = at;
    p->draco->attributes = gltf_key(&p->draco->at, "attributes");
    const enum draco_result r = draco_mesh_decode(view.at, view.size, &p->draco->mesh, why);
    if (r == DRACO_NO_MEMORY)
        return ERR_NOMEM;
    if (r == DRACO_DAMAGED)
        return gltf_fault(g, &at, ERR_FORMAT, "its compressed data are damaged: %s", why);
    if (draco_mesh_points(p->draco->mesh) > MESH_ELEMENTS_MAX ||
        draco_mesh_triangles(p->draco->mesh) > MESH_ELEMENTS_MAX)
        return gltf_fault(g, &at, ERR_RANGE, "has too many vertices or triangles");
    return ERR_OK;
}

static enum draco_number number_type(enum gltf_type type)
{
    switch (type) {
    case GLTF_BYTE: return DRACO_INT8;
    case GLTF_UNSIGNED_BYTE: return DRACO_UINT8;
    case GLTF_SHORT: return DRACO_INT16;
    case GLTF_UNSIGNED_SHORT: return DRACO_UINT16;
    case GLTF_UNSIGNED_INT: return DRACO_UINT32;
    case GLTF_FLOAT: break;
    }
    return DRACO_FLOAT32;
}

/* Room for an array that lasts as long as the primitive. */
static enum err add_array(struct gltf_draco *d, size_t count, size_t size, void **out)
{
    *out = d->count < GLTF_DRACO_ARRAYS ? mem_alloc_raw(count, size) : NULL;
    if (!*out)
        return ERR_NOMEM;
    d->arrays[d->count++] = *out;
    return ERR_OK;
}

static enum err read_indices(struct gltf_draco *d, struct gltf_accessor *a)
{
    void *out;

    *a = (struct gltf_accessor){ .count = 3 * draco_mesh_triangles(d->mesh), .components = 1 };
    a->elements = (struct gltf_run){ .stride = sizeof(uint32_t), .type = GLTF_UNSIGNED_INT };
    const enum err e = add_array(d, a->count, sizeof(uint32_t), &out);
    if (e)
        return e;
    draco_mesh_indices(d->mesh, out);
    a->elements.at = out;
    return ERR_OK;
}

enum err primitive_draco_accessor(struct gltf *g, const struct primitive *p, const struct gltf_at *at,
                                  struct gltf_accessor *out, bool *found)
{
    struct gltf_draco *d = p->draco;
    size_t id;
    void *array;

    *found = false;
    if (!d || (at->above != &p->attributes && at != &p->indices))
        return ERR_OK;
    if (at != &p->indices && !gltf_key(&d->attributes, at->key).value)
        return ERR_OK; /* not compressed */
    *found = true;
    if (at == &p->indices)
        return read_indices(d, out);
    enum err e = gltf_accessor_head(g, at, out);
    if (!e)
        e = gltf_size(g, &d->attributes, at->key, 0, &id);
    if (e)
        return e;
    out->count = draco_mesh_points(d->mesh);
    out->elements.stride = gltf_type_size(out->elements.type) * out->components;
    e = add_array(d, out->count, out->elements.stride, &array);
    if (!e && !draco_mesh_attribute(d->mesh, (uint32_t)id, number_type(out->elements.type), out->components, array))
        e = gltf_fault(g, &d->attributes, ERR_FORMAT, "%.40s: attribute %zu does not exist or is of another type",
                       at->key, id);
    out->elements.at = array;
    return e;
}
