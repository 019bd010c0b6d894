#include "light/estimators/baselines/chains.h"

#include "scene/geometry/scatter_hit.h"
#include "scene/surface/lobe.h"
#include "sky/tables/samples.h"

#include <math.h>

#define ROULETTE_FROM 4 /* events; chosen, not measured */

static double largest(const double v[3])
{
    return fmax(v[0], fmax(v[1], v[2]));
}

static double mean_weight(const struct delta_ray *r)
{
    return (r->weight[0] + r->weight[1] + r->weight[2]) / 3.0;
}

void chains_scatter(const struct scatter *at, struct vec3 dir, struct vec3 wi, double out[3])
{
    const struct lobe l = lobe_of(at);

    lobe_evaluate(&l, scatter_side(at, vec3_scale(dir, -1.0f)), wi, out); /* 0 unless both cosines are positive */
    const double shading = vec3_dot_double(l.shading, wi), geometric = vec3_dot_double(l.geometric, wi);
    const double factor = geometric > 0.0 ? shading / geometric : 0.0;
    for (int k = 0; k < 3; k++)
        out[k] *= factor;
}

/* Scatters a particle by the D lobe: samples a direction as for a path from the eye and weights it with the adjoint
 * BRDF. */
static bool scatter_rough(struct particle *p, struct rng *rng, double share, struct vec3 *origin)
{
    const struct lobe l = lobe_of(&p->at);
    const struct vec3 wi = vec3_scale(p->dir, -1.0f);
    const double x[3] = { rng_next(rng), rng_next(rng), rng_next(rng) };
    const struct vec3 wo = lobe_sample(&l, wi, x);
    const double density = share * lobe_density(&l, wi, wo), leaving = vec3_dot_double(l.geometric, wo);
    const struct vec3 g = p->at.surface.geometric,
                      on = p->at.through ? vec3_sub(wo, vec3_scale(g, 2.0f * vec3_dot(wo, g))) : wo;
    double f[3];

    chains_scatter(&p->at, vec3_scale(on, -1.0f), wi, f);
    if (!(density > 0.0 && leaving > 0.0))
        return false;
    for (int k = 0; k < 3; k++)
        p->flux[k] *= f[k] * leaving / density;
    p->dir = on;
    p->rough_events++;
    *origin = surface_start(&p->at.surface, p->at.through ? -1.0f : 1.0f);
    return largest(p->flux) > 0.0;
}

/* Selects one of the surface's lobes in proportion to its throughput. */
static bool scatter_particle(struct particle *p, struct rng *rng, struct vec3 *origin)
{
    struct delta_ray delta[4];
    const uint32_t count = scatter_light(&p->at, p->dir, delta);
    const struct vec3 d = p->at.diffuse;
    double sum = !p->at.rough ? 0.0 : count == 0 ? 1.0 : (d.x + d.y + d.z) / 3.0;
    const double rough = sum;

    for (uint32_t i = 0; i < count; i++)
        sum += mean_weight(&delta[i]);
    double choice = rng_next(rng) * sum - rough;
    if (p->at.rough && choice < 0.0)
        return scatter_rough(p, rng, rough / sum, origin);
    for (uint32_t i = 0; i < count; i++) {
        const double part = mean_weight(&delta[i]);
        choice -= part;
        if (choice >= 0.0)
            continue;
        for (int k = 0; k < 3; k++)
            p->flux[k] *= delta[i].weight[k] * sum / part;
        p->dir = delta[i].dir;
        *origin = delta[i].origin;
        return true;
    }
    return false; /* absorbed */
}

static bool begin(const struct path_world *world, const struct box *boxes, uint32_t count, struct rng *rng,
                  struct particle *p, struct vec3 *origin)
{
    const struct box bounds = { world->scene->low, world->scene->high };
    const double x[4] = { rng_next(rng), rng_next(rng), rng_next(rng), rng_next(rng) };
    float w[3], radiance[3], pdf;
    struct start start;
    double density;

    if (!environment_sample(world->environment, x, w, radiance, &pdf))
        return false;
    p->dir = vec3_make(-w[0], -w[1], -w[2]);
    start_init(&start, START_FACES, boxes, count, &bounds, p->dir);
    if (!start_sample(&start, x + 2, origin, &density))
        return false;
    p->area = 1.0 / density;
    for (int k = 0; k < 3; k++)
        p->flux[k] = radiance[k] / pdf * p->area;
    return largest(p->flux) > 0.0;
}

void chains_from_sky(const struct path_world *world, const struct box *boxes, uint32_t count, struct rng *rng,
                     bool (*meet)(void *data, const struct particle *p), void *data, uint64_t *rays)
{
    struct particle p = { .events = 0 };
    struct vec3 origin;
    struct hit h;

    if (!begin(world, boxes, count, rng, &p, &origin))
        return;
    for (; p.events < PATH_EVENTS_MAX; p.events++) {
        const double before = largest(p.flux);
        ++*rays;
        if (!rays_intersect(world->rays, origin, p.dir, 0.0f, &h))
            return;
        scatter_light_at(world->scene, world->rays, &h, p.dir, &p.at);
        if (p.at.rough && !meet(data, &p))
            return;
        for (int k = 0; k < 3; k++)
            p.flux[k] *= (double)p.at.weight;
        if (!scatter_particle(&p, rng, &origin))
            return;
        const double q = fmin(0.95, largest(p.flux) / before);
        if (p.events >= ROULETTE_FROM) {
            if (!(rng_next(rng) < q))
                return;
            for (int k = 0; k < 3; k++)
                p.flux[k] /= q;
        }
    }
}

void chains_from_eye(const struct path_world *world, const double xy[2], struct rng *rng,
                     void (*meet)(void *data, const struct scatter *at, struct vec3 dir, const double weight[3]),
                     void *data, uint64_t *rays)
{
    const double *o = world->view->origin;
    struct vec3 origin = vec3_make((float)o[0], (float)o[1], (float)o[2]);
    struct vec3 dir = view_direction(world->view, xy[0], xy[1]);
    double weight[3] = { 1.0, 1.0, 1.0 };
    struct hit h;

    if (!view_sees(world->view, xy[0], xy[1]))
        return;
    for (uint32_t event = 0; event < PATH_EVENTS_MAX; event++) {
        struct scatter at;
        struct delta_ray delta[2];
        ++*rays;
        if (!rays_intersect(world->rays, origin, dir, 0.0f, &h))
            return;
        scatter_at(world->scene, world->rays, &h, dir, &at);
        for (int k = 0; k < 3; k++)
            weight[k] *= (double)at.weight;
        if (at.rough) {
            double factor[3] = { 1.0, 1.0, 1.0 };
            float still[3]; /* is in path.h's part of the image */
            if (path_shows_ground(world, at.material))
                path_ground_factor(world, dir, factor, still);
            for (int k = 0; k < 3; k++)
                factor[k] *= weight[k];
            meet(data, &at, dir, factor);
        }
        const uint32_t count = scatter_eye(&at, dir, delta);
        const double first = count > 0 ? mean_weight(&delta[0]) : 0.0;
        const double sum = count > 1 ? first + mean_weight(&delta[1]) : first;
        /* the continuation is selected in proportion, and survives with probability `left` */
        const double left = fmin(1.0, sum), choice = rng_next(rng) * sum / left;
        if (!(sum > 0.0) || choice >= sum)
            return;
        const struct delta_ray *r = &delta[choice < first || count == 1 ? 0 : 1];
        for (int k = 0; k < 3; k++)
            weight[k] *= r->weight[k] * r->radiance_scale / mean_weight(r) * sum / left;
        origin = r->origin;
        dir = r->dir;
    }
}
