/* Refines the image of a still sky. The first image, y, is quick: it has few samples, or comes from a biased cache.
 * While no new frame arrives, unbiased passes of the same frame follow, each with its own random numbers: direct light
 * by the requested method (METHOD_AUTO instead of METHOD_CACHED), eye paths and light tracer by the plan. m is their
 * mean, and V estimates its squared error from the scatter of the passes so far:
 *
 *     V = 1 / (N (N - 1))  sum over the passes of (x_k - m)^2,     D = (m - y)^2
 *
 * Both are relative as relMSE is (measure/compare/metrics.h) and summed over tiles of 32 x 32 pixels and their
 * neighbours. The expectation of D is V plus the squared error of y. The displayed image is
 *
 *     m + w (y - m),     w = min(1, V / D)
 *
 * with the best w: the estimator of [James and Stein 1961], towards y instead of 0, as used by [Gu et al. 2022] for
 * images; w is interpolated between tiles. The image is y while the passes are worse than y, and changes smoothly
 * to m as V goes to 0. Its error is
 *
 *     w^2 (D - V) + (1 - w)^2 V
 *
 * and is reported as at least V / 4, since D - V is the difference of two noisy figures. Passes of eye paths and of the
 * light tracer continue one sequence each, so m is slightly better than V suggests.
 *
 * The same passes give the same bits, at any number of threads. One thread of control. */
#pragma once

#include "light/frame/relight.h"

struct refiner;

/* When to stop refining. */
struct refiner_wish {
    double error;    /* estimated relMSE of the displayed image; 0: no target */
    uint64_t passes; /* maximum number of passes; 0: no limit */
};

struct refiner_stats {
    uint64_t passes;
    double error; /* estimated relMSE of the displayed image, and */
    double mean;  /* of the mean of the passes; 0: fewer than two passes */
    double first; /* w: the share of the first image, averaged over the pixels */
    bool converged;
};

/* Needs 60 bytes per pixel. set and kernels must outlive it. NULL when out of memory. */
struct refiner *refiner_create(const struct prepared_scene *set, const struct kernels *kernels);
void refiner_destroy(struct refiner *s); /* NULL is allowed */

/* Restarts for another frame or other light. first: float[height][width][3], copied. */
void refiner_begin(struct refiner *s, const float *first);

/* Runs one pass under e, the frame of refiner_begin, with the first image's light. If light->direct.cancel becomes true
 * meanwhile, the pass does not count, which is not an error. Errors are those of relighter_run. */
MUST_CHECK enum err refiner_pass(struct refiner *s, const struct environment *e, const struct relight_desc *light);

/* Computes weights and errors from the passes so far. */
void refiner_look(struct refiner *s, const struct refiner_wish *wish, struct refiner_stats *out);

/* rgb: float[height][width][3], the displayed image as of the last refiner_look; before that, the first image. */
void refiner_image(const struct refiner *s, float *rgb);
