/* The part of an image that the scene's own emitters contribute: emissive surfaces and punctual lights
 * (scene/lamps/lamps.h). It does not depend on the sky, so it is computed once per scene, camera and seed and then
 * kept: image = the sky's part + scale * the lamps' part. Either the caller or a separate thread refines it in batches.
 * The same number of samples gives the same bits, at any number of threads. Filtered, it comes as two halves with seeds
 * of their own (light/denoise/denoise.h); what the camera sees of the emitters themselves is never filtered. */
#pragma once

#include "light/frame/relight.h"
#include "scene/lamps/lamps.h"

struct relight_lamps;

/* Samples per shading point after which the part is good enough for the rest to yield to other work. */
#define RELIGHT_LAMPS_GOOD 16

struct relight_lamps_desc {
    const struct prepared_scene *set; /* must outlive the part */
    uint32_t samples;      /* per shading point, after which it is complete; >= 1 */
    uint64_t seed;
    bool denoise;                  /* filter the light at shade points; an odd `samples` then counts as one more */
    const struct kernels *kernels; /* whose CPU level limits the filter; NULL: the best of this CPU */
};

/* On ERR_OK the caller owns *out, NULL if the scene has no emitters. ERR_NOMEM. Thread: one at a time, besides the
 * thread that relight_lamps_start starts. */
MUST_CHECK enum err relight_lamps_create(const struct relight_lamps_desc *desc, struct relight_lamps **out,
                                         struct reason *why);
/* Ends the thread within some hundredths of a second. NULL is allowed. */
void relight_lamps_destroy(struct relight_lamps *l);

/* Refines the part until it is complete, optionally with a progress line. ERR_NOMEM. Not after relight_lamps_start. */
MUST_CHECK enum err relight_lamps_complete(struct relight_lamps *l, bool progress, struct reason *why);

/* Refines the part on a separate thread. ERR_NOMEM: the thread cannot start. */
MUST_CHECK enum err relight_lamps_start(struct relight_lamps *l, struct reason *why);

/* ---- Any thread ---- */

/* The number of samples so far; 0: none yet. The part does not change once complete. */
uint32_t relight_lamps_samples(struct relight_lamps *l);
bool relight_lamps_is_complete(struct relight_lamps *l);

/* Whether memory ran out on the thread, so that the part is no longer refined. */
bool relight_lamps_has_failed(struct relight_lamps *l);

/* Adds scale times the part to rgb, float[height][width][3]. NULL, or a scale of 0: does nothing. */
void relight_lamps_add(struct relight_lamps *l, double scale, float *rgb);

/* The part at a pixel, with scale 1. NULL: black. */
void relight_lamps_pixel(struct relight_lamps *l, uint32_t x, uint32_t y, float rgb[3]);

/* The statistics of the part so far, and the seconds spent on it. */
void relight_lamps_get_stats(struct relight_lamps *l, struct lamps_stats *out, double *seconds);
