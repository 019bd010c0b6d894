/* Inside the cache of interreflection: less noise. */
#ifndef SHADE_BOUNCE_SMOOTH_H
#define SHADE_BOUNCE_SMOOTH_H

#include "bounce_parts.h"

#define BOUNCE_GROUP_POINTS (BOUNCE_GROUP * TRANSPORT_POINTS)

struct bounce_smoother { /* of one thread; a group's points, 64 to a block */
    float at[3][BOUNCE_GROUP_POINTS], normal[3][BOUNCE_GROUP_POINTS];
    float near[BOUNCE_GROUP_POINTS]; /* harmonic mean of distances to what is around, above 0 */
    bool used[BOUNCE_GROUP_POINTS];
    float weights[TRANSPORT_POINTS][BOUNCE_GROUP_POINTS];
};

struct bounce_smoother *bounce_smoother_create(void); /* NULL when out of memory */
void bounce_smoother_destroy(struct bounce_smoother *s);

/* to [64 blocks][wide] from the like; points that are not used give and get nothing. */
void bounce_smooth(struct bounce_smoother *s, uint32_t blocks, uint32_t wide, const float *from, float *to);

#endif
