/* Points to shade, 16 at a time: where they lie, and the parameters of their lobes. Thread: any. */
#pragma once

#include "base/vec.h"

#include <math.h>
#include <stdbool.h>
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

/* ---- Kinds of lobes ---- */

/* The kinds of rough lobes, and all that caches, filters and the G-buffer need to know about a kind. Thread: any. */

enum lobe_kind {
    LOBE_LAMBERT, /* diffuse only */
    LOBE_PHONG,   /* diffuse + specular lobe with an exponent */
    LOBE_GGX,     /* diffuse = ggx_matte, specular = F0, gloss = alpha; if alpha is 0, the specular part
                     is in the delta lobe, and only the diffuse part below it remains */
};

/* "lambert", "phong" or "ggx". */
const char *lobe_kind_name(enum lobe_kind kind);

/* Whether the matte part lies below a surface that reflects: light enters it less at grazing angles. */
static inline bool lobe_covers_matte(enum lobe_kind kind)
{
    return kind == LOBE_GGX;
}

/* The share of light at this cosine with the normal that enters the matte part, or leaves it. */
static inline double lobe_enters(enum lobe_kind kind, double cosine)
{
    return lobe_covers_matte(kind) ? 1.0 - schlick(cosine) : 1.0;
}

/* As lobe_enters, in single precision, for a cosine of at most 1. */
static inline float lobe_enters_single(enum lobe_kind kind, float cosine)
{
    const float q = 1.0f - cosine;
    return lobe_covers_matte(kind) ? 1.0f - q * q * q * q * q : 1.0f;
}

/* Alpha of the ggx lobe that is about as wide as the specular part; 0: there is none. */
static inline float lobe_width(enum lobe_kind kind, float gloss)
{
    return kind == LOBE_PHONG ? 0.7f / sqrtf(gloss) : kind == LOBE_GGX ? gloss : 0.0f;
}

/* Whether lane l of a packet has a specular part. */
static inline bool lobe_shines(const struct shade_packet *p, uint32_t l)
{
    if (p->kind == LOBE_PHONG)
        return p->specular[0][l] > 0.0f || p->specular[1][l] > 0.0f || p->specular[2][l] > 0.0f;
    return p->kind == LOBE_GGX && p->gloss[l] > 0.0f;
}

/* Whether lane l has a specular part that is narrower than Phong's of this exponent, or ggx's of this alpha. */
static inline bool lobe_is_narrow(const struct shade_packet *p, uint32_t l, float exponent, float alpha)
{
    return lobe_shines(p, l) && (p->kind == LOBE_PHONG ? p->gloss[l] > exponent : p->gloss[l] < alpha);
}

/* BRDF times cosine is a sum of rows, each times a colour, so that caches of rows do not depend on colours and textures
 * (lobes.h has the BRDFs; F0 is the specular colour):
 *     lambert  row 0: cos / pi, by diffuse
 *     phong    row 0: cos / pi, by diffuse;   row 1: its lobe, by specular
 *     ggx      row 0: (1 - F(n.w)) (1 - F(n.o)) cos / pi of F0 = 0, by (1 - F0)^2 diffuse;
 *              row 1: D V (1 - s), by F0;   row 2: D V s, by 1;   s = (1 - o.h)^5, F = F0 (1 - s) + s
 * The number of rows of a lobe that shines; others have row 0 alone. */
static inline uint32_t lobe_rows(enum lobe_kind kind)
{
    return kind == LOBE_LAMBERT ? 1 : kind == LOBE_PHONG ? 2 : 3;
}
