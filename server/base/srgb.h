/* The curve of sRGB [IEC 61966-2-1, section 5.2], between linear light and codes, both from 0 to 1. Thread: any. */
#pragma once

#include <math.h>

static inline double srgb_encode(double linear)
{
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1.0 / 2.4) - 0.055;
}

static inline double srgb_decode(double code)
{
    return code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4);
}
