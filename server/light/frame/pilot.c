#include "light/frame/pilot.h"

#include "base/cancel.h"
#include "base/mem.h"
#include "base/rng.h"
#include "light/resolve/resolve.h"

#include <math.h>

#define SMOOTH 0.3                   /* share of the newest time in a running mean */
#define LIGHT_SOON 4                 /* readings of particles; after that */
#define LIGHT_EVERY 4                /* frames */
#define NOISY 0.05                   /* relMSE above which single pixels are no yardstick */
#define HASTE 0.3                    /* of the time, for the quick image: if it takes more, it is the frame */
#define FIRST_SHARE 0.1              /* of the samples or paths to come, in either image that measures them, */
#define FIRST_MORE 1.5               /* if that is so many times as many as have been measured */
#define PASS_OWN (UINT64_C(1) << 40) /* no image has so high a pass */

double pilot_seconds(const struct pilot *p, const struct pilot_work *work, double by_clock)
{
    return p->desc.price ? p->desc.price(work) : by_clock;
}

uint64_t pilot_pass(struct pilot *p)
{
    return PASS_OWN + p->pass++;
}

static bool allocate(struct pilot *p)
{
    const struct gbuffer *g = p->set->gbuffer;
    const size_t pixels = (size_t)g->width * g->height;
    bool all = groups_init(&p->groups, g);

    for (int k = 0; k < 2; k++) {
        all = all && allot_init(&p->allot[k], g, &p->groups.all.list);
        all = (p->pair[k] = mem_alloc(g->packet_count, 3 * PACKET * sizeof(float))) && all;
        all = (p->spread[k] = mem_alloc(pixels, 3 * sizeof(float))) && all;
    }
    all = (p->mask = mem_alloc(pixels, 1)) && all;
    all = (p->point_error = mem_alloc(g->packet_count, sizeof(*p->point_error))) && all;
    return (p->passes = relighter_passes(p->relighter)) && all;
}

struct pilot *pilot_create(struct relighter *r, const struct pilot_desc *desc)
{
    struct pilot *p = mem_alloc(1, sizeof(*p));

    if (!p)
        return NULL;
    p->relighter = r;
    p->set = relighter_set(r);
    if (desc)
        p->desc = *desc;
    if (!allocate(p)) {
        pilot_destroy(p);
        return NULL;
    }
    resolve_mask(p->set->gbuffer, p->mask);
    return p;
}

void pilot_destroy(struct pilot *p)
{
    if (!p)
        return;
    for (int k = 0; k < 2; k++) {
        allot_finish(&p->allot[k]);
        mem_free(p->pair[k]);
        mem_free(p->spread[k]);
    }
    groups_finish(&p->groups);
    mem_free(p->mask);
    mem_free(p->point_error);
    mem_free(p);
}

/* Half of the samples are light samples, half BRDF samples: an odd count costs as much as the next even one. */
struct allot_count pilot_count(enum pilot_part part, double n)
{
    const uint32_t step = part == PILOT_DIRECT ? 2 : 1;

    return (struct allot_count){ fmax(n, step), step };
}

struct direct_desc pilot_direct(struct pilot *p, double n, uint64_t pass, const struct packet_list *only)
{
    const struct direct_desc *asked = &p->light->direct;
    const struct allot_count count = pilot_count(PILOT_DIRECT, n);

    return (struct direct_desc){
        .method = METHOD_AUTO,
        .samples = allot_counts(&p->allot[PILOT_DIRECT], &count, only),
        .counts = p->allot[PILOT_DIRECT].counts,
        .seed = asked->seed,
        .pass = pass,
        .no_visibility = asked->no_visibility,
        .only = only,
        .cancel = asked->cancel,
        .why = asked->why,
    };
}

struct eye_paths_desc pilot_eye(struct pilot *p, double n, uint64_t pass, const struct packet_list *only)
{
    const struct direct_desc *asked = &p->light->direct;
    const struct allot_count count = pilot_count(PILOT_EYE, n);
    struct eye_paths_desc desc = p->eye;

    desc.paths = p->wanted.eye_paths ? (uint32_t)ceil(n) : allot_counts(&p->allot[PILOT_EYE], &count, only);
    desc.counts = p->wanted.eye_paths ? NULL : p->allot[PILOT_EYE].counts;
    desc.only = only;
    desc.seed = rng_mix(rng_mix(asked->seed, 0x657965), pass);
    desc.pass = 0;
    desc.cancel = asked->cancel;
    return desc;
}

struct frame_plan pilot_passes(struct pilot *p, uint64_t pass)
{
    const struct packet_list *all = &p->groups.all.list;
    const double of = p->denoised ? 0.5 : 1.0; /* in either half */
    struct frame_plan out = { .background = p->background, .cancel = p->light->direct.cancel };
    struct pass *direct = frame_plan_add(&out, PASS_DIRECT, PATH_DIRECT);

    if (p->offered[PILOT_DIRECT])
        direct->direct = pilot_direct(p, of * p->n[PILOT_DIRECT], pass, all);
    if (p->offered[PILOT_EYE])
        frame_plan_add(&out, PASS_EYE, p->eye.classes | p->eye.behind_classes)->eye =
            pilot_eye(p, of * p->n[PILOT_EYE], pass, all);
    frame_plan_add(&out, PASS_RESOLVE, 0);
    for (int k = 0; k < 2; k++)
        if (p->offered[PILOT_AIMED + k]) {
            struct pass *s = frame_plan_add(&out, PASS_PARTICLES, p->light_by[k].classes);
            s->halves = true;
            s->light = p->light_by[k];
            s->light.particles = 2 * (uint64_t)(0.5 * p->n[PILOT_AIMED + k] * UNIT_PARTICLES);
            s->light.pass = pass;
            s->light.cancel = p->light->direct.cancel;
        }
    frame_plan_add(&out, PASS_SPLATS, 0);
    return out;
}

static enum pilot_part part_of(const struct pass *s)
{
    switch (s->kind) {
    case PASS_DIRECT: return PILOT_DIRECT;
    case PASS_EYE: return PILOT_EYE;
    case PASS_PARTICLES: return s->light.classes & PATH_INDIRECT_LIT ? PILOT_WHOLE : PILOT_AIMED;
    default: return PILOT_PARTS;
    }
}

/* Learns the times of a whole image's parts. A black sky takes no time and is not measured. */
static void learn_times(struct pilot *p, const struct frame_plan *plan)
{
    const uint64_t points = p->set->gbuffer->point_count;
    const struct pilot_work pixels = { PILOT_PARTS, points, 0, 0.0 };
    uint64_t rays[PILOT_PARTS + 1] = { 0 };
    double by_clock[PILOT_PARTS + 1] = { 0.0 };

    for (uint32_t k = 0; k < plan->count; k++) {
        rays[part_of(&plan->pass[k])] += plan->pass[k].rays;
        by_clock[part_of(&plan->pass[k])] += plan->pass[k].seconds;
    }
    p->image_s = pilot_seconds(p, &pixels, by_clock[PILOT_PARTS]);
    p->other_s += (p->other_s > 0.0 ? SMOOTH : 1.0) * (p->image_s - p->other_s);
    for (int part = 0; part < PILOT_PARTS; part++) {
        const struct pilot_work work = { (enum pilot_part)part, part < PILOT_AIMED ? points : 0, rays[part],
                                         p->n[part] };
        p->ran_s[part] = p->offered[part] ? pilot_seconds(p, &work, by_clock[part]) : 0.0;
        p->image_s += p->ran_s[part];
        if (p->ran_s[part] > 0.0 && p->environment->total_energy > 0.0)
            model_ran(&p->model[part], p->n[part], p->ran_s[part]);
    }
}

/* Renders the image of the choice and learns from it, unless it was cancelled. */
static enum err make_image(struct pilot *p, uint64_t pass, float *rgb, struct relight_stats *stats)
{
    const struct gbuffer *g = p->set->gbuffer;
    struct frame_plan plan = pilot_passes(p, pass);

    *stats = (struct relight_stats){ 0 };
    enum err e = p->denoised ? relighter_add_filter(p->relighter, &plan) : ERR_OK;
    if (!e)
        e = relighter_run_plan(p->relighter, p->environment, &plan, rgb, stats);
    if (e || is_cancelled(p->light->direct.cancel))
        return e;
    learn_times(p, &plan);
    yardstick_init(&p->yardstick, rgb, p->mask, g->width, g->height);
    p->yardstick.noisy = !p->denoised && (!p->begun || pilot_error(p) > NOISY);
    for (int part = PILOT_AIMED; part < PILOT_PARTS; part++)
        if (p->offered[part] && p->environment->total_energy > 0.0 &&
            (p->model[part].fresh < LIGHT_SOON || p->runs % LIGHT_EVERY == 0))
            pilot_read_light(p, (enum pilot_part)part, p->n[part], p->passes->half[part - PILOT_AIMED]);
    return ERR_OK;
}

/* Measures direct light and eye paths on the whole image: with few, and with more if many will be taken. */
static enum err measure_first(struct pilot *p, const struct budget_target *target)
{
    enum err e = ERR_OK;

    for (int part = 0; part <= PILOT_EYE && !e; part++)
        if (p->offered[part])
            e = pilot_probe_whole(p, (enum pilot_part)part, pilot_count((enum pilot_part)part, 0.0).step);
    if (e || is_cancelled(p->light->direct.cancel))
        return e;
    p->begun = true;
    pilot_choose(p, target);
    for (int part = 0; part <= PILOT_EYE && !e; part++) {
        const double n = floor(FIRST_SHARE * p->n[part]);
        if (!p->offered[part] || n < FIRST_MORE * pilot_count((enum pilot_part)part, 0.0).step)
            continue;
        e = pilot_probe_whole(p, (enum pilot_part)part, n);
    }
    return e;
}

/* Before the first image: a quick one as a yardstick, and whole measurements. done: there is time for the quick one
 * only. */
static enum err begin(struct pilot *p, const struct budget_target *target, float *rgb, struct relight_stats *stats,
                      bool *done)
{
    pilot_choose_first(p, target->seconds > 0.0);
    enum err e = make_image(p, pilot_pass(p), rgb, stats);
    if (e || is_cancelled(p->light->direct.cancel))
        return e;
    *done = target->seconds > 0.0 && p->image_s > HASTE * target->seconds;
    p->begun = *done;
    if (*done) {
        p->budget.met = p->image_s <= target->seconds;
        return ERR_OK;
    }
    p->pilot_s = p->image_s;
    e = measure_first(p, target);
    p->begun = !e && !is_cancelled(p->light->direct.cancel);
    p->bank_s = 0.0;
    return e;
}

enum err pilot_run(struct pilot *p, const struct environment *e, const struct relight_desc *light,
                   const struct budget_target *target, float *rgb, struct relight_stats *stats,
                   struct pilot_stats *measured)
{
    enum err result = ERR_OK;
    bool done = false;

    *measured = (struct pilot_stats){ 0 };
    p->environment = e;
    p->light = light;
    p->pilot_s = 0.0;
    pilot_follow(p);
    if (!p->begun && e->total_energy > 0.0)
        result = begin(p, target, rgb, stats, &done);
    if (result || is_cancelled(p->light->direct.cancel))
        return result;
    if (!done)
        pilot_choose(p, target);
    if (!done)
        result = make_image(p, light->direct.pass, rgb, stats);
    if (result || is_cancelled(p->light->direct.cancel))
        return result;
    if (p->runs > 0 && e->total_energy > 0.0)
        result = pilot_probe(p, target);
    p->frames++;
    p->runs++;
    p->frame_s += (p->frame_s > 0.0 ? SMOOTH : 1.0) * (p->image_s - p->frame_s);
    pilot_report(p, target, rgb, stats, measured);
    return result;
}
