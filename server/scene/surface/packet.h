/* Points to shade, 16 at a time: where they lie, and the parameters of their lobes. Thread: any. */
#pragma once

#include <stdint.h>

#define PACKET 16 /* the widest of Embree; a vector of AVX-512 */

struct shade_packet { /* 16 shading points; lanes >= count repeat the last one and are not shaded */
    _Alignas(64) float x[PACKET];
    float y[PACKET], z[PACKET];                     /* m: ray origins, already offset from the surface */
    float ng_x[PACKET], ng_y[PACKET], ng_z[PACKET]; /* geometric normal, facing the viewer */
    float ns_x[PACKET], ns_y[PACKET], ns_z[PACKET]; /* shading normal, on the same side */
    float wo_x[PACKET], wo_y[PACKET], wo_z[PACKET]; /* towards the viewer, unit */
    float diffuse[3][PACKET], specular[3][PACKET];  /* linear Rec.709, textures applied */
    float gloss[PACKET];                            /* phong: exponent; ggx: alpha */
    int32_t valid[PACKET];                          /* -1: shaded, 0: padding */
    uint32_t mesh[PACKET], material[PACKET];
    uint8_t behind[PACKET]; /* 1: seen in a mirror or through glass; 0: directly */
    uint8_t layer[PACKET];  /* enum scatter_layer */
    uint32_t kind;          /* enum lobe_kind */
    uint32_t count;         /* 1..16 */
};
