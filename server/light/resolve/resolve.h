/* Resolves shade points to pixels. A pixel is the sum of its parts: weight * Lo(shade point) over its entries, weight *
 * Lenv(direction) over its escapes (e NULL: without those). lo: float[packet_count][3][16] as direct_shade writes it.
 * Writes every pixel of rgb, float[height][width][3]. Runs on all OpenMP threads; the result does not depend on their
 * number. */
#pragma once

#include "base/err.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/scene.h"
#include "scene/geometry/view.h"
#include "sky/tables/environment.h"

#include <stdbool.h>

/* Stateless. Thread: one at a time. */
void resolve_pixels(const struct gbuffer *g, const float *lo, const struct environment *e, float *rgb);

/* Gives the same bits as resolve_pixels, faster from the second frame on. While layout, size and rotation of the sky
 * stay the same, it caches where escapes look up the sky (lookup_place.h, 16 bytes per escape), which pixels are a
 * single shade point or escape (4 bytes per pixel), and the entries of the others (8 bytes per pixel and 16 per entry).
 * It belongs to one G-buffer, which must outlive it and not change, and to one thread at a time. When out of memory it
 * caches nothing, which is not an error. */
struct resolver;

struct resolver *resolver_create(const struct gbuffer *g); /* NULL when out of memory */
void resolver_destroy(struct resolver *r);                 /* NULL is allowed */
/* As resolve_pixels. */
void resolver_pixels(struct resolver *r, const float *lo, const struct environment *e, float *rgb);

/* uint8_t[height][width]: 1 where a pixel holds a shade point, as the relative error counts them. */
void resolve_mask(const struct gbuffer *g, uint8_t *mask);

/* ---- The ground ---- */

/* The ground as a shadow catcher (scene/geometry/ground.h): where the camera sees it, also in mirrors and through
 * glass, the image is the background, scaled by the model's effect on the ground's light. Per channel, for a point x of
 * the ground seen along d, image = B(d) L(x) / L0,     L0 = albedo / pi  E, where B is the sky behind the ground, L the
 * radiance of x with the model, by any estimator, and L0 its radiance without the model: E is the closed-form
 * irradiance of an unoccluded horizontal plane (sky/tables/environment.h). Far from the model the ground thus looks
 * like the background; towards the model it is Lambertian. The ratio is 1 in channels where E is 0. Light from the
 * scene's lamps is added unscaled.
 *
 * A control variate reduces the noise of direct light on the ground, almost to none far from the model: the sampled
 * value X becomes X + v (L0 - U), where U is the same estimate without shadows and has mean L0. v is a constant of the
 * point, about the share of the sky's light that the model's bounding sphere leaves unblocked: for radius r and
 * distance d of its centre, 1 - min(1, 2 (r / d)^3).
 *
 * Thread: one at a time. Functions run on all OpenMP threads; the result does not depend on their number. */

struct backplate;

/* Creates the catcher for a scene with a ground, before a camera; all three must outlive it. NULL: out of memory. */
struct backplate *backplate_create(const struct scene *scene, const struct gbuffer *g, const struct view *view);
void backplate_destroy(struct backplate *b); /* NULL is allowed */

/* L0 under e, W sr^-1 m^-2. ERR_NOMEM. */
MUST_CHECK enum err backplate_bare(const struct environment *e, double rgb[3]);

/* Call it first for every frame. sky: the image shows the background. ERR_NOMEM. */
MUST_CHECK enum err backplate_begin(struct backplate *b, const struct environment *e, bool sky);

/* While held, backplate_begin keeps L0 of the previous sky, so that L / L0 is the share of one part of that sky's
 * light. */
void backplate_hold(struct backplate *b, bool hold);
bool backplate_is_held(const struct backplate *b);

/* The packets with points on the ground. */
const struct packet_list *backplate_packets(const struct backplate *b);

/* The buffer for direct light without shadows, float[packet_count][3][16]; NULL: out of memory. */
float *backplate_unshadowed(struct backplate *b);

/* Reduces the noise of lo with the light in backplate_unshadowed. */
void backplate_steady(const struct backplate *b, float *lo);

/* Replaces the ground's radiances in lo by what the camera sees there; backplate_restore undoes it. */
void backplate_show(struct backplate *b, const struct environment *e, float *lo);
void backplate_restore(const struct backplate *b, float *lo);

/* Black images for the light tracer, float[2][height][width][3]: the second is for light that arrives on the ground.
 * NULL: out of memory. */
float *backplate_splats(struct backplate *b);

/* Adds both images to an image. */
void backplate_add_splats(struct backplate *b, const struct environment *e, float *rgb);

/* From now on keeps the data for backplate_split. ERR_NOMEM. */
MUST_CHECK enum err backplate_keep(struct backplate *b);

/* Splits the last frame's image, to which more light may have been added, into a foreground and its alpha for any
 * background: rgba float[height][width][4], premultiplied. With T the share of the background that remains in a
 * channel (1 in the sky, L / L0 on the ground, 0 on the model),
 *     alpha = 1 - min(1, least T),   foreground = the model + (T - 1 + alpha) B,
 * so that foreground + (1 - alpha) B is the image; caustics and coloured shadows are in the foreground. */
void backplate_split(const struct backplate *b, const struct environment *e, const float *rgb, float *rgba);
