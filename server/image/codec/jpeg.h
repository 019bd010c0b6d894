/* JPEG encoding through libjpeg-turbo. Thread: one per encoder, whose output buffer is reused. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct jpeg_encoder;

struct jpeg_encoder *jpeg_encoder_create(void);    /* NULL when out of memory */
void jpeg_encoder_destroy(struct jpeg_encoder *j); /* NULL is allowed */

/* Encodes uint8_t[height][width][3] sRGB at quality 1..100; 4:4:4 from 90 up, else 4:2:0. The encoder owns *bytes,
 * which stay valid until its next call. ERR_RANGE: a side of 0 or above 65500. ERR_NOMEM. */
MUST_CHECK enum err jpeg_encode(struct jpeg_encoder *j, const uint8_t *rgb, uint32_t width, uint32_t height,
                                int quality, const uint8_t **bytes, size_t *size);

/* ---- PNG ---- */

/* PNG encoding through libpng. Thread: any. */

struct png_desc {
    const void *samples; /* [height][width][3], with alpha [4]: sRGB, alpha straight; uint8_t, or uint16_t where deep */
    uint32_t width, height;
    bool deep, alpha;
};

/* Encodes to memory, marked as sRGB; the caller frees *bytes with mem_free. The output is deterministic. ERR_RANGE: a
 * side of 0 or above a million. ERR_NOMEM. On error *bytes is NULL. */
MUST_CHECK enum err png_encode(const struct png_desc *d, uint8_t **bytes, size_t *size, struct reason *why);
