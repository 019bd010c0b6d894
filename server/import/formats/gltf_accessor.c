#include "import/formats/gltf.h"

#include <assert.h>
#include <inttypes.h>
#include <string.h>

static const struct {
    const char *name;
    size_t components;
} shapes[] = {
    { "SCALAR", 1 }, { "VEC2", 2 }, { "VEC3", 3 }, { "VEC4", 4 }, { "MAT4", 16 }, /* nothing uses MAT2 and MAT3 */
};

size_t gltf_type_size(enum gltf_type type)
{
    switch (type) {
    case GLTF_BYTE:
    case GLTF_UNSIGNED_BYTE: return 1;
    case GLTF_SHORT:
    case GLTF_UNSIGNED_SHORT: return 2;
    case GLTF_UNSIGNED_INT:
    case GLTF_FLOAT: return 4;
    }
    return 0;
}

static enum err read_type(const struct gltf *g, const struct gltf_at *at, enum gltf_type *out)
{
    size_t type;

    const enum err e = gltf_size(g, at, "componentType", 0, &type);
    if (e)
        return e;
    *out = (enum gltf_type)type;
    if (type > GLTF_FLOAT || gltf_type_size(*out) == 0)
        return gltf_fault(g, at, ERR_FORMAT, "componentType is %zu; expected 5120 to 5123, 5125 or 5126", type);
    return ERR_OK;
}

static enum err read_head(const struct gltf *g, const struct gltf_at *at, struct gltf_accessor *a)
{
    const char *shape = gltf_string(at, "type");

    for (size_t i = 0; shape && i < sizeof(shapes) / sizeof(shapes[0]); i++) {
        if (strcmp(shape, shapes[i].name) == 0)
            a->components = shapes[i].components;
    }
    if (a->components == 0)
        return gltf_fault(g, at, ERR_FORMAT, "type is '%.20s'; expected SCALAR, VEC2, VEC3, VEC4 or MAT4",
                          shape ? shape : "");
    enum err e = gltf_size(g, at, "count", 0, &a->count);
    if (!e)
        e = read_type(g, at, &a->elements.type);
    if (!e && (a->count < 1 || a->count > MESH_ELEMENTS_MAX))
        e = gltf_fault(g, at, ERR_RANGE, "count is %zu, not within 1 to %" PRIu32, a->count, MESH_ELEMENTS_MAX);
    a->normalized = json_is_true(json_object_get(at->value, "normalized"));
    return e;
}

/* Finds `count` elements of `size` bytes in the view that at.bufferView names. */
static enum err read_run(struct gltf *g, const struct gltf_at *at, size_t count, size_t size, struct gltf_run *out)
{
    struct gltf_view v = { 0 };
    size_t index, offset;

    enum err e = gltf_index(g, at, "bufferView", GLTF_BUFFER_VIEWS, &index);
    if (e || index == GLTF_NONE)
        return e;
    e = gltf_size(g, at, "byteOffset", 0, &offset);
    if (!e)
        e = gltf_view_bytes(g, index, &v);
    if (e)
        return e;
    out->stride = v.stride ? v.stride : size;
    if (offset > v.size || v.size - offset < size || (count - 1) > (v.size - offset - size) / out->stride)
        return gltf_fault(g, at, ERR_FORMAT,
                          "%zu elements of %zu bytes at steps of %zu from byte %zu on end beyond bufferViews[%zu], "
                          "which has %zu bytes",
                          count, size, out->stride, offset, index, v.size);
    out->at = v.at + offset;
    return ERR_OK;
}

static uint32_t read_integer(const struct gltf_run *r, size_t i)
{
    const uint8_t *at = r->at + i * r->stride;
    uint16_t two;
    uint32_t four;

    switch (r->type) {
    case GLTF_UNSIGNED_BYTE: return *at;
    case GLTF_UNSIGNED_SHORT: memcpy(&two, at, sizeof(two)); return two;
    case GLTF_UNSIGNED_INT: memcpy(&four, at, sizeof(four)); return four;
    default: return 0;
    }
}

static bool is_unsigned(enum gltf_type type)
{
    return type == GLTF_UNSIGNED_BYTE || type == GLTF_UNSIGNED_SHORT || type == GLTF_UNSIGNED_INT;
}

/* The replaced elements must be in order, so that a range of them is found quickly. */
static enum err read_sparse(struct gltf *g, const struct gltf_at *at, struct gltf_accessor *a)
{
    const struct gltf_at sparse = gltf_key(at, "sparse");
    const struct gltf_at indices = gltf_key(&sparse, "indices"), values = gltf_key(&sparse, "values");
    uint32_t before = 0;

    if (!sparse.value)
        return ERR_OK;
    enum err e = gltf_size(g, &sparse, "count", 0, &a->sparse_count);
    if (!e && (a->sparse_count < 1 || a->sparse_count > a->count))
        e = gltf_fault(g, &sparse, ERR_FORMAT, "count is %zu, not within 1 to %zu", a->sparse_count, a->count);
    if (!e)
        e = read_type(g, &indices, &a->sparse_indices.type);
    if (!e && !is_unsigned(a->sparse_indices.type))
        e = gltf_fault(g, &indices, ERR_FORMAT, "componentType is not an unsigned integer");
    if (!e)
        e = read_run(g, &indices, a->sparse_count, gltf_type_size(a->sparse_indices.type), &a->sparse_indices);
    a->sparse_values.type = a->elements.type;
    if (!e)
        e = read_run(g, &values, a->sparse_count, gltf_type_size(a->elements.type) * a->components, &a->sparse_values);
    if (!e && (!a->sparse_indices.at || !a->sparse_values.at))
        e = gltf_fault(g, &sparse, ERR_FORMAT, "indices or values name no bufferView");
    for (size_t i = 0; i < a->sparse_count && !e; i++) {
        const uint32_t index = read_integer(&a->sparse_indices, i);
        if (index >= a->count || (i > 0 && index <= before))
            e = gltf_fault(g, &indices, ERR_FORMAT, "number %zu is %" PRIu32 ": not increasing or not below %zu", i,
                           index, a->count);
        before = index;
    }
    return e;
}

enum err gltf_accessor_head(struct gltf *g, const struct gltf_at *at, struct gltf_accessor *out)
{
    *out = (struct gltf_accessor){ 0 };
    const enum err e = gltf_index_of(g, at, GLTF_ACCESSORS, &out->index);
    if (e)
        return e;
    const struct gltf_at accessor = gltf_element(g, GLTF_ACCESSORS, out->index);
    return read_head(g, &accessor, out);
}

enum err gltf_accessor_open(struct gltf *g, const struct gltf_at *at, struct gltf_accessor *out)
{
    enum err e = gltf_accessor_head(g, at, out);
    if (e)
        return e;
    const struct gltf_at accessor = gltf_element(g, GLTF_ACCESSORS, out->index);
    e = read_run(g, &accessor, out->count, gltf_type_size(out->elements.type) * out->components, &out->elements);
    return e ? e : read_sparse(g, &accessor, out);
}

enum err gltf_accessor_width(const struct gltf *g, const struct gltf_at *at, size_t least, size_t most,
                             const struct gltf_accessor *a)
{
    if (a->components < least || a->components > most)
        return gltf_fault(g, at, ERR_FORMAT, "accessors[%zu] has %zu components; expected %zu", a->index, a->components,
                          least);
    return ERR_OK;
}

enum err gltf_accessor_vector(struct gltf *g, const struct gltf_at *at, size_t least, size_t most,
                              struct gltf_accessor *out)
{
    const enum err e = gltf_accessor_open(g, at, out);
    return e ? e : gltf_accessor_width(g, at, least, most, out);
}

/* A component as a number [glTF 2.0, section 3.11]. */
static float component(const uint8_t *at, enum gltf_type type, bool normalized)
{
    int16_t s;
    uint16_t us;
    uint32_t ui;
    float f;

    switch (type) {
    case GLTF_BYTE: f = (float)(int8_t)*at; return !normalized ? f : f < -127.0f ? -1.0f : f / 127.0f;
    case GLTF_UNSIGNED_BYTE: return normalized ? (float)*at / 255.0f : (float)*at;
    case GLTF_SHORT:
        memcpy(&s, at, sizeof(s));
        return !normalized ? (float)s : s < -32767 ? -1.0f : (float)s / 32767.0f;
    case GLTF_UNSIGNED_SHORT: memcpy(&us, at, sizeof(us)); return normalized ? (float)us / 65535.0f : (float)us;
    case GLTF_UNSIGNED_INT: memcpy(&ui, at, sizeof(ui)); return (float)ui;
    case GLTF_FLOAT: memcpy(&f, at, sizeof(f)); return f;
    }
    return 0.0f;
}

static void put_element(const struct gltf_accessor *a, const struct gltf_run *r, size_t i, size_t width, float *out)
{
    const size_t size = gltf_type_size(r->type), n = width < a->components ? width : a->components;

    for (size_t k = 0; k < n; k++)
        out[k] = r->at ? component(r->at + i * r->stride + k * size, r->type, a->normalized) : 0.0f;
}

void gltf_accessor_floats(const struct gltf_accessor *a, size_t first, size_t count, size_t width, float *out)
{
    assert(first <= a->count && count <= a->count - first);
    for (size_t i = 0; i < count; i++)
        put_element(a, &a->elements, first + i, width, out + i * width);
    for (size_t i = 0; i < a->sparse_count; i++) {
        const uint32_t index = read_integer(&a->sparse_indices, i);
        if (index >= first && index - first < count)
            put_element(a, &a->sparse_values, i, width, out + (index - first) * width);
    }
}

enum err gltf_accessor_indices(const struct gltf *g, const struct gltf_at *at, const struct gltf_accessor *a,
                               uint32_t *out)
{
    if (a->components != 1 || !is_unsigned(a->elements.type))
        return gltf_fault(g, at, ERR_FORMAT, "accessors[%zu] does not hold unsigned integers", a->index);
    for (size_t i = 0; i < a->count; i++)
        out[i] = a->elements.at ? read_integer(&a->elements, i) : 0;
    for (size_t i = 0; i < a->sparse_count; i++) {
        struct gltf_run r = a->sparse_values;
        out[read_integer(&a->sparse_indices, i)] = read_integer(&r, i);
    }
    return ERR_OK;
}
