#include "import/formats/draco_make.h"

#include <draco/compression/encode.h>

#include <cstdlib>
#include <cstring>

static int add(draco::Mesh &mesh, draco::GeometryAttribute::Type kind, int components, draco::DataType type,
               bool normalized, size_t size)
{
    draco::GeometryAttribute a;

    a.Init(kind, nullptr, static_cast<uint8_t>(components), type, normalized, static_cast<int64_t>(size), 0);
    return mesh.AddAttribute(a, true, mesh.num_points());
}

size_t draco_make_grid(uint32_t side, uint8_t **out)
{
    const uint32_t row = side + 1;
    draco::EncoderBuffer buffer;
    draco::Encoder encoder;
    draco::Mesh mesh;

    mesh.set_num_points(row * row);
    const int position = add(mesh, draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32, false, 3 * sizeof(float));
    const int uv = add(mesh, draco::GeometryAttribute::TEX_COORD, 2, draco::DT_UINT16, true, 2 * sizeof(uint16_t));
    for (uint32_t i = 0; i < row * row; i++) {
        const uint32_t x = i % row, y = i / row;
        const float p[3] = { static_cast<float>(x), static_cast<float>(y), 0.0f };
        const uint16_t t[2] = { static_cast<uint16_t>(65535 * x / side), static_cast<uint16_t>(65535 * y / side) };
        mesh.attribute(position)->SetAttributeValue(draco::AttributeValueIndex(i), p);
        mesh.attribute(uv)->SetAttributeValue(draco::AttributeValueIndex(i), t);
    }
    for (uint32_t i = 0; i < side * side; i++) {
        const uint32_t a = i / side * row + i % side;
        mesh.AddFace({ draco::PointIndex(a), draco::PointIndex(a + 1), draco::PointIndex(a + row + 1) });
        mesh.AddFace({ draco::PointIndex(a), draco::PointIndex(a + row + 1), draco::PointIndex(a + row) });
    }
    encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, 16);
    encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
    if (!encoder.EncodeMeshToBuffer(mesh, &buffer).ok())
        return 0;
    *out = static_cast<uint8_t *>(std::malloc(buffer.size()));
    std::memcpy(*out, buffer.data(), buffer.size());
    return buffer.size();
}
