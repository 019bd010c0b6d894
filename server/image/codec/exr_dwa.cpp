// C++ as draco_mesh.cpp: no exception and no type of the library leaves this file.
#include "image/codec/exr_dwa.h"

#include <ImfFrameBuffer.h>
#include <ImfIO.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>

#include <cstdio>
#include <cstring>
#include <new>
#include <stdexcept>

namespace {

class Memory : public Imf::IStream {
public:
    explicit Memory(const exr_dwa &x) : IStream("memory"), bytes(x.bytes), size(x.size)
    {
    }

    bool read(char out[], int n) override
    {
        if (n < 0 || at > size || static_cast<uint64_t>(n) > size - at)
            throw std::runtime_error("the file ends too early");
        std::memcpy(out, bytes + at, static_cast<size_t>(n));
        at += static_cast<uint64_t>(n);
        return at < size;
    }

    uint64_t tellg() override
    {
        return at;
    }

    void seekg(uint64_t to) override
    {
        at = to;
    }

private:
    const uint8_t *bytes;
    uint64_t size, at = 0;
};

void read(const exr_dwa &x, float *rgb)
{
    Memory memory(x);
    Imf::MultiPartInputFile file(memory, 0, false); // no threads, no repair of a chunk table
    Imf::InputPart part(file, x.part);
    Imf::FrameBuffer frame;
    const bool grey = std::strcmp(x.channels[0], x.channels[1]) == 0;
    const size_t texel = 3 * sizeof(float);

    for (int c = 0; c < (grey ? 1 : 3); c++)
        frame.insert(x.channels[c], Imf::Slice::Make(Imf::FLOAT, rgb + c, Imath::V2i(x.left, x.top), x.width, x.height,
                                                     texel, texel * x.width));
    part.setFrameBuffer(frame);
    part.readPixels(x.top, x.top + static_cast<int>(x.height) - 1);
    for (size_t i = 0; grey && i < static_cast<size_t>(x.width) * x.height; i++)
        rgb[3 * i + 1] = rgb[3 * i + 2] = rgb[3 * i];
}

} // namespace

enum exr_dwa_result exr_dwa_read(const struct exr_dwa *x, float *rgb, char why[128])
{
    try {
        read(*x, rgb);
        return EXR_DWA_OK;
    } catch (const std::bad_alloc &) {
        return EXR_DWA_NO_MEMORY;
    } catch (const std::exception &e) {
        std::snprintf(why, 128, "%s", e.what());
        return EXR_DWA_DAMAGED;
    }
}
