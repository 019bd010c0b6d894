/* An OpenEXR file during decoding: decode_exr.c fills it from the header, exr_chunks.c reads the pixels. Private to
 * this room. Thread: one per file. The caller owns the bytes. */
#pragma once

#include "base/err.h"
#include "image/codec/image.h"

#include <openexr.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define EXR_CHANNELS_MAX 1024 /* the library counts them in 16 bits */

struct exr_source {
    int channel; /* index in the part's channel list */
    bool half;   /* else float */
    size_t skip; /* bytes of a texel's preceding channels */
};

struct exr_frame {
    uint32_t width, height; /* 0: that of the data */
    int64_t left, top;      /* of the data in it */
};

struct exr_file {
    const uint8_t *bytes;
    size_t size;
    size_t table_at; /* byte of the chunk table; 0: several parts */
    const char *name;
    const struct image *into; /* for its limits */
    struct reason *why;

    exr_context_t context;
    struct reason library_fault; /* the library's first message since it was last cleared */

    int part;
    bool tiled;
    exr_compression_t compression;
    struct exr_source source[3]; /* R, G and B */
    bool grey;                   /* all three are Y */
    uint32_t width, height;
    int32_t left, top;    /* data window */
    uint64_t texel_bytes; /* all channels, unpacked */
    bool converts;        /* apply to_rec709 */
    float to_rec709[9];

    enum layout layout;
    struct exr_frame frame;
    float aspect;     /* of a pixel, width per height; 0: unknown */
    char note[320];   /* the layer that was chosen; "": there is no choice */
    char window[160]; /* where the data were placed; "": they are the whole image */
};

/* Reports an error at `where` with the library's message or, without one, the text of its code. Returns the matching
 * error code. */
enum err exr_file_say(struct exr_file *x, exr_result_t r, const char *where);

/* Whether `packed` bytes can encode `unpacked` bytes in the file's compression. */
bool exr_file_plausible(const struct exr_file *x, uint64_t packed, uint64_t unpacked);

/* When the image was taken and how long the exposure was, by capDate, utcOffset (0 if missing) and expTime; damaged
 * ones are noted and left out. */
void exr_file_take_time(struct exr_file *x, struct image *im);

/* Decodes and sanitises all chunks of the chosen part into the image, which already has its size, and counts faults.
 * ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err exr_chunks_read(struct exr_file *x, struct image *im);
