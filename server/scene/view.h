/* server/scene/view.h */
/* A camera with a picture before it: from pixels to directions, and from places back to pixels. Pixel (0, 0) is top
 * left, square; pixel (x, y) spans x..x+1 and y..y+1. Never changes after view_init; any thread. */
#ifndef SCENE_VIEW_H
#define SCENE_VIEW_H

#include "scene.h"

#include <stdbool.h>
#include <stdint.h>

struct view { /* the camera's axes, scaled so that a pixel is one step on the plane at distance 1 */
    double origin[3], corner[3], step_x[3], step_y[3];
    double ahead[3]; /* unit */
    double step;     /* m: edge of a pixel on that plane */
    uint32_t width, height;
};

void view_init(struct view *v, const struct camera *c, uint32_t width, uint32_t height);

/* The direction, unit, through (x, y) of the picture. */
struct vec3 view_direction(const struct view *v, double x, double y);

/* How a place shows. A pixel's value is the mean of radiance over its area A on the plane at distance 1, and
 * dA = cos(theta_p) dA_p / (d^2 cos^3(theta_c)): so flux Phi that arrives at p and leaves by the BRDF f adds
 * Phi f |n.w| response to it, n being the geometric normal and w the direction to the eye. */
struct projection {
    double x, y;        /* pixels */
    struct vec3 to_eye; /* unit */
    double distance;    /* m */
    double response;    /* 1 / (A d^2 cos^3 theta_c), m^-2 */
};

/* False where p is behind the eye or outside the picture. */
bool view_project(const struct view *v, struct vec3 p, struct projection *out);

#endif
