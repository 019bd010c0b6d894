/* The relighter's state. Private to this room: only relight.c, part.c and stated.c include it. Thread: the
 * relighter's. */
#pragma once

#include "light/frame/frame_plan.h"
#include "light/frame/relight.h"
#include "light/frame/relight_cache.h"

struct light_team;
struct stated;

struct relighter {
    const struct prepared_scene *set;
    const struct kernels *kernels;
    struct passes passes;
    struct relight_cache cache;
    struct relight_caustics caustics;
    struct denoiser *denoiser; /* this and the next two: NULL until an image needs them */
    struct accumulation *accumulation;
    struct beside *beside;
    struct stated *stated;         /* NULL until an image states its error */
    uint64_t sky;                  /* the last live image's: a digest */
    const struct light_team *team; /* NULL: this process lights the points alone */
    bool half;                     /* round them to half floats */
    uint32_t *packets;             /* [packet_count]: packet numbers, for lists of a part; NULL until a part is run */
};

/* Ends the accumulation of its images, if there is one. */
void relighter_forget(struct relighter *r);

/* Fills r->packets. False: out of memory. */
bool relighter_number_packets(struct relighter *r);

/* ---- reference.c ---- */

/* One entry point for all methods that render whole images, camera rays included: the reference and the baselines of
 * server/light/estimators/baselines. */

/* Fills rgb float[height][width][3] by desc->direct.method, which must be one of them, with desc->direct.samples per
 * pixel. Sets the reference fields of *stats. ERR_NOMEM; METHOD_COMPONENTS: errors of relight_whole. Runs on all OpenMP
 * threads. */
MUST_CHECK enum err reference_run(const struct prepared_scene *set, const struct environment *e,
                                  const struct relight_desc *desc, float *rgb, struct relight_stats *stats);

/* ---- stated.c ---- */

/* Audits the relighter's images and states their error (light/audit/audit.h): relighter_state_error of
 * frame_plan.h. Private to this room. Thread: the relighter's. */

struct stated;
void stated_destroy(struct stated *s); /* NULL is allowed */
