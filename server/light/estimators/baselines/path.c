#include "light/estimators/baselines/path.h"

#include "base/cancel.h"
#include "base/rng.h"
#include "scene/geometry/lane_rays.h"
#include "scene/geometry/scatter_hit.h"
#include "scene/surface/lobe.h"
#include "scene/surface/scatter.h"
#include "sky/tables/samples.h"

#include <assert.h>
#include <math.h>
#include <string.h>

/* Indices of an event's random numbers, relative to 2 + event * PATH_PLACES_EVENT. */
enum place {
    PLACE_LIGHT = 0,    /* 2 numbers: direction to the sky */
    PLACE_LOBE = 2,     /* 3 numbers: direction from the rough lobe */
    PLACE_CHOICE = 5,   /* selects the lobe */
    PLACE_ROULETTE = 6, /* Russian roulette */
};

/* From this event on, paths survive with the probability of their throughput [Arvo and Kirk 1990]; much later with at
 * most ROULETTE_CAP, so that paths end even in white rooms. */
#define ROULETTE_FROM 3
#define ROULETTE_CAP_FROM 16
#define ROULETTE_CAP 0.95

struct walk { /* a path being traced from the eye */
    const struct path_world *world;
    struct numbers *numbers;
    uint32_t classes, event;
    struct vec3 origin, dir;
    double weight[3];      /* throughput so far, as flux */
    double scale;          /* radiance factor to the eye; changes where the path enters or leaves glass */
    uint32_t rough_events; /* D */
    bool after_delta;      /* the last event was S */
    double density;        /* sr^-1, of dir, by the D lobe that sampled it */
    double *rgb;
    uint64_t *rays;
};

static double number(const struct walk *w, uint32_t place)
{
    return w->numbers->at(w->numbers, 2 + w->event * PATH_PLACES_EVENT + place);
}

/* The class of the path if w's ray reaches the sky. */
static uint32_t class_now(const struct walk *w)
{
    if (w->rough_events == 0)
        return PATH_BACKGROUND;
    if (w->rough_events == 1)
        return w->after_delta ? PATH_CAUSTICS : PATH_DIRECT;
    return w->after_delta ? PATH_INDIRECT_CAUSTIC : PATH_INDIRECT_LIT;
}

/* The classes that its continuations may belong to. */
static uint32_t classes_ahead(const struct walk *w)
{
    if (w->rough_events == 0)
        return PATH_ALL;
    if (w->rough_events == 1)
        return class_now(w) | PATH_CAUSTICS | PATH_INDIRECT;
    return PATH_INDIRECT;
}

static void add(struct walk *w, const double brdf[3], const float radiance[3], double factor)
{
    for (int k = 0; k < 3; k++)
        w->rgb[k] += w->weight[k] * w->scale * brdf[k] * radiance[k] * factor;
}

/* The ray left the scene. Background is looked up in the source image; all else uses the sampled function. A ray
 * sampled by a D lobe could also have been sampled from the sky's table: balance heuristic [Veach 1997, Eq. 9.8]. */
static void miss(struct walk *w)
{
    static const double one[3] = { 1.0, 1.0, 1.0 };
    const struct environment *e = w->world->environment;
    const float d[3] = { w->dir.x, w->dir.y, w->dir.z };
    float radiance[3];

    if (!(w->classes & class_now(w)))
        return;
    if (w->rough_events == 0) {
        environment_lookup(e, w->dir, radiance);
        add(w, one, radiance, 1.0);
        return;
    }
    const double light = environment_sample_density(e, d, radiance);
    add(w, one, radiance, w->after_delta ? 1.0 : w->density / (w->density + light));
}

/* Next event estimation at a D lobe: one direction from the sky's table, balanced with the lobe, which is followed with
 * probability `share`. */
static void light(struct walk *w, struct vec3 start, struct vec3 wo, const struct lobe *lobe, double share)
{
    const double x[2] = { number(w, PLACE_LIGHT), number(w, PLACE_LIGHT + 1) };
    float d[3], radiance[3], pdf;
    double brdf[3];

    if (!environment_sample(w->world->environment, x, d, radiance, &pdf))
        return;
    const struct vec3 wi = vec3_make(d[0], d[1], d[2]);
    lobe_evaluate(lobe, wo, wi, brdf);
    if (!(brdf[0] + brdf[1] + brdf[2] > 0.0))
        return;
    ++*w->rays;
    if (rays_blocked(w->world->rays, start, wi, 0.0f, INFINITY))
        return;
    add(w, brdf, radiance, vec3_dot_double(lobe->shading, wi) / (pdf + share * lobe_density(lobe, wo, wi)));
}

/* Continues by the D lobe, which was selected with probability `share`. */
static bool follow_lobe(struct walk *w, struct vec3 start, struct vec3 wo, const struct lobe *lobe, double share)
{
    const double x[3] = { number(w, PLACE_LOBE), number(w, PLACE_LOBE + 1), number(w, PLACE_LOBE + 2) };
    const struct vec3 wi = lobe_sample(lobe, wo, x);
    double brdf[3];

    lobe_evaluate(lobe, wo, wi, brdf);
    w->density = share * lobe_density(lobe, wo, wi);
    if (!(brdf[0] + brdf[1] + brdf[2] > 0.0 && w->density > 0.0))
        return false;
    for (int k = 0; k < 3; k++)
        w->weight[k] *= brdf[k] * vec3_dot_double(lobe->shading, wi) / w->density;
    w->origin = start;
    w->dir = wi;
    w->after_delta = false;
    return true;
}

static void follow_delta(struct walk *w, const struct delta_ray *ray, double share)
{
    for (int k = 0; k < 3; k++)
        w->weight[k] *= ray->weight[k] / share;
    w->scale *= ray->radiance_scale;
    w->origin = ray->origin;
    w->dir = ray->dir;
    w->after_delta = true;
}

static bool survives(struct walk *w)
{
    const double left = fmax(w->weight[0], fmax(w->weight[1], w->weight[2]));
    const double q = fmin(w->event < ROULETTE_CAP_FROM ? 1.0 : ROULETTE_CAP, left);

    if (w->event < ROULETTE_FROM)
        return left > 0.0;
    if (!(number(w, PLACE_ROULETTE) < q))
        return false;
    for (int k = 0; k < 3; k++)
        w->weight[k] /= q;
    return true;
}

void path_ground_factor(const struct path_world *w, struct vec3 dir, double factor[3], float still[3])
{
    float sky[3];

    environment_lookup(w->environment, dir, sky);
    for (int k = 0; k < 3; k++) {
        const bool lit = w->bare_ground[k] > 0.0;
        factor[k] = lit ? (double)sky[k] / w->bare_ground[k] : 0.0;
        still[k] = lit ? 0.0f : sky[k];
    }
}

/* The first rough surface is the ground. */
static void show_ground(struct walk *w)
{
    static const double one[3] = { 1.0, 1.0, 1.0 };
    double factor[3];
    float still[3];

    path_ground_factor(w->world, w->dir, factor, still);
    if (w->classes & PATH_BACKGROUND)
        add(w, one, still, 1.0);
    for (int k = 0; k < 3; k++)
        w->weight[k] *= factor[k];
}

/* Handles a hit: lights the D lobe, and continues by one lobe, selected in proportion to its throughput. False: the
 * path ends. */
static bool meet(struct walk *w, const struct hit *h)
{
    struct scatter at;
    struct delta_ray delta[2];
    double part[3] = { 0.0, 0.0, 0.0 }; /* the two delta rays, the D lobe */

    scatter_at(w->world->scene, w->world->rays, h, w->dir, &at);
    for (int k = 0; k < 3; k++)
        w->weight[k] *= (double)at.weight;
    if (w->rough_events == 0 && path_shows_ground(w->world, at.material))
        show_ground(w);
    const uint32_t count = scatter_eye(&at, w->dir, delta);
    for (uint32_t i = 0; i < count; i++)
        part[i] = rgb_luminance(delta[i].weight[0], delta[i].weight[1], delta[i].weight[2]);
    if (at.rough)
        part[2] = count == 0 ? 1.0 : rgb_luminance(at.diffuse.x, at.diffuse.y, at.diffuse.z);
    const double sum = part[0] + part[1] + part[2], share = sum > 0.0 ? part[2] / sum : 0.0;
    const double choice = number(w, PLACE_CHOICE) * sum;
    const struct lobe lobe = lobe_of(&at);
    const struct vec3 wo = scatter_side(&at, vec3_scale(w->dir, -1.0f)), start = surface_start(&at.surface, 1.0f);

    if (!(sum > 0.0))
        return false;
    if (at.rough) {
        struct walk lit = *w;
        lit.rough_events++;
        lit.after_delta = false;
        if (w->classes & class_now(&lit))
            light(&lit, start, wo, &lobe, share);
    }
    if (at.rough && choice >= part[0] + part[1]) {
        w->rough_events++;
        if (!follow_lobe(w, start, wo, &lobe, share))
            return false;
    } else {
        const int i = count == 2 && choice >= part[0];
        follow_delta(w, &delta[i], part[i] / sum);
    }
    return (w->classes & classes_ahead(w)) && survives(w);
}

/* From w->event on. */
static void walk_on(struct walk *w)
{
    struct hit h;

    for (; w->event < PATH_EVENTS_MAX; w->event++) {
        ++*w->rays;
        if (!rays_intersect(w->world->rays, w->origin, w->dir, 0.0f, &h)) {
            miss(w);
            return;
        }
        if (!meet(w, &h))
            return;
    }
}

void path_sample(const struct path_world *world, uint32_t classes, const double xy[2], struct numbers *numbers,
                 double rgb[3], uint64_t *rays)
{
    const double *o = world->view->origin;
    struct walk w = {
        .world = world,
        .numbers = numbers,
        .classes = classes,
        .origin = vec3_make((float)o[0], (float)o[1], (float)o[2]),
        .dir = view_direction(world->view, xy[0], xy[1]),
        .weight = { 1.0, 1.0, 1.0 },
        .scale = 1.0,
        .rgb = rgb,
        .rays = rays,
    };

    rgb[0] = rgb[1] = rgb[2] = 0.0;
    if (view_sees(world->view, xy[0], xy[1]))
        walk_on(&w);
}

/* Where in its pixel a point's ray starts. */
static struct vec3 start_in_pixel(const struct shade_packet *p, uint32_t lane, double x)
{
    struct lane_pixels pixels;
    struct ray16 rays;
    uint32_t place[PACKET];

    LANES(l) place[l] = (uint32_t)(x * PIXEL_CELLS);
    lanes_pixels(p, &pixels);
    lanes_start(p, &pixels, place, &rays);
    return vec3_make(rays.org_x[lane], rays.org_y[lane], rays.org_z[lane]);
}

void path_sample_point(const struct path_world *world, const struct shade_packet *p, uint32_t lane, uint32_t classes,
                       struct numbers *numbers, double rgb[3], uint64_t *rays)
{
    const struct vec3 at = start_in_pixel(p, lane, numbers->at(numbers, 1));
    const struct vec3 wo = vec3_make(p->wo_x[lane], p->wo_y[lane], p->wo_z[lane]);
    const struct lobe lobe = lobe_of_lane(p, lane);
    struct walk w = {
        .world = world,
        .numbers = numbers,
        .classes = classes,
        .weight = { 1.0, 1.0, 1.0 },
        .scale = 1.0,
        .rough_events = 1,
        .rgb = rgb,
        .rays = rays,
    };

    rgb[0] = rgb[1] = rgb[2] = 0.0;
    if (classes & PATH_DIRECT)
        light(&w, at, wo, &lobe, 1.0);
    if (!follow_lobe(&w, at, wo, &lobe, 1.0))
        return;
    w.event = 1;
    walk_on(&w);
}

struct counter { /* random numbers as a function of seed, pixel, sample and index */
    struct numbers numbers;
    uint64_t stream;
};

static double counted(struct numbers *n, uint32_t place)
{
    const struct counter *c = (const struct counter *)n; /* the first member */
    struct rng r = { c->stream + place * UINT64_C(0x9e3779b97f4a7c15) };
    return rng_next(&r);
}

static void render_pixel(const struct path_world *world, const struct path_desc *desc, uint32_t x, uint32_t y,
                         float out[3], uint64_t *rays)
{
    const uint64_t pixel = rng_mix(rng_mix(desc->seed, desc->pass), (uint64_t)y * world->view->width + x);
    double sum[3] = { 0.0, 0.0, 0.0 };

    for (uint32_t i = 0; i < desc->samples; i++) {
        struct counter c = { { counted }, rng_mix(pixel, i) };
        const double xy[2] = { x + counted(&c.numbers, 0), y + counted(&c.numbers, 1) };
        double rgb[3];
        path_sample(world, desc->classes, xy, &c.numbers, rgb, rays);
        for (int k = 0; k < 3; k++)
            sum[k] += rgb[k];
    }
    for (int k = 0; k < 3; k++)
        out[k] = (float)(sum[k] / desc->samples);
}

enum err path_render(const struct path_world *world, const struct path_desc *desc, float *rgb, struct path_stats *stats)
{
    const uint32_t width = world->view->width, height = world->view->height;
    uint64_t rays = 0, pixels = 0;

    assert(world->environment->ready && desc->samples >= 1);
    memset(rgb, 0, (size_t)width * height * 3 * sizeof(*rgb));
    *stats = (struct path_stats){ 0 };
    if (!(world->environment->total_energy > 0.0)) /* a black sky gives no light */
        return ERR_OK;
#pragma omp parallel for schedule(dynamic, 1) reduction(+ : rays, pixels)
    for (uint32_t y = 0; y < height; y++) {
        for (uint32_t x = 0; x < width; x++) {
            if (is_cancelled(desc->cancel))
                break;
            render_pixel(world, desc, x, y, rgb + 3 * ((size_t)y * width + x), &rays);
            pixels++;
        }
    }
    stats->rays = rays;
    stats->samples = pixels * desc->samples;
    return ERR_OK;
}
