/* The ground as a shadow catcher (scene/ground.h): where the camera sees it, also in mirrors and through glass, the
 * picture is the background times what the model changes of the ground's light. Per channel, for a point x of the
 * ground seen along d,
 *     picture = B(d) L(x) / L0,     L0 = albedo / pi  E,
 * where B is the sky behind the ground, L the radiance of x with the model, by any estimator, and L0 its radiance
 * without: E is the irradiance of an open horizontal plane, in closed form (env/irradiance.h). So the ground reflects
 * towards the camera what makes it look like the background where nothing is near; towards the model it is Lambert.
 * Where E is 0 in a channel the ratio counts as 1. Light of the scene's lamps is added as it is.
 *
 * Direct light on the ground has less noise than elsewhere, and hardly any far from the model: its sampled value X is
 * replaced by X + v (L0 - U), where U is the same estimate without shadows, of mean L0. v is a constant of the point,
 * about the share of the sky's light that the sphere around the model leaves to it: with its radius r and the distance
 * d of its centre, 1 - min(1, 2 (r / d)^3).
 *
 * One thread of control; functions run on all OpenMP threads, whose number does not change the result. */
#ifndef LIGHT_BACKPLATE_H
#define LIGHT_BACKPLATE_H

#include "light/relight.h"

struct backplate;

/* set, whose scene has a ground, must outlive it. NULL: out of memory. */
struct backplate *backplate_create(const struct set *set);
void backplate_destroy(struct backplate *b); /* NULL is allowed */

/* L0 under e, W sr^-1 m^-2. ERR_NOMEM. */
MUST_CHECK enum err backplate_bare(const struct environment *e, double rgb[3]);

/* To be called first for a frame; sky: the picture shows the background. ERR_NOMEM. */
MUST_CHECK enum err backplate_begin(struct backplate *b, const struct environment *e, bool sky);

/* While held, backplate_begin keeps L0 of the sky before: L / L0 is then the share of a part of that sky's light. */
void backplate_hold(struct backplate *b, bool hold);
bool backplate_is_held(const struct backplate *b);

/* The packets with points on the ground. */
const struct packet_list *backplate_packets(const struct backplate *b);

/* Where direct light without shadows goes, float[packet_count][3][16]; NULL: out of memory. */
float *backplate_unshadowed(struct backplate *b);

/* Reduces the noise of lo by it. */
void backplate_steady(const struct backplate *b, float *lo);

/* Turns the ground's radiances in lo into what the camera sees there, until backplate_restore gives them back. */
void backplate_show(struct backplate *b, const struct environment *e, float *lo);
void backplate_restore(const struct backplate *b, float *lo);

/* Black images for the light tracer, float[2][height][width][3]: the second for what arrives on the ground. NULL: out
 * of memory. */
float *backplate_splats(struct backplate *b);

/* Adds both to a picture. */
void backplate_add_splats(struct backplate *b, const struct environment *e, float *rgb);

/* From now on keeps what backplate_split needs. ERR_NOMEM. */
MUST_CHECK enum err backplate_keep(struct backplate *b);

/* Splits the last frame's picture, to which more light may have been added, into a foreground and its alpha for any
 * background: rgba float[height][width][4], premultiplied. With T the share of the background that remains in a
 * channel (1 in the sky, L / L0 on the ground, 0 on the model),
 *     alpha = 1 - min(1, least T),   foreground = the model + (T - 1 + alpha) B,
 * so that foreground + (1 - alpha) B is the picture; caustics and coloured shadows are in the foreground. */
void backplate_split(const struct backplate *b, const struct environment *e, const float *rgb, float *rgba);

#endif
