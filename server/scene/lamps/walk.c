#include "scene/lamps/lamps.h"

#include "scene/geometry/scatter_hit.h"
#include "scene/surface/lobe.h"

struct walk {
    const struct walk_world *world;
    struct path_ray ray; /* the next one */
    struct rng *rng;
    double *sum;
    uint64_t *rays;
};

static void add(struct walk *w, const double brdf[3], double scale, const double rgb[3])
{
    for (int c = 0; c < 3; c++)
        w->sum[c] += w->ray.weight[c] * brdf[c] * scale * rgb[c];
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

/* What the surface at a hit emits. */
static void collect(struct walk *w, const struct hit *h, const struct scatter *at)
{
    static const double one[3] = { 1.0, 1.0, 1.0 };
    const struct material *m = &w->world->scene->materials[at->material];
    const struct vec3 e = scene_emission(w->world->scene, at->material, map_uv(m, MAP_EMISSION, &at->surface), NULL);
    const double rgb[3] = { e.x, e.y, e.z };

    if (!(e.x > 0.0f || e.y > 0.0f || e.z > 0.0f))
        return;
    const double other = w->ray.specular || w->world->by_lobes_alone
                             ? 0.0
                             : emitters_density(w->world->emitters, h, at->surface.geometric, w->ray.dir);
    add(w, one, w->ray.specular ? 1.0 : w->ray.density / (w->ray.density + other), rgb);
}

/* Handles a hit: collects its light and continues by one lobe. False: the path ends. */
static bool meet(struct walk *w, const struct hit *h)
{
    struct scatter at;
    struct path_fork fork;
    double x[3];
    bool by_lobe;

    scatter_at(w->world->scene, w->world->rays, h, w->ray.dir, &at);
    collect(w, h, &at);
    if (!path_fork_at(&w->ray, &at, at.rough, &fork))
        return false;
    for (int k = 0; k < 3; k++)
        x[k] = rng_next(w->rng);
    if (at.rough)
        light(w, &fork.lobe, fork.wo, fork.start, x, fork.share[0] * fork.scale);
    return path_fork_take(&w->ray, &fork, w->rng, &by_lobe);
}

void walk_sample(const struct walk_world *world, const struct walk_start *start, const double x[WALK_NUMBERS],
                 struct rng *rng, double sum[3], uint64_t *rays)
{
    struct walk w = { .world = world, .ray.weight = { 1.0, 1.0, 1.0 }, .rng = rng, .sum = sum, .rays = rays };
    const double to_triangle[3] = { x[WALK_PICK_TRIANGLE], x[WALK_TRIANGLE], x[WALK_TRIANGLE + 1] };
    const double to_lobe[3] = { x[WALK_PICK_LOBE], x[WALK_LOBE], x[WALK_LOBE + 1] };
    struct hit h;

    light(&w, &start->lobe, start->wo, start->origin, to_triangle, 1.0);
    if (!path_ray_follow(&w.ray, &start->lobe, start->wo, start->origin, to_lobe, 1.0))
        return;
    for (int event = 0; event < WALK_EVENTS_MAX; event++) {
        ++*rays;
        if (!rays_intersect(world->rays, w.ray.origin, w.ray.dir, 0.0f, &h) || !meet(&w, &h))
            return;
    }
}
