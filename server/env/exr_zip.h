/* server/env/exr_zip.h */
/* ZIP and ZIPS chunks of OpenEXR files: deflated, of bytes stored as differences, the low bytes of all values before
 * the high ones. OpenEXRCore unpacks them as well, but with memory that zlib asks of the system for each chunk; here
 * the inflater and its memory stay. Inside this room only; one thread per unpacker. */
#ifndef ENV_EXR_ZIP_H
#define ENV_EXR_ZIP_H

#include "scratch.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#define ZLIB_CONST /* its input is const */
#include <zlib.h>

struct exr_zip {             /* zeroed but for scratch, it is ready */
    struct scratch *scratch; /* borrowed; NULL: none */
    z_stream stream;
    bool begun;
    uint8_t *bytes; /* inflated */
    size_t room;
};

void exr_zip_finish(struct exr_zip *z);

/* Unpacks one chunk that must come to exactly `size` bytes. NULL when all went well, else what is wrong with the data,
 * in a few words, or exr_zip_no_memory. */
const char *exr_zip_unpack(struct exr_zip *z, const uint8_t *packed, size_t packed_size, uint8_t *out, size_t size);

extern const char exr_zip_no_memory[];

/* Undoes the differences in place: b[i] = b[i - 1] + b[i] - 128 modulo 256. The second is the specification; the same
 * bits. */
void exr_zip_sum(uint8_t *b, size_t n);
void exr_zip_sum_ref(uint8_t *b, size_t n);

#endif
