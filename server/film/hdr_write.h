/* server/film/hdr_write.h */
/* Linear pictures to Radiance's RGBE [Ward 1991]: #?RADIANCE, 32-bit_rle_rgbe, -Y +X, no EXPOSURE. Mantissas are cut,
 * not rounded, as Radiance's own programs do, who read m as (m + 1/2) / 256: then a value is off by 1/512 of the
 * texel's largest at most, and right in the mean. (env/decode_hdr.c reads m / 256.) What is not above 0 is 0.
 * Any thread. */
#ifndef FILM_HDR_WRITE_H
#define FILM_HDR_WRITE_H

#include "err.h"

#include <stddef.h>
#include <stdint.h>

struct hdr_desc {
    const float *rgb; /* [height][width][3] */
    uint32_t width, height;
    const char *lines; /* more of the header, each with its '\n' and none of them empty; NULL: none */
};

/* Into memory: the caller frees *bytes with mem_free. Same input, same bytes. ERR_NOMEM. */
MUST_CHECK enum err hdr_encode(const struct hdr_desc *d, uint8_t **bytes, size_t *size, struct reason *why);

/* To a file, as base/file_store.h does it: whole or not at all. ERR_IO names path and cause. */
MUST_CHECK enum err hdr_write(const struct hdr_desc *d, const char *path, struct reason *why);

#endif
