#include "light/frame/relight_passes.h"

#include "base/clock.h"
#include "base/mem.h"
#include "base/rng.h"
#include "light/resolve/backplate.h"
#include "light/resolve/resolve.h"

#include <string.h>

bool passes_init(struct passes *s, const struct prepared_scene *set, const struct kernels *kernels)
{
    *s = (struct passes){
        .set = set,
        .kernels = kernels,
        .direct = { direct_create(kernels) },
        .light = light_tracer_create(set->scene, set->rays, &set->view),
        .resolver = resolver_create(set->gbuffer),
        .scratch = scratch_create(),
        .lo = mem_alloc(set->gbuffer->packet_count, 3 * PACKET * sizeof(float)),
    };
    const bool ground = set->scene->ground.radius > 0.0f;
    s->backplate = ground ? backplate_create(set->scene, set->gbuffer, &set->view) : NULL;
    return s->direct[0] && s->light && s->resolver && s->scratch && s->lo && (s->backplate || !ground);
}

void passes_finish(struct passes *s)
{
    for (int k = 0; k < PASS_TABLES; k++)
        direct_destroy(s->direct[k]);
    for (int k = 0; k < 4; k++)
        mem_free(s->half[k / 2][k % 2]);
    light_tracer_destroy(s->light);
    resolver_destroy(s->resolver);
    backplate_destroy(s->backplate);
    scratch_destroy(s->scratch);
    mem_free(s->lo);
    *s = (struct passes){ .set = NULL };
}

enum err passes_measure(struct passes *s)
{
    const size_t pixels = (size_t)s->set->gbuffer->width * s->set->gbuffer->height * (s->backplate ? 2 : 1);
    bool all = s->direct[PASS_PROBE] || (s->direct[PASS_PROBE] = direct_create(s->kernels));

    for (int k = 0; k < 4; k++) {
        float **half = &s->half[k / 2][k % 2];
        all = (*half || (*half = mem_alloc(pixels, 3 * sizeof(float)))) && all;
    }
    return all ? ERR_OK : ERR_NOMEM;
}

enum err passes_direct(struct passes *s, int tables, const struct environment *e, const struct direct_desc *desc,
                       float *lo, struct direct_stats *stats, double *seconds)
{
    const double start = clock_seconds();
    const enum err result = direct_shade(s->direct[tables], s->set->gbuffer, s->set->rays, e, desc, lo, stats);

    *seconds = clock_seconds() - start;
    return result;
}

enum err passes_eye(struct passes *s, const struct environment *e, const struct eye_paths_desc *desc, float *lo,
                    struct eye_paths_stats *stats, double *seconds)
{
    struct eye_paths_desc own = *desc;
    const double start = clock_seconds();

    own.scratch = s->scratch;
    for (uint32_t k = 0; k < desc->only->count; k++)
        memset(lo + (size_t)desc->only->index[k] * 3 * PACKET, 0, 3 * PACKET * sizeof(float));
    const enum err result = eye_paths_shade(s->set->scene, s->set->rays, s->set->gbuffer, e, &own, lo, stats);
    *seconds = clock_seconds() - start;
    return result;
}

static void add_light_stats(struct light_tracer_stats *to, const struct light_tracer_stats *more)
{
    to->particles += more->particles;
    to->starts_hit += more->starts_hit;
    to->rays += more->rays;
    to->splats += more->splats;
}

enum err passes_halves(struct passes *s, const struct environment *e, const struct light_tracer_desc *desc,
                       float *const half[2], struct light_tracer_stats *stats, double *seconds)
{
    const size_t values = (size_t)s->set->gbuffer->width * s->set->gbuffer->height * 3;
    const size_t bytes = values * (s->backplate ? 2 : 1) * sizeof(float);
    struct light_tracer_desc own = *desc;
    const double start = clock_seconds();
    enum err result = ERR_OK;

    *stats = (struct light_tracer_stats){ 0 };
    own.particles = desc->particles / 2;
    own.pass = 0;
    for (uint64_t k = 0; k < 2 && !result; k++) {
        struct light_tracer_stats one = { 0 };
        memset(half[k], 0, bytes);
        own.seed = rng_mix(desc->seed, 2 * desc->pass + k);
        own.ground = s->backplate ? half[k] + values : NULL;
        result = light_tracer_run(s->light, e, &own, half[k], &one);
        add_light_stats(stats, &one);
    }
    *seconds = clock_seconds() - start;
    return result;
}

uint64_t passes_work(const struct prepared_scene *set, const struct image_passes *p)
{
    const uint64_t packets = set->gbuffer->packet_count, runs = p->denoiser ? 2 : 1;
    uint64_t steps = p->cached ? 0 : packets * p->direct.samples;

    for (int k = 0; k < 2; k++)
        steps += EYE_PATH_STEPS * (uint64_t)p->eye[k].paths * (p->eye[k].only ? p->eye[k].only->count : packets);
    return runs * steps + (p->light[0].particles + p->light[1].particles) / PARTICLES_A_STEP;
}

void passes_half(const struct image_passes *p, int k, struct image_passes *out)
{
    *out = *p;
    out->direct.pass = 2 * p->direct.pass + (uint64_t)k;
    out->direct.scatter = true;
    out->direct.keep = p->direct.keep || k > 0;
    for (int i = 0; i < 2; i++) {
        out->eye[i].pass = 2 * p->eye[i].pass + (uint64_t)k;
        out->eye[i].seed = rng_mix(p->eye[i].seed, (uint64_t)k);
    }
}
