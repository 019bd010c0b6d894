/* The rays of a packet of shading points, one a lane. Included only by the kernels. */
#pragma once

#include "scene/geometry/rays.h"
#include "scene/surface/lanes.h"

/* Aims a packet's rays along d, without end. */
static inline void lanes_aim(const struct lanes d[3], struct ray16 *rays)
{
    LANES(l)
    {
        rays->dir_x[l] = d[0].v[l];
        rays->dir_y[l] = d[1].v[l];
        rays->dir_z[l] = d[2].v[l];
        rays->tfar[l] = INFINITY;
    }
}

/* Rays that start at the packet's points; lanes_aim gives them directions. */
static inline void lobes_rays(const struct shade_packet *p, struct ray16 *rays)
{
    memset(rays, 0, sizeof(*rays));
    LANES(l)
    {
        rays->org_x[l] = p->x[l];
        rays->org_y[l] = p->y[l];
        rays->org_z[l] = p->z[l];
        rays->mask[l] = UINT32_MAX;
    }
}
