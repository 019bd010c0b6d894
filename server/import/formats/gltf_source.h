/* What readers of a glTF file's materials share. Private to this room. Thread: one at a time. */
#pragma once

#include "import/formats/gltf_textures.h"

#include <math.h>

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
