/* Finds exactly which pixels changed since the previous image, and what was computed for their light. */
#pragma once

#include "light/frame/relight.h"

enum change {
    CHANGE_RADIANCE = 1, /* the pixel's radiance has other bits than in the last image */
    CHANGE_SKY = 2,      /* light of one of its points was computed: from cells and gazes of a cache, or by sampling */
    CHANGE_SUN = 4,      /* and rays towards the sky's sun, of --method cached */
};

struct changes {                        /* zero it first */
    float *before;                      /* [height][width][3]: the last image */
    uint8_t *map;                       /* [height][width]: bits of enum change */
    bool begun;                         /* there is a last image */
    uint32_t pixels, changed, sky, sun; /* of the map: all, and those with each bit */
    uint32_t box[4];                    /* columns and rows, first and end, of what changed; 0: nothing did */
};

/* Compares rgb, the relighter's last image with whatever was added to it, with the one before, and keeps it. All of
 * the first image, and of one of another size, has changed. stats: of the image. ERR_NOMEM. Thread: the
 * relighter's. */
MUST_CHECK enum err changes_take(struct changes *c, const struct relighter *r, const struct relight_stats *stats,
                                 const float *rgb);
void changes_finish(struct changes *c); /* zeroed memory is allowed */

/* The map as an image, [height][width][3]: red where the radiance changed, green where light was computed, blue where
 * rays were traced; 255 or 0. */
void changes_paint(const struct changes *c, uint8_t *rgb);
