/* Caustics in live images, and the part of them that eye paths find in mirrors and through glass. They are resampled
 * in every image; a history (denoise.h) carries them over to the next ones, before and after the cache is
 * complete. The history of the points' other light never contains them, so that another estimator can take over.
 *
 * Particles splat on pixels. So that the filter can process the splats, they are converted to light at the shade points
 * that the camera sees directly. With the weights w of a pixel's entries and its splats S,
 *
 *     x(point) = sum over its pixels (w S / W) / sum over its pixels (w),   W = sum of w over the pixel's such points
 *
 * This light would take most of an image's time. So under a moving sky each image takes one slice of it in turn: half
 * of the stored paths, a part of half of the samples, or a part of the filter, none of which takes long, so that
 * images come evenly. What is shown moves to a round's light during the next round, and is a round and a quarter old on
 * average: six images or more, some 24 of the house at 640x360. A sky unlike the last image's, and a
 * still one, get all slices at once.
 *
 * Splats on pixels without such a point are added to the image unfiltered, as the mean of the images under one sky.
 * With a ground (resolve.h), splats on it go to points of the ground, and the others to other points. Stored paths
 * follow the sky without a history; their two halves are filtered together with the history's. One thread of control.
 */
#pragma once

#include "light/denoise/denoise.h"
#include "light/frame/relight_cache.h"
#include "light/frame/frame_plan.h"

struct beside;

/* Needs 114 bytes per shade point and 48 per pixel, with a ground 84. set and denoiser, whose halves take the samples,
 * must outlive it. NULL: no memory. */
struct beside *beside_create(const struct prepared_scene *set, struct denoiser *denoiser);
void beside_destroy(struct beside *b); /* NULL is allowed */

/* Whether images of desc need a struct beside: live, of a scene with mirrors or glass. */
bool beside_wanted(const struct prepared_scene *set, const struct relight_desc *desc);

/* Begins an image under e of which stats->plan and stats->still are known; glides: nothing will be sampled. Takes from
 * its passes stored paths, particles, caustics by eye paths, and everything but indirect light behind mirrors and
 * glass, by stored eye paths, or if stored_behind is false by others with a limit for the contribution of each; adds
 * PASS_BESIDE and PASS_REST. */
void beside_describe(struct beside *b, const struct environment *e, const struct relight_desc *desc,
                     const struct relight_stats *stats, bool stored_behind, bool glides, struct frame_plan *plan);

/* Adds the image's light to s->lo: stored paths, whose number grows by it, particles, and the eye paths of PASS_BESIDE.
 * Adds to *stats. eye->only: the packets, all of them. behind: two halves of stored eye paths; NULL if the cache was
 * refused meanwhile: this image lacks them. ERR_NOMEM. */
MUST_CHECK enum err beside_run(struct beside *b, struct passes *s, struct relight_caustics *caustics,
                               const struct environment *e, const struct eye_paths_desc *eye,
                               const struct eye_store *const *behind, struct relight_stats *stats);

/* Adds to rgb, float[height][width][3], the splats on pixels without a directly visible shade point. ground: the
 * scene's, or NULL. ERR_NOMEM. */
MUST_CHECK enum err beside_finish(const struct beside *b, struct backplate *ground, const struct environment *e,
                                  float *rgb);
