#include "light/estimators/light_tracer.h"

#include "base/cancel.h"
#include "base/luminance.h"
#include "base/mem.h"
#include "base/progress.h"
#include "base/rng.h"
#include "scene/geometry/scatter_hit.h"
#include "scene/surface/lobe.h"
#include "scene/surface/scatter.h"
#include "sky/tables/samples.h"

#include <math.h>

#define BATCH 1024u          /* approximate number of particles; whole directions */
#define ROULETTE_BEGINS 0.25 /* as a share of the initial flux: above that a particle always survives */
#define EVENTS_SURE 32u      /* from this event on at least a quarter of the paths end at each event */
#define ROULETTE_LATE 0.75   /* so that even without absorption one in 10^28 reaches PATH_EVENTS_MAX */
#define ABOUT_GEOMETRIC 0.25 /* share of the rays leaving a glossy lobe that are sampled about the geometric normal */

struct particle {
    struct vec3 origin, dir;
    double flux[3], first_flux; /* first_flux: luminance of the initial flux */
    uint32_t from;
    uint32_t rough, delta; /* events so far */
    bool gathered;         /* the first event was a delta event */
    struct rng rng;
};

bool particles_init(struct particles *p, const struct scene *scene, const struct rays *rays, const struct view *view)
{
    const size_t casters = scene_casters(scene, NULL, 0);

    *p = (struct particles){
        .scene = scene,
        .rays = rays,
        .view = *view,
        .bounds = { scene->low, scene->high },
        .casters = mem_alloc(casters, sizeof(*p->casters)),
    };
    if (!p->casters)
        return false;
    scene_casters(scene, p->casters, casters);
    p->caster_count = start_join(p->casters, casters);
    return true;
}

void particles_finish(struct particles *p)
{
    for (uint32_t k = 0; k < PARTICLE_ROUND; k++)
        mem_free(p->batches[k].splats);
    mem_free(p->casters);
}

void particles_aim(const struct particles *p, bool aimed, struct particle_run *run)
{
    run->world = p;
    run->boxes = aimed ? p->casters : &p->bounds;
    run->box_count = aimed ? p->caster_count : 1;
}

static void add_splat(struct particle_batch *b, uint32_t pixel, uint32_t from, const double rgb[3])
{
    if (!mem_reserve(&b->splats, b->count, &b->capacity, sizeof(*b->splats))) {
        b->out_of_memory = true;
        return;
    }
    b->splats[b->count++] = (struct particle_splat){ pixel, from, { (float)rgb[0], (float)rgb[1], (float)rgb[2] } };
}

/* The factor |wi.n_s| / |wi.n_g| of light arriving from wi; 0 if it does not count. */
static double arrival(const struct surface *s, struct vec3 wi)
{
    const double in_g = vec3_dot_double(wi, s->geometric), in_s = vec3_dot_double(wi, s->shading);
    return in_g > 0.0 && in_s > 0.0 ? in_s / in_g : 0.0;
}

/* Connects a hit on a rough surface to the camera. */
static void splat(const struct particle_run *run, const struct particle *p, const struct scatter *at,
                  struct particle_batch *b)
{
    const struct particles *t = run->world;
    const struct surface *s = &at->surface;
    const struct vec3 wi = vec3_scale(p->dir, -1.0f);
    const struct lobe lobe = lobe_of(at);
    struct projection to;
    double brdf[3], rgb[3];

    if (!view_project(&t->view, s->position, &to))
        return;
    const double side = at->through ? -1.0 : 1.0; /* of the camera */
    const double out_g = side * vec3_dot_double(to.to_eye, s->geometric), scale = arrival(s, wi) * out_g * to.response;
    if (!(out_g > 0.0 && scale > 0.0))
        return;
    lobe_evaluate(&lobe, scatter_side(at, to.to_eye), wi, brdf);
    for (int c = 0; c < 3; c++)
        rgb[c] = p->flux[c] * (double)at->weight * brdf[c] * scale;
    if (!(rgb[0] + rgb[1] + rgb[2] > 0.0))
        return;
    b->stats.rays++;
    if (rays_blocked(t->rays, surface_start(s, (float)side), to.to_eye, 0.0f, (float)to.distance))
        return;
    b->stats.splats++;
    const bool apart = run->ground_apart && t->scene->materials[at->material].ground;
    const uint32_t row = (uint32_t)to.y + (apart ? t->view.height : 0);
    add_splat(b, row * t->view.width + (uint32_t)to.x, p->from, rgb);
}

static struct vec3 cosine_about(struct vec3 n, double x, double y)
{
    const double r = sqrt(x), phi = 2.0 * PI * y;

    return frame_direction(n, r * cos(phi), r * sin(phi), sqrt(1.0 - x));
}

/* Continues by the rough lobe. Some or all rays are sampled about the geometric normal, since the camera may be where
 * the shading normal faces away, which the lobe's own sampling does not cover. False: absorbed. */
static bool go_on_rough(struct particle *p, const struct scatter *at)
{
    const struct surface *s = &at->surface;
    const struct vec3 wi = vec3_scale(p->dir, -1.0f);
    const struct lobe lobe = lobe_of(at);
    const double part = lobe.kind == LOBE_LAMBERT ? 1.0 : ABOUT_GEOMETRIC, in = arrival(s, wi);
    const double x[4] = { rng_next(&p->rng), rng_next(&p->rng), rng_next(&p->rng), rng_next(&p->rng) };
    double brdf[3];

    if (!(in > 0.0))
        return false;
    const struct vec3 w = x[3] < part ? cosine_about(s->geometric, x[0], x[1]) : lobe_sample(&lobe, wi, x);
    const double out_g = vec3_dot_double(w, s->geometric);
    if (!(out_g > 0.0))
        return false;
    const double pdf = part * out_g / PI + (part < 1.0 ? (1.0 - part) * lobe_density(&lobe, wi, w) : 0.0);
    const struct vec3 on = at->through ? vec3_sub(w, vec3_scale(s->geometric, 2.0f * vec3_dot(w, s->geometric))) : w;
    lobe_evaluate(&lobe, scatter_side(at, on), wi, brdf);
    for (int c = 0; c < 3; c++)
        p->flux[c] *= brdf[c] * in * out_g / pdf;
    p->origin = surface_start(s, at->through ? -1.0f : 1.0f);
    p->dir = on;
    p->rough++;
    return true;
}

/* Computes the luminance of each ray's weight; returns the sum. */
static double weigh(const struct delta_ray *rays, uint32_t count, double share[4])
{
    double sum = 0.0;

    for (uint32_t k = 0; k < count; k++) {
        const double w[3] = { rays[k].weight[0], rays[k].weight[1], rays[k].weight[2] };
        sum += share[k] = luminance_of(LUMINANCE_REC709, w);
    }
    return sum;
}

/* Continues by one of the delta lobe's rays, selected in proportion to weight. */
static void go_on_delta(struct particle *p, const struct delta_ray *rays, uint32_t count, const double share[4],
                        double sum)
{
    double x = rng_next(&p->rng) * sum;
    uint32_t k = 0;

    while (k + 1 < count && !(x < share[k]))
        x -= share[k++];
    while (k > 0 && !(share[k] > 0.0)) /* rounding: back to a ray with nonzero weight */
        k--;
    for (int c = 0; c < 3; c++)
        p->flux[c] *= rays[k].weight[c] * sum / share[k];
    p->origin = rays[k].origin;
    p->dir = rays[k].dir;
    p->gathered |= p->rough + p->delta == 0;
    p->delta++;
}

/* Selects a lobe and continues by it. False: absorbed. */
static bool go_on(const struct particle_run *run, struct particle *p, const struct scatter *at)
{
    struct delta_ray rays[4];
    double share[4];
    const uint32_t count = scatter_light(at, p->dir, rays);
    const double delta = weigh(rays, count, share);
    const bool may_rough = at->rough && (run->classes & (p->gathered ? PATH_INDIRECT_CAUSTIC : PATH_INDIRECT_LIT));
    double by_delta = delta > 0.0 ? 1.0 : 0.0;

    if (may_rough && delta > 0.0) {
        const struct vec3 albedo = vec3_add(at->diffuse, at->specular);
        const double rough = rgb_luminance(albedo.x, albedo.y, albedo.z);
        by_delta = fmin(0.9, fmax(0.1, delta / (delta + rough)));
    }
    if (!may_rough && by_delta == 0.0)
        return false;
    const bool goes_delta = by_delta == 1.0 || (by_delta > 0.0 && rng_next(&p->rng) < by_delta);
    const double chance = goes_delta ? by_delta : 1.0 - by_delta;
    for (int c = 0; c < 3; c++)
        p->flux[c] *= (double)at->weight;
    for (int c = 0; c < 3; c++)
        p->flux[c] /= chance;
    if (!goes_delta)
        return go_on_rough(p, at);
    go_on_delta(p, rays, count, share, delta);
    return true;
}

static bool survives(struct particle *p)
{
    double chance = luminance_of(LUMINANCE_REC709, p->flux) / (ROULETTE_BEGINS * p->first_flux);

    if (p->rough + p->delta >= EVENTS_SURE)
        chance = fmin(chance, ROULETTE_LATE);
    if (chance >= 1.0)
        return true;
    if (!(rng_next(&p->rng) < chance))
        return false;
    for (int c = 0; c < 3; c++)
        p->flux[c] /= chance;
    return true;
}

/* The class of the path if it ends at the camera after one more rough event; 0: direct light, which does not count. */
static uint32_t class_at(const struct particle *p)
{
    if (p->rough)
        return p->gathered ? PATH_INDIRECT_CAUSTIC : PATH_INDIRECT_LIT;
    return p->delta ? PATH_CAUSTICS : 0;
}

static void follow(const struct particle_run *run, struct particle *p, struct particle_batch *b)
{
    const struct particles *t = run->world;

    for (uint32_t event = 0; event < PATH_EVENTS_MAX; event++) {
        struct hit h;
        struct scatter at;
        b->stats.rays++;
        if (!rays_intersect(t->rays, p->origin, p->dir, 0.0f, &h))
            return;
        scatter_light_at(t->scene, t->rays, &h, p->dir, &at);
        if (event == 0 && !(run->classes & PATH_INDIRECT_LIT) && at.delta == DELTA_NONE)
            return;
        b->stats.starts_hit += event == 0;
        if (at.rough && (class_at(p) & run->shown))
            splat(run, p, &at, b);
        if (!go_on(run, p, &at) || !survives(p))
            return;
    }
}

static uint32_t reversed(uint32_t x)
{
    x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
    x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
    x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
    return __builtin_bswap32(x);
}

/* Scrambles each bit by the seed and the higher bits: a nested uniform scramble [Burley 2020, listing 3]. */
static uint32_t scrambled(uint32_t x, uint32_t seed)
{
    x = reversed(x) + seed;
    x ^= x * 0x6c50b47cu;
    x ^= x * 0xb82f1e52u;
    x ^= x * 0xc7afe638u;
    x ^= x * 0x8d22f6e6u;
    return reversed(x);
}

/* The start position of line number `line`: as rng_sobol2, but with 32 bits, which suffice for positions though not for
 * directions, in a tenth of the time. The order is shuffled such that each aligned block of 2^k lines remains a block;
 * otherwise directions and positions would be correlated [Burley 2020, section 5]. */
static void line_numbers(uint64_t seed, uint64_t line, double x[2])
{
    const uint64_t block = rng_mix(seed, line >> 32), next = rng_hash(block);
    const uint32_t index = scrambled((uint32_t)line, (uint32_t)block);
    uint32_t second = 0;

    for (uint32_t i = index, v = UINT32_C(1) << 31; i; i >>= 1, v ^= v >> 1)
        if (i & 1)
            second ^= v;
    x[0] = scrambled(reversed(index), (uint32_t)next) * 0x1p-32;
    x[1] = scrambled(second, (uint32_t)(next >> 32)) * 0x1p-32;
}

/* Samples a direction w from x in [0, 1)^2, with its radiance and density. False: the sky is black. */
static bool draw_direction(const struct particle_run *run, const double x[2], float w[3], float rgb[3], float *pdf)
{
    if (run->sun) {
        *pdf = 1.0f; /* rgb already includes the division */
        sky_split_sample(run->sun, run->environment, x, w, rgb);
        return true;
    }
    if (run->environment)
        return environment_sample(run->environment, x, w, rgb, pdf);
    const double z = 1.0 - 2.0 * x[0], r = sqrt(fmax(0.0, 1.0 - z * z)), phi = 2.0 * PI * x[1];
    w[0] = (float)(r * cos(phi));
    w[1] = (float)(r * sin(phi));
    w[2] = (float)z;
    rgb[0] = rgb[1] = rgb[2] = 1.0f;
    *pdf = (float)(0.25 / PI);
    return true;
}

/* Traces all particles of direction number `direction` of the run. */
static void follow_direction(const struct particle_run *run, uint64_t direction, struct particle_batch *b)
{
    const uint64_t first = direction * STARTS_PER_DIRECTION, number = run->first_direction + direction;
    const uint64_t last = first + STARTS_PER_DIRECTION < run->particles ? first + STARTS_PER_DIRECTION : run->particles;
    double x[2], density;
    float w[3], rgb[3], pdf;
    struct start start;

    rng_sobol2(rng_mix(run->seed, number >> 32), (uint32_t)number, x);
    if (!draw_direction(run, x, w, rgb, &pdf))
        return;
    start_init(&start, run->start, run->boxes, run->box_count, &run->world->bounds, vec3_make(-w[0], -w[1], -w[2]));
    for (uint64_t i = first; i < last; i++) {
        const uint64_t line = number * STARTS_PER_DIRECTION + (i - first);
        struct particle p = { .dir = { -w[0], -w[1], -w[2] }, .rng = { rng_mix(run->seed ^ 0x70617468, line) } };
        line_numbers(run->seed ^ 0x6c696e65, line, x);
        b->stats.particles++;
        if (!start_sample(&start, x, &p.origin, &density))
            continue;
        for (int c = 0; c < 3; c++)
            p.flux[c] = rgb[c] / (pdf * density * run->per_particle);
        p.first_flux = luminance_of(LUMINANCE_REC709, p.flux);
        p.from = direction_pack(w);
        if (p.first_flux > 0.0)
            follow(run, &p, b);
    }
}

static void run_batch(const struct particle_run *run, uint64_t first, uint64_t last, struct particle_batch *b)
{
    b->count = 0;
    b->stats = (struct light_tracer_stats){ 0 };
    b->out_of_memory = false;
    for (uint64_t d = first; d < last && !b->out_of_memory; d++)
        follow_direction(run, d, b);
}

/* Passes on the results of a round of batches, one after another. ERR_NOMEM if one of them is incomplete. */
static enum err hand_on(const struct particles *p, uint32_t count,
                        enum err (*take)(void *, const struct particle_splat *, size_t), void *user,
                        struct light_tracer_stats *stats)
{
    for (uint32_t k = 0; k < count; k++) {
        const struct particle_batch *b = &p->batches[k];
        const enum err e = b->out_of_memory ? ERR_NOMEM : take(user, b->splats, b->count);
        if (e)
            return e;
        stats->particles += b->stats.particles;
        stats->starts_hit += b->stats.starts_hit;
        stats->rays += b->stats.rays;
        stats->splats += b->stats.splats;
    }
    return ERR_OK;
}

enum err particles_trace(struct particles *p, const struct particle_run *run,
                         enum err (*take)(void *, const struct particle_splat *, size_t), void *user,
                         struct light_tracer_stats *stats)
{
    const uint64_t directions = (run->particles + STARTS_PER_DIRECTION - 1) / STARTS_PER_DIRECTION;
    const uint64_t each = BATCH / STARTS_PER_DIRECTION, batches = (directions + each - 1) / each;

    for (uint64_t begun = 0; begun < batches; begun += PARTICLE_ROUND) {
        const uint32_t count = (uint32_t)(batches - begun < PARTICLE_ROUND ? batches - begun : PARTICLE_ROUND);
#pragma omp parallel for schedule(dynamic, 1)
        for (uint32_t k = 0; k < count; k++) {
            const uint64_t first = (begun + k) * each, last = first + each < directions ? first + each : directions;
            if (!is_cancelled(run->cancel))
                run_batch(run, first, last, &p->batches[k]);
            progress_part_step(run->progress, (last - first) * STARTS_PER_DIRECTION / PARTICLES_A_STEP);
        }
        if (is_cancelled(run->cancel))
            return ERR_OK;
        const enum err e = hand_on(p, count, take, user, stats);
        if (e)
            return e;
    }
    return ERR_OK;
}
