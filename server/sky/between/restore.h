/* The sun that a camera lost. A sensor that clips shows the sun as a flat spot at the image's maximum, with a
 * thousandth of its energy: shadows and highlights go. Here a disc of the sun's size is put back, with the energy that
 * a stated illuminance or the rest of the sky calls for.
 *
 * What the rest of the sky calls for: the built-in clear sky (sky/daylight/sky.h) is compared with the image over the
 * upper hemisphere above 10 degrees. At each turbidity T the texels vote for the factor s that takes the model to the
 * image; the pair with the most votes wins, so that clouds and trees do not count while cloudless parts agree:
 *     share(T, s) = sum_i o_i exp(-(ln L_i - ln(s M_i(T)))^2 / (2 * 0.15^2)) / sum_i o_i
 * with luminance L, model M and solid angle o. The disc gets s times the model's sun [Preetham et al. 1999]. Colours do
 * not count: they depend on the camera's white balance.
 *
 * In known units s must agree with them, to about 10 %: a hazier sky is brighter, which settles T. In unknown units T
 * comes from the shape alone, between 2.2 and 6, which says far less: hazy skies may get up to twice the light.
 *
 * Images are float[height][width][3], lat-long as in sky/tables/layout.h, linear Rec.709, finite and not negative (an
 * image that image_mend repaired). Thread: any, one an image. */
#pragma once

#include "base/err.h"

#include <stdint.h>

struct restore_desc {
    double lux;   /* horizontal illuminance of the whole upper hemisphere; 0: what the rest of the sky calls for */
    double units; /* the image's units per W sr^-1 m^-2 (luminance = 179 lm/W); 0: unknown, which rules out lux */
};

enum restore_kind {
    RESTORE_NONE,  /* no flat spot at the maximum: no sun, one behind cloud, or one that did not clip */
    RESTORE_WHOLE, /* a flat spot with a sun's energy: it did not clip */
    RESTORE_DOUBT, /* a flat spot, but nothing tells its energy: the rest is no clear sky, or the lux do not fit */
    RESTORE_ADDED, /* a disc was added */
};

struct restored {
    enum restore_kind kind;
    double direction[3]; /* unit, of the disc or the flat spot; undefined for RESTORE_NONE */
    double spot_radius;  /* radians, of a disc of the flat spot's solid angle */
    double irradiance;   /* added, horizontal, luminance of W m^-2 in the image's units */
    double rest;         /* horizontal, of the upper hemisphere before */
    double lux;          /* irradiance in lux; 0: units unknown, or nothing added */
    double turbidity;    /* of the fit, 1.7 .. 10; 0: not fitted */
    double scale;        /* of the fit: image over model in W sr^-1 m^-2; 0: not fitted */
    double agreement;    /* the highest share above at any turbidity, 0..1 */
    char note[240];      /* one printable line that says what was found and done; "" for RESTORE_NONE */
};

/* Finds a clipped sun and adds what is missing. Changes rgb only for RESTORE_ADDED: the flat spot stays as glare, and
 * the disc's energy is spread over the texels that it covers by solid angle (sky_add_sun). ERR_USAGE: lux without
 * units. ERR_NOMEM. On an error rgb is unchanged. */
MUST_CHECK enum err restore_sun(float *rgb, uint32_t width, uint32_t height, const struct restore_desc *desc,
                                struct restored *out, struct reason *why);
