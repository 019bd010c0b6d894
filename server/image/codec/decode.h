/* Decodes image files.
 * JPEG and PNG, 8 or 16 bits, as sRGB with white at 1 (image.low_range: they hold no HDR), unless a PNG states its
 * curve (cICP, gAMA); HDR are a PNG by PQ or HLG, with 203 cd/m^2 at 1, and a JPEG with a gain map. Alpha is ignored.
 * Exif's orientation and the place of a part in a panorama (XMP's GPano) are applied.
 * OpenEXR, through OpenEXRCore: half and float, every compression, scan lines or tiles (the largest level of mip and
 * rip maps), any channel order, with or without alpha. Of several layers, in one part or many, image.layer names the
 * one to read; else it is root R, G and B, else Y as grey, else the one named like an image ("Combined", "beauty"),
 * else the first that is not named like something else ("AO", "albedo"); image.note says so. The image is the display
 * window: black where there are no data, without those outside. An `envmap` attribute
 * sets the image's layout. Radiance .hdr: old and new RLE, flat, RGBE and XYZE, all eight orientations. The result is
 * linear Rec.709, top row first. An EXR's chromaticities and an .hdr's EXPOSURE, COLORCORR, PRIMARIES (all zero means
 * absent) and FORMAT=32-bit_rle_xyze are applied. Every value is mended and counted as in image.h. No size is
 * trusted: before memory is allocated, the image is checked against the limits and against the number of bytes that
 * could encode it. Thread: any, one image per thread. The caller owns the bytes and the image. */
#pragma once

#include "base/err.h"
#include "image/codec/image.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define DECODE_FILE_MAX ((size_t)1 << 30) /* the largest file that decode_file reads */

#define DECODE_HEAD ((size_t)256 << 10) /* bytes of a file by which it is judged */

/* The most bytes that a file may have that begins with these, DECODE_HEAD or all of it; 0: it is no image. UINT64_MAX:
 * decoding will say what is wrong. Thread: any. */
uint64_t decode_claimed(const uint8_t *head, size_t size);

/* Decodes a file from memory; `name` stands for it in messages. On failure the contents of *im are undefined but valid,
 * and it still owns its memory. ERR_FORMAT: damaged, truncated, or none of these formats. ERR_UNSUPPORTED: valid,
 * but deep, subsampled, integer, luminance with chroma, without colour channels, or gamma-encoded. ERR_RANGE: larger
 * than image.h allows. ERR_NOMEM. */
MUST_CHECK enum err decode_image(const uint8_t *bytes, size_t size, const char *name, struct image *im,
                                 struct reason *why);

/* As decode_image, for bytes that are known to be of one format. */
MUST_CHECK enum err decode_exr(const uint8_t *bytes, size_t size, const char *name, struct image *im,
                               struct reason *why);
/* Likewise for Radiance .hdr. */
MUST_CHECK enum err decode_hdr(const uint8_t *bytes, size_t size, const char *name, struct image *im,
                               struct reason *why);

/* Likewise for JPEG. Also ERR_UNSUPPORTED: inks. */
MUST_CHECK enum err decode_jpeg(const uint8_t *bytes, size_t size, const char *name, struct image *im,
                                struct reason *why);
/* Likewise for PNG. */
MUST_CHECK enum err decode_png(const uint8_t *bytes, size_t size, const char *name, struct image *im,
                               struct reason *why);

/* Whether the bytes begin like a JPEG or PNG. */
bool decode_is_low_range(const uint8_t *bytes, size_t size);

/* An implementation of decode_image with a context of its own, such as one that runs in a separate process. */
struct image_decoder {
    enum err (*decode)(void *context, const uint8_t *bytes, size_t size, const char *name, struct image *im,
                       struct reason *why);
    void *context;
};

/* Reads and decodes the file at `path`. Errors of decode_image, and ERR_IO: cannot be read; ERR_RANGE: larger than
 * DECODE_FILE_MAX. */
MUST_CHECK enum err decode_file(const char *path, struct image *im, struct reason *why);

/* Makes untrusted text printable: copies at most `size` bytes, up to a NUL, to out[room], truncated to room - 1, with
 * '?' for everything but printable ASCII. Returns out. */
const char *decode_printable(const void *bytes, size_t size, char *out, size_t room);

/* ---- EXR headers ---- */

/* Reads EXR headers without OpenEXRCore, attribute by attribute, and restricts which EXR files are accepted from the
 * network. The library's decoders of the other compressions are large, old and have had vulnerabilities; although
 * decoding is sandboxed (import/decoder/decoder.h), a remote client must not be able to reach them. Every step is
 * checked against `size`, nothing is allocated, and EXR_POLICY_ATTRIBUTES bounds the time. Thread: any. */

#define EXR_POLICY_ATTRIBUTES 1024 /* maximum number of attributes in a header */

#define EXR_COMPRESSIONS 10                                       /* that OpenEXR defines */
extern const char *const exr_compression_names[EXR_COMPRESSIONS]; /* by the format's numbers */

/* A header that is being read. */
struct exr_header {
    const uint8_t *bytes; /* the whole file */
    size_t size, at;      /* at: the next attribute */
    const char *name;     /* of the file, for messages */
    struct reason *why;
};

/* [OpenEXR File Layout]: a name, a type, a length and a value, all little-endian. They point into the file. */
struct exr_entry {
    const char *name, *type; /* terminated */
    const uint8_t *value;
    size_t size;
};

/* Reads the next attribute; the caller checks for the end of the list. ERR_FORMAT: damaged or truncated. */
MUST_CHECK enum err exr_header_next(struct exr_header *h, struct exr_entry *a);

/* ERR_OK: a single-part scan-line file with no, RLE, ZIPS or ZIP compression. ERR_UNSUPPORTED: another kind of EXR
 * file, which *why names. ERR_FORMAT: not an EXR file, or its header is damaged or truncated. Does not look past the
 * header. `name` begins the message. */
MUST_CHECK enum err exr_policy_check(const uint8_t *bytes, size_t size, const char *name, struct reason *why);
