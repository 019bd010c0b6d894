/* Light: shadow rays, arithmetic, particles. */
#include "measure/bench/bench.h"

#include "base/mem.h"

#include <math.h>
#include <stdlib.h>

#define CHUNK 64     /* packets of rays that a thread takes at a time from the bare loop */
#define SINGLES 1024 /* likewise, single rays */
#define PAPER_SAMPLES 60
#define PAPER_FRAMES 198.0 /* per second, on its GPU [LPG13] */

/* Some of the set's packets, so that their rays can be recorded. */
struct part {
    struct bench *b;
    struct gbuffer g;
    struct direct *direct;
    struct direct_desc desc;
    struct direct_stats stats;
    double rays, terms; /* of the last call */
    struct ray_log log;
    float *lo;
};

static enum err shade_part(void *context)
{
    struct part *p = context;
    const enum err e =
        direct_shade(p->direct, &p->g, p->b->set->rays, p->b->sky->environment, &p->desc, p->lo, &p->stats);

    p->rays = (double)p->stats.rays;
    p->terms = (double)(p->stats.chosen + p->stats.lobes);
    return e;
}

enum err bench_part_replay(void *part)
{
    const struct part *p = part;
    const size_t count = p->log.count;
    uint64_t occluded = 0;

#pragma omp parallel for schedule(dynamic, 1) reduction(+ : occluded)
    for (size_t i = 0; i < count; i += CHUNK)
        occluded += rays_replay(p->b->set->rays, &p->log, i, i + CHUNK < count ? i + CHUNK : count);
    return occluded == UINT64_MAX ? ERR_RANGE : ERR_OK; /* never: the sum must be computed */
}

static enum err on_one_thread(const struct bench *b, struct ray_log *log, enum err (*work)(void *), void *context)
{
    rays_set_log(b->set->rays, log);
    const enum err e = bench_threads(b, 1, work, context);
    rays_set_log(b->set->rays, NULL);
    return e;
}

static enum err reserve_log(struct part *p)
{
    p->log.capacity = (size_t)p->g.packet_count * (2 * p->desc.samples + 16);
    p->log.packets = mem_alloc_raw(p->log.capacity, sizeof(*p->log.packets));
    p->log.valid = mem_alloc_raw(p->log.capacity, sizeof(*p->log.valid));
    p->log.spread = mem_alloc_raw(p->log.capacity, sizeof(*p->log.spread));
    return p->log.packets && p->log.valid && p->log.spread ? ERR_OK : ERR_NOMEM;
}

enum err bench_part_create(struct bench *b, const struct direct_desc *desc, struct part **out, uint64_t *rays)
{
    const struct gbuffer *g = b->set->gbuffer;
    struct part *p = mem_alloc(1, sizeof(*p));

    *out = p;
    *rays = 0;
    if (!p)
        return ERR_NOMEM;
    *p = (struct part){ .b = b, .desc = *desc };
    p->g.packets = mem_alloc(g->packet_count, sizeof(*p->g.packets));
    p->lo = mem_alloc(g->packet_count, 3 * PACKET * sizeof(float));
    p->direct = direct_create(b->kernels);
    if (!p->g.packets || !p->lo || !p->direct)
        return ERR_NOMEM;
    for (uint32_t i = 0; i < g->packet_count; i++) /* in runs of 32, which keeps their coherence */
        if (i / 32 % 8 == 0) {
            p->g.packets[p->g.packet_count++] = g->packets[i];
            p->g.point_count += g->packets[i].count;
        }
    enum err e = desc->no_visibility ? ERR_OK : reserve_log(p);
    if (!e)
        e = desc->no_visibility ? shade_part(p) : on_one_thread(b, &p->log, shade_part, p);
    *rays = p->stats.rays;
    return !e && p->log.capacity && p->log.count == p->log.capacity ? ERR_RANGE : e;
}

void bench_part_destroy(struct part *p)
{
    if (!p)
        return;
    mem_free(p->g.packets);
    mem_free(p->log.packets);
    mem_free(p->log.valid);
    mem_free(p->log.spread);
    mem_free(p->lo);
    direct_destroy(p->direct);
    mem_free(p);
}

bool bench_part_skip(enum err *created, uint64_t rays, struct bench_row *row)
{
    const bool many = *created == ERR_RANGE;

    if (many || (!*created && rays == 0))
        bench_skip(row, many ? "too many rays to record" : "nothing is lit, so that no ray is traced");
    *created = many ? ERR_OK : *created;
    return *created || row->skipped[0];
}

enum err bench_shadow_rays(struct bench *b, struct bench_row *row)
{
    struct part *p;
    uint64_t count;

    snprintf(row->note, sizeof(row->note),
             "bare: rtcOccluded16 over one sky's packets of rays, an eighth of the image; ours with all its shading");
    enum err e = bench_part_create(b, &b->light.direct, &p, &count);
    const struct bench_pair pair = {
        { shade_part, bench_part_replay }, p, { 1e-6, 1e-6 * (double)count }, .rate = true, .units = { &p->rays }
    };
    if (!bench_part_skip(&e, count, row))
        e = bench_time(b, &pair, row);
    bench_part_destroy(p);
    return e;
}

/* The time to weigh one sample of the sky or of a lobe at one point, without rays. */
enum err bench_terms(struct bench *b, struct bench_row *row)
{
    struct direct_desc desc = b->light.direct;
    struct part *p;
    uint64_t rays;

    desc.no_visibility = true;
    enum err e = bench_part_create(b, &desc, &p, &rays);
    const struct bench_pair pair = { { shade_part }, p, .scale = { 1e9 * b->threads }, .units = { &p->terms } };
    snprintf(row->note, sizeof(row->note), "nothing is traced");
    if (!e && p->terms > 0.0)
        e = bench_time(b, &pair, row);
    else if (!e)
        bench_skip(row, "nothing is lit");
    bench_part_destroy(p);
    return e;
}

/* ---- Light tracer ---- */

struct tracing {
    struct bench *b;
    struct light_tracer *tracer;
    struct light_tracer_desc desc;
    struct light_tracer_stats stats;
    double rays; /* of the last call */
    struct ray_log log;
    float *rgb;
};

static enum err trace(void *context)
{
    struct tracing *t = context;
    const enum err e = light_tracer_run(t->tracer, t->b->sky->environment, &t->desc, t->rgb, &t->stats);

    t->rays = (double)t->stats.rays;
    return e;
}

static enum err replay_singles(void *context)
{
    const struct tracing *t = context;
    const size_t count = t->log.single_count;
    uint64_t met = 0;

#pragma omp parallel for schedule(dynamic, 1) reduction(+ : met)
    for (size_t i = 0; i < count; i += SINGLES)
        met += rays_replay_singles(t->b->set->rays, &t->log, i, i + SINGLES < count ? i + SINGLES : count);
    return met == UINT64_MAX ? ERR_RANGE : ERR_OK;
}

enum err bench_light_rays(struct bench *b, struct bench_row *row)
{
    const bool casters = scene_casters(b->set->scene, NULL, 0) > 0;
    struct tracing t = {
        .b = b,
        .tracer = light_tracer_create(b->set->scene, b->set->rays, &b->set->view),
        .desc = { .classes = casters ? PATH_CAUSTICS | PATH_INDIRECT : PATH_INDIRECT, .particles = b->desc->particles },
        .rgb = mem_alloc((size_t)b->desc->width * b->desc->height, 3 * sizeof(float)),
    };
    enum err e = t.tracer && t.rgb ? trace(&t) : ERR_NOMEM;

    t.log.single_capacity = (size_t)t.stats.rays + 1;
    t.log.singles = mem_alloc_raw(t.log.single_capacity, sizeof(*t.log.singles));
    e = !e && !t.log.singles ? ERR_NOMEM : e;
    if (!e)
        e = on_one_thread(b, &t.log, trace, &t);
    const struct bench_pair pair = {
        { trace, replay_singles }, &t, { 1e-6, 1e-6 * t.rays }, .rate = true, .units = { &t.rays }
    };
    if (!e && t.log.single_count != t.stats.rays)
        bench_skip(row, "%zu rays of %llu recorded", t.log.single_count, (unsigned long long)t.stats.rays);
    else if (!e && t.stats.rays == 0)
        bench_skip(row, "no particle meets anything");
    else if (!e)
        e = bench_time(b, &pair, row);
    snprintf(
        row->note, sizeof(row->note),
        "bare: rtcIntersect1 and rtcOccluded1 over one sky's rays, %llu of %llu particles; ours with all scattering",
        (unsigned long long)t.stats.rays, (unsigned long long)t.stats.particles);
    light_tracer_destroy(t.tracer);
    mem_free(t.log.singles);
    mem_free(t.rgb);
    return e;
}

/* ---- The setting of [LPG13] ---- */

static enum err whole_unshadowed(void *context)
{
    struct image_maker *m = context;
    struct reason why;
    enum err e = environment_rebuild(m->bench->sky->environment, &why);

    if (!e)
        e = image_maker_light(m);
    if (!e)
        tone_map(m->rgb, m->width, m->height, &(struct tone_desc){ 1.0, TONE_FILMIC, m->level }, m->display);
    return e;
}

enum err bench_no_visibility(struct bench *b, struct bench_row *row)
{
    struct image_maker m;
    struct relight_desc light = {
        .direct = { .method = METHOD_MIS, .samples = PAPER_SAMPLES, .no_visibility = true },
    };
    const struct bench_pair pair = { { whole_unshadowed }, &m, .scale = { 1.0 }, .rate = true };

    enum err e = image_maker_init(&m, b, b->set);
    m.light = &light;
    if (!e)
        e = bench_time(b, &pair, row);
    row->bare = PAPER_FRAMES;
    row->ratio = row->ours / PAPER_FRAMES;
    snprintf(row->note, sizeof(row->note),
             "the sky's tables, direct light by mis, tone map; second figure: what [LPG13, Fig. 3] states for its GPU");
    image_maker_finish(&m);
    return e;
}
