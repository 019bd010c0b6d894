/* What readers of a glTF file's materials share. Private to this room. Thread: one at a time. */
#pragma once

#include "import/formats/gltf.h"

#include <math.h>

/* ---- Textures ---- */

/* Textures of glTF: each image is read once per use. Private to this room. Thread: one at a time. */

struct gltf_known_image;

struct gltf_images { /* zeroed but for g at first */
    struct gltf *g;
    struct gltf_known_image *known; /* the caller frees the list, not the scene's textures */
    size_t count, room;
};

struct gltf_numbers { /* a texture of numbers: TEXTURE_LINEAR */
    bool found;       /* false: it cannot be read; the rest is zero, and a warning was logged */
    uint32_t texture; /* of the scene; MATERIAL_NO_TEXTURE: uniform, the means say it all */
    float mean[4];    /* of the channels, 0..1 */
    struct gltf_surface surface;
};

/* Reads the texture of colours that `at` names; *index is MATERIAL_NO_TEXTURE if it cannot be read, which costs a
 * warning. Else sets *surface. ERR_FORMAT, ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err gltf_texture_colours(struct gltf_images *s, const struct gltf_at *at, enum texture_values values,
                                         uint32_t *index, struct gltf_surface *surface);

/* The same for numbers. channels: those that count, bit 0 for red, where a uniform texture is as good as its means; 0:
 * it never is. If only alpha counts, the scene's texture has it in each channel. instead: what happens without the
 * image, for the warning; static text. */
MUST_CHECK enum err gltf_texture_numbers(struct gltf_images *s, const struct gltf_at *at, unsigned channels,
                                         const char *instead, struct gltf_numbers *out);

struct gltf_image {         /* an image by itself, sRGB with alpha */
    size_t index;           /* of the texture in the file */
    struct texture texture; /* without texels: it cannot be read, and a warning was logged */
    enum texture_wrap wrap_u, wrap_v;
    struct gltf_surface surface;
};

/* Decodes the texture that `at` names without adding it to the scene; free out->texture with texture_finish. instead:
 * as above. ERR_FORMAT, ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err gltf_texture_image(struct gltf_images *s, const struct gltf_at *at, const char *instead,
                                       struct gltf_image *out);

/* ---- The source ---- */

struct glossy_known;

#define GREY 0.5f /* in place of a texture that cannot be opened */

struct gltf_source {
    struct gltf *g;
    struct gltf_images images;
    struct gltf_note unlit, notes[FEATURE_COUNT];
    size_t material;             /* being read */
    struct glossy_known *glossy; /* what specular-glossiness textures have become */
    size_t glossy_count, glossy_room;
};

static inline float largest(struct vec3 v)
{
    return fmaxf(v.x, fmaxf(v.y, v.z));
}

/* A number from 0 to 1; others become the nearest. ERR_FORMAT: not a number. */
MUST_CHECK enum err gltf_share(struct gltf_source *s, const struct gltf_at *at, const char *key, double fallback,
                               float *out);

/* A colour whose first three of `count` numbers matter, likewise. */
MUST_CHECK enum err gltf_colour(struct gltf_source *s, const struct gltf_at *at, const char *key, size_t count,
                                double fallback, struct vec3 *out);

/* The texture of the base colour and of alpha, at the key of an object; the surfaces are grey, with a warning, if it
 * cannot be read. m has its alpha_mode. ERR_FORMAT, ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err gltf_read_base_texture(struct gltf_source *s, const struct gltf_at *above, const char *key,
                                           struct material *m, struct gltf_surface *surface);

/* Whether a texture can have one of the two sets of texture coordinates of the material's meshes, which the first
 * textures choose, or if it is one of `maps`, some that are affine in one: then m->moved_by says so. surface[2]. */
bool gltf_place_texture(struct gltf_source *s, struct material *m, enum material_map map, struct gltf_surface *surface,
                        const struct gltf_surface *own);

/* KHR_materials_clearcoat. Its normal is that of the mesh, or of the surface's normal map if it names the same.
 * ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err gltf_read_coat(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                                   struct gltf_surface *surface);

/* KHR_materials_sheen, of the material `at`. ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err gltf_read_sheen(struct gltf_source *s, const struct gltf_at *at, struct material *m,
                                    struct gltf_surface *surface);

/* ---- Glossiness ---- */

/* KHR_materials_pbrSpecularGlossiness as metallic-roughness. Private to this room. Thread: one at a time. */

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
