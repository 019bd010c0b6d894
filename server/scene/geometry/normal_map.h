/* Normal maps [glTF 2.0, section 3.9.3]. Thread: any. */
#pragma once

#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"

/* Applies the material's normal map to at->shading, as set by rays_surface; normals are averaged over the footprint. A
 * normal that would face behind the triangle is tilted until it no longer does. Does nothing if the mesh has no
 * tangents. uv_step: see scatter_of. */
void normal_map_turn(const struct scene *scene, const struct hit *h, const float (*uv_step)[2], struct surface *at);
