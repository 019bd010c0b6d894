/* A DWA chunk during decoding: shared by dwa.c and dwa_lossy.c. Thread: that of the workspace. */
#pragma once

#include "image/codec/dwa/dwa.h"

#include <stdbool.h>

#define RULES_MAX 256 /* bounds what a file may ask for */

enum scheme {
    SCHEME_DEFLATE, /* deflate only */
    SCHEME_LOSSY,
    SCHEME_RLE,
};

/* The chunk's header: eleven 64-bit numbers. */
struct head {
    uint64_t version;
    uint64_t plain_size, plain_packed;
    uint64_t ac_packed, dc_packed;
    uint64_t rle_packed, rle_size, rle_raw;
    uint64_t ac_count, dc_count; /* 16-bit values */
    uint64_t ac_coding;          /* 0: Huffman, 1: deflate */
};

/* How channels are stored, selected by type and by the part of the name after the last dot. */
struct rule {
    const char *suffix;
    enum scheme scheme;
    int colour; /* 0, 1, 2: red, green, blue of a layer, stored together; -1: none */
    int type;   /* exr_pixel_type_t; -1: half and float */
    bool any_case;
};

struct channel {
    const char *name;
    size_t prefix; /* length of the layer's name */
    int number;    /* in file order */
    enum scheme scheme;
    int colour;
    int type;
    bool linear; /* stored without the curve */
    bool done;
    size_t size;   /* bytes per value */
    size_t offset; /* bytes from the start of an output row */
};

struct chunk {
    struct dwa *dwa;
    uint32_t width, height;
    size_t row_bytes;
    uint8_t *out;
    int count;
    struct channel *channels; /* by layer, then in file order */
    struct rule rules[RULES_MAX];
    int rule_count;

    struct head head;
    const uint8_t *plain, *ac, *dc, *rle; /* packed data */

    uint8_t *plain_bytes, *rle_bytes; /* unpacked, channel after channel; run-length encoded channels store each byte of
                                         the values as a plane */
    uint16_t *ac_at, *ac_end, *dc_at;
};

/* Decodes a single lossy channel, or a set of three in luma and chroma: consumes coefficients from c->dc_at and
 * c->ac_at and writes the texels. Returns NULL, or what is wrong. */
const char *dwa_lossy(struct chunk *c, struct channel *const set[], int count);
