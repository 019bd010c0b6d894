/* A decoded environment map: linear Rec.709 radiance, float[height][width][3], top row first. Every value is finite and
 * not negative: decoding sanitises and counts faults. The image owns rgb and is reused from frame to frame.
 * Thread: one at a time, unless a function says otherwise. */
#pragma once

#include "base/choice.h"
#include "base/recent.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum layout {
    LAYOUT_AUTO, /* EXR's envmap attribute if present, else 2:1 means lat-long */
    LAYOUT_LATLONG,
    LAYOUT_LATLONG_BOTTOM_FIRST, /* rows from the bottom up, as in [Scotty3D] */
    LAYOUT_CUBE,                 /* OpenEXR's cube map: six stacked faces, 1:6 */
    LAYOUT_HCROSS,               /* horizontal cross, 4:3 */
    LAYOUT_VCROSS,               /* vertical cross, 3:4 */
    LAYOUT_BALL,                 /* photograph of a mirror ball */
    LAYOUT_FISHEYE,              /* equidistant, one hemisphere, camera pointing up */
    LAYOUT_CUBE_3X2,             /* video's cube map, 3:2: right, left, up above down, front, back */
    LAYOUT_CUBE_6X1,             /* the same six faces in one row, 6:1 */
    LAYOUT_LAST = LAYOUT_CUBE_6X1,
};

struct image_faults {  /* values (not texels) of this frame that were corrected */
    uint64_t nan;      /* became 0 */
    uint64_t infinite; /* infinite or beyond IMAGE_MAX: became IMAGE_MAX, or 0 if negative */
    uint64_t negative; /* became 0 */
    uint64_t clipped;  /* at 65504, the largest half float: the capture may have been clipped; kept */
};

#define IMAGE_MAX_SIDE 16384                                             /* bounds memory: see IMAGE_MAX_TEXELS */
#define IMAGE_MAX_TEXELS ((size_t)IMAGE_MAX_SIDE * (IMAGE_MAX_SIDE / 2)) /* the largest 2:1 image: 1.5 GiB */
#define IMAGE_MAX 1e12f /* larger finite values are clamped, so that sums of squares stay finite in float */

struct scratch;
struct libdeflate_decompressor;

struct image {
    uint32_t width, height;
    uint32_t max_side; /* larger images are rejected; set by the owner; 0: IMAGE_MAX_SIDE */
    bool middle;       /* read an .hdr's mantissa m as (m + 1/2) / 256, as Radiance's programs do; set by the owner */
    float *rgb;
    size_t capacity;    /* floats allocated for rgb */
    enum layout layout; /* the file's own layout; LAYOUT_AUTO if it has none */
    struct image_faults faults;
    bool low_range;                           /* of an image that ends at white, such as a JPEG */
    struct scratch *scratch;                  /* memory that decoders reuse (base/scratch.h); NULL until used */
    struct libdeflate_decompressor *inflater; /* likewise (exr_zip.h) */
    struct recent recent;                     /* recent sizes in bytes, updated by image_trim */
};

/* Checks a size. ERR_RANGE: a side exceeds max_side, or the image has more texels than a 2:1 image of that side; *why
 * begins with `where`. */
MUST_CHECK enum err image_check_size(const struct image *im, uint64_t width, uint64_t height, const char *where,
                                     struct reason *why);
/* Allocates texels, undefined, and clears layout and faults. ERR_RANGE: a side of 0, or as image_check_size. ERR_NOMEM.
 * On failure the image is unchanged or empty. */
MUST_CHECK enum err image_resize(struct image *im, uint32_t width, uint32_t height);
/* Call once per image: frees memory that only much larger, earlier images needed (base/recent.h). Moves the texels. rgb
 * must come from mem_alloc. */
void image_trim(struct image *im);
void image_finish(struct image *im); /* frees everything; NULL and zeroed memory are allowed */

/* Corrects NaN, infinite, negative and too large values in `count` texels and adds them to *faults. If to_rec709
 * (row-major 3x3) is not NULL, also converts the texels to linear Rec.709: NaN, infinite and clipped values are counted
 * before the conversion, negative ones after it. Thread: any. */
void image_sanitise_texels(float *rgb, size_t count, const float *to_rec709, struct image_faults *faults);

/* All layouts; sky/tables/layout.h defines their orientation. */
extern const struct setting_choice layout_choices[];
const char *layout_name(enum layout layout); /* static; any thread */
