/* Writes linear images as OpenEXR through OpenEXRCore: R, G, B, possibly A and channels of further layers, as float or
 * half, ZIP, a single part of scan lines, with Rec.709 chromaticities. Thread: any. The caller owns pixels and
 * attributes. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum exr_depth {
    EXR_FLOAT,
    EXR_HALF, /* values above 65504 are clamped */
};

struct exr_attribute { /* written as a string attribute */
    const char *name, *value;
};

struct exr_channel {     /* one more, such as "albedo.R" or "Z" */
    const char *name;    /* unlike all others */
    const float *values; /* [height][width], `stride` numbers from one to the next */
    uint32_t stride;
    bool full; /* 32 bits, whatever the depth: positions, depths, ids */
};

struct exr_desc {
    const float *rgb; /* [height][width][3]; with alpha [4], premultiplied */
    uint32_t width, height;
    enum exr_depth depth;
    const struct exr_attribute *attributes;
    size_t attribute_count;
    const struct exr_channel *channels;
    size_t channel_count; /* at most EXR_CHANNELS_MAX */
    bool alpha;
};

#define EXR_CHANNELS_MAX 124 /* bounds a table; with R, G, B and A 128 */

/* Encodes to memory; the caller frees *bytes with mem_free. The output is deterministic. ERR_RANGE: the size.
 * ERR_NOMEM. */
MUST_CHECK enum err exr_encode(const struct exr_desc *d, uint8_t **bytes, size_t *size, struct reason *why);

/* Encodes to a file, written atomically (base/file_store.h). Errors of exr_encode, and ERR_IO, which names path and
 * cause. */
MUST_CHECK enum err exr_write(const struct exr_desc *d, const char *path, struct reason *why);
