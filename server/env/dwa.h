/* server/env/dwa.h */
/* The DWAA and DWAB chunks of OpenEXR files, which OpenEXRCore 3.1 has no code for. A chunk holds, behind a header:
 * what is deflated only (any channel), the AC and then the DC coefficients of channels stored lossily, and what is
 * run-length encoded and deflated (alpha). Lossy channels are half floats under a curve that is a power below 1 and
 * a logarithm above, R, G and B of a layer turned to luma and chroma, in blocks of 8x8 under the discrete cosine
 * transform, in JPEG's zigzag order. Inside this room only; one thread per workspace. */
#ifndef ENV_DWA_H
#define ENV_DWA_H

#include <openexr.h>
#include <stddef.h>
#include <stdint.h>

#define DWA_CHANNELS_MOST 1024

/* Buffers that are kept from chunk to chunk. Zeroed memory is an empty one. */
struct dwa {
    uint8_t *block; /* one allocation for all that a chunk needs */
    size_t block_size;
    uint16_t *to_linear; /* [65536]: half float under the curve to linear half float; 0 for NaN and infinity */
};

void dwa_finish(struct dwa *d); /* zeroed memory is allowed */

/* Unpacks one chunk into rows of width x height texels, each row one channel after the other in the given order, half
 * floats and floats little-endian: what the library's own decompressors give. No channel may be subsampled; their
 * number is at most DWA_CHANNELS_MOST. NULL when all went well, else what is wrong with the data, in a few words. */
const char *dwa_unpack(struct dwa *d, const exr_coding_channel_info_t *channels, int count, uint32_t width,
                       uint32_t height, const uint8_t *packed, size_t size, uint8_t *out);

/* What dwa_unpack returns when it is memory that it lacks. */
extern const char dwa_no_memory[];

/* A block of the Huffman code that PIZ and DWA share: exactly `count` values of 16 bits. NULL or what is wrong. */
const char *dwa_huffman(const uint8_t *packed, size_t size, uint16_t *out, size_t count);

#endif
