#include "light/pilot_parts.h"

#include <math.h>

#define SAMPLES_MOST 4096.0
#define PATHS_MOST 1024.0
#define UNITS_MOST 1e6 /* 2 * 10^9 particles */
#define FIRST_SAMPLES 4.0
#define WORTH 0.92     /* another way must promise this share of the variance or less */
#define KEPT 1.05      /* counts are kept unless others gain more than this, or they exceed the target by it */
#define AIM 0.9        /* of the target error, since estimates of it scatter */
#define TIME_LEAST 0.2 /* of the target always goes to the picture */

const uint32_t pilot_routes[ROUTES + 1][3] = {
    { WAY_EYE_ALL, WAY_NONE, WAY_NONE },
    { WAY_EYE_REST, WAY_AIMED, WAY_NONE },
    { WAY_EYE_BEHIND, WAY_AIMED, WAY_WHOLE },
    { WAY_NONE, WAY_NONE, WAY_NONE },
};

/* The requested classes that exist in the scene. */
static uint32_t classes_of(const struct pilot *p, const struct relight_desc *light)
{
    uint32_t classes = light->classes & (PATH_CAUSTICS | PATH_INDIRECT);

    if (p->set->facts.casters == 0)
        classes &= ~(uint32_t)(PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC);
    if (light->caustics == PLAN_NONE)
        classes &= ~(uint32_t)PATH_CAUSTICS;
    if (light->indirect == PLAN_NONE)
        classes &= ~(uint32_t)PATH_INDIRECT;
    return classes;
}

/* After a change nothing is known of the way. */
static void offer(struct pilot *p, uint32_t way, bool offered, uint32_t classes, uint32_t behind)
{
    const struct way_classes before = p->find[way];

    p->find[way] = (struct way_classes){ classes, p->set->facts.behind > 0 ? behind : 0 };
    if (before.classes != p->find[way].classes || before.behind != p->find[way].behind)
        p->model[way] = (struct model){ 0 };
    p->offered[way] = offered && (p->find[way].classes || p->find[way].behind);
}

/* BRDF samples alone rarely find a sun, and their readings are small until one is large, so they are not offered if
 * there may be a sun. Combined light and BRDF samples are safe everywhere [Veach 1997, section 9.2]. */
void pilot_offer_ways(struct pilot *p)
{
    const uint32_t all = p->classes, aimed = all & (PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC);
    const bool peaked = p->peakedness > PEAKED_MOST;
    const bool lost = peaked && p->caustics_by != PLAN_EYE; /* caustics of the sun behind mirrors and glass */
    const uint32_t behind = lost ? all & ~aimed : all;

    const bool light_caustics = all & PATH_CAUSTICS && p->caustics_by != PLAN_EYE;
    const bool light_whole = all & PATH_INDIRECT_LIT && p->indirect_by != PLAN_EYE;
    const bool eye_caustics = !(all & PATH_CAUSTICS) || (p->caustics_by != PLAN_LIGHT && !lost);
    const bool eye_rest = !(all & PATH_INDIRECT) || p->indirect_by != PLAN_LIGHT;

    for (uint32_t way = WAY_DIRECT; way < WAY_EYE_ALL; way++)
        p->offered[way] = p->with_direct && p->groups.all.list.count > 0 &&
                          (method_recipe(techniques[way].desc.method)->light_part > 0.0f || !peaked);
    offer(p, WAY_AIMED, light_caustics, aimed, 0);
    offer(p, WAY_WHOLE, light_whole, all & PATH_INDIRECT_LIT, 0);
    offer(p, WAY_EYE_ALL, eye_caustics && eye_rest, all, behind);
    offer(p, WAY_EYE_REST, light_caustics && eye_rest, all & PATH_INDIRECT_LIT, behind);
    offer(p, WAY_EYE_BEHIND, light_whole, light_caustics ? 0 : aimed, behind);
    /* Caustics by eye paths with interreflection by light paths only if both were requested by name. */
    if (light_whole && !light_caustics && all & PATH_CAUSTICS && p->indirect_by == PLAN_AUTO)
        p->offered[WAY_WHOLE] = p->offered[WAY_EYE_BEHIND] = false;
}

void pilot_take_request(struct pilot *p, const struct relight_desc *light)
{
    const uint32_t classes = classes_of(p, light);
    const enum plan_estimator caustics =
        light->caustics == PLAN_STORED ? PLAN_LIGHT : light->caustics; /* the pilot keeps no store */
    const bool direct = light->classes & PATH_DIRECT || light->classes == 0;

    if (p->runs && classes == p->classes && direct == p->with_direct && caustics == p->caustics_by &&
        light->indirect == p->indirect_by && light->eye_paths == p->eye_paths && light->particles == p->particles)
        return;
    p->classes = classes;
    p->with_direct = direct;
    p->caustics_by = caustics;
    p->indirect_by = light->indirect;
    p->eye_paths = light->eye_paths;
    p->particles = light->particles;
    for (uint32_t way = WAY_EYE_ALL; way < WAYS; way++)
        p->model[way] = (struct model){ 0 };
    pilot_offer_ways(p);
    for (int part = 0; part < PILOT_PARTS; part++)
        p->choice.way[part] = WAY_NONE;
    p->begun = false;
    p->frames = 0;
}

/* Converts a model for the budget. Among several techniques one looks good by chance, so a replacement must promise a
 * clear gain over the current one. */
static struct budget_part budget_of(const struct pilot *p, uint32_t way)
{
    const struct model *m = &p->model[way];
    const enum pilot_part part = pilot_part_of(way);
    const uint32_t now = p->choice.way[part];
    struct budget_part w = {
        .variance = m->variance / (now != WAY_NONE && now != way && p->runs ? WORTH : 1.0),
        .begin_s = m->begin_s,
        .unit_s = fmax(m->unit_s, 1e-12),
        .least = part == PILOT_DIRECT ? pilot_count(p, way, 0.0).step : 1.0,
        .most = part == PILOT_DIRECT ? SAMPLES_MOST
                : part == PILOT_EYE  ? PATHS_MOST
                                     : UNITS_MOST,
    };

    if (part == PILOT_EYE && p->eye_paths)
        w.least = w.most = p->eye_paths;
    if (part >= PILOT_AIMED && p->particles)
        w.least = w.most = fmax(1.0, (double)p->particles / UNIT_PARTICLES);
    return w;
}

/* Whether the request allows it to be left out. */
static bool may_be_left_out(const struct pilot *p, int part)
{
    if (part == PILOT_AIMED)
        return p->caustics_by == PLAN_AUTO;
    if (part == PILOT_WHOLE) /* its route would be another one without it */
        return false;
    return p->caustics_by == PLAN_AUTO && p->indirect_by == PLAN_AUTO && !p->eye_paths;
}

static bool usable(const struct pilot *p, uint32_t way)
{
    return way != WAY_NONE && p->offered[way] && p->model[way].known && p->model[way].timed;
}

/* Whether everything about the route is known. Without a route there is only direct light. */
static bool possible(const struct pilot *p, uint32_t route)
{
    const uint32_t *way = pilot_routes[route];
    bool any = route == ROUTES;

    for (int k = 0; k < 3; k++) {
        const bool offered = way[k] != WAY_NONE && p->offered[way[k]];
        if ((offered && !usable(p, way[k])) || (!offered && k > 0 && k == (int)route))
            return false;
        any |= offered;
    }
    return any || !p->classes;
}

struct trial {
    struct budget budget;
    struct choice choice;
};

/* Direct light by one technique, other light by a route without the parts in the mask left_out. False: not allowed. */
static bool try_ways(const struct pilot *p, uint32_t route, uint32_t direct, uint32_t left_out,
                     const struct budget_target *target, struct trial *t)
{
    struct budget_part parts[PILOT_PARTS] = { { .least = FIRST_SAMPLES, .most = FIRST_SAMPLES } };

    *t = (struct trial){ .choice = { .route = route, .way[PILOT_DIRECT] = direct } };
    if (usable(p, direct))
        parts[PILOT_DIRECT] = budget_of(p, direct);
    for (int part = PILOT_EYE; part < PILOT_PARTS; part++) {
        const uint32_t way = pilot_routes[route][part - PILOT_EYE];
        const bool leave = left_out >> part & 1, can = usable(p, way);
        if (leave && !(can && may_be_left_out(p, part)))
            return false;
        t->choice.way[part] = can && !leave ? way : WAY_NONE;
        if (can)
            parts[part] = leave ? (struct budget_part){ .bias = p->model[way].energy_most } : budget_of(p, way);
    }
    budget_spend(parts, PILOT_PARTS, target, &t->budget);
    for (int part = 0; part < PILOT_PARTS; part++)
        t->choice.n[part] = t->budget.n[part];
    return true;
}

/* The best of all combinations that are known. */
static struct trial try_all(const struct pilot *p, const struct budget_target *target)
{
    struct trial best, t;
    bool found = false, known = false;

    for (uint32_t way = WAY_DIRECT; way < WAY_EYE_ALL; way++)
        known |= usable(p, way);
    for (uint32_t route = 0; route <= ROUTES; route++) {
        if (route < ROUTES ? !possible(p, route) : found)
            continue;
        for (uint32_t way = WAY_DIRECT; way < WAY_EYE_ALL; way++)
            for (uint32_t left_out = 0; left_out < 1u << PILOT_PARTS; left_out += 2) {
                /* Direct light was not requested, or nothing is known of it yet. */
                const uint32_t direct = known || p->offered[way] ? way : WAY_NONE;
                if ((known ? !usable(p, way) : way != WAY_DIRECT) || !try_ways(p, route, direct, left_out, target, &t))
                    continue;
                if (!found || budget_better(&t.budget, &best.budget, target))
                    best = t;
                found = true;
            }
    }
    return best;
}

/* Keeps the counts of the same techniques if others would gain little, so that noise is static in a still picture: near
 * the optimum the error hardly depends on the division of time. */
static void hold_counts(const struct pilot *p, const struct budget_target *target, struct trial *t)
{
    double seconds = 0.0, error = t->budget.error;

    for (int part = 0; part < PILOT_PARTS; part++) {
        const uint32_t way = t->choice.way[part];
        if (way != p->choice.way[part])
            return;
        if (way == WAY_NONE)
            continue;
        seconds += model_seconds(&p->model[way], p->choice.n[part]);
        error += model_error(&p->model[way], p->choice.n[part]) - model_error(&p->model[way], t->choice.n[part]);
    }
    const bool of_error = target->error > 0.0 && t->budget.met;
    if (of_error ? error > KEPT * target->error || seconds > KEPT * t->budget.seconds
                 : seconds > KEPT * target->seconds || error > KEPT * t->budget.error)
        return;
    for (int part = 0; part < PILOT_PARTS; part++)
        t->choice.n[part] = p->choice.n[part];
}

void pilot_choose(struct pilot *p, const struct pilot_target *target)
{
    struct budget_target left = { target->seconds, AIM * target->error };

    if (!p->begun || !(p->environment->total_energy > 0.0)) {
        p->choice = (struct choice){ ROUTES,
                                     { p->offered[WAY_DIRECT] ? WAY_DIRECT : WAY_NONE, WAY_NONE, WAY_NONE, WAY_NONE },
                                     { FIRST_SAMPLES } };
        p->budget = (struct budget){ .met = true };
        return;
    }
    if (left.seconds > 0.0)
        left.seconds = fmax(TIME_LEAST * target->seconds, (1.0 - pilot_share(p)) * target->seconds - p->other_s);
    struct trial best = try_all(p, &left);
    hold_counts(p, &left, &best);
    p->choice = best.choice;
    p->budget = best.budget;
    p->more = try_all(p, &(struct budget_target){ .seconds = 2.0 * p->budget.seconds }).budget.error;
}

double pilot_missing(const struct pilot *p, enum pilot_part part)
{
    if (p->choice.way[part] != WAY_NONE || part == PILOT_DIRECT)
        return 0.0;
    const uint32_t way = pilot_routes[p->choice.route][part - PILOT_EYE];
    return usable(p, way) ? p->model[way].energy : 0.0;
}

/* Several omitted parts may be missing in the same places. In that worst case their roots add up.
 */
double pilot_error(const struct pilot *p)
{
    double error = 0.0, missing = 0.0;

    for (int part = 0; part < PILOT_PARTS && p->environment->total_energy > 0.0; part++) {
        if (p->choice.way[part] != WAY_NONE)
            error += model_error(&p->model[p->choice.way[part]], p->choice.n[part]);
        missing += sqrt(pilot_missing(p, (enum pilot_part)part));
    }
    return error + missing * missing;
}
