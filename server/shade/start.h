/* server/shade/start.h */
/* Where light paths from the environment begin [DH09, section 3]: for one direction, a line that light travels along,
 * drawn from those that meet given boxes. The density is per square metre perpendicular to the direction.
 *
 * Several boxes make one mixture: a box is chosen in proportion to the area of its shape, the place within it evenly,
 * so that p = (shapes that the line crosses) / (sum of their areas). Every line that meets a box can be drawn.
 * Pure functions; any thread. */
#ifndef SHADE_START_H
#define SHADE_START_H

#include "scene.h"
#include "vec.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum start_kind {
    START_FACES, /* the visible faces of a box, by projected area: its silhouette and nothing else */
    START_QUAD,  /* the rectangle of least area around the projected box [DH09, Fig. 3] */
    START_DISC,  /* the projected bounding sphere [Pharr and Humphreys 2004, section 14.2] */
};

#define START_BOXES_MAX 32

struct start_shape {
    double centre[3], half[3]; /* of the box */
    double face[3];            /* START_FACES: projected area of the visible face across each axis */
    double side[2][3];         /* START_QUAD: two unit vectors */
    double reach[2];           /* START_QUAD: half the edges along them; START_DISC: the radius */
};

struct start { /* all that holds for one direction */
    enum start_kind kind;
    double along[3]; /* unit, where light travels to */
    double area;     /* m^2, sum over the shapes */
    double low[3], high[3];
    uint32_t count;
    double areas[START_BOXES_MAX]; /* m^2, perpendicular to the direction */
    struct start_shape shapes[START_BOXES_MAX];
};

/* boxes: 1..START_BOXES_MAX, flat ones too. bounds: the scene's, which all boxes are in. along: unit. */
void start_init(struct start *s, enum start_kind kind, const struct box *boxes, uint32_t count,
                const struct box *bounds, struct vec3 along);

/* From x in [0, 1)^2 a point of a line along `along`, before the scene's bounds so that whatever is in the way is met.
 * False when there is nothing to be met: the line misses the bounds (*density is set), or no shape has an area. */
bool start_sample(const struct start *s, const double x[2], struct vec3 *origin, double *density);

/* The density of the line through p, m^-2; 0 where it cannot be drawn. */
double start_density(const struct start *s, const double p[3]);

/* Makes at most START_BOXES_MAX boxes of any number, by joining those whose common box has the least surface more than
 * they have by themselves; in place. Returns how many are left. */
uint32_t start_join(struct box *boxes, size_t count);

#endif
