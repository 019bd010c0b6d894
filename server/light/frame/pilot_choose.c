#include "light/frame/pilot.h"

#include <math.h>
#include <string.h>

#define SAMPLES_MOST 4096.0 /* bounds per point, however much time there is */
#define PATHS_MOST 1024.0
#define UNITS_MOST 1e6    /* 2 * 10^9 particles */
#define QUICK_SAMPLES 4.0 /* of the quick image, and no fewer for a filter, */
#define QUICK_PATHS 2.0   /* which compares two halves */
#define QUICK_UNITS 4.0
#define KEPT 1.05      /* counts are kept unless others gain more than this, or they exceed the target by it */
#define AIM 0.9        /* of the target error, since estimates of it scatter */
#define TIME_LEAST 0.2 /* of the target always goes to the image */
#define FILTERED 0.7   /* of PILOT_FILTER_ABOVE, below which a filtered image is no longer filtered */

/* What of the request the plan depends on. */
static struct relight_desc wish_of(const struct relight_desc *light)
{
    return (struct relight_desc){
        .direct.method = METHOD_AUTO,
        .direct.samples = 1,
        .direct.seed = light->direct.seed,
        .classes = light->classes,
        .caustics = light->caustics == PLAN_STORED ? PLAN_LIGHT : light->caustics, /* the pilot keeps no store */
        .indirect = light->indirect,
        .particles = light->particles,
        .eye_paths = light->eye_paths,
        .start = light->start,
    };
}

static bool same_wish(const struct relight_desc *a, const struct relight_desc *b)
{
    return a->classes == b->classes && a->caustics == b->caustics && a->indirect == b->indirect &&
           a->particles == b->particles && a->eye_paths == b->eye_paths && a->start == b->start &&
           a->direct.seed == b->direct.seed;
}

/* Those for the whole scene, or those aimed at mirrors and glass. */
static struct light_tracer_desc particles_of(const struct frame_plan *rule, bool whole)
{
    for (uint32_t k = 0; k < rule->count; k++) {
        const struct pass *s = &rule->pass[k];
        if (s->kind == PASS_PARTICLES && whole == ((s->light.classes & PATH_INDIRECT_LIT) != 0))
            return s->light;
    }
    return (struct light_tracer_desc){ .particles = 0 };
}

/* Plans anew; nothing is known of a part whose classes have changed. */
static void plan(struct pilot *p)
{
    const struct eye_paths_desc eye = p->eye;
    const bool direct = p->offered[PILOT_DIRECT], points = p->groups.all.list.count > 0;
    struct frame_plan rule;
    bool changed = p->runs == 0;

    frame_plan_make(p->set, NULL, p->passes->scratch, p->environment, &p->wanted, false, &rule);
    p->plan = rule.light;
    const struct pass *found = frame_plan_find(&rule, PASS_EYE);
    p->background = rule.background;
    p->eye = found ? found->eye : (struct eye_paths_desc){ .paths = 0 };
    p->offered[PILOT_DIRECT] = frame_plan_find(&rule, PASS_DIRECT)->direct.samples > 0 && points;
    p->offered[PILOT_EYE] = found && points;
    if (eye.classes != p->eye.classes || eye.behind_classes != p->eye.behind_classes) {
        p->model[PILOT_EYE] = (struct model){ 0 };
        changed = true;
    }
    changed |= direct != p->offered[PILOT_DIRECT];
    for (uint32_t k = 0; k < 2; k++) {
        const uint32_t before = p->light_by[k].classes;
        p->light_by[k] = particles_of(&rule, k == 1);
        p->offered[PILOT_AIMED + k] = p->light_by[k].particles > 0;
        if (before == p->light_by[k].classes)
            continue;
        p->model[PILOT_AIMED + k] = (struct model){ 0 };
        changed = true;
    }
    p->begun &= !changed;
}

void pilot_follow(struct pilot *p)
{
    const struct environment *e = p->environment;
    const struct relight_desc wish = wish_of(p->light);
    const bool same = p->runs && same_wish(&wish, &p->wanted), same_sky = pilot_same_sky(p->energy, e);

    if (same && same_sky)
        return;
    p->wanted = wish;
    plan(p);
    p->frames = 0;
    if (same_sky)
        return;
    memcpy(p->energy, e->energy, sizeof(p->energy));
    for (int part = 0; part < PILOT_PARTS; part++)
        model_age(&p->model[part]);
    for (int part = 0; part <= PILOT_EYE; part++) {
        allot_age(&p->allot[part]);
        p->allot_readings[part] = p->allot_turns[part] = 0;
    }
}

/* The count that the request names; 0: none. */
static double named(const struct pilot *p, int part)
{
    return part == PILOT_EYE     ? p->wanted.eye_paths
           : part >= PILOT_AIMED ? ceil((double)p->wanted.particles / UNIT_PARTICLES)
                                 : 0.0;
}

static double quick(const struct pilot *p, int part)
{
    const double n = named(p, part);

    return n > 0.0 ? n : part == PILOT_DIRECT ? QUICK_SAMPLES : part == PILOT_EYE ? QUICK_PATHS : QUICK_UNITS;
}

void pilot_choose_first(struct pilot *p, bool denoised)
{
    p->denoised = denoised && (p->offered[PILOT_EYE] || p->offered[PILOT_AIMED] || p->offered[PILOT_WHOLE]);
    for (int part = 0; part < PILOT_PARTS; part++)
        p->n[part] = !p->offered[part] ? 0.0 : !denoised && part == PILOT_EYE ? 1.0 : quick(p, part);
    p->budget = (struct budget){ .met = true };
}

/* A part that is not known yet gets few. */
static struct budget_part budget_of(const struct pilot *p, int part)
{
    const struct model *m = &p->model[part];
    struct budget_part w = {
        .variance = m->variance,
        .unit_s = fmax(m->unit_s, 1e-12),
        .least = m->known ? pilot_count((enum pilot_part)part, 0.0).step : quick(p, part),
        .most = part == PILOT_DIRECT ? SAMPLES_MOST
                : part == PILOT_EYE  ? PATHS_MOST
                                     : UNITS_MOST,
    };

    if (!p->offered[part])
        return (struct budget_part){ .least = 0.0 };
    if (named(p, part) > 0.0)
        w.least = w.most = named(p, part);
    return w;
}

/* Keeps the counts if others would gain little, so that noise is static in a still image: near the optimum the error
 * hardly depends on the division of time. */
static void hold_counts(const struct pilot *p, const struct budget_target *target, struct budget *b)
{
    double seconds = 0.0, error = b->error;

    for (int part = 0; part < PILOT_PARTS; part++) {
        if (!p->offered[part])
            continue;
        if (!(p->n[part] >= budget_of(p, part).least))
            return;
        seconds += model_seconds(&p->model[part], p->n[part]);
        error += model_error(&p->model[part], p->n[part]) - model_error(&p->model[part], b->n[part]);
    }
    const bool of_error = target->error > 0.0 && b->met;
    if (of_error ? error > KEPT * target->error || seconds > KEPT * b->seconds
                 : seconds > KEPT * target->seconds || error > KEPT * b->error)
        return;
    memcpy(b->n, p->n, sizeof(p->n));
}

/* Whether the samples that the time pays for have more error than a filter leaves. */
static bool wants_filter(const struct pilot *p, const struct budget_target *target)
{
    const double least = PILOT_FILTER_ABOVE * (p->denoised ? FILTERED : 1.0);
    bool known = true, other = false;

    for (int part = 0; part < PILOT_PARTS; part++) {
        known &= !p->offered[part] || p->model[part].known;
        other |= part != PILOT_DIRECT && p->offered[part];
    }
    return other && target->seconds > 0.0 && (!known || pilot_error(p) > fmax(least, target->error));
}

static void take_at_least_two_halves(struct pilot *p, double seconds)
{
    double sum = 0.0;

    for (int part = 0; part < PILOT_PARTS; part++) {
        if (part < PILOT_AIMED && p->offered[part] && !(named(p, part) > 0.0))
            p->n[part] = fmax(p->n[part], quick(p, part));
        sum += p->offered[part] ? model_seconds(&p->model[part], p->n[part]) : 0.0;
    }
    p->budget.met = sum <= KEPT * seconds;
}

void pilot_choose(struct pilot *p, const struct budget_target *target)
{
    struct budget_target left = { target->seconds, AIM * target->error };

    if (!p->begun || !(p->environment->total_energy > 0.0)) {
        pilot_choose_first(p, target->seconds > 0.0);
        return;
    }
    if (left.seconds > 0.0)
        left.seconds = fmax(TIME_LEAST * target->seconds,
                            (p->runs ? 1.0 - pilot_share(p) : 1.0) * target->seconds - p->other_s - p->pilot_s);
    struct budget_part parts[PILOT_PARTS];

    for (int part = 0; part < PILOT_PARTS; part++)
        parts[part] = budget_of(p, part);
    budget_spend(parts, PILOT_PARTS, &left, &p->budget);
    hold_counts(p, &left, &p->budget);
    memcpy(p->n, p->budget.n, sizeof(p->n));
    p->denoised = wants_filter(p, target);
    if (p->denoised)
        take_at_least_two_halves(p, left.seconds);
}

double pilot_error(const struct pilot *p)
{
    double error = 0.0;

    for (int part = 0; part < PILOT_PARTS && p->environment->total_energy > 0.0; part++)
        if (p->offered[part])
            error += model_error(&p->model[part], p->n[part]);
    return error;
}
