/* server/env/decode.h */
/* Bytes of a picture file to an image.
 * OpenEXR through OpenEXRCore: half and float, any compression it has, scanlines or tiles (of mip and rip maps the
 * largest level), any channel order, with or without alpha. Channels are R, G and B; else Y alone, as grey; else those
 * of the first layer ("sky.R") that has all three. Of several parts the first that has them is read. The picture is the
 * data window, wherever the display window lies: an environment has no frame to crop it to. An `envmap` attribute
 * becomes the image's layout.
 * Radiance .hdr: RLE old and new, flat, RGBE and XYZE, its eight orientations.
 * The result is linear Rec.709, top row first: an EXR's chromaticities, an .hdr's EXPOSURE, COLORCORR, PRIMARIES (all
 * zero means absent) and FORMAT=32-bit_rle_xyze are honoured. Every value is sanitised and counted as in image.h.
 * Never trusts a size: a picture is held against the limits and against the number of bytes that could carry it
 * before memory is taken. Any thread, one image per thread. */
#ifndef ENV_DECODE_H
#define ENV_DECODE_H

#include "err.h"
#include "image.h"

#include <stddef.h>
#include <stdint.h>

#define DECODE_FILE_MAX ((size_t)1 << 30) /* bytes of a file that decode_file reads */

/* `name` stands in messages. On failure *im may hold anything valid, its memory is still owned by it.
 * ERR_FORMAT: damaged, cut short, or neither EXR nor Radiance. ERR_UNSUPPORTED: valid, but deep, subsampled, of
 * integers, luminance with chroma, without colour channels, or gamma-encoded. ERR_RANGE: larger than image.h allows.
 * ERR_NOMEM. */
MUST_CHECK enum err decode_image(const uint8_t *bytes, size_t size, const char *name, struct image *im,
                                 struct reason *why);

MUST_CHECK enum err decode_exr(const uint8_t *bytes, size_t size, const char *name, struct image *im,
                               struct reason *why);
MUST_CHECK enum err decode_hdr(const uint8_t *bytes, size_t size, const char *name, struct image *im,
                               struct reason *why);

/* Whoever else does what decode_image does, such as a process that may die of it; with a context of its own. */
struct image_decoder {
    enum err (*decode)(void *context, const uint8_t *bytes, size_t size, const char *name, struct image *im,
                       struct reason *why);
    void *context;
};

/* The file at `path` whole: reads and decodes. ERR_IO when it cannot be read, ERR_RANGE above DECODE_FILE_MAX. */
MUST_CHECK enum err decode_file(const char *path, struct image *im, struct reason *why);

/* For messages: at most `size` bytes of a file, up to a NUL, with all but printable ASCII as '?', at most room - 1 of
 * them. Returns out. */
const char *decode_plain(const void *bytes, size_t size, char *out, size_t room);

#endif
