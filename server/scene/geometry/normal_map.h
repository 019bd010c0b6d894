/* Normal maps [glTF 2.0, section 3.9.3]. Thread: any. */
#pragma once

#include "scene/geometry/rays.h"
#include "scene/geometry/scatter.h"
#include "scene/geometry/scene.h"

/* Applies the material's normal map to at->shading, as set by rays_surface; normals are averaged over the footprint. A
 * normal that would face behind the triangle is tilted until it no longer does. Does nothing if the mesh has no
 * tangents. uv_step: see scatter_on. */
void normal_map_turn(const struct scene *scene, const struct hit *h, const float (*uv_step)[2], struct surface *at);

/* Factor for the matte part under a normal map. Of the light that the matte part would reflect by the cosine with its
 * shading normal, the triangle hides the part from below: x = (1 - cos) / 2 of a uniform sky, by the angle between the
 * two normals. The factor 1 / (1 - x) restores it, so that a white surface under a uniform sky stays white. The matte
 * part of ggx loses less, since little of that light enters it: at least x - 0.0137. The loss of a specular lobe is not
 * restored. */
float normal_map_gain(enum lobe_kind kind, const struct surface *at);
