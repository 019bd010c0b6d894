/* Where light paths from the environment start [DH09, section 3]: for a direction, samples a line of light that hits
 * given boxes. The density is per square metre perpendicular to the direction.
 *
 * Several boxes form a mixture: a box is selected in proportion to the area of its shape, a position in it uniformly,
 * so that p = (number of shapes that the line crosses) / (sum of their areas). Every line that hits a box is possible.
 * Thread: any. */
#pragma once

#include "base/vec.h"
#include "scene/geometry/scene.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum start_kind {
    START_FACES, /* the visible faces of a box, by projected area: exactly its silhouette */
    START_QUAD,  /* the minimum-area rectangle around the projected box [DH09, Fig. 3] */
    START_DISC,  /* the projected bounding sphere [Pharr and Humphreys 2004, section 14.2] */
};

#define START_BOXES_MAX 32 /* bounds arrays on the stack: start_join joins the others */

struct start_shape {
    double centre[3], half[3]; /* of the box */
    double face[3];            /* START_FACES: projected area of the visible face per axis */
    double side[2][3];         /* START_QUAD: two unit vectors */
    double reach[2];           /* START_QUAD: half the edges along them; START_DISC: the radius */
};

struct start { /* the setup for one direction */
    enum start_kind kind;
    double along[3]; /* unit, the direction in which light travels */
    double area;     /* m^2, total of the shapes */
    double low[3], high[3];
    uint32_t count;
    double areas[START_BOXES_MAX]; /* m^2, perpendicular to the direction */
    struct start_shape shapes[START_BOXES_MAX];
};

/* Sets up a direction. boxes: 1..START_BOXES_MAX, possibly flat. bounds: the scene's, which contains all boxes. along:
 * unit. */
void start_init(struct start *s, enum start_kind kind, const struct box *boxes, uint32_t count,
                const struct box *bounds, struct vec3 along);

/* Samples a line along `along` from x in [0, 1)^2 and returns a point on it outside the scene's bounds, so that the ray
 * hits any occluder. False if there is nothing to hit: the line misses the bounds (*density is set), or no shape has an
 * area. */
bool start_sample(const struct start *s, const double x[2], struct vec3 *origin, double *density);

/* Reduces the boxes, in place, to at most START_BOXES_MAX by joining the pairs whose common box adds the least surface
 * area. Returns the number left. */
uint32_t start_join(struct box *boxes, size_t count);
