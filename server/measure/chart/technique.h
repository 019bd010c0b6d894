/* The techniques that are compared: named ways of lighting an image, and what a budget means for each. Constant
 * tables; any thread may read them, and run techniques on a relighter of its own. */
#pragma once

#include "base/err.h"
#include "light/frame/decide.h"
#include "light/frame/relight.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Which light an image holds; a chart compares techniques for the same light only. */
enum light_class {
    LIGHT_DIRECT, /* the sky, and what it lights directly */
    LIGHT_ALL,    /* and caustics and indirect light */
    LIGHT_CLASSES,
};

enum technique_kind {
    TECHNIQUE_FIXED,    /* the lower envelope is that of these */
    TECHNIQUE_BASELINE, /* for comparison: paths, Metropolis, photons, point lights */
    TECHNIQUE_PREPARED, /* has a precomputation, which is not in the time of a frame: plotted, but not ranked */
    TECHNIQUE_FILTERED, /* denoised: the eye prefers it, but it is biased. Plotted, not ranked; compared with the same
                         * technique unfiltered */
    TECHNIQUE_AUTO,     /* chooses by measurement (light/frame/pilot.h); compared with the envelope of the fixed ones */
};

struct technique {
    const char *name;  /* on command lines and in the CSV: no blanks, no commas */
    const char *about; /* for people, a phrase that follows "it takes ..." */
    enum light_class light_class;
    uint32_t colour; /* of its line, 0xrrggbb; 0: the ink's */
    enum technique_kind kind;
    struct relight_desc light; /* all but the budget and the seed */
    /* What a budget N means, as a ratio: N times / per samples per shade point, or per pixel where the method makes the
     * whole image. Particles and eye paths follow from the plan (light/plan/plan.h), one for every eight samples.
     * Auto gets the time that technique_pace takes for that budget; its own time is measured like that of the others.
     */
    uint32_t times, per;
};

/* All of them, in the order of the legend. */
const struct technique *technique_all(size_t *count);
#define TECHNIQUES_MAX 32 /* bounds a table */

extern const char *const technique_kinds[]; /* their names */

/* Whether a list of names with commas between has the technique's; NULL: it has all. technique_check_list returns
 * ERR_USAGE for an unknown name. */
bool technique_listed(const char *list, const struct technique *t);
MUST_CHECK enum err technique_check_list(const char *list, struct reason *why);

/* The samples that a budget comes to, at least 1. */
uint32_t technique_samples(const struct technique *t, uint32_t budget);

/* The technique whose time auto is given. */
const struct technique *technique_pace(enum light_class c);

struct technique_stage { /* what a run needs; borrowed */
    struct relighter *relighter;
    double seconds;                                /* a frame, for TECHNIQUE_AUTO */
    const struct environment *environment, *other; /* other: has nothing in common with it */
};

struct technique_cost {
    double seconds;  /* of the image: samples, shading, light tracing, resolving, and all measurements of the pilot,
                        which begins anew */
    double expected; /* relMSE without bias, as estimated by auto; 0: by others */
    uint32_t samples, eye_paths; /* per shade point */
    uint64_t particles, rays;
    const char *bias; /* what the method computes wrongly, in words; NULL: nothing */
    double prepared;  /* seconds of precomputation in this run, not in `seconds` */
    uint64_t prepared_bytes;
};

/* One image, as the first of a file: rgb float[height][width][3]. TECHNIQUE_PREPARED lights the other sky before, so
 * that nothing is taken over from a frame under the same one. Errors as relighter_run's: ERR_UNSUPPORTED where the
 * method needs another layout of sky. */
MUST_CHECK enum err technique_run(const struct technique *t, const struct technique_stage *stage, uint32_t budget,
                                  uint64_t seed, float *rgb, struct technique_cost *cost, struct reason *why);
