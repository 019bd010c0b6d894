/* Images on surfaces: 8 bits per channel, with a pyramid of smaller ones for distant surfaces. Immutable once built.
 * Thread: any. */
#pragma once

#include "base/err.h"
#include "base/vec.h"

#include <stddef.h>
#include <stdint.h>

#define TEXTURE_SIDE_MAX 16384 /* texels */
#define TEXTURE_TEXELS_MAX (UINT64_C(1) << 26)

enum texture_values {                 /* what the bytes mean; alpha is always a / 255 */
                      TEXTURE_SRGB,   /* colours, decoded to linear Rec.709 */
                      TEXTURE_CUTOUT, /* the same; alpha says how much of a texel is surface, so smaller levels weight
                                         colours by it */
                      TEXTURE_LINEAR, /* numbers: v / 255 */
};

enum texture_wrap { /* beyond the image's edge */
                    TEXTURE_REPEAT,
                    TEXTURE_CLAMP,
                    TEXTURE_MIRROR,
};

struct texture {
    uint32_t width, height;
    enum texture_values values;
    enum texture_wrap wrap_u, wrap_v;
    uint32_t left_out; /* levels finer than the finest here that its file has */
    uint8_t *texels;   /* RGBA, top row first; all levels, the finest first, down to 1 x 1: see texture_level_side */
};

/* The width or height of a level; 0 is the finest, of `side` texels. Each level is half as wide and high as the one
 * before, rounded down, at least 1. */
static inline uint32_t texture_level_side(uint32_t side, uint32_t level)
{
    return side >> level ? side >> level : 1;
}

uint32_t texture_level_count(uint32_t width, uint32_t height); /* down to 1 x 1 */

/* Texels of all levels: a third more than of the finest. */
uint64_t texture_texel_count(uint32_t width, uint32_t height);

/* Allocates texels for a width and height within the limits above; they are uninitialised. ERR_NOMEM. Free with
 * texture_finish. */
MUST_CHECK enum err texture_init(struct texture *t, uint32_t width, uint32_t height, enum texture_values values);
void texture_finish(struct texture *t); /* zeroed memory is allowed */

/* Computes all levels from the finest. A level's texel is the mean, in linear light, of the area that it covers. */
void texture_build_levels(struct texture *t);

/* Leaves out the finest level, of more than 1 x 1, and frees its memory. ERR_NOMEM: nothing has changed. */
MUST_CHECK enum err texture_coarsen(struct texture *t);

/* Bilinear lookup at the finest level; u to the right, v upwards. */
struct vec3 texture_lookup(const struct texture *t, float u, float v);
float texture_alpha(const struct texture *t, float u, float v); /* 0..1 */

/* Mean over a parallelogram about (u, v) with edges step[0] and step[1], both as (du, dv). */
struct vec3 texture_filter(const struct texture *t, float u, float v, const float step[2][2]);
float texture_filter_alpha(const struct texture *t, float u, float v, const float step[2][2]); /* 0..1 */

/* texture_filter, or texture_lookup where step is NULL. */
static inline struct vec3 texture_read(const struct texture *t, const float uv[2], const float (*step)[2])
{
    return step ? texture_filter(t, uv[0], uv[1], step) : texture_lookup(t, uv[0], uv[1]);
}

/* The smallest and largest alpha of any texel, 0..1. */
void texture_alpha_limits(const struct texture *t, float *low, float *high);

/* Bounds of mean alphas about (u, v), out to at least `width` texels of the finest level in each direction: *low is 1
 * if alpha is 1 everywhere there, *high is 0 if it is 0 everywhere. */
void texture_alpha_around(const struct texture *t, float u, float v, float width, float *low, float *high);

/* ---- Private to texture*.c ---- */

/* What the texture*.c files share. Private to them. */

extern const float texture_srgb[256]; /* linear values of sRGB bytes, rising from 0 to 1 */
