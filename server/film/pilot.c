#include "pilot_parts.h"

#include "clock.h"
#include "film.h"
#include "mem.h"
#include "resolve.h"
#include "rng.h"

#include <math.h>
#include <string.h>

#define SMOOTH 0.3
#define READINGS_SOON 4    /* of the light tracer in use; after that */
#define READ_EVERY 4       /* frames */
#define PACE_STEP 0.3      /* of what a picture says about the machine's pace, in its logarithm: it was early, */
#define PACE_STEP_LATE 0.6 /* it was late */
#define PACE_MOST 4.0
#define HELD_UP 1.4       /* times as long as the median of three */
#define OTHER_LEAST 0.002 /* seconds */
#define BETTER_SHARE 0.4  /* of the first frame's extra time, for the picture that all is measured by */
#define BETTER_LEAST 2.0  /* times as many samples as the first */
#define BETTER_MOST 16.0
#define PACE_FOLD 0.02 /* a frame */

/* The second differs from what the programs' own flags give by nothing: it is what `auto` stands for without a pilot.
 */
const struct technique techniques[PILOT_TECHNIQUES] = {
    { "light and lobes, the sun apart", { .method = METHOD_AUTO }, false },
    { "light alone", { .method = METHOD_FACES, .sun = true }, false },
    { "lobes alone", { .method = METHOD_BRDF }, false },
    { "light by cells and lobes",
      { .method = METHOD_MIS, .cells = 4, .sun = true, .compensate = COMPENSATE_ON },
      false },
    { "light alone by cells", { .method = METHOD_FACES, .cells = 8, .sun = true }, false },
    { "light alone, one table", { .method = METHOD_LIGHT }, false },
    { "light and lobes", { .method = METHOD_MIS }, false },
};

const char *pilot_technique_name(uint32_t technique)
{
    return techniques[technique].name;
}

const char *pilot_part_name(enum pilot_part part)
{
    static const char *const names[] = {
        "direct, matte", "direct, glossy", "eye paths", "light tracer at mirrors and glass", "light tracer",
    };
    return names[part];
}

enum pilot_part pilot_part_of(uint32_t way)
{
    return way < WAY_GLOSSY    ? PILOT_MATTE
           : way < WAY_EYE_ALL ? PILOT_GLOSSY
           : way < WAY_AIMED   ? PILOT_EYE
           : way == WAY_AIMED  ? PILOT_AIMED
                               : PILOT_WHOLE;
}

double pilot_now(const struct pilot *p)
{
    return p->desc.price ? 0.0 : clock_seconds();
}

double pilot_spent(const struct pilot *p, double start, const struct pilot_work *work)
{
    return p->desc.price ? p->desc.price(work) : clock_seconds() - start;
}

static bool allocate(struct pilot *p, const struct kernels *kernels)
{
    const struct gbuffer *g = p->set->gbuffer;
    const size_t pixels = (size_t)g->width * g->height;
    float **const points[] = { &p->lo_direct, &p->lo_eye, &p->lo_other, &p->lo_sum };
    bool all = true;

    for (int k = 0; k < 4; k++)
        all = (*points[k] = mem_alloc(g->packet_count, 3 * PACKET * sizeof(float))) && all;
    for (int k = 0; k < SURFACE_KINDS; k++) {
        all = (p->direct[k] = direct_create(kernels)) && all;
        all = (p->half[k] = mem_alloc(pixels, 3 * sizeof(float))) && all;
        all = (p->spread[k] = mem_alloc(pixels, 3 * sizeof(float))) && all;
    }
    all = (p->probe = direct_create(kernels)) && all;
    all = (p->light = light_tracer_create(p->set->scene, p->set->rays, &p->set->view)) && all;
    all = (p->mask = mem_alloc(pixels, 1)) && all;
    all = (p->scratch = scratch_create()) && all;
    all = (p->point_error = mem_alloc(g->packet_count, sizeof(*p->point_error))) && all;
    return all && pilot_edges_init(p);
}

struct pilot *pilot_create(const struct set *set, const struct kernels *kernels, const struct pilot_desc *desc)
{
    struct pilot *p = mem_alloc(1, sizeof(*p));

    if (!p)
        return NULL;
    p->set = set;
    p->pace = 1.0;
    for (int k = 0; k < SURFACE_KINDS; k++)
        p->base_times[k] = p->unit_times[k] = 1.0;
    if (desc)
        p->desc = *desc;
    if (!allocate(p, kernels)) {
        pilot_destroy(p);
        return NULL;
    }
    resolve_mask(set->gbuffer, p->mask);
    return p;
}

void pilot_destroy(struct pilot *p)
{
    if (!p)
        return;
    for (int k = 0; k < SURFACE_KINDS; k++) {
        direct_destroy(p->direct[k]);
        mem_free(p->half[k]);
        mem_free(p->spread[k]);
    }
    direct_destroy(p->probe);
    light_tracer_destroy(p->light);
    pilot_edges_finish(p);
    mem_free(p->mask);
    scratch_destroy(p->scratch);
    mem_free(p->point_error);
    mem_free(p->lo_direct);
    mem_free(p->lo_eye);
    mem_free(p->lo_other);
    mem_free(p->lo_sum);
    mem_free(p);
}

struct allot_wish pilot_deal(uint32_t way, double n)
{
    const uint32_t step = pilot_halves(way) ? 2 : 1;

    return (struct allot_wish){ fmax(n, step), step };
}

enum err pilot_direct(struct pilot *p, struct direct *d, uint32_t way, double n, uint64_t pass, bool keep,
                      const struct packet_list *only, float *lo, struct direct_stats *stats)
{
    const struct direct_desc *asked = &p->wish_light->direct;
    struct direct_desc desc = techniques[way % PILOT_TECHNIQUES].desc;

    const struct allot_wish wish = pilot_deal(way, n);
    struct allotment *allot = &p->allot[pilot_part_of(way)];

    desc.samples = allot_counts(allot, &wish, only);
    desc.counts = allot->counts;
    desc.seed = asked->seed;
    desc.pass = pass;
    desc.no_visibility = asked->no_visibility;
    desc.interleave = asked->interleave;
    desc.only = only;
    desc.keep = keep;
    desc.cancel = asked->cancel;
    desc.why = asked->why;
    return direct_shade(d, p->gbuffer, p->set->rays, p->environment, &desc, lo, stats);
}

enum err pilot_eye(struct pilot *p, uint32_t way, double n, uint64_t pass, const struct packet_list *only, float *lo,
                   struct eye_paths_stats *stats)
{
    const struct direct_desc *asked = &p->wish_light->direct;
    const struct allot_wish wish = pilot_deal(way, n);
    const struct eye_paths_desc desc = {
        .classes = p->route[way].classes,
        .behind_classes = p->route[way].behind,
        .paths = p->eye_wish ? p->eye_wish : allot_counts(&p->allot[PILOT_EYE], &wish, only),
        .counts = p->eye_wish ? NULL : p->allot[PILOT_EYE].counts,
        .only = only,
        .seed = rng_mix(rng_mix(asked->seed, 0x657965), pass),
        .cancel = asked->cancel,
        .scratch = p->scratch,
    };

    for (uint32_t k = 0; k < only->count; k++)
        memset(lo + (size_t)only->index[k] * 3 * PACKET, 0, 3 * PACKET * sizeof(float));
    return eye_paths_shade(p->set->scene, p->set->rays, p->gbuffer, p->environment, &desc, lo, stats);
}

enum err pilot_light(struct pilot *p, uint32_t way, double n, uint64_t pass, struct light_tracer_stats *stats)
{
    const struct gbuffer *g = p->set->gbuffer;
    const struct direct_desc *asked = &p->wish_light->direct;
    struct light_tracer_desc desc = {
        .classes = p->route[way].classes,
        .particles = (uint64_t)(0.5 * n * UNIT_PARTICLES),
        .start = p->wish_light->start,
        .cancel = asked->cancel,
    };
    enum err e = ERR_OK;

    *stats = (struct light_tracer_stats){ 0 };
    for (uint64_t k = 0; k < 2 && !e; k++) {
        struct light_tracer_stats one;
        memset(p->half[k], 0, (size_t)g->width * g->height * 3 * sizeof(float));
        desc.seed = rng_mix(rng_mix(asked->seed, 0x6c6967), 2 * pass + k);
        e = light_tracer_run(p->light, p->environment, &desc, p->half[k], &one);
        stats->particles += one.particles;
        stats->starts_hit += one.starts_hit;
        stats->rays += one.rays;
        stats->splats += one.splats;
    }
    return e;
}

/* What a whole picture's parts took. A black sky takes no time, and teaches nothing. */
static void learn_times(struct pilot *p)
{
    for (int part = 0; part < PILOT_PARTS && p->environment->total_energy > 0.0; part++)
        if (p->choice.way[part] != WAY_NONE && p->ran_s[part] > 0.0)
            model_ran(&p->model[p->choice.way[part]], p->choice.n[part], p->ran_s[part] / p->pace);
}

/* Glossy surfaces by the technique of matte ones take their tables too. */
static bool shares_tables(const struct pilot *p, int kind)
{
    return kind == SURFACE_GLOSSY && p->choice.way[PILOT_MATTE] != WAY_NONE &&
           p->choice.way[PILOT_MATTE] - WAY_MATTE == p->choice.way[PILOT_GLOSSY] - WAY_GLOSSY;
}

static enum err make_direct(struct pilot *p, struct relight_stats *stats)
{
    enum err e = ERR_OK;

    for (int kind = 0; kind < SURFACE_KINDS && !e; kind++) {
        const struct packet_list *list = &p->groups.all.list[kind];
        const uint32_t way = p->choice.way[kind];
        struct direct_stats *s = &p->direct_stats[kind];
        *s = (struct direct_stats){ 0 };
        if (list->count == 0)
            continue;
        if (way == WAY_NONE) {
            for (uint32_t k = 0; k < list->count; k++)
                memset(p->lo_direct + (size_t)list->index[k] * 3 * PACKET, 0, 3 * PACKET * sizeof(float));
            continue;
        }
        const double start = pilot_now(p), n = p->choice.n[kind];
        p->tables[kind] = shares_tables(p, kind) ? p->direct[SURFACE_MATTE] : p->direct[kind];
        e = pilot_direct(p, p->tables[kind], way, n, p->picture_pass, p->tables[kind] != p->direct[kind], list,
                         p->lo_direct, s);
        const struct pilot_work work = { (enum pilot_part)kind, p->groups.all.points[kind], s->rays, n };
        p->ran_s[kind] = pilot_spent(p, start, &work);
        stats->direct.rays += s->rays;
        stats->direct.generated += s->generated;
        stats->direct.chosen += s->chosen;
        stats->direct.effective += s->effective;
        stats->direct.lobes += s->lobes;
        stats->direct.strata = s->strata > stats->direct.strata ? s->strata : stats->direct.strata;
        stats->direct.sun |= s->sun;
        stats->direct.compensated |= s->compensated;
        stats->shade_ms += 1e3 * p->ran_s[kind];
    }
    return e;
}

static enum err make_eye(struct pilot *p, struct relight_stats *stats)
{
    if (p->choice.way[PILOT_EYE] == WAY_NONE)
        return ERR_OK;
    const double start = pilot_now(p), n = p->choice.n[PILOT_EYE];
    const enum err e =
        pilot_eye(p, p->choice.way[PILOT_EYE], n, p->picture_pass, &p->groups.all.both, p->lo_eye, &stats->eye);
    const struct pilot_work work = { PILOT_EYE, p->gbuffer->point_count, stats->eye.rays, n };
    p->ran_s[PILOT_EYE] = pilot_spent(p, start, &work);
    stats->eye_ms = 1e3 * p->ran_s[PILOT_EYE];
    return e;
}

static void make_pixels(struct pilot *p, float *rgb, struct relight_stats *stats)
{
    const struct gbuffer *g = p->gbuffer;
    const size_t values = (size_t)g->packet_count * 3 * PACKET;
    const bool eye = p->choice.way[PILOT_EYE] != WAY_NONE;
    const uint32_t classes = p->wish_light->classes;
    const double start = pilot_now(p);

    if (eye) {
#pragma omp parallel for schedule(static)
        for (size_t i = 0; i < values; i++)
            p->lo_sum[i] = p->lo_direct[i] + p->lo_eye[i];
    }
    resolve_pixels(g, eye ? p->lo_sum : p->lo_direct, classes & PATH_BACKGROUND || classes == 0 ? p->environment : NULL,
                   rgb);
    const struct pilot_work work = { PILOT_PARTS, g->point_count, 0, 0.0 };
    stats->resolve_ms = 1e3 * pilot_spent(p, start, &work);
}

void pilot_read_light(struct pilot *p, uint32_t way, double n, const float *rgb)
{
    const struct gbuffer *g = p->set->gbuffer;
    struct yardstick y = p->yardstick;
    struct pair pair;

    yardstick_spread(p->half[0], p->half[1], g->width, g->height, p->spread[0], p->spread[1]);
    y.rgb = rgb;
    y.part = p->spread[1];
    pair_of_pictures(&p->groups.all, p->half[0], p->half[1], &y, &pair);
    if (pair.pixels) /* the mean of the halves has half of either's variance */
        model_read(&p->model[way], &(struct reading){ n, 0.5 * pair.error / (double)pair.pixels,
                                                      pair.energy / (double)pair.pixels, 1.0, false });
}

/* Both halves' mean into the picture. What their difference says is read before the next run takes the place, and not
 * in every frame. */
static enum err make_light(struct pilot *p, float *rgb, struct relight_stats *stats)
{
    const struct gbuffer *g = p->set->gbuffer;
    const size_t values = 3 * (size_t)g->width * g->height;
    enum err e = ERR_OK;

    for (int part = PILOT_AIMED; part <= PILOT_WHOLE && !e; part++) {
        const uint32_t way = p->choice.way[part];
        struct light_tracer_stats one;
        if (way == WAY_NONE)
            continue;
        double start = pilot_now(p);
        const double n = p->choice.n[part];
        e = pilot_light(p, way, n, p->picture_pass, &one);
        const struct pilot_work work = { (enum pilot_part)part, 0, one.rays, n };
        p->ran_s[part] = pilot_spent(p, start, &work);
        start = pilot_now(p);
        if (p->environment->total_energy > 0.0 && (p->model[way].fresh < READINGS_SOON || p->runs % READ_EVERY == 0)) {
            yardstick_init(&p->yardstick, rgb, p->mask, g->width, g->height);
            pilot_read_light(p, way, n, rgb);
        }
        p->pilot_s += pilot_now(p) - start;
#pragma omp parallel for schedule(static)
        for (size_t i = 0; i < values; i++)
            rgb[i] += 0.5f * (p->half[0][i] + p->half[1][i]);
        stats->light.particles += one.particles;
        stats->light.starts_hit += one.starts_hit;
        stats->light.rays += one.rays;
        stats->light.splats += one.splats;
        stats->light_ms += 1e3 * p->ran_s[part];
    }
    return e;
}

static enum err make_picture(struct pilot *p, float *rgb, struct relight_stats *stats)
{
    memset(p->ran_s, 0, sizeof(p->ran_s));
    enum err e = make_direct(p, stats);
    if (!e)
        e = make_eye(p, stats);
    if (e)
        return e;
    make_pixels(p, rgb, stats);
    e = make_light(p, rgb, stats);
    p->picture_s = 1e-3 * (stats->shade_ms + stats->eye_ms + stats->resolve_ms + stats->light_ms);
    return e;
}

/* What lasts is no pace: it becomes part of all times, used or not, so that these stay comparable. */
static void fold_pace(struct pilot *p)
{
    const double share = pow(p->pace, PACE_FOLD);

    p->pace /= share;
    for (uint32_t way = 0; way < WAYS; way++)
        model_scale(&p->model[way], share);
}

static double median_of_three(const double x[3])
{
    return fmax(fmin(x[0], x[1]), fmin(fmax(x[0], x[1]), x[2]));
}

/* Other work on the machine makes all parts slower alike. One picture that took far longer than its neighbours was
 * held up, and says nothing about the next; two in a row do. */
static void note_pace(struct pilot *p, const double expected[PILOT_PARTS], const bool seasoned[PILOT_PARTS])
{
    double took = 0.0, should = 0.0;

    for (int part = 0; part < PILOT_PARTS; part++)
        if (seasoned[part] && expected[part] > 0.0) {
            took += p->ran_s[part];
            should += expected[part];
        }
    if (!(should > 0.0) || !(took > 0.0) || p->desc.price) {
        learn_times(p);
        return;
    }
    p->late[p->runs % 3] = took / should;
    const double usual = p->runs < 3 ? took / should : median_of_three(p->late);
    if (took / should > HELD_UP * usual)
        return;
    learn_times(p);
    /* Late pictures are worse than early ones. */
    const double ratio = fmin(3.0, fmax(0.5, usual));
    p->pace = fmin(PACE_MOST, fmax(1.0 / PACE_MOST, p->pace * pow(ratio, ratio > 1.0 ? PACE_STEP_LATE : PACE_STEP)));
    /* The models' own times follow too, slowly; together they must not answer the same reading twice. */
    for (int part = 0; part < PILOT_PARTS; part++)
        if (seasoned[part])
            model_scale(&p->model[p->choice.way[part]], 1.0 / pow(ratio, PACE_STEP));
    fold_pace(p);
}

static bool cancelled(const struct pilot *p)
{
    const atomic_bool *c = p->wish_light->direct.cancel;
    return c && atomic_load_explicit(c, memory_order_relaxed);
}

/* A quick picture, by which the rest is measured, as good as its share of the first frame's time allows: who is to be
 * measured by a noisy one is measured badly. */
static enum err begin(struct pilot *p, const struct pilot_wish *wish, float *rgb, struct relight_stats *stats)
{
    const struct gbuffer *g = p->set->gbuffer;

    pilot_choose(p, wish);
    p->picture_pass = pilot_pass(p);
    enum err result = make_picture(p, rgb, stats);
    if (result || cancelled(p))
        return result;
    learn_times(p);
    double seconds = p->picture_s, times = fmin(BETTER_MOST, floor(BETTER_SHARE * pilot_first_s(wish) / seconds));
    if (times >= BETTER_LEAST) {
        for (int kind = 0; kind < SURFACE_KINDS; kind++)
            p->choice.n[kind] *= times;
        float *const first = p->lo_direct;
        p->lo_direct = p->lo_sum;
        p->lo_sum = first;
        p->picture_pass = pilot_pass(p);
        *stats = (struct relight_stats){ 0 };
        result = make_picture(p, rgb, stats);
        if (result || cancelled(p))
            return result;
        learn_times(p);
        seconds += p->picture_s;
    } else {
        times = 1.0;
    }
    yardstick_init(&p->yardstick, rgb, p->mask, g->width, g->height);
    p->picture_noise = 1.0 / times; /* four samples a point: 1 */
    if (times >= BETTER_LEAST)
        pilot_allot_all(p, p->lo_sum);
    if (!groups_deal(&p->groups, &p->yardstick))
        return ERR_NOMEM;
    result = pilot_probe(p, wish);
    if (result || cancelled(p))
        return result;
    p->begun = true;
    p->pilot_s += seconds;
    return ERR_OK;
}

enum err pilot_run(struct pilot *p, const struct environment *e, const struct relight_desc *light,
                   const struct pilot_wish *wish, float *rgb, struct relight_stats *stats, struct pilot_stats *out)
{
    const struct gbuffer *g = p->set->gbuffer;
    double expected[PILOT_PARTS] = { 0.0 };
    bool seasoned[PILOT_PARTS] = { false };
    enum err result;

    *stats = (struct relight_stats){ 0 };
    *out = (struct pilot_stats){ 0 };
    p->environment = e;
    p->wish_light = light;
    p->pilot_s = 0.0;
    pilot_take_wish(p, light);
    pilot_look_at_sky(p);
    if (!p->begun && e->total_energy > 0.0) {
        result = begin(p, wish, rgb, stats);
        if (result || cancelled(p))
            return result;
        *stats = (struct relight_stats){ 0 };
    }
    const double start = pilot_now(p);
    pilot_choose(p, wish);
    p->picture_pass = light->direct.pass;
    p->pilot_s += p->desc.price ? 0.0 : pilot_now(p) - start;
    for (int part = 0; part < PILOT_PARTS; part++)
        if (p->choice.way[part] != WAY_NONE) {
            const struct model *m = &p->model[p->choice.way[part]];
            expected[part] = p->pace * model_seconds(m, p->choice.n[part]);
            seasoned[part] = m->ran;
        }
    result = make_picture(p, rgb, stats);
    if (result || cancelled(p))
        return result;
    note_pace(p, expected, seasoned);
    const double probing = pilot_now(p);
    p->picture_noise = pilot_error(p);
    yardstick_init(&p->yardstick, rgb, p->mask, g->width, g->height);
    result = p->runs == 0 || !(e->total_energy > 0.0) ? ERR_OK : pilot_probe(p, wish);
    if (!p->desc.price)
        p->pilot_s += pilot_now(p) - probing;
    p->frames++;
    p->runs++;
    p->other_s += SMOOTH * (fmin(1e-3 * stats->resolve_ms, 2.0 * p->other_s + OTHER_LEAST) - p->other_s);
    p->frame_s += (p->frame_s > 0.0 ? SMOOTH : 1.0) * (p->picture_s - p->frame_s);
    for (int part = 0; part < PILOT_PARTS; part++)
        out->part[part].expected_seconds = expected[part];
    pilot_say(p, wish, stats, out);
    return result;
}
