#include "pilot_parts.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>

static bool used(const struct pilot *p, enum pilot_part part)
{
    return p->choice.way[part] != WAY_NONE;
}

static uint32_t classes_by(const struct pilot *p, enum pilot_part part)
{
    return used(p, part) ? p->route[p->choice.way[part]].classes : 0;
}

static enum plan_estimator who(const struct pilot *p, uint32_t class)
{
    if ((classes_by(p, PILOT_AIMED) | classes_by(p, PILOT_WHOLE)) & class)
        return PLAN_LIGHT;
    return classes_by(p, PILOT_EYE) & class ? PLAN_EYE : PLAN_NONE;
}

__attribute__((format(printf, 3, 4))) static void leave_out(struct pilot *p, struct plan *plan, const char *format, ...)
{
    if (plan->left_out_count >= PLAN_LEFT_OUT_MAX)
        return;
    char *to = p->sentence[plan->left_out_count];
    va_list args;
    va_start(args, format);
    vsnprintf(to, sizeof(p->sentence[0]), format, args);
    va_end(args);
    plan->left_out[plan->left_out_count++] = to;
}

/* What there is no question of. */
static void say_absent(struct pilot *p, const struct relight_desc *light, struct plan *plan)
{
    if (!(light->classes & PATH_CAUSTICS))
        leave_out(p, plan, "caustics: not asked for");
    else if (light->caustics == PLAN_NONE)
        leave_out(p, plan, "caustics: switched off");
    else if (p->set->facts.casters == 0)
        leave_out(p, plan, "caustics: the scene has no mirror and no glass");
    if (!(light->classes & PATH_INDIRECT))
        leave_out(p, plan, "interreflection: not asked for");
    else if (light->indirect == PLAN_NONE)
        leave_out(p, plan, "interreflection: switched off");
}

/* What a part that is left out would have bought. */
static void say_missing(struct pilot *p, struct plan *plan)
{
    static const char *const what[PILOT_PARTS] = {
        [PILOT_EYE] = "light by eye paths",
        [PILOT_AIMED] = "caustics by the light tracer",
        [PILOT_WHOLE] = "interreflection by the light tracer",
    };
    const double error = pilot_error(p);

    for (int part = PILOT_EYE; part < PILOT_PARTS; part++) {
        const double missing = pilot_missing(p, (enum pilot_part)part);
        const uint32_t way = p->choice.route < ROUTES ? pilot_routes[p->choice.route][part - PILOT_EYE] : WAY_NONE;
        if (used(p, (enum pilot_part)part) || way == WAY_NONE || !p->there[way])
            continue;
        if (!p->model[way].known)
            leave_out(p, plan, "%s: not measured yet", what[part]);
        else
            leave_out(p, plan, "%s: %.2g of the relative squared error of %.2g, less than the time for it takes off",
                      part == PILOT_EYE && !(p->route[way].classes & PATH_CAUSTICS) ? "interreflection by eye paths"
                                                                                    : what[part],
                      missing, error);
    }
    if (p->classes & PATH_CAUSTICS && p->set->facts.behind > 0 && p->peakedness > PEAKED_MOST &&
        p->caustics_by != PLAN_EYE)
        leave_out(p, plan, "caustics of the sun seen in mirrors and through glass: no estimator here finds them");
    if (p->classes && p->choice.route >= ROUTES)
        leave_out(p, plan, "caustics and interreflection: not measured yet");
}

/* Samples of lobes where light alone was better, and the other way round. */
static void say_technique(struct pilot *p, enum pilot_part part, struct plan *plan)
{
    const uint32_t first = part == PILOT_MATTE ? WAY_MATTE : WAY_GLOSSY, way = p->choice.way[part];
    const struct model *both = &p->model[first];

    if (way == WAY_NONE)
        return;
    const enum method m = techniques[way - first].desc.method;
    const char *left = m == METHOD_BRDF                         ? "light samples"
                       : m == METHOD_FACES || m == METHOD_LIGHT ? "lobe samples"
                                                                : NULL;
    if (!left || !both->known || !both->timed)
        return;
    const double seconds = model_seconds(&p->model[way], p->choice.n[part]);
    const double n = fmax(1.0, (seconds - model_begin(both)) / both->unit_s);
    const double times = model_error(both, n) / model_error(&p->model[way], p->choice.n[part]);
    char much[40];
    if (times > 100.0)
        snprintf(much, sizeof(much), "a hundred times as large or more");
    else if (times > 1.05)
        snprintf(much, sizeof(much), "%.2g times as large", times);
    else /* what was read since it was chosen is not yet reason enough to change over */
        snprintf(much, sizeof(much), "about as large");
    leave_out(p, plan, "%s on %s surfaces: with them the error there would be %s", left,
              part == PILOT_MATTE ? "matte" : "glossy", much);
}

static void say_plan(struct pilot *p, struct relight_stats *stats)
{
    struct plan *plan = &stats->plan;
    const uint32_t behind = used(p, PILOT_EYE) ? p->route[p->choice.way[PILOT_EYE]].behind : 0;

    *plan = (struct plan){
        .caustics = who(p, PATH_CAUSTICS),
        .indirect = who(p, PATH_INDIRECT_LIT),
        .indirect_caustics = who(p, PATH_INDIRECT_CAUSTIC),
        .behind_caustics = behind & PATH_CAUSTICS,
        .behind_indirect = behind & PATH_INDIRECT,
        .particles = stats->light.particles,
        .eye_paths = used(p, PILOT_EYE) ? (uint32_t)lround(p->choice.n[PILOT_EYE]) : 0,
    };
    say_absent(p, p->wish_light, plan);
    say_missing(p, plan);
    if (stats->direct.strata && !stats->direct.sun)
        leave_out(p, plan, "samples of the sun: this sky has none apart");
    if (pilot_edges_are_jagged(p))
        leave_out(p, plan,
                  "anti-aliasing: %.2g of the relative squared error of %.2g, less than the time for it takes off",
                  pilot_edge_error(p), pilot_error(p));
    say_technique(p, PILOT_MATTE, plan);
    say_technique(p, PILOT_GLOSSY, plan);
}

static bool part_is_there(const struct pilot *p, enum pilot_part part)
{
    for (uint32_t way = 0; way < WAYS; way++)
        if (pilot_part_of(way) == part && p->there[way])
            return true;
    return false;
}

static void say_part(const struct pilot *p, enum pilot_part part, struct pilot_part_stats *out)
{
    const uint32_t way = p->choice.way[part];

    out->there = part_is_there(p, part);
    out->name = "";
    out->error = pilot_missing(p, part);
    if (way == WAY_NONE)
        return;
    out->name = part <= PILOT_GLOSSY ? techniques[way % PILOT_TECHNIQUES].name : pilot_part_name(part);
    out->n = part >= PILOT_AIMED ? p->choice.n[part] * UNIT_PARTICLES : p->choice.n[part];
    out->seconds = p->ran_s[part];
    out->error = model_error_told(&p->model[way], p->choice.n[part]);
}

void pilot_say(struct pilot *p, const struct pilot_wish *wish, struct relight_stats *stats, struct pilot_stats *out)
{
    (void)wish;
    say_plan(p, stats);
    out->readings = UINT32_MAX;
    for (int part = 0; part < PILOT_PARTS; part++) {
        const uint32_t way = p->choice.way[part];
        say_part(p, (enum pilot_part)part, &out->part[part]);
        if (way != WAY_NONE && p->model[way].chosen < out->readings)
            out->readings = p->model[way].chosen;
    }
    const double matte = (double)p->groups.all.points[SURFACE_MATTE];
    const double glossy = (double)p->groups.all.points[SURFACE_GLOSSY];
    if (matte + glossy > 0.0)
        out->samples = (uint32_t)lround((matte * out->part[PILOT_MATTE].n + glossy * out->part[PILOT_GLOSSY].n) /
                                        (matte + glossy));
    out->pilot_seconds = p->pilot_s;
    out->seconds = p->picture_s + p->pilot_s;
    out->error = pilot_error(p);
    out->met = p->budget.met;
    out->more = p->more;
    out->edge_points = p->edge_points;
    out->edge_error = pilot_edge_error(p);
    out->jagged = pilot_edges_are_jagged(p);
    out->frames = p->frames;
}
