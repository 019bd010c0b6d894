/* EXT_meshopt_compression, and KHR_meshopt_compression with version 0 of its vertex codec, through libmeshoptimizer. */
#include "import/formats/gltf.h"

#include "base/mem.h"

#include <meshoptimizer.h>
#include <string.h>

#define STRIDE_MAX 256        /* bytes of a vertex */
#define FILTER_GROUP 4        /* the filters may write whole groups of elements */
#define VERTEX_VERSION_1 0xa1 /* first byte of version 1 of the vertex codec */
#define ADVICE "repack it with 'gltfpack -i IN -o OUT', or decompress it with 'gltf-transform copy IN OUT'"

struct packed { /* a buffer view, compressed */
    struct gltf_at at;
    const uint8_t *bytes;
    size_t size, count, stride;
    const char *mode, *filter;
};

struct gltf_at gltf_meshopt(const struct gltf_at *view)
{
    const struct gltf_at ext = gltf_extension(view, "EXT_meshopt_compression");
    return ext.value ? ext : gltf_extension(view, "KHR_meshopt_compression");
}

static enum err find_bytes(struct gltf *g, struct packed *p)
{
    const uint8_t *buffer = NULL;
    size_t index, whole = 0, offset = 0;

    enum err e = gltf_index(g, &p->at, "buffer", GLTF_BUFFERS, &index);
    if (!e && index == GLTF_NONE)
        e = gltf_fault(g, &p->at, ERR_FORMAT, "names no buffer");
    if (!e)
        e = gltf_buffer_bytes(g, index, &buffer, &whole);
    if (!e)
        e = gltf_size(g, &p->at, "byteOffset", 0, &offset);
    if (!e)
        e = gltf_size(g, &p->at, "byteLength", 0, &p->size);
    if (!e && (offset > whole || p->size > whole - offset))
        e = gltf_fault(g, &p->at, ERR_FORMAT, "ends at byte %zu of buffers[%zu], which has %zu", offset + p->size,
                       index, whole);
    if (!e)
        p->bytes = buffer + offset;
    return e;
}

static bool is(const char *text, const char *what)
{
    return strcmp(text, what) == 0;
}

/* The library takes these on trust. */
static enum err check(struct gltf *g, const struct packed *p)
{
    const bool attributes = is(p->mode, "ATTRIBUTES"), triangles = is(p->mode, "TRIANGLES");

    if (!attributes && !triangles && !is(p->mode, "INDICES"))
        return gltf_fault(g, &p->at, ERR_FORMAT, "mode is '%.20s'; expected ATTRIBUTES, TRIANGLES or INDICES", p->mode);
    if (p->count < 1 || p->count > MESH_ELEMENTS_MAX || (triangles && p->count % 3 != 0))
        return gltf_fault(g, &p->at, ERR_RANGE, "count is %zu", p->count);
    if (attributes ? p->stride < 4 || p->stride > STRIDE_MAX || p->stride % 4 != 0 : p->stride != 2 && p->stride != 4)
        return gltf_fault(g, &p->at, ERR_RANGE, "byteStride is %zu", p->stride);
    if (!attributes && !is(p->filter, "NONE"))
        return gltf_fault(g, &p->at, ERR_FORMAT, "has a filter, but mode is not ATTRIBUTES");
    if ((is(p->filter, "OCTAHEDRAL") && p->stride != 4 && p->stride != 8) ||
        (is(p->filter, "QUATERNION") && p->stride != 8))
        return gltf_fault(g, &p->at, ERR_FORMAT, "byteStride is %zu, which does not suit its filter", p->stride);
    if (attributes && p->size > 0 && p->bytes[0] == VERTEX_VERSION_1)
        return gltf_fault(g, &p->at, ERR_UNSUPPORTED, "uses version 1 of the vertex codec, which is not supported; %s",
                          ADVICE);
    return ERR_OK;
}

static int decode(const struct packed *p, uint8_t *out)
{
    if (is(p->mode, "ATTRIBUTES"))
        return meshopt_decodeVertexBuffer(out, p->count, p->stride, p->bytes, p->size);
    if (is(p->mode, "TRIANGLES"))
        return meshopt_decodeIndexBuffer(out, p->count, p->stride, p->bytes, p->size);
    return meshopt_decodeIndexSequence(out, p->count, p->stride, p->bytes, p->size);
}

static enum err filter(struct gltf *g, const struct packed *p, uint8_t *out)
{
    if (is(p->filter, "OCTAHEDRAL"))
        meshopt_decodeFilterOct(out, p->count, p->stride);
    else if (is(p->filter, "QUATERNION"))
        meshopt_decodeFilterQuat(out, p->count, p->stride);
    else if (is(p->filter, "EXPONENTIAL"))
        meshopt_decodeFilterExp(out, p->count, p->stride);
    else if (!is(p->filter, "NONE"))
        return gltf_fault(g, &p->at, ERR_UNSUPPORTED, "the filter '%.20s' is not supported; %s", p->filter, ADVICE);
    return ERR_OK;
}

enum err gltf_meshopt_decode(struct gltf *g, const struct gltf_at *at, struct gltf_view *out)
{
    struct packed p = { .at = *at };

    p.mode = gltf_string(at, "mode");
    p.filter = gltf_string(at, "filter");
    p.mode = p.mode ? p.mode : "";
    p.filter = p.filter ? p.filter : "NONE";
    enum err e = gltf_size(g, at, "count", 0, &p.count);
    if (!e)
        e = gltf_size(g, at, "byteStride", 0, &p.stride);
    if (!e)
        e = find_bytes(g, &p);
    if (!e)
        e = check(g, &p);
    if (e)
        return e;
    uint8_t *bytes = mem_alloc_raw(p.count + FILTER_GROUP, p.stride);
    if (!bytes)
        return ERR_NOMEM;
    if (decode(&p, bytes) != 0)
        e = gltf_fault(g, at, ERR_FORMAT, "its compressed data are damaged");
    if (!e)
        e = filter(g, &p, bytes);
    if (e) {
        mem_free(bytes);
        return e;
    }
    out->owned = bytes;
    out->at = bytes;
    out->size = p.count * p.stride;
    return ERR_OK;
}
