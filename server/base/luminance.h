/* Photometric units of images: linear Rec.709 in W sr^-1 m^-2 to luminance in cd m^-2, by Radiance's convention of
 * 179 lm/W for white [Ward 1994]. Thread: any. */
#pragma once

#include <math.h>

#define LUMINOUS_EFFICACY 179.0 /* lm/W: luminance in cd m^-2 over the radiance of white */

/* Weights of red, green and blue; each triple adds up to 1, so that grey light has the same luminance by all. */
enum luminance_weights {
    LUMINANCE_REC709,   /* 0.2126, 0.7152, 0.0722 [ITU-R BT.709-6] */
    LUMINANCE_RADIANCE, /* 0.265, 0.670, 0.065, those of Radiance's own primaries [Ward 1994] */
};

/* In the unit of rgb; times LUMINOUS_EFFICACY: cd m^-2. */
static inline double luminance_of(enum luminance_weights w, const double rgb[3])
{
    return w == LUMINANCE_RADIANCE ? 0.265 * rgb[0] + 0.670 * rgb[1] + 0.065 * rgb[2]
                                   : 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

/* ---- sRGB ---- */

/* The curve of sRGB [IEC 61966-2-1, section 5.2], between linear light and codes, both from 0 to 1. Thread: any. */

static inline double srgb_encode(double linear)
{
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1.0 / 2.4) - 0.055;
}

static inline double srgb_decode(double code)
{
    return code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4);
}
