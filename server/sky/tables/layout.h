/* The mapping between directions and texels for each layout, and the solid angles of texels, in the image's own frame
 * (before the environment's rotation). Texels are areas: texel (x, y) spans x..x+1 and y..y+1, from the top left.
 *
 * latlong   Any aspect. Centre +Z, a quarter of the width to its left +X, top row +Y. latlong-bottom: flipped.
 * cube      1:6. Six square faces as OpenEXR stacks them, from the top +X, -X, +Y, -Y, +Z, -Z, each seen from inside.
 *           Side faces are upright; their right edge is +Z, -Z (faces +X, -X) and -X, +X (faces +Z, -Z). +Y has +Z at
 *           its top edge, -Y has -Z there; +X is on the right of both.
 * hcross    4:3. The unfolded cube, seen from inside: the middle row is +X, +Z, -X, -Z, all upright; above and below
 *           +Z are the faces +Y and -Y, joined to it.
 * vcross    3:4. The same except -Z, which is upside down at the bottom, joined to -Y (as in Debevec's HDRShop).
 *           The other cells of a cross are ignored.
 * cube-3x2  3:2. As video's cube maps are stored: in the upper row the faces right (-X), left (+X) and up, in the lower
 *           one down, front (+Z) and back, all oriented as in hcross. cube-6x1: the same six in one row.
 * ball      A mirror ball photographed from far along +Z: centre +Z (the camera itself), top +Y, right +X, rim -Z.
 *           All texels have the same solid angle.
 * fisheye   A camera that points up: centre +Y, top +Z, right +X; the radius is proportional to the angle from +Y
 *           (equidistant, also called angular) up to the horizon at the rim. The lower hemisphere is not covered.
 * The image circle of ball and fisheye is the largest centred one; everything outside is masked.
 *
 * Thread: any. */
#pragma once

#include "base/err.h"
#include "image/codec/image.h"
#include "sky/tables/cube.h"

#include <stdbool.h>
#include <stdint.h>

#define LAYOUT_DISC_MIN 16 /* minimum diameter of the circle of a ball or a fisheye, texels */

/* A cube face within an image: its cell, in faces from the top left, and the axes that point right and down, as +-(1 +
 * axis). */
struct layout_face {
    int8_t column, row, right, down;
};

/* The six faces in the order of cube.h for layouts of cube faces; NULL for others. */
const struct layout_face *layout_faces(enum layout layout);
uint32_t layout_face_size(enum layout layout, uint32_t width); /* texels along an edge */

bool layout_is_disc(enum layout layout); /* ball or fisheye */

/* Checks that an image of this size can have this layout. ERR_UNSUPPORTED: *why begins with `name` and says what is
 * required. */
MUST_CHECK enum err layout_fits(enum layout layout, uint32_t width, uint32_t height, const char *name,
                                struct reason *why);

/* The layout of an image without a declared one: lat-long for 2:1, else ERR_UNSUPPORTED, naming the layouts that fit.
 */
MUST_CHECK enum err layout_guess(uint32_t width, uint32_t height, const char *name, enum layout *out,
                                 struct reason *why);

/* The position of a direction (nonzero) in an image, and the contiguous part around it within which to interpolate:
 * texels low[k] .. high[k] - 1 of each coordinate. */
struct layout_place {
    double x, y;
    uint32_t low[2], high[2];
    bool wraps; /* the left and right borders are adjacent */
};

/* False if the layout does not cover the direction (below a fisheye's horizon). */
bool layout_find(enum layout layout, uint32_t width, uint32_t height, const double w[3], struct layout_place *out);

/* The direction (unit) of a point of a ball or a fisheye, in radii from the centre: x to the right, y down. Points
 * outside the circle map to the rim. */
void layout_disc_direction(enum layout layout, double x, double y, double w[3]);

/* Solid angle, sr, of the rectangle (x0, y0) .. (x1, y1) of the image, in texels. Must lie within one face of a cube.
 * Masked parts and ignored cells count 0. Exact up to rounding; for a fisheye to 1e-10 of a texel. */
double layout_solid_angle(enum layout layout, uint32_t width, uint32_t height, const double low[2],
                          const double high[2]);

/* Clips the border of a rectangle (in radii, as above) to the circle: up to four straight pieces in the order right,
 * down, left, up. Returns their number. */
int layout_disc_border(const double low[2], const double high[2], double pieces[4][2][2]);

double layout_shown(enum layout layout); /* covered solid angle: 4 pi or 2 pi, sr */

/* The covered solid angle, sr, of a rectangle on a face of the cube map. */
double layout_shown_of_face(enum layout layout, uint32_t face, double u0, double v0, double u1, double v1);
