#include "pilot_parts.h"

#include <math.h>
#include <string.h>

#define SAMPLES_MOST 4096.0
#define PATHS_MOST 1024.0
#define UNITS_MOST 1e6  /* 2 * 10^9 particles */
#define FINE 16.0       /* counts a point are means, and real: the budget has them in sixteenths */
#define GROWTH 16.0     /* of a count from one frame to the next, */
#define GROWTH_ELSE 4.0 /* where the technique is another */
#define FIRST_SAMPLES 4.0
#define WORTH 0.92       /* another way must promise this share of the error (or of the time) to be taken */
#define STEADY 1.12      /* a wished time that changes by less is the same one */
#define GAIN_LEAST 1.05  /* counts that would gain less than this stay as they are, */
#define OVERTIME 1.05    /* unless they take longer than this, */
#define OVER_ERROR 1.05  /* or leave more than this */
#define LATE 1.1         /* times the wish */
#define LONGER 1.1       /* times its share of the wish a picture may take where the best way just does not fit, */
#define WORTH_LONGER 0.6 /* and that much less error comes of it */
#define CHOOSE_OFTEN 16  /* frames */
#define CHOOSE_EVERY 4
#define TIME_LEAST 0.2 /* of the wish, that is always the picture's */

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

static void set_route(struct pilot *p, uint32_t way, bool there, uint32_t classes, uint32_t behind)
{
    const struct route before = p->route[way];

    p->route[way] = (struct route){ classes, p->set->facts.behind > 0 ? behind : 0 };
    if (before.classes != p->route[way].classes || before.behind != p->route[way].behind)
        p->model[way] = (struct model){ 0 };
    p->there[way] = there && (p->route[way].classes || p->route[way].behind);
}

/* The techniques of direct light. Lobes alone must meet what they are to find, light alone knows nothing of a narrow
 * lobe: where that may be a sun, or a highlight, their readings are small until one is large, and so they are not
 * offered. Both together are safe everywhere [Veach 1997, section 9.2]. */
static void set_techniques(struct pilot *p)
{
    for (uint32_t way = 0; way < WAY_EYE_ALL; way++) {
        const enum surface_kind kind = (enum surface_kind)(way / PILOT_TECHNIQUES);
        const struct method_recipe *r = method_recipe(techniques[way % PILOT_TECHNIQUES].desc.method);
        const bool safe =
            (r->light_part > 0.0f || p->peakedness <= PEAKED_MOST) && (r->brdf_part > 0.0f || kind == SURFACE_MATTE);
        p->there[way] = p->with_direct && p->groups.all.list[kind].count > 0 && safe;
    }
}

/* A change makes nothing known of the way. */
void pilot_set_routes(struct pilot *p)
{
    const uint32_t all = p->classes, aimed = all & (PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC);
    const bool peaked = p->peakedness > PEAKED_MOST && p->caustics_by != PLAN_EYE;
    const uint32_t behind = peaked ? all & ~aimed : all;

    const bool light_caustics = all & PATH_CAUSTICS && p->caustics_by != PLAN_EYE;
    const bool light_whole = all & PATH_INDIRECT_LIT && p->indirect_by != PLAN_EYE;
    const bool eye_caustics = !(all & PATH_CAUSTICS) || (p->caustics_by != PLAN_LIGHT && !peaked);
    const bool eye_rest = !(all & PATH_INDIRECT) || p->indirect_by != PLAN_LIGHT;

    set_techniques(p);
    set_route(p, WAY_AIMED, light_caustics, aimed, 0);
    set_route(p, WAY_WHOLE, light_whole, all & PATH_INDIRECT_LIT, 0);
    set_route(p, WAY_EYE_ALL, eye_caustics && eye_rest, all, behind);
    set_route(p, WAY_EYE_REST, light_caustics && eye_rest, all & PATH_INDIRECT_LIT, behind);
    set_route(p, WAY_EYE_BEHIND, light_whole, light_caustics ? 0 : aimed, behind);
    /* Caustics of eye paths beside interreflection of light paths only where both were asked for by name. */
    if (light_whole && !light_caustics && all & PATH_CAUSTICS && p->indirect_by == PLAN_AUTO)
        p->there[WAY_WHOLE] = p->there[WAY_EYE_BEHIND] = false;
}

void pilot_take_wish(struct pilot *p, const struct relight_desc *light)
{
    const uint32_t classes = classes_of(p, light);
    const enum plan_estimator caustics =
        light->caustics == PLAN_STORED ? PLAN_LIGHT : light->caustics; /* none is kept */
    const bool direct = light->classes & PATH_DIRECT || light->classes == 0;

    if (p->runs && classes == p->classes && direct == p->with_direct && caustics == p->caustics_by &&
        light->indirect == p->indirect_by && light->eye_paths == p->eye_wish && light->particles == p->particles_wish)
        return;
    p->classes = classes;
    p->with_direct = direct;
    p->caustics_by = caustics;
    p->indirect_by = light->indirect;
    p->eye_wish = light->eye_paths;
    p->particles_wish = light->particles;
    for (uint32_t way = WAY_EYE_ALL; way < WAYS; way++)
        p->model[way] = (struct model){ 0 };
    pilot_set_routes(p);
    for (int part = 0; part < PILOT_PARTS; part++)
        p->choice.way[part] = WAY_NONE;
    p->begun = false;
    p->frames = 0;
    pilot_edges_take(p, false);
}

static bool usable(const struct pilot *p, uint32_t way)
{
    return way != WAY_NONE && p->there[way] && p->model[way].known && p->model[way].timed;
}

/* Half of the samples by light, half by lobes: an odd count takes the time of the next even one. */
bool pilot_halves(uint32_t way)
{
    return way < WAY_EYE_ALL && method_recipe(techniques[way % PILOT_TECHNIQUES].desc.method)->brdf_part == 0.5f;
}

static double fine_of(enum pilot_part part)
{
    return part <= PILOT_EYE ? FINE : 1.0;
}

/* What a model knows, as a way of the budget, whose counts are fine_of() times ours. */
static struct budget_way way_of(const struct pilot *p, uint32_t way)
{
    const struct model *m = &p->model[way];
    const enum pilot_part part = pilot_part_of(way);
    const bool used = p->choice.way[part] == way;
    struct budget_way w = {
        /* Of many techniques one looks good by chance: each must do so by more than its readings scatter. */
        .variance =
            used ? model_error_told(m, p->choice.n[part]) * pow(p->choice.n[part], m->order)
                 : m->variance * (1.0 + (part <= PILOT_GLOSSY && p->choice.way[part] != WAY_NONE ? m->doubt : 0.0)),
        .order = m->order,
        .begin_s = p->pace * model_begin(m),
        .unit_s = p->pace * fmax(m->unit_s, 1e-12),
        .least = pilot_halves(way) ? 2.0 : 1.0,
        .most = part <= PILOT_GLOSSY ? SAMPLES_MOST
                : part == PILOT_EYE  ? PATHS_MOST
                                     : UNITS_MOST,
    };

    if (p->choice.way[part] != WAY_NONE && p->runs)
        w.most = fmin(w.most, fmax(16.0, (used ? GROWTH : GROWTH_ELSE) * p->choice.n[part]));
    if (part == PILOT_EYE && p->eye_wish)
        w.least = w.most = p->eye_wish;
    if (part >= PILOT_AIMED && p->particles_wish)
        w.least = w.most = fmax(1.0, ceil((double)p->particles_wish / UNIT_PARTICLES));
    w.variance *= pow(fine_of(part), w.order);
    w.unit_s /= fine_of(part);
    w.least *= fine_of(part);
    w.most *= fine_of(part);
    return w;
}

/* Whether the user leaves it to us to leave a part out. */
static bool may_be_left_out(const struct pilot *p, enum pilot_part part)
{
    if (part == PILOT_AIMED)
        return p->caustics_by == PLAN_AUTO;
    if (part == PILOT_WHOLE) /* without it, its route is another one */
        return false;
    return p->caustics_by == PLAN_AUTO && p->indirect_by == PLAN_AUTO && !p->eye_wish;
}

static void add_way(struct pilot *p, enum pilot_part part, uint32_t way, struct budget_way w)
{
    const uint32_t k = p->way_count[part]++;

    p->ways[part][k] = w;
    p->of_way[part][k] = way;
}

/* A way of the other light, and leaving it out. What is not known yet, or not of this route, is out at no cost. */
static void add_other(struct pilot *p, enum pilot_part part, uint32_t way, bool only_used)
{
    const bool can = usable(p, way), used = p->choice.way[part] == way;

    p->way_count[part] = 0;
    if (!can) {
        add_way(p, part, WAY_NONE, (struct budget_way){ 0 });
        return;
    }
    if (!only_used || used)
        add_way(p, part, way, way_of(p, way));
    if (may_be_left_out(p, part) && !(only_used && used))
        add_way(p, part, WAY_NONE, (struct budget_way){ .bias = p->model[way].energy_most });
    if (p->way_count[part] == 0)
        add_way(p, part, way, way_of(p, way));
}

static void add_direct(struct pilot *p, enum pilot_part part, bool only_used)
{
    const uint32_t first = part == PILOT_MATTE ? WAY_MATTE : WAY_GLOSSY, used = p->choice.way[part];

    p->way_count[part] = 0;
    for (uint32_t way = first; way < first + PILOT_TECHNIQUES; way++) {
        const bool read = p->model[way].fresh >= 2 || way == used || way == first;
        if (usable(p, way) && read && (!only_used || way == used))
            add_way(p, part, way, way_of(p, way));
    }
    if (p->way_count[part] > 0)
        return;
    if (p->there[first]) /* nothing is known: as at first */
        add_way(p, part, first, (struct budget_way){ .least = FINE * FIRST_SAMPLES, .most = FINE * FIRST_SAMPLES });
    else
        add_way(p, part, WAY_NONE, (struct budget_way){ 0 });
}

struct plan_trial {
    struct budget budget;
    struct choice choice;
    bool there;
};

static void solve(const struct pilot *p, const struct pilot_wish *wish, struct plan_trial *out)
{
    struct budget_part parts[PILOT_PARTS];

    for (int part = 0; part < PILOT_PARTS; part++)
        parts[part] = (struct budget_part){ p->ways[part], p->way_count[part] };
    if (wish->error > 0.0) {
        budget_for_error(parts, PILOT_PARTS, wish->error, &out->budget);
        if (wish->seconds > 0.0 && out->budget.seconds > wish->seconds)
            budget_for_time(parts, PILOT_PARTS, wish->seconds, &out->budget);
    } else {
        budget_for_time(parts, PILOT_PARTS, wish->seconds, &out->budget);
    }
    for (int part = 0; part < PILOT_PARTS; part++) {
        const struct budget_share *s = &out->budget.part[part];
        out->choice.way[part] = p->of_way[part][s->way];
        out->choice.n[part] = s->n / fine_of((enum pilot_part)part);
    }
    out->there = true;
}

static bool better(const struct plan_trial *a, const struct plan_trial *b, const struct pilot_wish *wish, double worth)
{
    if (!b->there || a->budget.met != b->budget.met)
        return !b->there || a->budget.met;
    if (wish->error > 0.0 && a->budget.met)
        return a->budget.seconds < worth * b->budget.seconds;
    if (!(wish->error > 0.0) && !a->budget.met)
        return a->budget.seconds < worth * b->budget.seconds;
    return a->budget.error < worth * b->budget.error;
}

/* The best of a route's; `only_used`: by the ways that the frame before had. */
static void try_route(struct pilot *p, uint32_t route, bool only_used, const struct pilot_wish *wish,
                      struct plan_trial *out)
{
    for (int part = PILOT_MATTE; part <= PILOT_GLOSSY; part++)
        add_direct(p, (enum pilot_part)part, only_used);
    for (int k = 0; k < 3; k++)
        add_other(p, (enum pilot_part)(PILOT_EYE + k), pilot_routes[route][k], only_used);
    solve(p, wish, out);
    out->choice.route = route;
}

/* A route is possible where all that it needs is there and known. */
static bool possible(const struct pilot *p, uint32_t route)
{
    bool any = false;

    for (int k = 0; k < 3; k++) {
        const uint32_t way = pilot_routes[route][k];
        if (way == WAY_NONE || !p->there[way])
            continue;
        if (!usable(p, way))
            return false;
        any = true;
    }
    if (route == 1 && !p->there[WAY_AIMED])
        return false;
    if (route == 2 && !p->there[WAY_WHOLE])
        return false;
    return any || !p->classes;
}

/* The best of all routes. */
static void try_routes(struct pilot *p, const struct pilot_wish *wish, struct plan_trial *best)
{
    for (uint32_t route = 0; route < ROUTES; route++) {
        struct plan_trial t = { .there = false };
        if (!possible(p, route))
            continue;
        try_route(p, route, false, wish, &t);
        if (better(&t, best, wish, 1.0))
            *best = t;
    }
}

/* Counts of the same ways stay where others would gain little, so that noise stands still in a picture that does: near
 * the best of them the error hardly depends on how the time is shared out. */
static void hold_counts(const struct pilot *p, const struct pilot_wish *wish, struct plan_trial *t)
{
    double seconds = 0.0, error = t->budget.error;

    for (int part = 0; part < PILOT_PARTS; part++) {
        if (t->choice.way[part] != p->choice.way[part])
            return;
        if (t->choice.way[part] == WAY_NONE)
            continue;
        const struct budget_way w = way_of(p, t->choice.way[part]);
        const double n = p->choice.n[part] * fine_of((enum pilot_part)part);
        seconds += budget_seconds(&w, n);
        error += budget_error(&w, n) - budget_error(&w, t->budget.part[part].n);
    }
    const bool of_error = wish->error > 0.0 && t->budget.met;
    if (of_error ? error > OVER_ERROR * wish->error || seconds > GAIN_LEAST * t->budget.seconds
                 : seconds > OVERTIME * wish->seconds || error > GAIN_LEAST * t->budget.error)
        return;
    for (int part = 0; part < PILOT_PARTS; part++)
        t->choice.n[part] = p->choice.n[part];
}

static void choose_first(struct pilot *p)
{
    for (int part = 0; part < PILOT_PARTS; part++) {
        const uint32_t way = part == PILOT_MATTE ? WAY_MATTE : part == PILOT_GLOSSY ? WAY_GLOSSY : WAY_NONE;
        p->choice.way[part] = way != WAY_NONE && p->there[way] ? way : WAY_NONE;
        p->choice.n[part] = FIRST_SAMPLES;
    }
    p->choice.route = ROUTES;
}

double pilot_error_at(struct pilot *p, double seconds)
{
    const struct pilot_wish wish = { .seconds = seconds };
    struct plan_trial t;

    if (p->choice.route >= ROUTES)
        return 0.0;
    try_route(p, p->choice.route, false, &wish, &t);
    return t.budget.error;
}

/* To choose takes about a third of a millisecond, and little changes from frame to frame: later on it is done for every
 * fourth, unless the sky or the wish is another or the last picture was late. */
static bool choice_stands(const struct pilot *p, const struct pilot_wish *wish)
{
    const bool same = wish->error == p->solved.error && wish->seconds <= STEADY * p->solved.seconds &&
                      p->solved.seconds <= STEADY * wish->seconds;
    const bool late = wish->seconds > 0.0 && p->picture_s > LATE * wish->seconds;

    return same && !late && p->frames > CHOOSE_OFTEN && p->runs % CHOOSE_EVERY != 0;
}

void pilot_choose(struct pilot *p, const struct pilot_wish *wish)
{
    struct pilot_wish left = *wish;
    struct plan_trial best = { .there = false }, stay = { .there = false };

    if (!p->begun || !(p->environment->total_energy > 0.0)) {
        choose_first(p);
        p->budget = (struct budget){ .met = true };
        return;
    }
    if (choice_stands(p, wish))
        return;
    p->solved = *wish;
    if (left.seconds > 0.0)
        left.seconds = fmax(TIME_LEAST * wish->seconds, (1.0 - pilot_share(p)) * wish->seconds - p->other_s);
    try_routes(p, &left, &best);
    if (left.seconds > 0.0 && best.there && !(left.error > 0.0)) {
        const struct pilot_wish longer = { .seconds = LONGER * left.seconds };
        struct plan_trial t = { .there = false };
        try_routes(p, &longer, &t);
        if (t.there && t.budget.met && t.budget.error < WORTH_LONGER * best.budget.error) {
            best = t;
            left = longer;
        }
    }
    if (p->choice.route < ROUTES && possible(p, p->choice.route))
        try_route(p, p->choice.route, true, &left, &stay);
    if (!best.there) { /* nothing of the other light is known yet: direct light alone */
        for (int part = PILOT_EYE; part < PILOT_PARTS; part++)
            add_other(p, (enum pilot_part)part, WAY_NONE, false);
        for (int part = PILOT_MATTE; part <= PILOT_GLOSSY; part++)
            add_direct(p, (enum pilot_part)part, false);
        solve(p, &left, &best);
        best.choice.route = ROUTES;
    }
    if (p->runs && stay.there && !better(&best, &stay, &left, WORTH))
        best = stay;
    hold_counts(p, &left, &best);
    for (int part = 0; part < PILOT_PARTS; part++)
        if (best.choice.way[part] != WAY_NONE && best.choice.way[part] != p->choice.way[part])
            p->model[best.choice.way[part]].chosen = 0;
    p->choice = best.choice;
    p->budget = best.budget;
    if (pilot_edges_turn(p, &left))
        pilot_edges_take(p, !pilot_edges_are_jagged(p));
    p->more = pilot_error_at(p, 2.0 * p->budget.seconds);
}

double pilot_missing(const struct pilot *p, enum pilot_part part)
{
    uint32_t way = WAY_NONE;

    if (p->choice.way[part] != WAY_NONE || part <= PILOT_GLOSSY)
        return 0.0;
    if (p->choice.route < ROUTES)
        way = pilot_routes[p->choice.route][part - PILOT_EYE];
    return usable(p, way) ? p->model[way].energy : 0.0;
}

/* Several that are left out may miss in the same places: then their roots add up, which is the most that it can be. */
double pilot_error(const struct pilot *p)
{
    double error = 0.0, missing = 0.0;

    if (!(p->environment->total_energy > 0.0))
        return 0.0;

    for (int part = 0; part < PILOT_PARTS; part++) {
        if (p->choice.way[part] != WAY_NONE)
            error += model_error_told(&p->model[p->choice.way[part]], p->choice.n[part]);
        missing += sqrt(pilot_missing(p, (enum pilot_part)part));
    }
    return error + missing * missing + (pilot_edges_are_jagged(p) ? pilot_edge_error(p) : 0.0);
}
