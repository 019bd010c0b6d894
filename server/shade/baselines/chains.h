/* server/shade/baselines/chains.h */
/* What the two baselines that join light from both ends share: particles that set out from the sky, and rays that go
 * from the eye through mirrors and glass to what scatters roughly. Nothing of path.h's own walk, nothing of the light
 * tracer but where particles begin. Pure functions; any thread. */
#ifndef SHADE_BASELINES_CHAINS_H
#define SHADE_BASELINES_CHAINS_H

#include "baselines/path.h"
#include "rng.h"
#include "scatter.h"
#include "start.h"

#include <stdbool.h>
#include <stdint.h>

struct particle { /* at a surface with a D lobe */
    struct scatter at;
    struct vec3 dir;       /* where it was going, unit */
    double flux[3];        /* W, up to the sky's scale; of one particle, if only one were sent */
    uint32_t rough_events; /* D events before this one */
    uint32_t events;       /* of either kind */
    double area;           /* m^2 across its first direction that it stands for */
};

/* Sends one particle through boxes (at most START_BOXES_MAX, as start.h joins them), with Veach's factor for shading
 * normals [Veach 1997, section 5.3], until Russian roulette ends it or `meet` returns false. meet: called at every
 * surface with a D lobe. */
void chains_from_sky(const struct path_world *world, const struct box *boxes, uint32_t count, struct rng *rng,
                     bool (*meet)(void *data, const struct particle *p), void *data, uint64_t *rays);

/* Follows the ray through (x, y) of the picture: `meet` is called at each surface with a D lobe that it comes to by
 * mirrors and glass alone, with the weight of radiance from there. */
void chains_from_eye(const struct path_world *world, const double xy[2], struct rng *rng,
                     void (*meet)(void *data, const struct scatter *at, struct vec3 dir, const double weight[3]),
                     void *data, uint64_t *rays);

/* Radiance towards -dir per irradiance that a particle brings: BRDF times |n_s.wi| / |n_g.wi|. */
void chains_scatter(const struct scatter *at, struct vec3 dir, struct vec3 wi, double out[3]);

/* The scene's bounding box. */
struct box chains_bounds(const struct scene *scene);

#endif
