/* server/scene/sheen.h */
/* The share of an even sky's light that sheen reflects [KHR_materials_sheen], as of cloth. Thread: any. */
#ifndef SCENE_SHEEN_H
#define SCENE_SHEEN_H

/* Of white sheen of this roughness (0..1; below 0.1 as 0.1), towards a direction of this cosine with the normal: the
 * integral of D V cos over the hemisphere, with D and V of [Estevez and Kulla 2017] for alpha = roughness^2; 0..1. */
float sheen_albedo(float cosine, float roughness);

#endif
