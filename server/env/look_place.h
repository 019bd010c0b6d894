/* server/env/look_place.h */
/* Where a direction that stands still looks skies up that stand still in layout, size and rotation: what of
 * environment_look_wide depends on geometry alone, found once, so that a frame does nothing but read four texels. What
 * is read has the same bits as from environment_look_wide.
 *
 * Only a look at the source itself has a place, by an eye no wider than its texels (that is nearly all of a picture's
 * background), and none at the rim of a ball or fisheye, where texels are masked. */
#ifndef ENV_LOOK_PLACE_H
#define ENV_LOOK_PLACE_H

#include "environment.h"
#include "resample_table.h"

#include <stdbool.h>
#include <stdint.h>

#define LOOK_TEXEL 0x0fffffffu /* the first texel's index: there are at most 2^27 */
#define LOOK_RIGHT 28          /* two bits: the texel to its right is the next, itself, or the first of its row */
#define LOOK_DOWN 30           /* one bit: the one below is in the next row, or itself */
#define LOOK_NONE 0x80000000u  /* no place: ask environment_look_wide */

struct look_place {
    uint32_t texel; /* of four the upper left one, and where the others are */
    float x, y;     /* shares of the right and of the lower ones */
};

/* What places belong to: they are of no use with an environment for which this differs. e must be ready. */
struct look_key {
    enum layout layout;
    uint32_t width, height;
    double rotation;
};
struct look_key look_key_of(const struct environment *e);
bool look_key_equal(const struct look_key *a, const struct look_key *b);

/* The place of environment_look_wide(e, w, width), or LOOK_NONE. Any thread. */
struct look_place look_place_find(const struct environment *e, struct vec3 w, float width);

/* The picture of one frame, as look_at reads it. */
struct look_picture {
    const float *rgb;
    float gain;
    int32_t right[4], down[2]; /* texels, by the bits of a place */
};
struct look_picture look_picture_of(const struct environment *e);

/* p must have a place. */
static inline void look_at(const struct look_picture *from, const struct look_place *p, float rgb[3])
{
    const float *t = from->rgb + 3 * (size_t)(p->texel & LOOK_TEXEL);
    const int32_t right = 3 * from->right[p->texel >> LOOK_RIGHT & 3], down = 3 * from->down[p->texel >> LOOK_DOWN & 1];
    const float a = (1 - p->x) * (1 - p->y), b = p->x * (1 - p->y), c = (1 - p->x) * p->y, d = p->x * p->y;
    const float whole = a + b + c + d;

    for (int i = 0; i < 3; i++)
        rgb[i] = from->gain * ((a * t[i] + b * t[right + i] + c * t[down + i] + d * t[right + down + i]) / whole);
}

#endif
