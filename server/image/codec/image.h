/* A decoded environment map: linear Rec.709 radiance, float[height][width][3], top row first. Every value is finite and
 * not negative: decoding mends and counts faults. The image owns rgb and is reused from frame to frame.
 * Thread: one at a time, unless a function says otherwise. */
#pragma once

#include "base/mem.h"
#include "base/setting.h"

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
    uint64_t nan;      /* see image_mend */
    uint64_t infinite; /* infinite: see image_mend; beyond IMAGE_MAX: became IMAGE_MAX; negative: became 0 */
    uint64_t negative; /* became 0 */
    uint64_t clipped;  /* at 65504, the largest half float: the capture may have been clipped; kept */
};

#define IMAGE_MAX_SIDE 16384                                             /* bounds memory: see IMAGE_MAX_TEXELS */
#define IMAGE_MAX_TEXELS ((size_t)IMAGE_MAX_SIDE * (IMAGE_MAX_SIDE / 2)) /* the largest 2:1 image: 1.5 GiB */
#define IMAGE_MAX 1e12f /* larger finite values are clamped, so that sums of squares stay finite in float */

#define IMAGE_EXPOSURE_MAX_S 86400.0 /* a day: a longer exposure is a mistake */

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
    int64_t taken_us;        /* when, microseconds since 1970 UTC by the file's own attributes; 0: unknown */
    double exposure_s;       /* how long the shutter was open, by the file, 0 to IMAGE_EXPOSURE_MAX_S; 0: unknown */
    bool low_range;          /* of an image that ends at white, such as a JPEG */
    const char *layer;       /* of an EXR with several; NULL or "": by meaning (decode.h); set by the owner, borrowed */
    char note[320];          /* what decoding chose, or left out of what the file says; "": nothing. Printable. */
    struct scratch *scratch; /* memory that decoders reuse (base/mem.h); NULL until used */
    struct libdeflate_decompressor *inflater; /* likewise (exr_zip.h) */
    struct recent recent;                     /* recent sizes in bytes, updated by image_trim */
};

/* Checks a size. ERR_RANGE: a side exceeds max_side, or the image has more texels than a 2:1 image of that side; *why
 * begins with `where`. */
MUST_CHECK enum err image_check_size(const struct image *im, uint64_t width, uint64_t height, const char *where,
                                     struct reason *why);
/* Allocates texels, undefined, and clears layout, faults, note and times. ERR_RANGE: a side of 0, or as
 * image_check_size. ERR_NOMEM. On failure the image is unchanged or empty. */
MUST_CHECK enum err image_resize(struct image *im, uint32_t width, uint32_t height);
/* Call once per image: frees memory that only much larger, earlier images needed (base/mem.h). Moves the texels. rgb
 * must come from mem_alloc. */
void image_trim(struct image *im);
void image_finish(struct image *im); /* frees everything; NULL and zeroed memory are allowed */

/* Corrects negative and too large values in `count` texels and adds them and all others to *faults; marks what
 * image_mend is to replace: NaN, and infinity. If to_rec709 (row-major 3x3) is not NULL, also converts the texels to
 * linear Rec.709: NaN, infinite and clipped values are counted before the conversion, where they mark their texel,
 * negative ones after it. Thread: any. */
void image_sanitise_texels(float *rgb, size_t count, const float *to_rec709, struct image_faults *faults);

/* Replaces the marks that image_sanitise_texels left in any texels of the image. Each connected area of them takes the
 * highest finite value around it, in each channel; an infinite value takes at least 65504, since it overflowed a half
 * float at least. An area of NaN above 1 % of the image is a mask and becomes black. Without marks: returns at once,
 * by the counts in im->faults. */
void image_mend(struct image *im);

/* Adds to the note; the parts are separated by "; ". */
void image_note(struct image *im, const char *format, ...) PRINTF_LIKE(2, 3);

#define IMAGE_SAID_LAST 32u /* of the bits of *said */

/* Logs what was mended, chosen or ignored, and what may clip the sun, each kind the first time that a sequence has it.
 * *said remembers the kinds; initialise it to 0. `name` is the file's. */
void image_report(const struct image *im, const char *name, unsigned *said);

/* ---- Placement ---- */

/* Turns and mirrors the image as Exif's orientation 2 to 8 says, so that the result has orientation 1; others change
 * nothing. ERR_NOMEM. */
MUST_CHECK enum err image_orient(struct image *im, unsigned orientation);

/* Exif's orientation of a video's display matrix (libavutil's: 16.16 fixed point, two columns for x and y of each
 * row); 0: it does more than turn by quarters and mirror. */
unsigned image_orientation_of(const int32_t matrix[9]);

/* Makes the image a window of width x height texels, in which its first texel lies at (left, top): what lies outside is
 * cut off, what is missing is black. ERR_RANGE: too large, or no texel lies inside. ERR_NOMEM. */
MUST_CHECK enum err image_place(struct image *im, uint32_t width, uint32_t height, int64_t left, int64_t top);

/* Takes the shape of its pixels into account, width per height: a lat-long image need not be 2:1 in pixels. */
void image_take_aspect(struct image *im, double pixel_aspect);

/* All layouts; sky/tables/layout.h defines their orientation. */
extern const struct setting_choice layout_choices[];
const char *layout_name(enum layout layout); /* static; any thread */
