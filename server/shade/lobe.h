/* server/shade/lobe.h */
/* The rough lobe of one surface point, one direction at a time, in double precision: the same BRDFs as lobes.h, for
 * those who follow paths. wo points to where the light goes (the eye's side), wi to where it comes from; both unit,
 * away from the surface. Pure functions; any thread. */
#ifndef SHADE_LOBE_H
#define SHADE_LOBE_H

#include "scatter.h"
#include "vec.h"

#include <stdbool.h>

struct lobe { /* a rough lobe in the terms that evaluating takes */
    enum lobe_kind kind;
    struct vec3 geometric, shading;
    struct vec3 diffuse, specular;
    double gloss;
};

struct lobe lobe_of(const struct scatter *s);

/* BRDF, sr^-1, without any cosine. 0 where wi is below the geometric or the shading surface. */
void lobe_evaluate(const struct lobe *l, struct vec3 wo, struct vec3 wi, double brdf[3]);

/* A direction wi by the lobe as it is seen from wo, from three numbers in [0, 1), and the density it has there, sr^-1.
 * It may be below the surface: there the BRDF is 0. */
struct vec3 lobe_sample(const struct lobe *l, struct vec3 wo, const double x[3]);
double lobe_density(const struct lobe *l, struct vec3 wo, struct vec3 wi);

/* Two unit vectors that make a right-handed frame with n. */
void frame_about(struct vec3 n, struct vec3 *t, struct vec3 *u);

#endif
