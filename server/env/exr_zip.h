/* server/env/exr_zip.h */
/* ZIP and ZIPS chunks of OpenEXR files: deflated, of bytes stored as differences, the low bytes of all values before
 * the high ones. OpenEXRCore unpacks them as well, but by zlib, which takes more than twice as long as libdeflate and
 * asks the system for memory for each chunk; here the inflater stays from picture to picture, and its memory with it.
 * Inside this room only; one thread per unpacker. */
#ifndef ENV_EXR_ZIP_H
#define ENV_EXR_ZIP_H

#include "scratch.h"

#include <stddef.h>
#include <stdint.h>

struct libdeflate_decompressor;

struct exr_zip {                               /* zeroed but for the first two, it is ready */
    struct scratch *scratch;                   /* borrowed; NULL: none */
    struct libdeflate_decompressor **inflater; /* the caller's, made where it is NULL; free with exr_inflater_destroy */
    uint8_t *bytes;                            /* inflated */
    size_t room;
};

void exr_zip_finish(struct exr_zip *z);
void exr_inflater_destroy(struct libdeflate_decompressor *inflater); /* NULL is allowed */

/* Unpacks one chunk that must come to exactly `size` bytes. NULL when all went well, else what is wrong with the data,
 * in a few words, or exr_zip_no_memory. */
const char *exr_zip_unpack(struct exr_zip *z, const uint8_t *packed, size_t packed_size, uint8_t *out, size_t size);

extern const char exr_zip_no_memory[];

/* Undoes the differences in place: b[i] = b[i - 1] + b[i] - 128 modulo 256. The second is the specification; the same
 * bits. */
void exr_zip_sum(uint8_t *b, size_t n);
void exr_zip_sum_ref(uint8_t *b, size_t n);

#endif
