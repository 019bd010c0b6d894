#include "light/pilot_parts.h"

#include <math.h>

#define SAMPLES_MOST 4096.0
#define PATHS_MOST 1024.0
#define UNITS_MOST 1e6 /* 2 * 10^9 particles */
#define FIRST_SAMPLES 4.0
#define WORTH 0.92      /* another way must promise this share of the variance to be taken */
#define GAIN_LEAST 1.05 /* counts that would gain less than this stay as they are, */
#define OVERTIME 1.05   /* unless they take longer than this, */
#define OVER_ERROR 1.05 /* or leave more than this */
#define TIME_LEAST 0.2  /* of the target, that is always the picture's */

const uint32_t pilot_routes[ROUTES][3] = {
    { WAY_EYE_ALL, WAY_NONE, WAY_NONE },
    { WAY_EYE_REST, WAY_AIMED, WAY_NONE },
    { WAY_EYE_BEHIND, WAY_AIMED, WAY_WHOLE },
};

/* What was asked for and can be found here. */
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

/* A change makes nothing known of the way. */
static void offer(struct pilot *p, uint32_t way, bool offered, uint32_t classes, uint32_t behind)
{
    const struct way_classes before = p->find[way];

    p->find[way] = (struct way_classes){ classes, p->set->facts.behind > 0 ? behind : 0 };
    if (before.classes != p->find[way].classes || before.behind != p->find[way].behind)
        p->model[way] = (struct model){ 0 };
    p->offered[way] = offered && (p->find[way].classes || p->find[way].behind);
}

/* Lobes alone must meet what they are to find: where that may be a sun, their readings are small until one is large,
 * and so they are not offered. Light and lobes together are safe everywhere [Veach 1997, section 9.2]. */
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
    /* Caustics of eye paths beside interreflection of light paths only where both were asked for by name. */
    if (light_whole && !light_caustics && all & PATH_CAUSTICS && p->indirect_by == PLAN_AUTO)
        p->offered[WAY_WHOLE] = p->offered[WAY_EYE_BEHIND] = false;
}

void pilot_take_request(struct pilot *p, const struct relight_desc *light)
{
    const uint32_t classes = classes_of(p, light);
    const enum plan_estimator caustics =
        light->caustics == PLAN_STORED ? PLAN_LIGHT : light->caustics; /* none is kept */
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

static bool usable(const struct pilot *p, uint32_t way)
{
    return way != WAY_NONE && p->offered[way] && p->model[way].known && p->model[way].timed;
}

/* What a model knows, as a way of the budget. Of several ways one looks good by chance: another than the present one
 * must promise more. */
static struct budget_way way_of(const struct pilot *p, uint32_t way)
{
    const struct model *m = &p->model[way];
    const enum pilot_part part = pilot_part_of(way);
    const uint32_t now = p->choice.way[part];
    struct budget_way w = {
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

/* Whether the request leaves it to us to leave a part out. */
static bool may_be_left_out(const struct pilot *p, enum pilot_part part)
{
    if (part == PILOT_AIMED)
        return p->caustics_by == PLAN_AUTO;
    if (part == PILOT_WHOLE) /* without it, its route is another one */
        return false;
    return p->caustics_by == PLAN_AUTO && p->indirect_by == PLAN_AUTO && !p->eye_paths;
}

/* The ways that a frame's parts may take by a route. */
struct menu {
    struct budget_way ways[PILOT_PARTS][TECHNIQUES + 1];
    uint32_t way[PILOT_PARTS][TECHNIQUES + 1]; /* WAY_*, of each */
    struct budget_part parts[PILOT_PARTS];
};

static void add(struct menu *m, int part, uint32_t way, struct budget_way w)
{
    m->way[part][m->parts[part].count] = way;
    m->ways[part][m->parts[part].count++] = w;
    m->parts[part].ways = m->ways[part];
}

static void list_ways(const struct pilot *p, uint32_t route, struct menu *m)
{
    *m = (struct menu){ .parts[0].count = 0 };
    for (uint32_t way = WAY_DIRECT; way < WAY_EYE_ALL; way++)
        if (usable(p, way))
            add(m, PILOT_DIRECT, way, way_of(p, way));
    if (m->parts[PILOT_DIRECT].count == 0) /* it is not asked for, or nothing is known: as at first */
        add(m, PILOT_DIRECT, p->offered[WAY_DIRECT] ? WAY_DIRECT : WAY_NONE,
            (struct budget_way){ .least = FIRST_SAMPLES, .most = FIRST_SAMPLES });
    for (int part = PILOT_EYE; part < PILOT_PARTS; part++) {
        const uint32_t way = route < ROUTES ? pilot_routes[route][part - PILOT_EYE] : WAY_NONE;
        const bool can = usable(p, way);
        if (can)
            add(m, part, way, way_of(p, way));
        if (!can || may_be_left_out(p, (enum pilot_part)part))
            add(m, part, WAY_NONE, (struct budget_way){ .bias = can ? p->model[way].energy_most : 0.0 });
    }
}

struct trial {
    struct budget budget;
    struct choice choice;
};

/* The best by a route. */
static struct trial try_route(const struct pilot *p, uint32_t route, const struct pilot_target *target)
{
    struct trial t = { .choice.route = route };
    struct menu m;

    list_ways(p, route, &m);
    if (target->error > 0.0)
        budget_for_error(m.parts, PILOT_PARTS, target->error, &t.budget);
    if (!(target->error > 0.0) || (target->seconds > 0.0 && t.budget.seconds > target->seconds))
        budget_for_time(m.parts, PILOT_PARTS, target->seconds, &t.budget);
    for (int part = 0; part < PILOT_PARTS; part++) {
        t.choice.way[part] = m.way[part][t.budget.part[part].way];
        t.choice.n[part] = t.budget.part[part].n;
    }
    return t;
}

static bool better(const struct budget *a, const struct budget *b, const struct pilot_target *target)
{
    if (a->met != b->met)
        return a->met;
    return (target->error > 0.0) == a->met ? a->seconds < b->seconds : a->error < b->error;
}

/* Whether all that the route needs is known. */
static bool possible(const struct pilot *p, uint32_t route)
{
    bool any = false;

    for (int k = 0; k < 3; k++) {
        const uint32_t way = pilot_routes[route][k];
        if (way == WAY_NONE || !p->offered[way])
            continue;
        if (!usable(p, way))
            return false;
        any = true;
    }
    if ((route == 1 && !p->offered[WAY_AIMED]) || (route == 2 && !p->offered[WAY_WHOLE]))
        return false;
    return any || !p->classes;
}

/* Counts of the same ways stay where others would gain little, so that noise stands still in a picture that does: near
 * the best of them the error hardly depends on how the time is shared out. */
static void hold_counts(const struct pilot *p, const struct pilot_target *target, struct trial *t)
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
    if (of_error ? error > OVER_ERROR * target->error || seconds > GAIN_LEAST * t->budget.seconds
                 : seconds > OVERTIME * target->seconds || error > GAIN_LEAST * t->budget.error)
        return;
    for (int part = 0; part < PILOT_PARTS; part++)
        t->choice.n[part] = p->choice.n[part];
}

void pilot_choose(struct pilot *p, const struct pilot_target *target)
{
    struct pilot_target left = *target;
    struct trial best = { .choice.route = ROUTES };

    if (!p->begun || !(p->environment->total_energy > 0.0)) {
        p->choice = (struct choice){ ROUTES,
                                     { p->offered[WAY_DIRECT] ? WAY_DIRECT : WAY_NONE, WAY_NONE, WAY_NONE, WAY_NONE },
                                     { FIRST_SAMPLES } };
        p->budget = (struct budget){ .met = true };
        return;
    }
    if (left.seconds > 0.0)
        left.seconds = fmax(TIME_LEAST * target->seconds, (1.0 - pilot_share(p)) * target->seconds - p->other_s);
    for (uint32_t route = 0; route < ROUTES; route++) {
        const struct trial t = possible(p, route) ? try_route(p, route, &left) : best;
        if (t.choice.route < ROUTES && (best.choice.route == ROUTES || better(&t.budget, &best.budget, &left)))
            best = t;
    }
    if (best.choice.route == ROUTES) /* nothing of the other light is known yet: direct light alone */
        best = try_route(p, ROUTES, &left);
    hold_counts(p, &left, &best);
    p->choice = best.choice;
    p->budget = best.budget;
    p->more = try_route(p, p->choice.route, &(struct pilot_target){ .seconds = 2.0 * p->budget.seconds }).budget.error;
}

double pilot_missing(const struct pilot *p, enum pilot_part part)
{
    if (p->choice.way[part] != WAY_NONE || part == PILOT_DIRECT || p->choice.route >= ROUTES)
        return 0.0;
    const uint32_t way = pilot_routes[p->choice.route][part - PILOT_EYE];
    return usable(p, way) ? p->model[way].energy : 0.0;
}

/* Several that are left out may miss in the same places: then their roots add up, which is the most that it can be. */
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
