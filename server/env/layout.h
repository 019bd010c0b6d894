/* server/env/layout.h */
/* Where a direction stands in a picture of each layout, and how large each texel is, in the picture's own frame (before
 * the rotation of the environment). Texels are areas: texel (x, y) spans x..x+1 and y..y+1, counted from the top left.
 *
 * latlong   Any shape. Centre +Z, a quarter of the width to its left +X, top row +Y. latlong-bottom: upside down.
 * cube      1:6. Six square faces as OpenEXR stacks them, from the top +X, -X, +Y, -Y, +Z, -Z, each as seen from the
 *           inside. The sides stand upright: right of them is +Z, -Z (faces +X, -X) and -X, +X (faces +Z, -Z). +Y has
 *           +Z at its top edge, -Y has -Z there; +X is on the right of both.
 * hcross    4:3. The unfolded cube, seen from the inside: in the middle row +X, +Z, -X, -Z, all upright; above and
 *           below +Z the faces +Y and -Y, joined to it.
 * vcross    3:4. The same but for -Z, which stands upside down at the bottom, joined to -Y (Debevec's, HDRShop's).
 *           The other cells of a cross are not read.
 * ball      A mirror ball photographed from far along +Z: centre +Z (the camera itself), top +Y, right +X, rim -Z.
 *           All texels are equally large in solid angle.
 * fisheye   A camera that looks up: centre +Y, top +Z, right +X, and the angle from +Y grows evenly (equidistant, also
 *           called angular) to the horizon at the rim. Nothing is seen below.
 * Of ball and fisheye the image circle is the largest one about the picture's centre; what is outside is masked.
 *
 * Pure functions; any thread. */
#ifndef ENV_LAYOUT_H
#define ENV_LAYOUT_H

#include "cube.h"
#include "err.h"
#include "image.h"

#include <stdbool.h>
#include <stdint.h>

#define LAYOUT_DISC_MIN 16 /* texels across the circle of a ball or a fisheye */

/* One face of a cube in a picture: its cell, counted in faces from the top left, and the axes that point right and
 * down in it, as +-(1 + axis). */
struct layout_face {
    int8_t column, row, right, down;
};

/* The six faces, in the order of cube.h, of cube, hcross and vcross; NULL for the others. */
const struct layout_face *layout_faces(enum layout layout);
uint32_t layout_face_size(enum layout layout, uint32_t width); /* texels along an edge */

bool layout_is_disc(enum layout layout);

/* Whether a picture of that shape can be of that layout. If not, *why (which `name` begins) says what is asked for. */
MUST_CHECK enum err layout_fits(enum layout layout, uint32_t width, uint32_t height, const char *name,
                                struct reason *why);

/* The layout of a picture that does not say it: lat-long for 2:1, else ERR_UNSUPPORTED and the names that fit. */
MUST_CHECK enum err layout_guess(uint32_t width, uint32_t height, const char *name, enum layout *out,
                                 struct reason *why);

/* Where the picture shows a direction (any length but zero) and the part of it that belongs together there: texels
 * low[k] .. high[k] - 1 of each coordinate, between which it may be interpolated. */
struct layout_place {
    double x, y;
    uint32_t low[2], high[2];
    bool wraps; /* left and right border are one */
};

/* False where the layout does not show that direction (below a fisheye's horizon). */
bool layout_find(enum layout layout, uint32_t width, uint32_t height, const double w[3], struct layout_place *out);

/* The direction of a point of a ball or a fisheye, in units of the circle's radius from its centre: x to the right, y
 * down. Unit; beyond the circle that of the rim. */
void layout_disc_direction(enum layout layout, double x, double y, double w[3]);

/* Solid angle in sr of the rectangle (x0, y0) .. (x1, y1) of the picture, in texels. It must be within one face of a
 * cube; where it is masked, or in a cell of a cross that is not read, it counts nothing. Exact but for rounding; of a
 * fisheye to 1e-10 of a texel. */
double layout_solid_angle(enum layout layout, uint32_t width, uint32_t height, const double low[2],
                          const double high[2]);

/* The part of a rectangle's border (in units of the circle's radius, as above) that is inside the circle: up to four
 * straight pieces, in the order right, down, left, up. Returns how many. */
int layout_disc_border(const double low[2], const double high[2], double pieces[4][2][2]);

/* All that the layout shows: 4 pi, or 2 pi. And what it shows of a rectangle on a face of the cube map. */
double layout_shown(enum layout layout);
double layout_shown_of_face(enum layout layout, uint32_t face, double u0, double v0, double u1, double v1);

#endif
