/* Vogel's spiral: sample points that divide a disc into equal areas. Thread: any. */
#pragma once

#include "base/vec.h"

#include <math.h>

/* Place k of `count` on the disc with this radius about the origin, perpendicular to the unit vector w; *r: its
 * distance. */
static inline struct vec3 spiral_place(struct vec3 w, double radius, int k, int count, double *r)
{
    const struct vec3 side = fabsf(w.y) < 0.9f ? vec3_make(0.0f, 1.0f, 0.0f) : vec3_make(1.0f, 0.0f, 0.0f);
    const struct vec3 u = vec3_normalize(vec3_cross(side, w)), v = vec3_cross(w, u);
    const double turn = 2.399963229728653 * k;

    *r = radius * sqrt((k + 0.5) / count);
    return vec3_add(vec3_scale(u, (float)(*r * cos(turn))), vec3_scale(v, (float)(*r * sin(turn))));
}
