/* EXT_mesh_gpu_instancing: copies of a mesh. Each is a mesh of its own in the scene. */
#include "import/gltf_mesh.h"

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
