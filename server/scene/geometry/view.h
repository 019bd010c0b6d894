/* A camera's view: from pixels to directions, and from points to pixels. Pixel (0, 0) is at the top left, square; pixel
 * (x, y) spans x..x+1 and y..y+1. A fisheye's image is a circle, as high as the image; a point at distance r pixels
 * from the centre shows the angle t to the viewing direction:
 *     equidistant: t = step r        equisolid: sin(t/2) = step r / 2
 * Immutable after view_init. Thread: any. */
#pragma once

#include "scene/geometry/scene.h"

#include <stdbool.h>
#include <stdint.h>

struct view { /* the camera's axes, scaled to one pixel on the plane at distance 1, or by a fisheye's step */
    double origin[3], corner[3], step_x[3], step_y[3];
    double ahead[3]; /* unit */
    double step;     /* m: edge of a pixel on that plane; of a fisheye radians, in the middle */
    uint32_t width, height;
    enum camera_projection projection;
    double half_angle; /* of a fisheye's circle, radians */
};

/* The view of camera c with an image of width x height pixels. */
void view_init(struct view *v, const struct camera *c, uint32_t width, uint32_t height);

/* The unit direction through (x, y) of the image; ahead, where nothing is seen. */
struct vec3 view_direction(const struct view *v, double x, double y);

/* The unit direction in which the image's x grows there. */
struct vec3 view_right(const struct view *v, double x, double y);

/* Whether (x, y) of the image shows anything: not outside a fisheye's circle. */
bool view_sees(const struct view *v, double x, double y);

/* Where ray i of the side^2 of a pixel goes, in pixels from its upper left corner: one to each cell of a grid, to each
 * of side^2 columns and to each of side^2 rows, so that of an upright or level edge half a ray is missed at most. */
void view_ray_in_pixel(uint32_t i, uint32_t side, double out[2]);

/* The solid angle of a pixel in unit direction w, sr. */
double view_solid_angle(const struct view *v, struct vec3 w);

/* The projection of a point. A pixel's value is the mean radiance over its area A on the plane at distance 1, and dA =
 * cos(theta_p) dA_p / (d^2 cos^3(theta_c)): flux Phi that arrives at p and leaves by BRDF f adds Phi f |n.w| response,
 * with n the geometric normal and w the direction to the camera. In general response is 1 / (d^2 W), with the pixel's
 * solid angle W. */
struct projection {
    double x, y;        /* pixels */
    struct vec3 to_eye; /* unit */
    double distance;    /* m */
    double response;    /* 1 / (A d^2 cos^3 theta_c), m^-2 */
};

/* False if p is behind the camera or outside the image. */
bool view_project(const struct view *v, struct vec3 p, struct projection *out);
