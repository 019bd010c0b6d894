/* Where the light of one pixel comes from: the estimate of direct light at the shade point that weighs most in it,
 * taken apart into the samples that made it, as [LPG13, Fig. 1] shows them; what is visible from there; and what many
 * more samples come to. The samples are those of direct_shade itself, written down (direct_log.h), so that with the
 * picture's own method, samples, seed and pass they add up to what the picture has there. Nothing that pictures are
 * made of is written to. One struct probe per thread of control; the same question gets the same bits. */
#ifndef SHADE_PROBE_H
#define SHADE_PROBE_H

#include "direct.h"
#include "direct_log.h"
#include "scatter.h"
#include "view.h"

#include <stdbool.h>
#include <stdint.h>

#define PROBE_MAP_WIDTH 64 /* of the map of what is visible: a small lat-long picture (DESIGN: conventions) */
#define PROBE_MAP_HEIGHT 32
#define PROBE_SAMPLES_MAX 256

/* The preset: what [LPG13, Fig. 1] was made with, whatever the surface is made of. */
#define PROBE_FIGURE_SAMPLES 50
#define PROBE_FIGURE_EXPONENT 150.0f

enum probe_sight {
    PROBE_BEHIND,  /* below the surface, by its geometric or its shading normal */
    PROBE_BLOCKED, /* something is in the way */
    PROBE_OPEN,    /* the sky */
};

struct probe_desc { /* borrowed */
    const struct scene *scene;
    const struct view *view;
    const struct gbuffer *gbuffer;
    const struct rays *rays;
    const struct environment *environment;
    /* method, samples, seed, pass and the options beyond the paper. A method whose strata are not the faces, one
     * without light samples, METHOD_CACHED and references are answered by METHOD_MIS; samples are held to
     * PROBE_SAMPLES_MAX. only, keep, counts and log do not matter. */
    struct direct_desc direct;
    uint32_t x, y; /* pixel */
    bool figure;   /* the preset: METHOD_MIS, its samples, and a Phong lobe of its exponent at the point */
};

struct probe_mean {           /* of independent estimates, each of PROBE_SAMPLES_MAX samples by METHOD_AUTO */
    double mean[3], error[3]; /* error: standard error of the mean */
    uint32_t estimates;
};

struct probe_answer {
    enum method method; /* by which it was answered, */
    uint32_t samples;   /* and N_s */
    uint32_t points;    /* shade points of the pixel; 0: nothing there scatters light from the sky directly, */
    uint32_t escapes;   /* directions in which it sees the sky itself, past everything or by mirrors and glass */
    struct vec3 escape; /* the heaviest of them; unit */
    bool met;           /* the camera ray through the pixel's middle meets something: */
    struct scatter first;

    /* The pixel, all its points and escapes together; not of the preset. */
    float radiance[3];           /* as resolve_pixels sums it */
    float background[3];         /* of that, the sky itself */
    struct probe_mean reference; /* of the radiance */

    /* The point that weighs most in it; where points > 0. */
    uint32_t point;            /* packet * 16 + lane, as gbuffer_entry.point */
    float weight[3];           /* in the pixel */
    struct shade_packet lane0; /* a copy of the point, in lane 0, as it was shaded */
    float lo[3];               /* its radiance: the sum over log's samples, divided by N_s */
    struct probe_mean lo_reference;
    struct direct_log log;                          /* owned by the struct probe, until its next run */
    uint8_t map[PROBE_MAP_HEIGHT][PROBE_MAP_WIDTH]; /* enum probe_sight */
    double open;        /* the share of the half space above the surface that is open sky, by solid angle, */
    double open_cosine; /* and weighted by the cosine with the shading normal */
};

struct probe;

struct probe *probe_create(const struct kernels *kernels); /* NULL when out of memory */
void probe_destroy(struct probe *p);                       /* NULL is allowed */

/* x, y must lie in the picture and the environment be ready. Uses OpenMP's threads little. ERR_NOMEM; what
 * direct_shade refuses. */
MUST_CHECK enum err probe_run(struct probe *p, const struct probe_desc *desc, struct probe_answer *out);

/* The direction through the middle of a cell of the map. */
void probe_map_direction(uint32_t column, uint32_t row, float w[3]);

#endif
