/* The first surface in each pixel, including mirrors and glass, which the G-buffer looks through: position, normal and
 * distance at the pixel's centre, and each mesh's share of the pixel. Shares match the G-buffer's sub-pixel coverage: a
 * pixel with one shading point or escape holds one mesh or none; other pixels get the same edge_rays^2 rays. Immutable.
 * Thread: any number may read. */
#pragma once

#include "scene/geometry/gbuffer.h"
#include "scene/geometry/view.h"

#define FIRST_HITS_FAR 1e10f /* depth where nothing is hit */

struct first_part {
    uint32_t mesh;
    float share; /* of the pixel, 0..1 */
};

struct first_hits {
    float *position; /* [height][width][3]: m, world; 0 where nothing is hit, as is `normal` */
    float *normal;   /* [height][width][3]: unit, shading, on the camera's side */
    float *depth;    /* [height][width]: m along the camera's axis */
    struct first_part *parts;
    uint32_t
        *first; /* [width * height + 1]: pixel i owns parts first[i] .. first[i + 1], in descending order of share */
};

/* edge_rays: as in the G-buffer's description; 0: 4. Traces on all OpenMP threads. The caller owns *out. ERR_NOMEM. */
MUST_CHECK enum err first_hits_create(const struct scene *scene, const struct rays *rays, const struct gbuffer *g,
                                      const struct view *view, uint32_t edge_rays, struct first_hits **out);
void first_hits_destroy(struct first_hits *f); /* NULL is allowed */
