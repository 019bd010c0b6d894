/* The BRDF (D lobe) of one surface point, one direction at a time, in double precision: the same models as lobes.h, for
 * estimators that trace paths. wo points to the eye's side, wi to the light's side; both are unit and point away from
 * the surface. Thread: any. */
#pragma once

#include "base/vec.h"
#include "scene/surface/packet.h"
#include "scene/surface/scatter.h"

#include <stdbool.h>

struct lobe { /* the parameters of a BRDF, ready to evaluate */
    enum lobe_kind kind;
    struct vec3 geometric, shading;
    struct vec3 diffuse, specular;
    double gloss;
    struct veil veil; /* dims the lobe; of a packet's lanes, the weights of its points do */
};

struct lobe lobe_of(const struct scatter *s);                       /* the rough lobe of s */
struct lobe lobe_of_lane(const struct shade_packet *p, uint32_t l); /* that of lane l */

/* The BRDF, sr^-1, without a cosine. 0 if wi is below the geometric or the shading surface. */
void lobe_evaluate(const struct lobe *l, struct vec3 wo, struct vec3 wi, double brdf[3]);

/* Samples a direction wi given wo, from three random numbers in [0, 1). It may lie below the surface, where the BRDF is
 * 0. */
struct vec3 lobe_sample(const struct lobe *l, struct vec3 wo, const double x[3]);
double lobe_density(const struct lobe *l, struct vec3 wo, struct vec3 wi); /* probability density of wi, sr^-1 */

/* The weight of a path that leaves along wi, a sample of this density, sr^-1: BRDF times cosine / density. False: none.
 */
bool lobe_weight(const struct lobe *l, struct vec3 wo, struct vec3 wi, double density, double weight[3]);

/* Approximate albedo: 0..1, > 0 wherever the lobe reflects anything. */
double lobe_albedo(const struct lobe *l, struct vec3 wo);

/* Approximate share of light that the specular part reflects. */
double lobe_shine(const struct lobe *l, struct vec3 wo);

/* The unit vector x t + y u + z n for the frame of n below; x, y and z have length 1. */
struct vec3 frame_direction(struct vec3 n, double x, double y, double z);

/* Two unit vectors that complete n (unit) to a right-handed orthonormal frame. */
void frame_about(struct vec3 n, struct vec3 *t, struct vec3 *u);
