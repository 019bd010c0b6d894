/* server/env/image.h */
/* One decoded environment picture: linear Rec.709 radiance, float[height][width][3], rows top to bottom.
 * Every value is finite and not negative: decoding sanitises and counts. An image is reused from frame to frame. */
#ifndef ENV_IMAGE_H
#define ENV_IMAGE_H

#include "err.h"
#include "recent.h"

#include <stddef.h>
#include <stdint.h>

enum layout {
    LAYOUT_AUTO, /* EXR's envmap attribute if there is one, else 2:1 means lat-long */
    LAYOUT_LATLONG,
    LAYOUT_LATLONG_BOTTOM_FIRST, /* rows counted from the bottom, as in [Scotty3D] */
    LAYOUT_CUBE,                 /* OpenEXR's cube: six faces stacked, 1:6 */
    LAYOUT_HCROSS,               /* horizontal cross, 4:3 */
    LAYOUT_VCROSS,               /* vertical cross, 3:4 */
    LAYOUT_BALL,                 /* photograph of a mirror ball */
    LAYOUT_FISHEYE,              /* equidistant, one hemisphere, looking up */
};

struct image_faults {  /* values (not texels) that were put right, of this frame */
    uint64_t nan;      /* became 0 */
    uint64_t infinite; /* infinite, or beyond IMAGE_MAX: became IMAGE_MAX, or 0 below 0 */
    uint64_t negative; /* became 0 */
    uint64_t clipped;  /* stand at 65504, a half float's largest: the capture may have been cut off; kept */
};

#define IMAGE_MAX_SIDE 16384
#define IMAGE_MAX_TEXELS ((size_t)IMAGE_MAX_SIDE * (IMAGE_MAX_SIDE / 2)) /* the largest 2:1 picture: 1.5 GiB */
#define IMAGE_MAX 1e12f /* larger finite values are cut here: sums of squares stay finite in float */

struct scratch;
struct libdeflate_decompressor;

struct image {
    uint32_t width, height;
    uint32_t most_side; /* what is larger is not read: the owner's to set, 0: IMAGE_MAX_SIDE */
    float *rgb;
    size_t capacity;    /* floats that rgb has room for */
    enum layout layout; /* what the file itself says; LAYOUT_AUTO when it says nothing */
    struct image_faults faults;
    struct scratch *scratch; /* what decoders keep from one picture to the next (scratch.h); NULL until there is one */
    struct libdeflate_decompressor *inflater; /* likewise (exr_zip.h) */
    struct recent recent;                     /* bytes that pictures took, as image_trim was told */
};

/* ERR_RANGE beyond most_side, or beyond the texels of a 2:1 picture with such a side: *why begins with `where`. */
MUST_CHECK enum err image_check_size(const struct image *im, uint64_t width, uint64_t height, const char *where,
                                     struct reason *why);
/* Makes room, with no layout and no faults; the texels are undefined afterwards. ERR_RANGE at 0 and where
 * image_check_size says so; ERR_NOMEM. On failure the image is as before, or empty. */
MUST_CHECK enum err image_resize(struct image *im, uint32_t width, uint32_t height);
/* Once for each picture that is held: room that only much larger ones before it have needed goes back (recent.h). The
 * texels stay, at another place. Only where rgb is of mem_alloc. */
void image_trim(struct image *im);
void image_finish(struct image *im); /* NULL and zeroed memory are allowed */

/* Puts NaN, infinite, negative and too large values right and counts them into im->faults (which it first clears). */
void image_sanitise(struct image *im);

/* The same for `count` texels anywhere, adding to *faults. With to_rec709 (row-major 3x3, NULL: none) they are brought
 * to linear Rec.709 on the way: NaN, infinite and clipped values are counted as they were read, negative ones as they
 * came out. Any thread. */
void image_sanitise_texels(float *rgb, size_t count, const float *to_rec709, struct image_faults *faults);

/* "auto", "latlong", "latlong-bottom", "cube", "hcross", "vcross", "ball" or "fisheye"; LAYOUT_AUTO and ERR_USAGE for
 * anything else. Which way each looks is in layout.h. */
MUST_CHECK enum err layout_parse(const char *name, enum layout *out, struct reason *why);
const char *layout_name(enum layout layout);

#endif
