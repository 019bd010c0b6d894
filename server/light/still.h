/* A sky that stands still. The picture that was shown first, y, was made in little time: by few samples, or by a cache
 * with a bias. While no other frame comes, unbiased passes of the same frame are made, each with random numbers of its
 * own: direct light by the method that was asked for, or by METHOD_AUTO where that was METHOD_CACHED, eye paths and
 * light tracer as the plan says. m is their mean, V what the passes' own scatter says of its squared error, so far:
 *
 *     V = 1 / (N (N - 1))  sum over the passes of (x_k - m)^2,     D = (m - y)^2
 *
 * Both are relative as relMSE is (metrics.h) and summed over tiles of 32 x 32 pixels and their neighbours. D is in the
 * mean V and the squared error of y, which is all that is known of that. The picture that is shown is
 *
 *     m + w (y - m),     w = min(1, V / D)
 *
 * which no other w would bring nearer to the truth: the estimator of [James and Stein 1961], towards y instead of 0, as
 * [Gu et al. 2022] have it for pictures, w going over evenly from tile to tile. As long as the passes are worse than y
 * it is y; as V goes to 0 it is m: it leaves y by less than y is wrong, and needs no jump to do so. Its error is
 *
 *     w^2 (D - V) + (1 - w)^2 V
 *
 * and stated no smaller than V / 4, since D - V is the difference of two noisy figures. Passes of eye paths and of the
 * light tracer go on with one sequence each, so that m is then a little better than V says.
 *
 * The same passes give the same bits, at any number of threads. One thread of control. */
#ifndef LIGHT_STILL_H
#define LIGHT_STILL_H

#include "light/relight.h"

struct still;

/* When it is good enough. */
struct still_wish {
    double error;    /* relMSE that is estimated of what is shown; 0: never */
    uint64_t passes; /* or so many; 0: any number */
};

struct still_stats {
    uint64_t passes;
    double error; /* relMSE of what is shown, and */
    double mean;  /* of the passes' mean, as estimated; 0: fewer than two passes */
    double first; /* w: the share of the first picture, in the mean over the pixels */
    bool converged;
};

/* 60 bytes a pixel. set and kernels must outlive it. NULL when out of memory. */
struct still *still_create(const struct set *set, const struct kernels *kernels);
void still_destroy(struct still *s); /* NULL is allowed */

/* Another frame, or other light: what was summed is forgotten. first: float[height][width][3], copied. */
void still_begin(struct still *s, const float *first);

/* One pass under e, the frame of still_begin; light is what the first picture was made by. When light->direct.cancel
 * came true meanwhile it does not count, and no error. Errors are those of relighter_run. */
MUST_CHECK enum err still_pass(struct still *s, const struct environment *e, const struct relight_desc *light);

/* Weighs what there is. */
void still_look(struct still *s, const struct still_wish *wish, struct still_stats *out);

/* rgb: float[height][width][3], the picture as of the last still_look; before one, the first. */
void still_picture(const struct still *s, float *rgb);

#endif
