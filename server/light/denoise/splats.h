/* Lone bright splats of the light tracer in denoised images (denoise.h), whose filter works on shade points. The
 * excess of a pixel over four times the brightest of the 24 around it, in the sum of its channels, is spread evenly
 * over the 5 x 5 pixels: the image keeps its light, which moves by two pixels at most. Lines and spots of caustics
 * have bright neighbours and stay. */
#pragma once

#include "base/err.h"

#include <stdint.h>

/* splats: float[height][width][3], of particles only, changed in place. Bits do not depend on the number of threads.
 * ERR_NOMEM: unchanged. Thread: any. */
MUST_CHECK enum err splats_spread(float *splats, uint32_t width, uint32_t height);
