/* Light: shadow rays, arithmetic, particles. */
#include "bench/bench_parts.h"

#include "base/mem.h"

#include <math.h>
#include <stdlib.h>

#define CHUNK 64          /* packets of rays that a thread takes at a time from the bare loop */
#define SINGLES 1024      /* likewise, single rays */
#define PATHS_PER_PIXEL 8 /* of the row of stored paths: as many as the plan has at 64 samples */
#define PAPER_SAMPLES 60
#define PAPER_FRAMES 198.0 /* per second, on its GPU [LPG13] */

/* Some of the set's packets, so that their rays can be recorded. */
struct part {
    struct bench *b;
    struct gbuffer g;
    struct direct *direct;
    struct direct_desc desc;
    struct direct_stats stats;
    struct ray_log log;
    float *lo;
};

static enum err shade_part(void *context)
{
    struct part *p = context;

    return direct_shade(p->direct, &p->g, p->b->set->rays, p->b->environment, &p->desc, p->lo, &p->stats);
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
    *p = (struct part){ .b = b, .desc = *desc, .g.interleave = g->interleave };
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
             "bare: rtcOccluded16 over the same packets of rays, an eighth of the image; ours with all its shading");
    enum err e = bench_part_create(b, &b->light.direct, &p, &count);
    const double rays = 1e-6 * (double)count;
    const struct bench_pair pair = { { shade_part, bench_part_replay }, p, .scale = { rays, rays }, .rate = true };
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
    const double terms = e ? 0.0 : (double)(p->stats.chosen + p->stats.lobes);
    const struct bench_pair pair = { { shade_part }, p, .scale = { 1e9 * b->threads / terms } };
    snprintf(row->note, sizeof(row->note), "nothing is traced");
    if (!e && terms > 0.0)
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
    struct ray_log log;
    float *rgb;
};

static enum err trace(void *context)
{
    struct tracing *t = context;

    return light_tracer_run(t->tracer, t->b->environment, &t->desc, t->rgb, &t->stats);
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
    const double rays = 1e-6 * (double)t.stats.rays;
    const struct bench_pair pair = { { trace, replay_singles }, &t, .scale = { rays, rays }, .rate = true };
    if (!e && t.log.single_count != t.stats.rays)
        bench_skip(row, "%zu rays of %llu recorded", t.log.single_count, (unsigned long long)t.stats.rays);
    else if (!e && t.stats.rays == 0)
        bench_skip(row, "no particle meets anything");
    else if (!e)
        e = bench_time(b, &pair, row);
    snprintf(
        row->note, sizeof(row->note),
        "bare: rtcIntersect1 and rtcOccluded1 over the same rays, %llu of %llu particles; ours with all scattering",
        (unsigned long long)t.stats.rays, (unsigned long long)t.stats.particles);
    light_tracer_destroy(t.tracer);
    mem_free(t.log.singles);
    mem_free(t.rgb);
    return e;
}

/* ---- Stored light paths ---- */

struct stored {
    struct tracing tracing; /* of as many paths */
    struct caustic_store *store;
};

static enum err light_stored(void *context)
{
    struct stored *s = context;

    return caustic_store_light(s->store, s->tracing.b->environment, INFINITY, s->tracing.rgb);
}

static enum err trace_stored(void *context)
{
    return trace(&((struct stored *)context)->tracing);
}

static enum err stored_init(struct stored *s, struct bench *b)
{
    const struct set *set = b->set;
    const uint64_t pixels = (uint64_t)b->desc->width * b->desc->height;
    const struct caustic_store_desc desc = { .classes = PATH_CAUSTICS, .paths = pixels * PATHS_PER_PIXEL };
    struct reason why;

    *s = (struct stored){
        .tracing = { .b = b,
                     .tracer = light_tracer_create(set->scene, set->rays, &set->view),
                     .desc = { .classes = PATH_CAUSTICS },
                     .rgb = mem_alloc((size_t)b->desc->width * b->desc->height, 3 * sizeof(float)) },
    };
    if (!s->tracing.tracer || !s->tracing.rgb)
        return ERR_NOMEM;
    const enum err e = caustic_store_create(set->scene, set->rays, &set->view, &desc, &s->store, &why);
    if (e)
        return e;
    s->tracing.desc.particles = caustic_store_stats(s->store)->paths;
    return caustic_store_turn(s->store, 0, NULL, NULL);
}

/* The store lights the whole sky, as under cloud, so that both sides do the same work. */
enum err bench_stored_caustics(struct bench *b, struct bench_row *row)
{
    struct stored s;

    if (scene_casters(b->set->scene, NULL, 0) == 0) {
        bench_skip(row, "the scene has no mirror and no glass");
        return ERR_OK;
    }
    enum err e = stored_init(&s, b);
    if (!e) {
        const struct caustic_store_stats *stats = caustic_store_stats(s.store);
        const double paths = 1e-6 * (double)stats->paths;
        const struct bench_pair pair = { { light_stored, trace_stored }, &s, .scale = { paths, paths }, .rate = true };
        snprintf(row->note, sizeof(row->note),
                 "bare: light_tracer_run with as many paths, drawn by the sky; the store has %llu splats, %.1f MB",
                 (unsigned long long)stats->splats, 1e-6 * (double)stats->bytes);
        e = bench_time(b, &pair, row);
    }
    caustic_store_destroy(s.store);
    light_tracer_destroy(s.tracing.tracer);
    mem_free(s.tracing.rgb);
    return e;
}

/* ---- The setting of [LPG13] ---- */

static enum err whole_unshadowed(void *context)
{
    struct picture_maker *m = context;
    struct reason why;
    enum err e = environment_rebuild((struct environment *)m->environment, &why);

    if (!e)
        e = picture_maker_light(m);
    if (!e)
        tone_map(m->rgb, m->width, m->height, &(struct tone_desc){ 1.0, TONE_FILMIC, m->level }, m->display);
    return e;
}

enum err bench_no_visibility(struct bench *b, struct bench_row *row)
{
    struct picture_maker m;
    struct relight_desc light = {
        .direct = { .method = METHOD_MIS, .samples = PAPER_SAMPLES, .no_visibility = true },
    };
    const struct bench_pair pair = { { whole_unshadowed }, &m, .scale = { 1.0 }, .rate = true };

    enum err e = picture_maker_init(&m, b, b->set);
    m.light = &light;
    if (!e)
        e = bench_time(b, &pair, row);
    row->alone = false;
    row->bare = PAPER_FRAMES;
    row->ratio = row->ours / PAPER_FRAMES;
    snprintf(row->note, sizeof(row->note),
             "the sky's tables, direct light by mis, tone map; second figure: what [LPG13, Fig. 3] states for its GPU");
    picture_maker_finish(&m);
    return e;
}
