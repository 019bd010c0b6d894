/* Path tracing from both ends, shared by the two baselines that connect them: particles from the sky, and rays from the
 * eye through mirrors and glass to rough surfaces. Independent of path.h, and of the light tracer except for the start
 * of particles. Thread: any. */
#pragma once

#include "base/rng.h"
#include "light/estimators/baselines/path.h"
#include "light/estimators/light_tracer.h"
#include "scene/surface/scatter.h"

#include <stdbool.h>
#include <stdint.h>

struct particle { /* a particle at a surface with a D lobe */
    struct scatter at;
    struct vec3 dir;       /* direction of travel, unit */
    double flux[3];        /* W, up to the sky's scale; as if only one particle were sent */
    uint32_t rough_events; /* D events before this one */
    uint32_t events;       /* of either kind */
    double area;           /* m^2 that it represents, perpendicular to its first direction */
};

/* Traces one particle through the boxes (at most START_BOXES_MAX, merged by start_join), with the correction factor for
 * shading normals [Veach 1997, section 5.3], until Russian roulette ends it or `meet` returns false. meet: called at
 * every surface with a D lobe. Adds to *rays. */
void chains_from_sky(const struct path_world *world, const struct box *boxes, uint32_t count, struct rng *rng,
                     bool (*meet)(void *data, const struct particle *p), void *data, uint64_t *rays);

/* Traces the ray through (x, y) of the image: calls `meet` at each surface with a D lobe that it reaches through
 * mirrors and glass alone, with the weight of radiance from there. Adds to *rays. */
void chains_from_eye(const struct path_world *world, const double xy[2], struct rng *rng,
                     void (*meet)(void *data, const struct scatter *at, struct vec3 dir, const double weight[3]),
                     void *data, uint64_t *rays);

/* Radiance towards -dir per irradiance from wi: BRDF times |n_s.wi| / |n_g.wi|. */
void chains_scatter(const struct scatter *at, struct vec3 dir, struct vec3 wi, double out[3]);
