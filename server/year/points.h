/* The points of measurement (sensors): read from a file or laid out as a grid over a surface. Thread: any, on
 * separate objects. */
#pragma once

#include "base/err.h"
#include "base/vec.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"

#include <stdbool.h>
#include <stddef.h>

#define POINTS_MAX 20000 /* bounds the memory of a year */

struct points {
    struct sensor *at;
    size_t count, capacity;
    double spacing; /* m, of a grid; of others the median distance to the nearest neighbour; 0: a single point */
};

/* Reads --sensors: a file with a line `x y z nx ny nz` for each point, in metres in the scene's axes (# begins a
 * comment), or "grid:NAME,spacing=0.5,height=0.8,margin=0": a grid over the surface of that name, `height` above it
 * along its normal and at least `margin` inside its rectangle. The caller frees *out with points_finish. ERR_IO;
 * ERR_FORMAT names the line; ERR_USAGE: no such surface (the names are listed), or none of the grid's points lies over
 * it; ERR_RANGE: more than POINTS_MAX; ERR_NOMEM. */
MUST_CHECK enum err points_read(const char *spec, const struct scene *scene, struct points *out, struct reason *why);
void points_finish(struct points *p); /* zeroed memory is allowed */

/* The number of points that seem to lie within a solid: of 64 rays into their hemisphere none escapes or meets glass,
 * and a quarter meets the back of a surface; others may meet the front of a solid that touches this one. *first: the
 * first of them. The cache's light is meaningless there: its records may cover both sides of a thin wall. */
size_t points_enclosed(const struct points *p, const struct scene *scene, const struct rays *rays, size_t *first);
