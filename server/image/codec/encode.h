/* Writes image files: OpenEXR, Radiance, JPEG and PNG.
 *
 * Writes linear images as OpenEXR through OpenEXRCore: R, G, B, possibly A and channels of further layers, as float or
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

/* ---- Radiance ---- */

/* Writes linear images as Radiance RGBE [Ward 1991]: #?RADIANCE, 32-bit_rle_rgbe, -Y +X, no EXPOSURE. Mantissas are
 * truncated, as in Radiance's own programs, which read m as (m + 1/2) / 256; of a value just above a power of two the
 * exponent may be one lower, with a mantissa of 255, where that is nearer: a value is then off by at most 1/256 of
 * the texel's largest channel, and 1.0 by 1/512. (image/codec/decode_hdr.c reads m / 256.) Values that are not positive
 * become 0. Thread: any. */

struct hdr_desc {
    const float *rgb; /* [height][width][3] */
    uint32_t width, height;
    const char *lines; /* further header lines, each ending in '\n', none empty; NULL: none */
};

/* Encodes to memory; the caller frees *bytes with mem_free. The output is deterministic. ERR_NOMEM. */
MUST_CHECK enum err hdr_encode(const struct hdr_desc *d, uint8_t **bytes, size_t *size, struct reason *why);

/* Encodes to a file, written atomically (base/file_store.h). ERR_NOMEM; ERR_IO names path and cause. */
MUST_CHECK enum err hdr_write(const struct hdr_desc *d, const char *path, struct reason *why);

/* ---- JPEG ---- */

/* JPEG encoding through libjpeg-turbo. Thread: one per encoder, whose output buffer is reused. */

struct jpeg_encoder;

struct jpeg_encoder *jpeg_encoder_create(void);    /* NULL when out of memory */
void jpeg_encoder_destroy(struct jpeg_encoder *j); /* NULL is allowed */

/* Encodes uint8_t[height][width][3] sRGB at quality 1..100; 4:4:4 from 90 up, else 4:2:0. The encoder owns *bytes,
 * which stay valid until its next call. ERR_RANGE: a side of 0 or above 65500. ERR_NOMEM. */
MUST_CHECK enum err jpeg_encode(struct jpeg_encoder *j, const uint8_t *rgb, uint32_t width, uint32_t height,
                                int quality, const uint8_t **bytes, size_t *size);

/* ---- PNG ---- */

/* PNG encoding through libpng. Thread: any. */

struct png_desc {
    const void *samples; /* [height][width][3], with alpha [4]: sRGB, alpha straight; uint8_t, or uint16_t where deep */
    uint32_t width, height;
    bool deep, alpha;
};

/* Encodes to memory, marked as sRGB; the caller frees *bytes with mem_free. The output is deterministic. ERR_RANGE: a
 * side of 0 or above a million. ERR_NOMEM. On error *bytes is NULL. */
MUST_CHECK enum err png_encode(const struct png_desc *d, uint8_t **bytes, size_t *size, struct reason *why);

/* ---- Cryptomatte ---- */

/* Cryptomatte [Friedman and Jones 2015], specification 1.2.0: a name becomes a 32-bit number by MurmurHash3, the number
 * a float, and a pixel holds pairs of such floats and their coverage, in descending order. Functions of their
 * arguments, any thread. */

/* MurmurHash3_x86_32 with seed 0. */
uint32_t cryptomatte_hash(const char *name);

/* The name's id. Bits that would make it a NaN, an infinity or a denormal are changed. */
float cryptomatte_id(const char *name);

/* The header attributes of one layer, such as "CryptoObject". Free with cryptomatte_finish. */
struct cryptomatte {
    char key[4][64]; /* cryptomatte/1a2b3c4/name, hash, conversion, manifest */
    const char *value[4];
    char *manifest; /* {"name":"id in hexadecimal",...}; each name once */
};

/* names: count of them, UTF-8, may repeat. layer is borrowed. ERR_NOMEM. */
MUST_CHECK enum err cryptomatte_init(struct cryptomatte *c, const char *layer, const char *const *names, size_t count);
void cryptomatte_finish(struct cryptomatte *c); /* zeroed memory is allowed */
