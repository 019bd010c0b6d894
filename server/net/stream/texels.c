#include "net/stream/texels.h"

#include <assert.h>
#include <string.h>

/* Frames are little-endian, and so is every machine this is built for: what was received is the float's own bytes. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "raw texels are taken as they came");

float texels_half(uint16_t bits)
{
    const uint32_t sign = (uint32_t)(bits & 0x8000u) << 16, exponent = bits >> 10 & 31u, mantissa = bits & 1023u;
    uint32_t out;
    float f;

    if (exponent == 0) {
        const float tiny = (float)mantissa * 0x1p-24f; /* a denormal, exact in float */
        return sign ? -tiny : tiny;
    }
    out = sign | (exponent == 31 ? 0xffu : exponent + (127 - 15)) << 23 | mantissa << 13;
    memcpy(&f, &out, sizeof(f));
    return f;
}

static void convert_half(struct frame *f, const uint8_t *from, unsigned channels)
{
    const size_t texels = (size_t)f->width * f->height;

    for (size_t i = 0; i < texels; i++) {
        for (unsigned c = 0; c < 3; c++) {
            uint16_t bits;
            memcpy(&bits, from + 2 * (i * channels + c), sizeof(bits));
            f->rgb[3 * i + c] = texels_half(bits);
        }
    }
}

/* Closes the gaps that alpha leaves, from the front: what is written has been read. */
static void drop_alpha(float *rgb, size_t texels)
{
    for (size_t i = 1; i < texels; i++)
        for (unsigned c = 0; c < 3; c++)
            rgb[3 * i + c] = rgb[4 * i + c];
}

static void turn_over(struct frame *f)
{
    const size_t row = 3 * (size_t)f->width;

    for (uint32_t y = 0; y < f->height / 2; y++) {
        float *upper = f->rgb + row * y, *lower = f->rgb + row * (f->height - 1 - y);
        for (size_t i = 0; i < row; i++) {
            const float t = upper[i];
            upper[i] = lower[i];
            lower[i] = t;
        }
    }
}

static void take_float(struct frame *f, const struct protocol_environment *header, struct block *payload)
{
    const struct block old = { (uint8_t *)f->rgb, f->rgb_capacity * sizeof(float) };

    f->rgb = (float *)(void *)payload->bytes; /* of mem_alloc: aligned for anything */
    f->rgb_capacity = payload->capacity / sizeof(float);
    *payload = old;
    f->kind = FRAME_TEXELS;
    f->width = header->width;
    f->height = header->height;
    if (header->channels == 4)
        drop_alpha(f->rgb, (size_t)f->width * f->height);
}

enum err texels_take(struct frame *f, const struct protocol_environment *header, struct block *payload)
{
    assert(header->channels == 3 || header->channels == 4);
    if (header->encoding == PROTOCOL_RAW_FLOAT) {
        take_float(f, header, payload);
    } else {
        assert(header->encoding == PROTOCOL_RAW_HALF);
        const enum err e = frame_reserve_texels(f, header->width, header->height);
        if (e)
            return e;
        convert_half(f, payload->bytes, header->channels);
    }
    if (header->flags & PROTOCOL_BOTTOM_FIRST)
        turn_over(f);
    return ERR_OK;
}
