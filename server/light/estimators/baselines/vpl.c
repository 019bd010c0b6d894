#include "light/estimators/baselines/path.h"

#include "base/cancel.h"
#include "base/mem.h"
#include "light/estimators/baselines/chains.h"
#include "scene/surface/lobe.h"

#include <assert.h>
#include <math.h>

/* Maximum number of lights per particle; the probability of exceeding it is below the roulette's 0.95^60. */
#define LIGHTS_MAX 64

struct lights { /* the lights of one particle */
    uint32_t count;
    struct particle *lights; /* [LIGHTS_MAX] */
};

struct session {
    const struct path_world *world;
    const struct path_desc *desc;
    uint64_t seed;
    struct lights *particles; /* [desc->samples] */
};

struct gather { /* state of one sample */
    const struct session *session;
    const struct lights *lights;
    double rgb[3];
    uint64_t rays;
};

static bool leave_light(void *data, const struct particle *p)
{
    struct lights *l = data;

    l->lights[l->count++] = *p;
    return l->count < LIGHTS_MAX;
}

/* Contribution of one light to a point: BRDF, geometry term, BRDF, flux [Keller 1997]. The geometry term is clamped at
 * pi / area: a patch of radiance 1 that fills the hemisphere contributes pi. */
static void connect(struct gather *g, const struct scatter *at, struct vec3 dir, const double weight[3],
                    const struct particle *light)
{
    const struct vec3 from = surface_start(&at->surface, 1.0f),
                      to = surface_start(&light->at.surface, light->at.through ? -1.0f : 1.0f);
    const struct vec3 across = vec3_sub(to, from), wi = vec3_normalize(across);
    const struct lobe lobe = lobe_of(at);
    const double distance2 = fmax(vec3_dot(across, across), 1e-20);
    const float side = light->at.through ? -1.0f : 1.0f;
    const double here = vec3_dot(lobe.shading, wi), there = -side * vec3_dot(light->at.surface.geometric, wi);
    double received[3], sent[3];

    if (!(here > 0.0 && there > 0.0))
        return;
    lobe_evaluate(&lobe, scatter_side(at, vec3_scale(dir, -1.0f)), wi, received);
    chains_scatter(&light->at, wi, vec3_scale(light->dir, -1.0f), sent);
    const double geometry = fmin(here * there / distance2, PI / light->area * g->session->desc->samples);
    const double most = fmax(received[0] * sent[0], fmax(received[1] * sent[1], received[2] * sent[2]));
    if (!(most * geometry > 0.0))
        return;
    g->rays++;
    if (rays_blocked(g->session->world->rays, from, across, 0.0f, 1.0f - 1e-5f))
        return;
    for (int k = 0; k < 3; k++)
        g->rgb[k] += weight[k] * received[k] * geometry * sent[k] * light->flux[k] * (double)light->at.weight;
}

static void light_point(void *data, const struct scatter *at, struct vec3 dir, const double weight[3])
{
    struct gather *g = data;

    for (uint32_t i = 0; i < g->lights->count; i++)
        connect(g, at, dir, weight, &g->lights->lights[i]);
}

static void light_pixel(const struct session *s, uint32_t x, uint32_t y, float *rgb, uint64_t *rays)
{
    const uint64_t pixel = rng_mix(rng_mix(s->seed, 1), (uint64_t)y * s->world->view->width + x);
    struct gather g = { .session = s };

    for (uint32_t i = 0; i < s->desc->samples; i++) {
        struct rng rng = { rng_mix(pixel, i) };
        const double xy[2] = { x + rng_next(&rng), y + rng_next(&rng) };
        g.lights = &s->particles[i];
        chains_from_eye(s->world, xy, &rng, light_point, &g, &g.rays);
    }
    for (int k = 0; k < 3; k++)
        rgb[k] += (float)(g.rgb[k] / s->desc->samples);
    *rays += g.rays;
}

/* Adds indirect light to the image. */
static void run(const struct session *s, float *rgb, struct path_stats *stats)
{
    const struct path_desc *desc = s->desc;
    const struct view *view = s->world->view;
    const struct box bounds = { s->world->scene->low, s->world->scene->high };
    uint64_t rays = 0, pixels = 0;

#pragma omp parallel for schedule(dynamic, 16) reduction(+ : rays)
    for (uint32_t i = 0; i < desc->samples; i++) {
        struct rng rng = { rng_mix(rng_mix(s->seed, 0), i) };
        chains_from_sky(s->world, &bounds, 1, &rng, leave_light, &s->particles[i], &rays);
    }
#pragma omp parallel for schedule(dynamic, 1) reduction(+ : rays, pixels)
    for (uint32_t y = 0; y < view->height; y++) {
        for (uint32_t x = 0; x < view->width; x++) {
            if (is_cancelled(desc->cancel))
                break;
            light_pixel(s, x, y, rgb + 3 * ((size_t)y * view->width + x), &rays);
            pixels++;
        }
    }
    stats->rays += rays;
    stats->samples += desc->samples + pixels * desc->samples;
}

enum err vpl_render(const struct path_world *world, const struct path_desc *desc, float *rgb, struct path_stats *stats)
{
    struct path_desc own = *desc;
    struct session s = { .world = world, .desc = desc, .seed = rng_mix(rng_mix(desc->seed, desc->pass), 'v') };

    assert(world->environment->ready && desc->samples >= 1);
    own.classes &= PATH_BACKGROUND | PATH_DIRECT;
    enum err e = path_render(world, &own, rgb, stats);
    stats->bias = "no caustics, no indirect light via mirrors or glass, corners too dark";
    if (e || !(desc->classes & PATH_INDIRECT) || !(world->environment->total_energy > 0.0))
        return e;
    struct particle *lights = mem_alloc_raw(desc->samples, LIGHTS_MAX * sizeof(*lights));
    s.particles = mem_alloc(desc->samples, sizeof(*s.particles));
    if (!lights || !s.particles) {
        e = ERR_NOMEM;
        goto done;
    }
    for (uint32_t i = 0; i < desc->samples; i++)
        s.particles[i].lights = lights + (size_t)i * LIGHTS_MAX;
    run(&s, rgb, stats);
done:
    mem_free(s.particles);
    mem_free(lights);
    return e;
}
