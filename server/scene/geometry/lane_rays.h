/* The rays of a packet of shading points, one a lane. For the kernels above all. */
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

/* Where a camera ray goes through a cell, in sixteenths of a pixel from its upper left corner: pixel_cell inverted, as
 * view_ray_in_pixel. */
static inline float lanes_cell_x(uint32_t cell)
{
    return (float)(int32_t)(((cell >> 1 & 2u) | (cell & 1u)) * 4 + 3 - ((cell >> 2 & 2u) | (cell >> 1 & 1u)));
}

static inline float lanes_cell_y(uint32_t cell)
{
    return (float)(int32_t)(((cell >> 2 & 2u) | (cell >> 1 & 1u)) * 4 + ((cell >> 1 & 2u) | (cell & 1u)));
}

/* Steps of a sixteenth of a pixel to the right and down on the points' planes, from its upper left corner. */
struct lane_pixels {
    struct lanes corner[3], right[3], down[3];
};

static inline void lanes_pixels(const struct shade_packet *p, struct lane_pixels *out)
{
    const float axis[3] = { p->right[0], p->right[1], p->right[2] };

    LANES(l)
    {
        const float n[3] = { p->ng_x[l], p->ng_y[l], p->ng_z[l] }, at[3] = { p->x[l], p->y[l], p->z[l] };
        const float w[3] = { p->wo_x[l], p->wo_y[l], p->wo_z[l] };
        const float along = axis[0] * w[0] + axis[1] * w[1] + axis[2] * w[2], across = 1.0f - along * along;
        const float height = p->pixel[l] * 0.0625f, length = sqrtf(across > 1e-6f ? across : INFINITY);
        const float unit = height / length; /* none if it looks along the axis */
        const float towards = n[0] * w[0] + n[1] * w[1] + n[2] * w[2];
        const float scale = 1.0f / (towards > 0.02f ? towards : 0.02f);
        float r[3], d[3], off_r = 0.0f, off_d = 0.0f;
        for (int i = 0; i < 3; i++)
            r[i] = unit * (axis[i] - along * w[i]);
        for (int i = 0; i < 3; i++)
            d[i] = r[(i + 1) % 3] * w[(i + 2) % 3] - r[(i + 2) % 3] * w[(i + 1) % 3];
        const float in_r = (n[0] * r[0] + n[1] * r[1] + n[2] * r[2]) * scale;
        const float in_d = (n[0] * d[0] + n[1] * d[1] + n[2] * d[2]) * scale;
        for (int i = 0; i < 3; i++) {
            r[i] -= in_r * w[i];
            d[i] -= in_d * w[i];
            off_r += n[i] * r[i];
            off_d += n[i] * d[i];
        }
        const bool middle = p->cell[l] == PIXEL_CELLS;
        const float own_x = middle ? 7.5f : lanes_cell_x(p->cell[l]);
        const float own_y = middle ? 7.5f : lanes_cell_y(p->cell[l]);
        for (int i = 0; i < 3; i++) {
            r[i] -= n[i] * off_r; /* what rounding has left, so that level ground stays level */
            d[i] -= n[i] * off_d;
            out->corner[i].v[l] = at[i] - own_x * r[i] - own_y * d[i];
            out->right[i].v[l] = r[i];
            out->down[i].v[l] = d[i];
        }
    }
}

/* A place for each of a row of samples, any few of them spread evenly: multiples of the golden ratio, which know
 * nothing of the samples' directions. */
static inline uint32_t lanes_place(uint32_t number)
{
    return number * 2654435769u >> 28;
}

/* Starts each ray elsewhere in its point's pixel; place: 0 .. PIXEL_CELLS - 1. */
static inline void lanes_start(const struct shade_packet *p, const struct lane_pixels *s, const uint32_t place[PACKET],
                               struct ray16 *rays)
{
    LANES(l)
    {
        const uint32_t digits = place[l] & 8u ? p->cells[1][l] : p->cells[0][l], cell = digits >> (place[l] & 7u) * 4;
        const float right = lanes_cell_x(cell), down = lanes_cell_y(cell);
        rays->org_x[l] = s->corner[0].v[l] + right * s->right[0].v[l] + down * s->down[0].v[l];
        rays->org_y[l] = s->corner[1].v[l] + right * s->right[1].v[l] + down * s->down[1].v[l];
        rays->org_z[l] = s->corner[2].v[l] + right * s->right[2].v[l] + down * s->down[2].v[l];
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
