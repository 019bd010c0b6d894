/* server/scene/normal_map.h */
/* Normal maps [glTF 2.0, section 3.9.3]. Thread: any. */
#ifndef SCENE_NORMAL_MAP_H
#define SCENE_NORMAL_MAP_H

#include "scene/rays.h"
#include "scene/scatter.h"
#include "scene/scene.h"

/* Turns at->shading, as rays_surface has set it, by the normal map of the material at a hit; a map's normals are
 * averaged over the footprint. A result that would face behind the triangle is turned until it no longer does. Nothing
 * where the mesh has no tangents. uv_step: see scatter_on. */
void normal_map_turn(const struct scene *scene, const struct hit *h, const float (*uv_step)[2], struct surface *at);

/* What the matte part is multiplied by below such a normal. Of the light that it would reflect by the cosine about its
 * normal, the triangle hides what comes from below: x = (1 - cos) / 2 of an even sky, by the angle of the two normals.
 * 1 / (1 - x) brings it back: a white surface under an even sky stays white. The matte part of ggx loses less, since
 * little of that light enters it: at least x - 0.0137. What a specular lobe loses is lost. */
float normal_map_gain(enum lobe_kind kind, const struct surface *at);

#endif
