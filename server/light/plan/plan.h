/* Which estimators bring the classes of light paths (light/estimators/paths.h), and with how many samples: each class
 * has exactly one, or none with a reason. Direct light is always included and not part of the plan.
 * light/frame/frame_plan.h chooses. Plain data. Thread: any. */
#pragma once

#include "base/setting.h"

#include <stdbool.h>
#include <stdint.h>

enum plan_estimator {
    PLAN_AUTO,   /* only in a request: let the planner choose */
    PLAN_NONE,   /* omitted */
    PLAN_LIGHT,  /* the light tracer; eye paths at points behind mirrors and glass, which it cannot reach */
    PLAN_EYE,    /* eye paths */
    PLAN_STORED, /* caustics and their indirect light: stored light paths, and the light tracer for the sun. Not
                    allowed in a request for indirect light */
    PLAN_CACHE,  /* indirect light: the cache. Not in a request: a relighter with this cache replaces PLAN_EYE */
};

/* A sky's peakedness from which BRDF rays find caustics too rarely. In equal time eye paths have 0.4 to 0.6 of the
 * light tracer's relMSE under uniform cloud (2.8), the same at 3.8, twice as much at 6.8 and 1.7 to 9 times from 7.3
 * to 8.7, where caustics bring a tenth of the light (tests/figures/figure5.c, the ring scene). Any sun that casts
 * shadows is far above: docs/internals/mathematics.md has the figures of more skies. */
#define PLAN_PEAKED 5.0

/* Facts about scene, image and sky. */
struct plan_facts {
    uint64_t casters; /* meshes with a delta lobe */
    uint64_t points;  /* shade points */
    uint64_t behind;  /* of these, seen in a mirror or through glass */
    uint64_t pixels;
    double albedo;     /* mean luminance of the shade points under a white sky, 0..1 */
    double peakedness; /* mean square of the sky's luminance over the square of its mean, >= 1; 0: unknown, black */
};

#define PLAN_LEFT_OUT_MAX 10 /* bounds a table; further sentences are dropped */

struct plan {
    enum plan_estimator caustics, indirect;  /* at directly visible points */
    enum plan_estimator indirect_caustics;   /* indirect light of caustics */
    bool behind_caustics, behind_indirect;   /* at the other points, by eye paths */
    uint64_t particles;                      /* 0: no light tracer */
    uint32_t eye_paths;                      /* per shade point; 0: no eye paths */
    const char *left_out[PLAN_LEFT_OUT_MAX]; /* one sentence per omitted class, without a full stop */
    uint32_t left_out_count;
};

/* "none", "light tracer", "eye paths", "stored light paths", "cache". */
const char *plan_estimator_name(enum plan_estimator e);

/* The values of --caustics and --indirect. */
extern const struct setting_choice caustics_choices[], indirect_choices[];
