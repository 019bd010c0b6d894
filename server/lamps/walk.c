#include "lamps/walk.h"

#include "scene/scatter.h"

#include <math.h>

struct walk {
    const struct walk_world *world;
    struct vec3 origin, dir; /* of the next ray */
    double weight[3];        /* product of BRDF x cosine / probability so far, and of n^2 */
    double density;          /* sr^-1: probability of continuing along dir from the last rough surface */
    bool specular;           /* scattered by a delta lobe since */
    struct rng *rng;
    double *sum;
    uint64_t *rays;
};

static void add(struct walk *w, const double brdf[3], double scale, const double rgb[3])
{
    for (int c = 0; c < 3; c++)
        w->sum[c] += w->weight[c] * brdf[c] * scale * rgb[c];
}

/* Whether light can arrive from there, and the BRDF for it; one shadow ray. */
static bool is_lit(struct walk *w, const struct lobe *lobe, struct vec3 wo, struct vec3 at, const struct arrival *light,
                   double brdf[3])
{
    lobe_evaluate(lobe, wo, light->dir, brdf);
    if (!(brdf[0] + brdf[1] + brdf[2] > 0.0))
        return false;
    ++*w->rays;
    return !rays_blocked(w->world->rays, at, light->to, 0.0f, light->tfar);
}

/* Next event estimation at a rough surface that continues along its lobe with probability `keep`. */
static void light(struct walk *w, const struct lobe *lobe, struct vec3 wo, struct vec3 at, const double x[3],
                  double keep)
{
    const struct emitters *e = w->world->emitters;
    struct arrival from;
    double brdf[3];

    if (!w->world->by_lobes_alone && emitters_sample(e, at, x, &from) && is_lit(w, lobe, wo, at, &from, brdf))
        add(w, brdf,
            vec3_dot_double(lobe->shading, from.dir) / (from.density + keep * lobe_density(lobe, wo, from.dir)),
            from.rgb);
    if (emitters_lights(e) == 0)
        return;
    if (emitters_pick_light(e, at, rng_next(w->rng), &from) && is_lit(w, lobe, wo, at, &from, brdf))
        add(w, brdf, vec3_dot_double(lobe->shading, from.dir), from.rgb);
}

/* Continues along the lobe, which happens with probability `keep`. False: no contribution is possible. */
static bool follow_lobe(struct walk *w, const struct lobe *lobe, struct vec3 wo, struct vec3 at, const double x[3],
                        double keep)
{
    double weight[3];

    w->dir = lobe_sample(lobe, wo, x);
    w->origin = at;
    w->specular = false;
    w->density = keep * lobe_density(lobe, wo, w->dir);
    if (!lobe_weight(lobe, wo, w->dir, w->density, weight))
        return false;
    for (int c = 0; c < 3; c++)
        w->weight[c] *= weight[c];
    return true;
}

static void follow_delta(struct walk *w, const struct delta_ray *ray, double keep)
{
    w->origin = ray->origin;
    w->dir = ray->dir;
    w->specular = true;
    for (int c = 0; c < 3; c++)
        w->weight[c] *= ray->weight[c] * ray->radiance_scale / keep;
}

/* What the surface at a hit emits. */
static void collect(struct walk *w, const struct hit *h, const struct scatter *at)
{
    static const double one[3] = { 1.0, 1.0, 1.0 };
    const struct material *m = &w->world->scene->materials[at->material];
    const struct vec3 e = scene_emission(w->world->scene, at->material, map_uv(m, MAP_EMISSION, &at->surface), NULL);
    const double rgb[3] = { e.x, e.y, e.z };

    if (!(e.x > 0.0f || e.y > 0.0f || e.z > 0.0f))
        return;
    const double other = w->specular || w->world->by_lobes_alone
                             ? 0.0
                             : emitters_density(w->world->emitters, h, at->surface.geometric, w->dir);
    add(w, one, w->specular ? 1.0 : w->density / (w->density + other), rgb);
}

static double mean3(const float w[3])
{
    return (w[0] + w[1] + w[2]) / 3.0;
}

/* Handles a hit: collects its light and continues by one lobe. False: the path ends. */
static bool meet(struct walk *w, const struct hit *h)
{
    struct scatter at;
    struct delta_ray delta[2];
    double share[3] = { 0.0, 0.0, 0.0 }; /* of the rough lobe and of the delta rays */
    double x[3];

    scatter_at(w->world->scene, w->world->rays, h, w->dir, &at);
    collect(w, h, &at);
    for (int c = 0; c < 3; c++)
        w->weight[c] *= (double)at.weight;
    const uint32_t count = scatter_eye(&at, w->dir, delta);
    const struct lobe lobe = lobe_of(&at);
    const struct vec3 wo = scatter_side(&at, vec3_scale(w->dir, -1.0f)), start = surface_start(&at.surface, 1.0f);
    if (at.rough)
        share[0] = lobe_albedo(&lobe, wo);
    for (uint32_t i = 0; i < count; i++)
        share[1 + i] = mean3(delta[i].weight);
    const double total = share[0] + share[1] + share[2];
    if (!(total > 0.0))
        return false;
    /* Each continuation is selected with its share of the throughput; what is missing to 1 is Russian roulette. */
    const double scale = fmin(1.0, 1.0 / total);
    for (int k = 0; k < 3; k++)
        x[k] = rng_next(w->rng);
    if (at.rough)
        light(w, &lobe, wo, start, x, share[0] * scale);
    const double pick = rng_next(w->rng) / scale;
    if (pick < share[0]) {
        for (int k = 0; k < 3; k++)
            x[k] = rng_next(w->rng);
        return follow_lobe(w, &lobe, wo, start, x, share[0] * scale);
    }
    for (uint32_t i = 0; i < count; i++)
        if (pick < share[0] + share[1] + (i ? share[2] : 0.0)) {
            follow_delta(w, &delta[i], share[1 + i] * scale);
            return true;
        }
    return false;
}

void walk_sample(const struct walk_world *world, const struct walk_start *start, const double x[WALK_NUMBERS],
                 struct rng *rng, double sum[3], uint64_t *rays)
{
    struct walk w = { .world = world, .weight = { 1.0, 1.0, 1.0 }, .rng = rng, .sum = sum, .rays = rays };
    const double to_triangle[3] = { x[WALK_PICK_TRIANGLE], x[WALK_TRIANGLE], x[WALK_TRIANGLE + 1] };
    const double to_lobe[3] = { x[WALK_PICK_LOBE], x[WALK_LOBE], x[WALK_LOBE + 1] };
    struct hit h;

    light(&w, &start->lobe, start->wo, start->origin, to_triangle, 1.0);
    if (!follow_lobe(&w, &start->lobe, start->wo, start->origin, to_lobe, 1.0))
        return;
    for (int event = 0; event < WALK_EVENTS_MAX; event++) {
        ++*rays;
        if (!rays_intersect(world->rays, w.origin, w.dir, 0.0f, &h) || !meet(&w, &h))
            return;
    }
}
