/* server/film/exr_write.h */
/* Linear pictures to OpenEXR through OpenEXRCore: R, G, B as float or half, ZIP, one part of scanlines, chromaticities
 * of Rec.709 stated. Any thread. */
#ifndef FILM_EXR_WRITE_H
#define FILM_EXR_WRITE_H

#include "err.h"

#include <stddef.h>
#include <stdint.h>

enum exr_depth {
    EXR_FLOAT,
    EXR_HALF, /* values beyond 65504 become 65504 */
};

struct exr_attribute { /* written as a string attribute */
    const char *name, *value;
};

struct exr_desc {
    const float *rgb; /* [height][width][3] */
    uint32_t width, height;
    enum exr_depth depth;
    const struct exr_attribute *attributes;
    size_t attribute_count;
};

/* Into memory: the caller frees *bytes with mem_free. Same input, same bytes. */
MUST_CHECK enum err exr_encode(const struct exr_desc *d, uint8_t **bytes, size_t *size, struct reason *why);

/* To a file, as base/file_store.h does it: whole or not at all. ERR_IO names path and cause. */
MUST_CHECK enum err exr_write(const struct exr_desc *d, const char *path, struct reason *why);

#endif
