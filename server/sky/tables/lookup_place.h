/* Precomputed lookups. For a fixed direction, and environment maps of constant layout, size and rotation, the part of
 * environment_lookup_wide that depends on geometry alone is computed once; per frame only texels are read, four of the
 * source or four of each of two levels of the pyramid. The result is identical to environment_lookup_wide's.
 *
 * Between the source and the pyramid there is no place: for pixels a little wider than the source's texels, and at the
 * rim of a ball or fisheye, where texels are masked. Thread: any. */
#pragma once

#include "sky/tables/environment.h"
#include "sky/tables/resample.h"

#include <stdbool.h>
#include <stdint.h>

#define LOOKUP_TEXEL 0x0fffffffu /* index of the first texel; there are at most 2^27 */
#define LOOKUP_RIGHT 28          /* two bits: its right neighbour is the next texel, itself, or the first of the row */
#define LOOKUP_DOWN 30           /* one bit: its lower neighbour is in the next row, or itself */
#define LOOKUP_NONE 0x80000000u  /* no place: use environment_lookup_wide */
#define LOOKUP_WIDE 0xc0000000u  /* bits of a place in the pyramid, */
#define LOOKUP_FACE 8            /* whose face is here; lower bits: the finer level */

struct lookup_place {
    uint32_t texel; /* the upper left of four, and the offsets of the others; or LOOKUP_WIDE, face and level */
    float x, y;     /* weights of the right and the lower texels; or u and v on the face */
    float share;    /* of the coarser level; 0 in the source */
};

/* The properties that places depend on: places for another key must not be used. e must be ready. */
struct lookup_key {
    enum layout layout;
    uint32_t width, height, n;
    double rotation;
};
/* The current key of an environment. */
struct lookup_key lookup_key_of(const struct environment *e);
bool lookup_key_equal(const struct lookup_key *a, const struct lookup_key *b); /* whether places remain valid */

/* The place of environment_lookup_wide(e, w, width), or LOOKUP_NONE: if that is one of its bits, a lookup needs the
 * pyramid. */
struct lookup_place lookup_place_find(const struct environment *e, struct vec3 w, float width);

/* A frame's image, for lookup_at. Borrows from e. */
struct lookup_image {
    const struct pyramid *pyramid;
    const float *rgb;
    float gain;
    int32_t right[4], down[2]; /* texel offsets, by the bits of a place */
};
/* The image of the current frame. */
struct lookup_image lookup_image_of(const struct environment *e);

/* Radiance at a place in the pyramid. */
void lookup_at_wide(const struct pyramid *from, const struct lookup_place *p, float rgb[3]);

/* Radiance at a place, which must not be LOOKUP_NONE. */
static inline void lookup_at(const struct lookup_image *from, const struct lookup_place *p, float rgb[3])
{
    if (p->texel & LOOKUP_NONE) {
        lookup_at_wide(from->pyramid, p, rgb);
        return;
    }
    const float *t = from->rgb + 3 * (size_t)(p->texel & LOOKUP_TEXEL);
    const int32_t right = 3 * from->right[p->texel >> LOOKUP_RIGHT & 3],
                  down = 3 * from->down[p->texel >> LOOKUP_DOWN & 1];
    const float a = (1 - p->x) * (1 - p->y), b = p->x * (1 - p->y), c = (1 - p->x) * p->y, d = p->x * p->y;
    const float whole = a + b + c + d;

    for (int i = 0; i < 3; i++)
        rgb[i] = from->gain * ((a * t[i] + b * t[right + i] + c * t[down + i] + d * t[right + down + i]) / whole);
}
