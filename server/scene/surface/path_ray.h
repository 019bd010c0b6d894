/* The ray that continues a camera path, for tracers that follow one continuation of each surface. Thread: any. */
#pragma once

#include "base/rng.h"
#include "scene/surface/lobe.h"
#include "scene/surface/scatter.h"

#include <math.h>

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
