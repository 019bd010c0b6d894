// C++ as image/codec/exr_dwa.cpp: no exception and no type of the library leaves this file.
#include "import/formats/draco_mesh.h"

#include <draco/compression/decode.h>

#include <cstdio>
#include <memory>
#include <new>

struct draco_mesh {
    std::unique_ptr<draco::Mesh> mesh;
};

static enum draco_result decode(const void *bytes, size_t size, struct draco_mesh **out, char why[128])
{
    draco::DecoderBuffer buffer;
    draco::Decoder decoder;

    buffer.Init(static_cast<const char *>(bytes), size);
    auto result = decoder.DecodeMeshFromBuffer(&buffer);
    if (!result.ok()) {
        std::snprintf(why, 128, "%s", result.status().error_msg());
        return DRACO_DAMAGED;
    }
    std::unique_ptr<draco_mesh> m(new draco_mesh{ std::move(result).value() });
    const uint32_t points = m->mesh->num_points();
    for (draco::FaceIndex f(0); f < m->mesh->num_faces(); ++f) {
        for (const draco::PointIndex &p : m->mesh->face(f)) {
            if (p.value() >= points) {
                std::snprintf(why, 128, "a face refers to point %u of %u", p.value(), points);
                return DRACO_DAMAGED;
            }
        }
    }
    *out = m.release();
    return DRACO_OK;
}

enum draco_result draco_mesh_decode(const void *bytes, size_t size, struct draco_mesh **out, char why[128])
{
    *out = nullptr;
    try {
        return decode(bytes, size, out, why);
    } catch (const std::bad_alloc &) {
        return DRACO_NO_MEMORY;
    } catch (const std::exception &e) {
        std::snprintf(why, 128, "%s", e.what());
        return DRACO_DAMAGED;
    }
}

void draco_mesh_destroy(struct draco_mesh *m)
{
    delete m;
}

size_t draco_mesh_points(const struct draco_mesh *m)
{
    return m->mesh->num_points();
}

size_t draco_mesh_triangles(const struct draco_mesh *m)
{
    return m->mesh->num_faces();
}

void draco_mesh_indices(const struct draco_mesh *m, uint32_t *out)
{
    for (draco::FaceIndex f(0); f < m->mesh->num_faces(); ++f) {
        for (const draco::PointIndex &p : m->mesh->face(f))
            *out++ = p.value();
    }
}

template <typename T> static bool convert(const draco::PointAttribute &a, uint32_t points, size_t components, void *out)
{
    T *at = static_cast<T *>(out);

    for (draco::PointIndex p(0); p < points; ++p, at += components) {
        const draco::AttributeValueIndex v = a.mapped_index(p);
        if (v.value() >= a.size() || !a.ConvertValue<T>(v, static_cast<int8_t>(components), at))
            return false;
    }
    return true;
}

bool draco_mesh_attribute(const struct draco_mesh *m, uint32_t id, enum draco_number type, size_t components, void *out)
{
    const draco::PointAttribute *a = m->mesh->GetAttributeByUniqueId(id);
    const uint32_t points = m->mesh->num_points();

    if (!a)
        return false;
    switch (type) {
    case DRACO_INT8: return convert<int8_t>(*a, points, components, out);
    case DRACO_UINT8: return convert<uint8_t>(*a, points, components, out);
    case DRACO_INT16: return convert<int16_t>(*a, points, components, out);
    case DRACO_UINT16: return convert<uint16_t>(*a, points, components, out);
    case DRACO_UINT32: return convert<uint32_t>(*a, points, components, out);
    case DRACO_FLOAT32: return convert<float>(*a, points, components, out);
    }
    return false;
}
