/* One level of the filter on rows of pixels: the inner loop of filter_run. Private to this room and its tests. Thread:
 * any; the caller owns all arrays. */
#pragma once

#include "base/cpu.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/view.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The surfaces at the pixels of a row or an image: planes of floats. */
enum {
    SURFACE_NORMAL = 0, /* x, y, z of the shading normal; 0, 0, 0: no surface */
    SURFACE_PLACE = 3,  /* x, y, z, m */
    SURFACE_WIDTH = 6,  /* of a pixel there, m */
    SURFACE_KIND = 7,   /* equal for points that may be averaged */
    SURFACE_PLANES = 8,
};

/* The light at the pixels and its variance. */
enum {
    LIGHT_HALF = 0,     /* r, g, b of half a, then of half b */
    LIGHT_VARIANCE = 6, /* of one half, summed over r, g and b */
    LIGHT_PLANES = 7,
};

#define FILTER_LEVELS 5 /* each twice as wide: docs/internals/mathematics.md */
#define FILTER_RADIUS 2 /* of a level, in steps */
#define SPREAD_RADIUS 3 /* of the mean over initial variances, in pixels */

/* The image that supplies the neighbours. */
struct filter_image {
    const float *surface[SURFACE_PLANES]; /* [height][pitch] */
    const float *light[LIGHT_PLANES];     /* likewise */
    uint32_t width, height;
    size_t pitch;
};

/* Points to filter: in `count` adjacent pixels of row y, beginning at column x, or each in a pixel of its own. */
struct filter_points {
    const float *surface[SURFACE_PLANES]; /* [count] */
    const float *light[LIGHT_PLANES];
    float *out[LIGHT_PLANES]; /* [count], written */
    uint32_t x, y, count;     /* count at most FILTER_COUNT_MAX */
    const uint32_t *pixel;    /* [count]: y * width + x; NULL: adjacent ones */
};

#define FILTER_COUNT_MAX 64 /* of filter_points */

struct filter_kernel {
    enum cpu_level cpu;
    /* The mean over 5 x 5 neighbours, `step` pixels apart. */
    void (*level)(const struct filter_image *p, const struct filter_points *at, uint32_t step);
    /* The mean of variances over 7 x 7 neighbours: writes out[LIGHT_VARIANCE] only. */
    void (*spread)(const struct filter_image *p, const struct filter_points *at);
};

/* The kernel of a CPU level by name (base/cpu.h); the best supported one if level is NULL or not supported. */
const struct filter_kernel *filter_kernel_select(const char *level);

/* ---- Filter layers ---- */

/* Which points of a G-buffer are filtered together. Private to this room. Thread: one at a time. */

#define NOWHERE UINT32_MAX

/* Points side by side: planes of `count` floats each. */
struct points {
    size_t count;
    float *surface, *light, *next; /* [SURFACE_PLANES], [LIGHT_PLANES], [LIGHT_PLANES] planes */
};

/* Points as an image: at most one per pixel. */
struct layer {
    struct points points;
    float *first;    /* [height * pitch]: variances before the first level */
    uint32_t *point; /* [height * pitch]: packet * 16 + lane, or NOWHERE */
};

/* layers[0] holds each pixel's point with the largest weight. layers[1] holds the largest that is unlike all of those
 * around it: the far side of a leaf, a surface below its coat, what a window pane reflects. Points take their
 * neighbours' light from their own layer. The other points, at edges, are `rest`; they take it from layers[0]. */
struct filter {
    const struct gbuffer *g;
    const struct filter_kernel *kernel;
    size_t pitch; /* of a layer, floats */
    struct layer layers[2];
    uint32_t layer_count; /* 1: layers[1] is empty */
    struct points rest;
    uint32_t *rest_point; /* [rest.count] */
    uint32_t *rest_pixel; /* y * width + x of the first pixel that shows it */
};

/* Chooses the points of f->g and fills their surfaces. false: out of memory; filter_layers_free frees what there is. */
bool filter_layers_make(struct filter *f, const struct view *v);
void filter_layers_free(struct filter *f);
