/* KHR_materials_pbrSpecularGlossiness as metallic-roughness. Private to this room. Thread: one at a time. */
#pragma once

#include "import/formats/gltf_source.h"

/* Reads the material whose extension `at` is; m has its alpha_mode. Factors alone become a metal where the diffuse
 * colour is black, else a dielectric with this F0. A specular-glossiness texture makes two textures of the scene, once
 * for all materials with the same textures and factors: base colour and metallic-roughness, texel by texel, as large
 * as the larger of the two. With other coordinates than the diffuse texture it counts by its means, with a warning.
 * ERR_FORMAT, ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err gltf_read_glossy(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                                     struct gltf_surface *surface);

struct glossy_texel { /* of the conversion, all 0..1 and linear */
    float base[3], metallic, roughness;
};

/* The metallic-roughness values that reflect the same: base and metallic solve
 *     0.96 (1 - metallic) base = diffuse (1 - max specular),    0.04 (1 - metallic) + metallic base = specular
 * for the luminance, where specular is at least 0.04; then base is the least-squares solution per channel. */
void glossy_convert(const float diffuse[3], const float specular[3], float glossiness, struct glossy_texel *out);
