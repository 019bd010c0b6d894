/* Scales a linear image down: each new pixel is the mean of the area that it covers, so that fine bright detail keeps
 * its energy. Images are float[height][width][3], top row first. Thread: any. */
#pragma once

#include <stdint.h>

/* The height that keeps the aspect ratio at a width of at most the image's; at least 1. */
uint32_t scale_height(uint32_t width, uint32_t height, uint32_t to_width);

/* Finite values. The caller owns the arrays. to_width and to_height are 1 to width and height. */
void scale_linear(const float *from, uint32_t width, uint32_t height, float *to, uint32_t to_width, uint32_t to_height);
