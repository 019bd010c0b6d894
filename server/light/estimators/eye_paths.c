#include "light/estimators/eye_paths.h"

#include "base/cancel.h"
#include "base/denormals.h"
#include "base/mem.h"
#include "base/precedence.h"
#include "base/progress.h"
#include "base/vec.h"
#include "scene/geometry/scatter_hit.h"
#include "scene/surface/lobe.h"
#include "sky/tables/samples.h"

#include <assert.h>
#include <math.h>

/* Numbers taken from a low-discrepancy sequence; later events use a stream of the path's own. */
enum number { NUMBER_LOBE, NUMBER_POLAR, NUMBER_AZIMUTH, NUMBER_SKY_X, NUMBER_SKY_Y, NUMBER_COUNT };

struct frame_paths { /* shared by all points; borrowed */
    const struct scene *scene;
    const struct rays *rays;
    const struct environment *environment;
    uint64_t (*numbers)[NUMBER_COUNT]; /* [paths], in units of 2^-64 */
    uint32_t paths;
    uint64_t point_seed, path_seed;
    double most; /* of a path; infinite: no limit */
};

struct record { /* of one packet */
    struct eye_path_end *ends;
    uint32_t count, lane;
};

/* A path being traced from a shading point. */
struct walk {
    const struct frame_paths *frame;
    uint32_t classes;
    struct path_ray ray; /* the next one */
    bool met_rough;      /* scattered by a rough lobe since the shading point */
    uint32_t events;
    double sky[2]; /* numbers of the first light sample */
    bool sky_used;
    struct rng rng;
    double sum[3];         /* contribution so far */
    struct record *record; /* gets the path's end instead; NULL: there is a sky */
    uint64_t rays;
};

static void add(struct walk *w, const double brdf[3], double scale, const float rgb[3])
{
    for (int c = 0; c < 3; c++)
        w->sum[c] += w->ray.weight[c] * (brdf ? brdf[c] : 1.0) * scale * rgb[c];
}

static void record_end(const struct walk *w)
{
    struct eye_path_end *end = &w->record->ends[w->record->count++];

    *end = (struct eye_path_end){ { w->ray.dir.x, w->ray.dir.y, w->ray.dir.z }, { 0.0f }, w->record->lane };
    for (int c = 0; c < 3; c++)
        end->weight[c] = (float)w->ray.weight[c];
}

/* The ray left the scene. */
static void miss(struct walk *w)
{
    const uint32_t class = w->met_rough      ? (w->ray.specular ? PATH_INDIRECT_CAUSTIC : PATH_INDIRECT_LIT)
                           : w->ray.specular ? PATH_CAUSTICS
                                             : PATH_DIRECT;
    const float dir[3] = { w->ray.dir.x, w->ray.dir.y, w->ray.dir.z };
    float rgb[3];

    if (!(w->classes & class))
        return;
    if (w->record) {
        record_end(w);
        return;
    }
    const double light = environment_sample_density(w->frame->environment, dir, rgb);
    add(w, NULL, w->ray.specular ? 1.0 : w->ray.density / (w->ray.density + light), rgb);
}

/* Next event estimation at a rough surface that continues along its lobe with probability `keep`. The density of the
 * light sample appears in the sum of the balance heuristic and cancels. */
static void sample_sky(struct walk *w, const struct lobe *lobe, struct vec3 wo, struct vec3 start, double keep)
{
    double x[2] = { w->sky[0], w->sky[1] }, brdf[3];
    float d[3], rgb[3], light;

    if (w->sky_used) {
        x[0] = rng_next(&w->rng);
        x[1] = rng_next(&w->rng);
    }
    w->sky_used = true;
    if (!environment_sample(w->frame->environment, x, d, rgb, &light) || !(light > 0.0f))
        return;
    const struct vec3 wi = vec3_make(d[0], d[1], d[2]);
    lobe_evaluate(lobe, wo, wi, brdf);
    if (!(brdf[0] + brdf[1] + brdf[2] > 0.0))
        return;
    w->rays++;
    if (rays_blocked(w->frame->rays, start, wi, 0.0f, INFINITY))
        return;
    add(w, brdf, vec3_dot_double(lobe->shading, wi) / ((double)light + keep * lobe_density(lobe, wo, wi)), rgb);
}

/* Handles a hit: collects its light and continues by one lobe. False: the path ends. There is no further roulette than
 * path_fork's: paths without loss, between mirrors or in glass, are rare, and thinning them would add noise. */
static bool meet(struct walk *w, const struct hit *h)
{
    struct scatter at;
    struct path_fork fork;

    scatter_at(w->frame->scene, w->frame->rays, h, w->ray.dir, &at);
    const bool rough = at.rough && (w->classes & PATH_INDIRECT);
    if (!path_fork_at(&w->ray, &at, rough, &fork))
        return false;
    if (rough && (w->classes & PATH_INDIRECT_LIT))
        sample_sky(w, &fork.lobe, fork.wo, fork.start, fork.share[0] * fork.scale);
    return path_fork_take(&w->ray, &fork, &w->rng, &w->met_rough);
}

/* Traces the path from its first ray, whose direction is set. */
static void walk_on(struct walk *w)
{
    for (;;) {
        struct hit h;
        w->rays++;
        if (!rays_intersect(w->frame->rays, w->ray.origin, w->ray.dir, 0.0f, &h)) {
            miss(w);
            return;
        }
        if (++w->events >= PATH_EVENTS_MAX || !meet(w, &h))
            return;
    }
}

/* The path ends: limits what it added to the sum of those before. */
static void limit(struct walk *w, const double before[3])
{
    double more = 0.0;

    for (int c = 0; c < 3; c++)
        more += w->sum[c] - before[c];
    if (!(more > w->frame->most))
        return;
    for (int c = 0; c < 3; c++)
        w->sum[c] = before[c] + w->frame->most / more * (w->sum[c] - before[c]);
}

/* All paths of one point. The sequence's numbers get a digital shift per point, which keeps each uniform and the set a
 * net. */
static uint64_t shade_point(const struct frame_paths *f, const struct shade_packet *p, uint32_t l, uint64_t point,
                            uint32_t paths, uint32_t classes, struct record *record, float *lo)
{
    const struct lobe lobe = lobe_of_lane(p, l);
    const struct vec3 wo = vec3_make(p->wo_x[l], p->wo_y[l], p->wo_z[l]), at = vec3_make(p->x[l], p->y[l], p->z[l]);
    uint64_t shift[NUMBER_COUNT];
    struct walk w = { .frame = f, .classes = classes, .record = record };

    for (uint64_t k = 0; k < NUMBER_COUNT; k++)
        shift[k] = rng_mix(f->point_seed, point * NUMBER_COUNT + k);
    for (uint32_t i = 0; i < paths; i++) {
        double x[NUMBER_COUNT];
        for (int k = 0; k < NUMBER_COUNT; k++)
            x[k] = rng_unit(f->numbers[i][k] ^ shift[k]);
        w.ray.weight[0] = w.ray.weight[1] = w.ray.weight[2] = 1.0;
        const double before[3] = { w.sum[0], w.sum[1], w.sum[2] };
        w.met_rough = w.sky_used = false;
        w.events = 0;
        w.sky[0] = x[NUMBER_SKY_X];
        w.sky[1] = x[NUMBER_SKY_Y];
        w.rng.state = rng_mix(f->path_seed, point * f->paths + i);
        if (path_ray_follow(&w.ray, &lobe, wo, at,
                            (const double[]){ x[NUMBER_LOBE], x[NUMBER_POLAR], x[NUMBER_AZIMUTH] }, 1.0))
            walk_on(&w);
        limit(&w, before);
    }
    for (int c = 0; c < 3 && lo; c++)
        lo[c * PACKET + l] += (float)(w.sum[c] / paths);
    return w.rays;
}

static void fill_numbers(uint64_t seed, uint32_t first, uint32_t paths, uint64_t (*out)[NUMBER_COUNT])
{
    for (uint32_t i = 0; i < paths; i++) {
        double pick[2], lobe[2], sky[2];
        rng_sobol2(rng_mix(seed, 0), first + i, lobe);
        rng_sobol2(rng_mix(seed, 1), rng_shuffled(rng_mix(seed, 2), first + i), sky);
        rng_sobol2(rng_mix(seed, 3), rng_shuffled(rng_mix(seed, 4), first + i), pick);
        const double x[NUMBER_COUNT] = { pick[0], lobe[0], lobe[1], sky[0], sky[1] };
        for (int k = 0; k < NUMBER_COUNT; k++)
            out[i][k] = (uint64_t)(x[k] * 0x1p53) << 11;
    }
}

/* Restricts classes to what exists: no caustics without a mirror or glass. */
static uint32_t classes_in(const struct scene *scene)
{
    uint32_t classes = PATH_INDIRECT_LIT;
    for (size_t i = 0; i < scene->material_count; i++)
        if (material_is_delta(&scene->materials[i]))
            classes |= PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC;
    return classes;
}

bool eye_paths_can_find(const struct scene *scene, const struct eye_paths_desc *desc)
{
    return ((desc->classes | desc->behind_classes) & classes_in(scene)) != 0;
}

static void shade_packets(const struct frame_paths *f, const struct gbuffer *g, const struct eye_paths_desc *desc,
                          const uint32_t classes[2], float *lo, struct eye_paths_stats *stats)
{
    const uint32_t packets = desc->only ? desc->only->count : g->packet_count;
    uint64_t rays = 0, paths = 0;

#pragma omp parallel reduction(+ : rays, paths)
    {
        const unsigned before = denormals_flush();
#pragma omp for schedule(dynamic, 4)
        for (uint32_t k = 0; k < packets; k++) {
            const uint32_t i = desc->only ? desc->only->index[k] : k;
            const struct shade_packet *p = &g->packets[i];
            const uint32_t own = desc->counts ? desc->counts[i] : desc->paths;
            if (is_cancelled(desc->cancel))
                continue;
            for (uint32_t l = 0; l < p->count; l++) {
                const uint32_t wanted = classes[p->behind[l] != 0];
                if (!wanted)
                    continue;
                rays += shade_point(f, p, l, (uint64_t)i * PACKET + l, own, wanted, NULL, lo + (size_t)i * 3 * PACKET);
                paths += own;
            }
            progress_part_step(desc->progress, (uint64_t)EYE_PATH_STEPS * desc->paths);
        }
        denormals_restore(before);
    }
    stats->rays = rays;
    stats->paths = paths;
}

static struct frame_paths frame_of(const struct scene *scene, const struct rays *rays, const struct environment *e,
                                   const struct eye_paths_desc *desc)
{
    return (struct frame_paths){
        .scene = scene,
        .rays = rays,
        .environment = e,
        .paths = desc->paths,
        .point_seed = rng_mix(desc->seed, 0),
        .path_seed = rng_mix(rng_mix(desc->seed, 1), desc->pass),
        .most = desc->most > 0.0 ? desc->most : INFINITY,
    };
}

enum err eye_paths_shade(const struct scene *scene, const struct rays *rays, const struct gbuffer *g,
                         const struct environment *e, const struct eye_paths_desc *desc, float *lo,
                         struct eye_paths_stats *stats)
{
    struct frame_paths f = frame_of(scene, rays, e, desc);

    const uint32_t found = classes_in(scene), classes[2] = { desc->classes & found, desc->behind_classes & found };

    assert(e->ready && desc->paths >= 1);
    *stats = (struct eye_paths_stats){ 0 };
    /* A black sky gives no light; visiting all points for nothing would take a millisecond. */
    if (!(e->total_energy > 0.0) || !(classes[0] | classes[1]))
        return ERR_OK;
    environment_complete(e);
    scratch_begin(desc->scratch);
    f.numbers = scratch_alloc(desc->scratch, desc->paths * sizeof(*f.numbers));
    if (!f.numbers)
        return ERR_NOMEM;
    fill_numbers(rng_mix(desc->seed, 2), (uint32_t)(desc->pass * desc->paths), desc->paths, f.numbers);
    shade_packets(&f, g, desc, classes, lo, stats);
    scratch_free(desc->scratch, f.numbers);
    return ERR_OK;
}

/* A packet's paths into r. Returns the number of rays. */
static uint64_t record_packet(const struct frame_paths *f, const struct shade_packet *p, uint32_t packet,
                              const uint32_t classes[2], struct record *r)
{
    uint64_t rays = 0;

    r->count = 0;
    for (r->lane = 0; r->lane < p->count; r->lane++) {
        const uint32_t wanted = classes[p->behind[r->lane] != 0];
        if (wanted)
            rays += shade_point(f, p, r->lane, (uint64_t)packet * PACKET + r->lane, f->paths, wanted, r, NULL);
    }
    return rays;
}

enum err eye_paths_record(const struct scene *scene, const struct rays *rays, const struct gbuffer *g,
                          const struct eye_paths_desc *desc, eye_paths_take *take, void *context,
                          struct eye_paths_stats *stats)
{
    struct frame_paths f = frame_of(scene, rays, NULL, desc);
    const uint32_t found = classes_in(scene), classes[2] = { desc->classes & found, desc->behind_classes & found };
    const uint32_t packets = desc->only ? desc->only->count : g->packet_count;
    uint64_t traced = 0;
    enum err result = ERR_OK;

    assert(desc->paths >= 1 && !((desc->classes | desc->behind_classes) & ~(PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC)));
    *stats = (struct eye_paths_stats){ 0 };
    f.numbers = mem_alloc(desc->paths, sizeof(*f.numbers));
    if (!f.numbers)
        return ERR_NOMEM;
    fill_numbers(rng_mix(desc->seed, 2), (uint32_t)(desc->pass * desc->paths), desc->paths, f.numbers);
#pragma omp parallel reduction(+ : traced)
    {
        struct record r = { .ends = mem_alloc((size_t)desc->paths * PACKET, sizeof(*r.ends)) };
        enum err own = r.ends ? ERR_OK : ERR_NOMEM;
        const unsigned before = denormals_flush();
#pragma omp for schedule(dynamic, 4)
        for (uint32_t k = 0; k < packets; k++) {
            const uint32_t i = desc->only ? desc->only->index[k] : k;
            if (own || is_cancelled(desc->cancel))
                continue;
            precedence_give_way(desc->urgent);
            traced += record_packet(&f, &g->packets[i], i, classes, &r);
            if (r.count > 0)
                own = take(context, i, r.ends, r.count);
        }
        denormals_restore(before);
        mem_free(r.ends);
        if (own) {
#pragma omp critical(eye_paths_record)
            result = own;
        }
    }
    stats->rays = traced;
    mem_free(f.numbers);
    return result;
}
