/* Points to shade, 16 at a time: where they lie, and the parameters of their lobes. Thread: any. */
#pragma once

#include <stdint.h>

#define PACKET 16 /* the widest of Embree; a vector of AVX-512 */

/* Cells of a pixel, 4 x 4, quarter by quarter: a camera ray goes through each (view_ray_in_pixel). */
#define PIXEL_CELLS 16
#define PIXEL_WHOLE UINT16_MAX /* bits of all of them */

static inline uint32_t pixel_cell(uint32_t x, uint32_t y)
{
    return (y / 2 * 2 + x / 2) * 4 + y % 2 * 2 + x % 2;
}

struct shade_packet { /* 16 shading points; lanes >= count repeat the last one and are not shaded */
    _Alignas(64) float x[PACKET];
    float y[PACKET], z[PACKET];                     /* m: ray origins, already offset from the surface */
    float ng_x[PACKET], ng_y[PACKET], ng_z[PACKET]; /* geometric normal, facing the viewer */
    float ns_x[PACKET], ns_y[PACKET], ns_z[PACKET]; /* shading normal, on the same side */
    float wo_x[PACKET], wo_y[PACKET], wo_z[PACKET]; /* towards the viewer, unit */
    float diffuse[3][PACKET], specular[3][PACKET];  /* linear Rec.709, textures applied */
    float gloss[PACKET];                            /* phong: exponent; ggx: alpha */
    float pixel[PACKET];       /* m: height of the pixel there; 0: rays start at the point alone */
    uint32_t cells[2][PACKET]; /* digits of four bits: where else they may start, cells that the point stands for */
    int32_t valid[PACKET];                          /* -1: shaded, 0: padding */
    uint32_t mesh[PACKET], material[PACKET];
    uint8_t behind[PACKET]; /* 1: seen in a mirror or through glass; 0: directly */
    uint8_t layer[PACKET];  /* enum scatter_layer */
    uint8_t cell[PACKET];   /* its own, PIXEL_CELLS: the middle of the pixel */
    float right[3];         /* unit: in which the image's x grows, in a pixel of one of them */
    uint32_t kind;          /* enum lobe_kind */
    uint32_t count;         /* 1..16 */
};
