/* Scattering at the hit of a ray: scatter.h, at a surface of the scene. Thread: any. */
#pragma once

#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "scene/surface/scatter.h"

/* Evaluates the material at the hit of a camera path. dir: direction of the ray, unit; h->t: its length, m. Where light
 * from both sides counts, or there is a coat, chooses one side or layer, with a hash of the ray as the random
 * number. */
void scatter_at(const struct scene *scene, const struct rays *rays, const struct hit *h, struct vec3 dir,
                struct scatter *out);
/* As scatter_at, for a light path: out->surface stays on the side of the light, which is the ray's. */
void scatter_light_at(const struct scene *scene, const struct rays *rays, const struct hit *h, struct vec3 dir,
                      struct scatter *out);

/* As scatter_at, with out->surface already filled. uv_step[4]: the two edges of the area over which textures are
 * averaged, in the mesh's first texture coordinates, then in its second; NULL: no averaging. */
void scatter_on(const struct scene *scene, const struct hit *h, const float (*uv_step)[2], struct scatter *out);

/* ---- Normal maps ---- */

/* Normal maps [glTF 2.0, section 3.9.3]. Thread: any. */

/* Applies the material's normal map to at->shading, as set by rays_surface; normals are averaged over the footprint. A
 * normal that would face behind the triangle is tilted until it no longer does. Does nothing if the mesh has no
 * tangents. uv_step: see scatter_of. */
void normal_map_turn(const struct scene *scene, const struct hit *h, const float (*uv_step)[2], struct surface *at);
