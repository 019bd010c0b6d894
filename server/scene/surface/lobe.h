/* The BRDF (D lobe) of one surface point, one direction at a time, in double precision: the same models as lobes.h, for
 * estimators that trace paths. wo points to the eye's side, wi to the light's side; both are unit and point away from
 * the surface. Thread: any. */
#pragma once

#include "base/rng.h"
#include "base/vec.h"
#include "scene/surface/packet.h"
#include "scene/surface/scatter.h"

#include <math.h>
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

/* ---- Continued camera paths ---- */

/* The ray that continues a camera path, for tracers that follow one continuation of each surface. Thread: any. */

struct path_ray {
    struct vec3 origin, dir; /* of the next ray */
    double weight[3];        /* product of BRDF x cosine / probability so far, and of n^2 */
    double density;          /* sr^-1: probability of continuing along dir from the last rough surface */
    bool specular;           /* scattered by a delta lobe since */
};

/* Continues along the lobe, which happens with probability `keep`. False: no contribution is possible. */
static inline bool path_ray_follow(struct path_ray *r, const struct lobe *lobe, struct vec3 wo, struct vec3 start,
                                   const double x[3], double keep)
{
    double weight[3];

    r->dir = lobe_sample(lobe, wo, x);
    r->origin = start;
    r->specular = false;
    r->density = keep * lobe_density(lobe, wo, r->dir);
    if (!lobe_weight(lobe, wo, r->dir, r->density, weight))
        return false;
    for (int c = 0; c < 3; c++)
        r->weight[c] *= weight[c];
    return true;
}

/* How a surface may continue a path: the rough lobe, and two delta rays. */
struct path_fork {
    struct lobe lobe;
    struct vec3 wo, start;
    struct delta_ray delta[2];
    double share[3]; /* of each in the throughput; 0: it does not continue the path */
    double scale;    /* of the shares, to probabilities: what they lack to 1 is Russian roulette */
};

/* At what r has met; rough: whether the rough lobe counts. False: nothing continues. */
static inline bool path_fork_at(struct path_ray *r, const struct scatter *at, bool rough, struct path_fork *out)
{
    for (int c = 0; c < 3; c++)
        r->weight[c] *= (double)at->weight;
    const uint32_t count = scatter_eye(at, r->dir, out->delta);
    out->lobe = lobe_of(at);
    out->wo = scatter_side(at, vec3_scale(r->dir, -1.0f));
    out->start = surface_start(&at->surface, 1.0f);
    out->share[0] = rough ? lobe_albedo(&out->lobe, out->wo) : 0.0;
    for (uint32_t i = 0; i < 2; i++) {
        const float *w = out->delta[i].weight;
        out->share[1 + i] = i < count ? (w[0] + w[1] + w[2]) / 3.0 : 0.0;
    }
    const double total = out->share[0] + out->share[1] + out->share[2];
    out->scale = fmin(1.0, 1.0 / total);
    return total > 0.0;
}

/* Continues by one of them, in proportion to the shares. *rough becomes true by the rough lobe. False: the path ends.
 */
static inline bool path_fork_take(struct path_ray *r, const struct path_fork *f, struct rng *rng, bool *rough)
{
    const double pick = rng_next(rng) / f->scale;

    if (pick < f->share[0]) {
        double x[3];
        for (int k = 0; k < 3; k++)
            x[k] = rng_next(rng);
        *rough = true;
        return path_ray_follow(r, &f->lobe, f->wo, f->start, x, f->share[0] * f->scale);
    }
    if (!(pick < f->share[0] + f->share[1] + f->share[2]))
        return false;
    const int i = !(pick < f->share[0] + f->share[1]);
    r->origin = f->delta[i].origin;
    r->dir = f->delta[i].dir;
    r->specular = true;
    for (int c = 0; c < 3; c++)
        r->weight[c] *= f->delta[i].weight[c] * f->delta[i].radiance_scale / (f->share[1 + i] * f->scale);
    return true;
}
