/* What JPEG and PNG files say beside their texels: Exif, XMP and ICC profiles, and the gain maps that make HDR of a
 * JPEG [ISO 21496-1; Google's Ultra HDR 1.1]. Private to this room. Sizes and numbers are untrusted; all reads are
 * bounded. Thread: any. The caller owns the bytes. */
#pragma once

#include "image/codec/image.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct marker {
    const uint8_t *at; /* NULL: there is none */
    size_t size;
};

struct markers {                  /* zeroed: nothing is said */
    unsigned orientation;         /* Exif's, 1 to 8; 0: not stated, then XMP's counts */
    double aspect;                /* width per height of a texel; 0: not stated */
    struct marker exif;           /* a block that begins as a TIFF file */
    struct marker xmp, icc, gain; /* gain: ISO 21496-1's metadata */
    size_t end;                   /* of a JPEG: behind the image's last byte */
};

/* Reads the markers of the JPEG that begins at bytes[0]; what is damaged ends the list. */
void markers_of_jpeg(const uint8_t *bytes, size_t size, struct markers *out);

/* The orientation in a block of Exif, which begins as a TIFF file; 0: none. */
unsigned markers_orientation(const uint8_t *tiff, size_t size);

/* Sets the image's time and exposure by DateTimeOriginal, SubSecTimeOriginal, OffsetTimeOriginal (without it: as UTC)
 * and ExposureTime; what is damaged is left out, a time that is none is noted. */
void markers_taken(const struct marker *exif, struct image *im);

/* Up to three numbers of an XMP property such as "hdrgm:Gamma", of an attribute, an element or a list in it. Returns
 * how many there are; out[] keeps its other values. */
int markers_numbers(const struct marker *xmp, const char *key, double out[3]);

/* Places the image as its Exif and a panorama's XMP (GPano) say, notes what is ignored, and calls markers_taken.
 * ERR_NOMEM; ERR_RANGE: the panorama is too large. */
MUST_CHECK enum err markers_place(const struct markers *m, struct image *im);

/* ---- Gain maps ---- */

struct gain_map { /* of each channel: HDR = (SDR + base) 2^(low + (high - low) code^(1/gamma)) - alternate */
    double low[3], high[3], gamma[3], base[3], alternate[3];
};

/* False: this image's markers describe no gain map, or one that lowers the range of an HDR image. */
bool markers_gain(const struct markers *m, struct gain_map *out);
