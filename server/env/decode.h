/* server/env/decode.h */
/* Bytes of a picture file to an image. Formats: OpenEXR through OpenEXRCore (half and float, any compression it
 * has, scanlines or tiles, any channel order, with or without alpha, luminance alone, data window other than the
 * display window: the data window's texels are the picture) and Radiance .hdr (RLE old and new, flat, its eight
 * orientations). The result is linear Rec.709: an EXR's chromaticities, an .hdr's EXPOSURE, COLORCORR, PRIMARIES (all
 * zero means absent) and FORMAT=32-bit_rle_xyze are honoured. Never trusts a size: dimensions are capped before memory
 * is taken. Any thread, one image per thread. */
#ifndef ENV_DECODE_H
#define ENV_DECODE_H

#include "err.h"
#include "image.h"

#include <stdbool.h>

/* `name` stands in messages. On failure *im may hold anything valid, its memory is still owned by it.
 * ERR_FORMAT: damaged, or neither EXR nor Radiance. ERR_UNSUPPORTED: valid, but deep, multi-part without a part that
 * has R, G, B, subsampled, or of integers. ERR_RANGE: larger than IMAGE_MAX_SIDE. ERR_NOMEM. */
MUST_CHECK enum err decode_image(const uint8_t *bytes, size_t size, const char *name, struct image *im,
                                 struct reason *why);

MUST_CHECK enum err decode_exr(const uint8_t *bytes, size_t size, const char *name, struct image *im,
                               struct reason *why);
MUST_CHECK enum err decode_hdr(const uint8_t *bytes, size_t size, const char *name, struct image *im,
                               struct reason *why);

/* The file at `path` whole: reads and decodes. ERR_IO when it cannot be read. */
MUST_CHECK enum err decode_file(const char *path, struct image *im, struct reason *why);

#endif
