/* The albedo of sheen [KHR_materials_sheen], as of cloth, under a uniform sky. Thread: any. */
#pragma once

/* The directional albedo of white sheen with this roughness (0..1; below 0.1 as 0.1) for a direction with this cosine
 * to the normal: the integral of D V cos over the hemisphere, with D and V of [Estevez and Kulla 2017] for alpha =
 * roughness^2; 0..1. */
float sheen_albedo(float cosine, float roughness);
