/* ZIP chunks of OpenEXR files (and ZIPS, for decoding): deflated byte differences, the low bytes of all values before
 * the high ones. OpenEXRCore can do both, but with zlib, which is less than half as fast as libdeflate and allocates
 * memory for each chunk. Private to this room. Thread: one per unpacker and per deflater. */
#pragma once

#include "base/err.h"
#include "base/mem.h"

#include <stddef.h>
#include <stdint.h>

struct libdeflate_compressor;
struct libdeflate_decompressor;

struct exr_zip {             /* valid when zeroed except for the first two */
    struct scratch *scratch; /* borrowed; NULL: none */
    struct libdeflate_decompressor *
        *inflater;  /* owned by the caller; created if NULL; free with exr_inflater_destroy */
    uint8_t *bytes; /* inflated data */
    size_t room;
};

void exr_zip_finish(struct exr_zip *z);                              /* frees the buffer, not the inflater */
void exr_inflater_destroy(struct libdeflate_decompressor *inflater); /* NULL is allowed */

/* Unpacks one chunk to exactly `size` bytes. Returns NULL, a short description of what is wrong with the data, or
 * exr_zip_no_memory. */
const char *exr_zip_unpack(struct exr_zip *z, const uint8_t *packed, size_t packed_size, uint8_t *out, size_t size);

extern const char exr_zip_no_memory[];

struct exr_deflater {
    uint8_t *plain;  /* the caller writes a chunk's values here */
    uint8_t *halves; /* the same, low and high bytes separated */
    struct libdeflate_compressor *deflate;
};

/* room: the largest chunk, bytes. ERR_NOMEM; *z needs no finish then. */
MUST_CHECK enum err exr_deflater_init(struct exr_deflater *z, size_t room);
void exr_deflater_finish(struct exr_deflater *z); /* zeroed memory is allowed */

/* Packs z->plain[size] to out[size]. Returns the number of bytes; `size` if packing saves none, or of a large chunk
 * less than an estimated fifth, and out holds them as they were: readers take a chunk of that size as uncompressed. */
size_t exr_zip_pack(struct exr_deflater *z, size_t size, uint8_t *out);

/* Undoes the differences in place: b[i] = b[i - 1] + b[i] - 128 modulo 256. */
void exr_zip_sum(uint8_t *b, size_t n);
void exr_zip_sum_ref(uint8_t *b, size_t n); /* the scalar reference; same result */
