/* Textures of glTF: each image is read once per use. Private to this room. Thread: one at a time. */
#pragma once

#include "import/formats/gltf.h"

struct gltf_known_image;

struct gltf_images { /* zeroed but for g at first */
    struct gltf *g;
    struct gltf_known_image *known;
    size_t count, room;
};

void gltf_images_finish(struct gltf_images *s); /* frees the list, not the scene's textures */

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
