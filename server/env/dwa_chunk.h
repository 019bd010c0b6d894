/* server/env/dwa_chunk.h */
/* One DWA chunk while it is taken apart: what dwa.c and dwa_lossy.c share. */
#ifndef ENV_DWA_CHUNK_H
#define ENV_DWA_CHUNK_H

#include "dwa.h"

#include <stdbool.h>

#define RULES_MOST 256

enum scheme {
    SCHEME_DEFLATE, /* and nothing else */
    SCHEME_LOSSY,
    SCHEME_RLE,
};

/* The chunk's head: eleven numbers of 64 bits. */
struct head {
    uint64_t version;
    uint64_t plain_size, plain_packed;
    uint64_t ac_packed, dc_packed;
    uint64_t rle_packed, rle_size, rle_raw;
    uint64_t ac_count, dc_count; /* values of 16 bits */
    uint64_t ac_coding;          /* 0: Huffman, 1: deflate */
};

/* Which channels are stored how: by the name behind the last dot, and the type. */
struct rule {
    const char *suffix;
    enum scheme scheme;
    int colour; /* 0, 1, 2: red, green, blue of a layer, which go together; -1 */
    int type;   /* exr_pixel_type_t; -1: half and float */
    bool any_case;
};

struct channel {
    const char *name;
    size_t prefix; /* length of the layer's name */
    int number;    /* in the file's order */
    enum scheme scheme;
    int colour;
    int type;
    bool linear; /* stored without the curve */
    bool done;
    size_t size;   /* bytes of a value */
    size_t offset; /* bytes within a row of the result */
};

struct chunk {
    struct dwa *dwa;
    uint32_t width, height;
    size_t row_bytes;
    uint8_t *out;
    int count;
    struct channel *channels; /* by layer, then in the file's order */
    struct rule rules[RULES_MOST];
    int rule_count;

    struct head head;
    const uint8_t *plain, *ac, *dc, *rle; /* packed */

    uint8_t *plain_bytes, *rle_bytes; /* unpacked, channel after channel; of run-length encoded ones byte after byte */
    uint16_t *ac_at, *ac_end, *dc_at;
};

/* Lossy channels, one or three that were turned to luma and chroma: takes their coefficients off c->dc_at and c->ac_at
 * and writes their texels. NULL or what is wrong. */
const char *dwa_lossy(struct chunk *c, struct channel *const set[], int count);

#endif
