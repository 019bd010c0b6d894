/* server/film/jpeg.h */
/* JPEG through libjpeg-turbo. One encoder per thread; its output memory is reused. */
#ifndef FILM_JPEG_H
#define FILM_JPEG_H

#include "err.h"

#include <stddef.h>
#include <stdint.h>

struct jpeg_encoder;

struct jpeg_encoder *jpeg_encoder_create(void);    /* NULL when out of memory */
void jpeg_encoder_destroy(struct jpeg_encoder *j); /* NULL is allowed */

/* Encodes uint8_t[height][width][3] sRGB at quality 1..100; 4:4:4 from 90 up, else 4:2:0. *bytes stays owned by the
 * encoder and is valid until its next call. ERR_RANGE: sides beyond 65500 or 0. ERR_NOMEM. */
MUST_CHECK enum err jpeg_encode(struct jpeg_encoder *j, const uint8_t *rgb, uint32_t width, uint32_t height,
                                int quality, const uint8_t **bytes, size_t *size);

#endif
