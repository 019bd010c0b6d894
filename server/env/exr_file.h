/* server/env/exr_file.h */
/* An OpenEXR file that is being decoded: what decode_exr.c makes of its header and exr_chunks.c of its pixels. Inside
 * this room only; one thread per file. */
#ifndef ENV_EXR_FILE_H
#define ENV_EXR_FILE_H

#include "err.h"
#include "image.h"

#include <openexr.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define EXR_CHANNELS_MOST 1024 /* the library counts them in 16 bits */

struct exr_source {
    int channel; /* place in the part's list of channels */
    bool half;   /* else float */
    size_t skip; /* bytes of a texel's channels that come before this one */
};

struct exr_file {
    const uint8_t *bytes;
    size_t size;
    const char *name;
    const struct image *into; /* for its limits */
    struct reason *why;

    exr_context_t context;
    struct reason said; /* the library's own first complaint since it was last cleared */

    int part;
    bool tiled;
    exr_compression_t compression;
    struct exr_source source[3]; /* of R, G and B */
    bool grey;                   /* all three are Y */
    uint32_t width, height;
    int32_t left, top;    /* of the data window */
    uint64_t texel_bytes; /* of all channels, unpacked */
    bool converts;        /* to Rec.709, by the matrix */
    float to_rec709[9];

    enum layout layout;
};

/* The fault at `where`, in the library's words or, where it had none, in those for its code. */
enum err exr_file_say(struct exr_file *x, exr_result_t r, const char *where);

bool exr_file_is_dwa(const struct exr_file *x);

/* False when `packed` bytes cannot stand for so many unpacked ones, whatever they are. */
bool exr_file_plausible(const struct exr_file *x, uint64_t packed, uint64_t unpacked);

/* Decodes all chunks of the chosen part into the image, which has its size; sanitises them and counts. */
MUST_CHECK enum err exr_chunks_read(struct exr_file *x, struct image *im);

#endif
