/* Writes linear images as Radiance RGBE [Ward 1991]: #?RADIANCE, 32-bit_rle_rgbe, -Y +X, no EXPOSURE. Mantissas are
 * truncated, as in Radiance's own programs, which read m as (m + 1/2) / 256; of a value just above a power of two the
 * exponent may be one lower, with a mantissa of 255, where that is nearer: a value is then off by at most 1/256 of
 * the texel's largest channel, and 1.0 by 1/512. (image/codec/decode_hdr.c reads m / 256.) Values that are not positive
 * become 0. Thread: any. */
#pragma once

#include "base/err.h"

#include <stddef.h>
#include <stdint.h>

struct hdr_desc {
    const float *rgb; /* [height][width][3] */
    uint32_t width, height;
    const char *lines; /* further header lines, each ending in '\n', none empty; NULL: none */
};

/* Encodes to memory; the caller frees *bytes with mem_free. The output is deterministic. ERR_NOMEM. */
MUST_CHECK enum err hdr_encode(const struct hdr_desc *d, uint8_t **bytes, size_t *size, struct reason *why);

/* Encodes to a file, written atomically (base/file_store.h). ERR_NOMEM; ERR_IO names path and cause. */
MUST_CHECK enum err hdr_write(const struct hdr_desc *d, const char *path, struct reason *why);
