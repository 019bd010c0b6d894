/* Decoder for the DWAA and DWAB chunks of OpenEXR files, which OpenEXRCore 3.1 does not implement. A chunk holds, after
 * a header: deflated data (any channel), the AC and then the DC coefficients of lossy channels, and run-length encoded
 * and deflated data (alpha). Lossy channels are half floats under a curve that is a power below 1 and a logarithm
 * above. The R, G and B of a layer are converted to luma and chroma. Blocks of 8x8 are transformed by the discrete
 * cosine transform and stored in JPEG's zigzag order. Private to this room. Thread: one per workspace. */
#pragma once

#include <openexr.h>
#include <stddef.h>
#include <stdint.h>

#define DWA_CHANNELS_MAX 1024 /* as EXR_CHANNELS_MAX of exr_file.h */

/* Buffers reused from chunk to chunk. Zeroed memory is a valid empty workspace. */
struct dwa {
    uint8_t *block; /* one allocation for everything that a chunk needs */
    size_t block_size;
    uint16_t *to_linear; /* [65536]: half float under the curve to linear half float; 0 for NaN and infinity */
};

void dwa_finish(struct dwa *d); /* frees the buffers; zeroed memory is allowed */

/* Unpacks one chunk into rows of width x height texels. Each row holds one channel after the other in the given order,
 * as little-endian half floats and floats: the output format of the library's own decompressors. No channel may be
 * subsampled; there are at most DWA_CHANNELS_MAX. Returns NULL, or a short description of what is wrong with the data.
 */
const char *dwa_unpack(struct dwa *d, const exr_coding_channel_info_t *channels, int count, uint32_t width,
                       uint32_t height, const uint8_t *packed, size_t size, uint8_t *out);

/* What dwa_unpack returns when out of memory. */
extern const char dwa_no_memory[];

/* Decodes a block of the Huffman code that PIZ and DWA share to exactly `count` 16-bit values. Returns NULL, or what is
 * wrong. */
const char *dwa_huffman(const uint8_t *packed, size_t size, uint16_t *out, size_t count);
