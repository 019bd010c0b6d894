/* Which points of a G-buffer are filtered together. Private to this room. Thread: one at a time. */
#pragma once

#include "light/denoise/filter_kernel.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/view.h"

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
