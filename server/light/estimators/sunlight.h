/* The sun's disc alone, without reflections: which share of it do points see, and for how long? Rays spread over the
 * disc; panes of thin glass weight each by their transmittance. Thread: one; all OpenMP threads are used. */
#pragma once

#include "base/progress.h"
#include "base/vec.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"

#include <math.h>
#include <stddef.h>

/* The share 0..1 of the disc's light, for luminance, that a point with this normal receives: sixteen rays. 0 from
 * behind and below the horizon. sun: unit, towards the disc's centre. One thread. */
double sunlight_share(const struct scene *scene, const struct rays *rays, const struct sensor *at, const double sun[3]);

/* The illuminance of sensors, as annual sunlight exposure requires. normal_lux: the sun's at normal incidence. lux:
 * [count]. */
void sunlight_lux(const struct scene *scene, const struct rays *rays, const struct sensor *sensors, size_t count,
                  const double sun[3], double normal_lux, float *lux);

/* A part of the sun's way. */
struct sun_step {
    float from[3], to[3]; /* unit */
    float hours;          /* that it takes; more if it is gone along more often */
};

/* Adds up how long each shading point sees the sun: hours[packet_count][16]. Each point looks once in each step, at a
 * moment and towards a place of the disc of its own: unbiased but for the chord between the ends of a step. */
void sunlight_hours(const struct gbuffer *g, const struct rays *rays, const struct sun_step *steps, size_t count,
                    struct progress *line, float *hours);

/* ---- Places on a disc ---- */

/* Vogel's spiral: sample points that divide a disc into equal areas. Thread: any. */

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
