/* Collects the placements of a mesh: its nodes, and EXT_mesh_gpu_instancing. */
#include "import/formats/gltf.h"

#include "base/mem.h"

#include <string.h>

enum { TRANSLATION, ROTATION, SCALE, PARTS };

static const struct {
    const char *key;
    size_t width;
    double fallback[4];
} parts[PARTS] = {
    [TRANSLATION] = { "TRANSLATION", 3, { 0.0 } },
    [ROTATION] = { "ROTATION", 4, { 0.0, 0.0, 0.0, 1.0 } },
    [SCALE] = { "SCALE", 3, { 1.0, 1.0, 1.0 } },
};

void places_finish(struct places *p)
{
    mem_free(p->matrices);
    *p = (struct places){ 0 };
}

static enum err allocate(struct places *p, size_t count)
{
    p->matrices = mem_alloc(count, sizeof(*p->matrices));
    p->count = count;
    return p->matrices ? ERR_OK : ERR_NOMEM;
}

static enum err open_parts(struct gltf *g, const struct gltf_at *attributes, struct gltf_accessor accessors[PARTS],
                           size_t *count)
{
    enum err e = ERR_OK;

    *count = 0;
    for (int i = 0; i < PARTS && !e; i++) {
        const struct gltf_at at = gltf_key(attributes, parts[i].key);
        if (!at.value)
            continue;
        e = gltf_accessor_vector(g, &at, parts[i].width, parts[i].width, &accessors[i]);
        if (!e && *count > 0 && accessors[i].count != *count)
            e = gltf_fault(g, &at, ERR_FORMAT, "has %zu elements for %zu instances", accessors[i].count, *count);
        *count = accessors[i].count;
    }
    if (!e && *count == 0)
        e = gltf_fault(g, attributes, ERR_FORMAT, "has neither TRANSLATION nor ROTATION nor SCALE");
    return e;
}

static enum err read_parts(const struct gltf_accessor accessors[PARTS], size_t count, float *numbers[PARTS])
{
    for (int i = 0; i < PARTS; i++) {
        if (accessors[i].count == 0)
            continue;
        numbers[i] = mem_alloc_raw(count, parts[i].width * sizeof(float));
        if (!numbers[i])
            return ERR_NOMEM;
        gltf_accessor_floats(&accessors[i], 0, count, parts[i].width, numbers[i]);
    }
    return ERR_OK;
}

static void compose(float *const numbers[PARTS], size_t i, const double world[16], double out[16])
{
    double v[PARTS][4], local[16];

    for (int k = 0; k < PARTS; k++) {
        memcpy(v[k], parts[k].fallback, sizeof(v[k]));
        for (size_t n = 0; numbers[k] && n < parts[k].width; n++)
            v[k][n] = numbers[k][parts[k].width * i + n];
    }
    gltf_compose(v[TRANSLATION], v[ROTATION], v[SCALE], local);
    matrix_multiply(world, local, out);
}

enum err places_load(struct gltf *g, const struct gltf_at *node, const double world[16], struct places *out)
{
    const struct gltf_at at = gltf_extension(node, "EXT_mesh_gpu_instancing");
    const struct gltf_at attributes = gltf_key(&at, "attributes");
    struct gltf_accessor accessors[PARTS] = { 0 };
    float *numbers[PARTS] = { NULL };
    size_t count = 1;
    enum err e = ERR_OK;

    if (at.value)
        e = open_parts(g, &attributes, accessors, &count);
    if (!e)
        e = read_parts(accessors, count, numbers);
    if (!e)
        e = allocate(out, count);
    for (size_t i = 0; i < count && !e; i++)
        compose(numbers, i, world, out->matrices[i]);
    for (int k = 0; k < PARTS; k++)
        mem_free(numbers[k]);
    return e;
}

/* ---- Sharing between the places of a mesh ---- */

/* A skin's joints and the weights of a node deform the mesh for this node alone. */
static bool may_share(const struct gltf_at *node)
{
    return !json_object_get(node->value, "skin") && !json_object_get(node->value, "weights");
}

/* The number of places, as places_load will find it, or a guess for what it will refuse. */
static double count_places(const struct gltf *g, const struct gltf_at *node)
{
    const struct gltf_at at = gltf_extension(node, "EXT_mesh_gpu_instancing");
    const json_t *attributes = json_object_get(at.value, "attributes");

    for (int i = 0; i < PARTS; i++) {
        const json_t *index = json_object_get(attributes, parts[i].key);
        const json_t *accessor = json_array_get(g->lists[GLTF_ACCESSORS].value, (size_t)json_integer_value(index));
        if (index && accessor)
            return json_number_value(json_object_get(accessor, "count"));
    }
    return 1.0;
}

void gltf_count_uses(struct gltf *g, size_t node, double copies)
{
    const struct gltf_at at = gltf_element(g, GLTF_NODES, node);
    const json_t *mesh = json_object_get(at.value, "mesh");
    const json_int_t index = json_integer_value(mesh);

    if (json_is_integer(mesh) && index >= 0 && (size_t)index < g->counts[GLTF_MESHES] && may_share(&at))
        g->uses[index].count += copies * count_places(g, &at);
}

enum err sharing_find(struct gltf *g, size_t mesh, const struct gltf_at *node, size_t primitive, struct sharing *out)
{
    struct gltf_use *use = &g->uses[mesh];
    const struct gltf_at at = gltf_element(g, GLTF_MESHES, mesh), list = gltf_key(&at, "primitives");
    const size_t count = json_array_size(list.value);

    *out = (struct sharing){ 0 };
    if (use->count < 2.0 || !may_share(node))
        return ERR_OK;
    if (!use->shared)
        use->shared = mem_alloc(count, sizeof(*use->shared));
    if (!use->shared)
        return ERR_NOMEM;
    *out = (struct sharing){ use->count, &use->shared[primitive] };
    return ERR_OK;
}
