/* Scales an image down: each new pixel is the mean of the area that it covers, in linear light, so that fine bright
 * detail keeps its energy. Images are [height][width][3], top row first. Thread: any, one per struct scaler.
 */
#pragma once

#include <stdint.h>

struct scaler;

struct scaler *scaler_create(void);    /* NULL when out of memory */
void scaler_destroy(struct scaler *s); /* NULL is allowed */

/* The height that keeps the aspect ratio at a width of at most the image's; at least 1. */
uint32_t scale_height(uint32_t width, uint32_t height, uint32_t to_width);

/* The caller owns all arrays. to_width and to_height are 1 to width and height. sRGB values are decoded and encoded
 * again; within 1 code value of the exact formula. */
void scale_srgb(struct scaler *s, const uint8_t *from, uint32_t width, uint32_t height, uint8_t *to, uint32_t to_width,
                uint32_t to_height);
/* Linear values, finite. */
void scale_linear(const float *from, uint32_t width, uint32_t height, float *to, uint32_t to_width, uint32_t to_height);
