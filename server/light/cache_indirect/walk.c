/* Traces paths through mirrors, glass and glossy lobes until they find light. */
#include "base/mem.h"
#include "light/cache_indirect/internal.h"
#include "light/estimators/paths.h"
#include "scene/geometry/scatter_hit.h"

#include <math.h>

struct walk {
    const struct indirect_world *world;
    struct vec3 origin, dir;
    double weight[3];
    bool met_rough, specular;
    struct rng *rng;
    struct indirect_ends *ends;
};

static void end_in(struct walk *w, uint32_t source, const double weight[3])
{
    struct indirect_ends *e = w->ends;

    if (mem_reserve(&e->at, e->count, &e->capacity, sizeof(*e->at)))
        e->at[e->count++] = (struct indirect_end){ source, { (float)weight[0], (float)weight[1], (float)weight[2] } };
    else
        e->failed = true;
}

static void write_down(struct indirect_spots *s, const struct indirect_spot *spot)
{
    if (mem_reserve(&s->at, s->count, &s->capacity, sizeof(*s->at)))
        s->at[s->count++] = *spot;
    else
        s->failed = true;
}

bool indirect_leave(const struct indirect_spot *s, const double x[2], struct vec3 *dir, float *weight)
{
    const double z = sqrt(1.0 - x[0]), r = sqrt(x[0]), phi = 2.0 * PI * x[1];

    *dir = frame_direction(s->shading, r * cos(phi), r * sin(phi), z);
    *weight = (float)lobe_enters(s->kind, z);
    return z > 0.0 && vec3_dot_double(s->geometric, *dir) > 0.0;
}

/* Share of the incident light that the matte part reflects towards wo. */
static void matte_albedo(const struct scatter *at, struct vec3 wo, double out[3])
{
    const float d[3] = { at->diffuse.x, at->diffuse.y, at->diffuse.z };
    const double leave = lobe_enters(at->kind, fmax(1e-3, vec3_dot_double(at->surface.shading, wo)));
    const double passes = veil_passes(&at->veil, wo);

    for (int c = 0; c < 3; c++)
        out[c] = passes * leave * (double)d[c];
}

/* Ends the path in the record of a matte surface, or notes the surface. If there is no record, the path may continue by
 * the matte part: returns its share of the throughput then, else 0. */
static double meet_matte(struct walk *w, const struct indirect_spot *spot, const double albedo[3])
{
    const double most = fmax(albedo[0], fmax(albedo[1], albedo[2]));

    if (!(most > 0.0))
        return 0.0;
    if (w->world->found) {
        write_down(w->world->found, spot);
        return 0.0;
    }
    const double x[2] = { rng_next(w->rng), rng_next(w->rng) };
    const uint32_t record = indirect_find(w->world->records, spot, x);
    if (record == INDIRECT_NO_RECORD)
        return most;
    double weight[3];
    for (int c = 0; c < 3; c++)
        weight[c] = w->weight[c] * albedo[c];
    end_in(w, record, weight);
    return 0.0;
}

/* Continues by the glossy lobe, which was selected with probability `keep`. False: no contribution is possible. */
static bool follow_lobe(struct walk *w, const struct lobe *shine, struct vec3 wo, struct vec3 start, double keep)
{
    double x[3], brdf[3];

    for (int k = 0; k < 3; k++)
        x[k] = rng_next(w->rng);
    w->dir = lobe_sample(shine, wo, x);
    w->origin = start;
    const double density = keep * lobe_density(shine, wo, w->dir);
    lobe_evaluate(shine, wo, w->dir, brdf);
    if (!(density > 0.0 && brdf[0] + brdf[1] + brdf[2] > 0.0))
        return false;
    for (int c = 0; c < 3; c++)
        w->weight[c] *= brdf[c] * vec3_dot_double(shine->shading, w->dir) / density;
    return true;
}

static bool follow_matte(struct walk *w, const struct indirect_spot *spot, const double albedo[3], double keep)
{
    const double x[2] = { rng_next(w->rng), rng_next(w->rng) };
    float weight;

    w->origin = spot->at;
    if (!indirect_leave(spot, x, &w->dir, &weight))
        return false;
    for (int c = 0; c < 3; c++)
        w->weight[c] *= albedo[c] * (double)weight / keep;
    return true;
}

static void follow_delta(struct walk *w, const struct delta_ray *ray, double keep)
{
    w->origin = ray->origin;
    w->dir = ray->dir;
    for (int c = 0; c < 3; c++)
        w->weight[c] *= (double)ray->weight[c] * (double)ray->radiance_scale / keep;
}

/* A surface's lobe without its matte part, and approximately the share of light that it reflects. */
static struct lobe shine_of(const struct scatter *at, struct vec3 wo, double *share)
{
    struct lobe l = lobe_of(at);

    l.diffuse = vec3_make(0.0f, 0.0f, 0.0f);
    *share = at->rough ? lobe_shine(&l, wo) : 0.0;
    return l;
}

/* Handles a hit: collects the light of the matte part and continues by one lobe. False: the path ends. */
static bool meet(struct walk *w, const struct hit *h)
{
    struct scatter at;
    struct delta_ray rays[2];
    double share[4] = { 0.0 }, albedo[3] = { 0.0 };

    scatter_at(w->world->scene, w->world->rays, h, w->dir, &at);
    for (int c = 0; c < 3; c++)
        w->weight[c] *= (double)at.weight;
    const uint32_t count = scatter_eye(&at, w->dir, rays);
    const struct vec3 wo = scatter_side(&at, vec3_scale(w->dir, -1.0f));
    const struct indirect_spot spot = { .at = surface_start(&at.surface, 1.0f),
                                      .geometric = at.surface.geometric,
                                      .shading = at.surface.shading,
                                      .length = h->t,
                                      .kind = at.kind };
    if (at.rough) {
        matte_albedo(&at, wo, albedo);
        share[0] = meet_matte(w, &spot, albedo);
    }
    const struct lobe shine = shine_of(&at, wo, &share[1]);
    for (uint32_t i = 0; i < count; i++)
        share[2 + i] = (double)(rays[i].weight[0] + rays[i].weight[1] + rays[i].weight[2]) / 3.0;
    const double total = share[0] + share[1] + share[2] + share[3], scale = fmin(1.0, 1.0 / total);
    double pick = rng_next(w->rng) / scale;
    for (uint32_t k = 0; k < 4 && total > 0.0; pick -= share[k++]) {
        if (!(pick < share[k]))
            continue;
        w->met_rough |= k < 2;
        w->specular = k >= 2;
        if (k == 0)
            return follow_matte(w, &spot, albedo, share[0] * scale);
        if (k == 1)
            return follow_lobe(w, &shine, wo, spot.at, share[1] * scale);
        follow_delta(w, &rays[k - 2], share[k] * scale);
        return true;
    }
    return false;
}

float indirect_walk(const struct indirect_world *world, struct vec3 origin, struct vec3 dir, struct rng *rng,
                  struct indirect_ends *ends)
{
    struct walk w = {
        .world = world, .origin = origin, .dir = dir, .weight = { 1.0, 1.0, 1.0 }, .rng = rng, .ends = ends
    };
    float first = INFINITY;

    for (uint32_t events = 0; events < PATH_EVENTS_MAX; events++) {
        struct hit h;
        ends->rays++;
        if (!rays_intersect(world->rays, w.origin, w.dir, 0.0f, &h)) {
            if (w.met_rough && !w.specular && !world->found)
                end_in(&w, world->records->count + indirect_cell(w.dir, rng_next(rng)), w.weight);
            break;
        }
        if (events == 0)
            first = h.t;
        if (!meet(&w, &h))
            break;
    }
    return first;
}
