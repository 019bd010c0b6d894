/* What live pictures have beside direct light and interreflection: caustics, and what eye paths find of them in mirrors
 * and through glass. It is sampled anew in each picture; a history (history.h) carries it to the next ones, from the
 * first picture on and after the cache is complete.
 *
 * Particles splat on pixels. So that the filter sees them, they become light of the shade points that the camera sees
 * directly: with the weights w of a pixel's entries and S its splats,
 *
 *     x(point) = sum over its pixels (w S / W) / sum over its pixels (w),   W = sum of w over the pixel's such points
 *
 * Splats on pixels without such a point are added to the picture as they are. Stored paths follow the sky by themselves
 * and need no history; their two halves are filtered together with it. One thread of control. */
#ifndef LIGHT_BESIDE_H
#define LIGHT_BESIDE_H

#include "light/denoise.h"
#include "light/relight_caustics.h"
#include "light/stated.h"

struct beside;

/* 90 bytes a shade point and 36 a pixel. set and denoiser, whose halves take the samples, must outlive it. NULL when
 * out of memory. */
struct beside *beside_create(const struct set *set, struct denoiser *denoiser);
void beside_destroy(struct beside *b); /* NULL is allowed */

/* Whether pictures of desc need one: live pictures of a scene with mirrors or glass. Not with a ground. */
bool beside_wanted(const struct set *set, const struct relight_desc *desc);

/* Begins a picture under e, and takes from its passes what is not interreflection behind mirrors and glass: eye_beside
 * gets that, with a limit for what a path may bring. */
void beside_describe(struct beside *b, const struct environment *e, const struct relight_desc *desc,
                     const struct plan *plan, struct picture_passes *passes);

/* Adds the picture's light to s->lo: stored paths, which grow meanwhile, the particles of passes, and eye_beside. Adds
 * to *stats. ERR_NOMEM. */
MUST_CHECK enum err beside_run(struct beside *b, struct passes *s, struct relight_caustics *caustics,
                               const struct environment *e, const struct picture_passes *passes,
                               struct relight_stats *stats);

/* The error of its light, while there is a history. Borrowed. */
struct stated *beside_stated(struct beside *b);

/* Adds to rgb, float[height][width][3], the splats that no shade point takes. */
void beside_finish(const struct beside *b, float *rgb);

#endif
