/* Images of models as textures. Thread: any. */
#pragma once

#include "import/reader/host.h"
#include "scene/surface/texture.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Decodes a PNG, JPEG, WebP or TGA image to a texture that repeats; `name` begins messages. PNG of 16 bits is rounded
 * to 8. Alpha is 1 with TEXTURE_SRGB, and in JPEG. On ERR_OK the caller owns *out (texture_finish). ERR_FORMAT.
 * ERR_RANGE: more than TEXTURE_SIDE_MAX per side or TEXTURE_TEXELS_MAX. ERR_UNSUPPORTED: another format. ERR_NOMEM. */
MUST_CHECK enum err texture_decode(const void *bytes, size_t count, enum texture_values values, const char *name,
                                   struct texture *out, struct reason *why);
/* The same from a file. Also ERR_IO. */
MUST_CHECK enum err texture_load(const struct host *host, const char *path, enum texture_values values,
                                 struct texture *out, struct reason *why);

/* TGA for texture_decode, which builds the levels: whether it may be one, as no other format begins like it, and its
 * finest level, with alpha. */
bool tga_recognise(const void *bytes, size_t count);
MUST_CHECK enum err tga_decode(const void *bytes, size_t count, enum texture_values values, const char *name,
                               struct texture *out, struct reason *why);

/* ERR_RANGE: an image of no size, or one above the limits of texture_decode. */
MUST_CHECK enum err texture_check_size(uint64_t width, uint64_t height, const char *name, struct reason *why);
