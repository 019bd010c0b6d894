#include "light/pilot_parts.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>

static bool used(const struct pilot *p, enum pilot_part part)
{
    return p->choice.way[part] != WAY_NONE;
}

static uint32_t classes_by(const struct pilot *p, enum pilot_part part)
{
    return used(p, part) ? p->find[p->choice.way[part]].classes : 0;
}

static enum plan_estimator estimator_of(const struct pilot *p, uint32_t class)
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

/* What was not asked for, or is not to be found in the scene. */
static void report_absent(struct pilot *p, struct plan *plan)
{
    const struct relight_desc *light = p->light;

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

/* What a part that is left out would bring. */
static void report_missing(struct pilot *p, struct plan *plan)
{
    static const char *const what[PILOT_PARTS] = {
        [PILOT_EYE] = "light by eye paths",
        [PILOT_AIMED] = "caustics by the light tracer",
        [PILOT_WHOLE] = "interreflection by the light tracer",
    };

    for (int part = PILOT_EYE; part < PILOT_PARTS; part++) {
        const uint32_t way = p->choice.route < ROUTES ? pilot_routes[p->choice.route][part - PILOT_EYE] : WAY_NONE;
        if (used(p, (enum pilot_part)part) || way == WAY_NONE || !p->offered[way])
            continue;
        if (!p->model[way].known)
            leave_out(p, plan, "%s: not measured yet", what[part]);
        else
            leave_out(p, plan, "%s: %.2g of the relative squared error of %.2g, less than the time for it takes off",
                      part == PILOT_EYE && !(p->find[way].classes & PATH_CAUSTICS) ? "interreflection by eye paths"
                                                                                   : what[part],
                      pilot_missing(p, (enum pilot_part)part), pilot_error(p));
    }
    if (p->classes & PATH_CAUSTICS && p->set->facts.behind > 0 && p->peakedness > PEAKED_MOST &&
        p->caustics_by != PLAN_EYE)
        leave_out(p, plan, "caustics of the sun seen in mirrors and through glass: no estimator here finds them");
    if (p->classes && p->choice.route >= ROUTES)
        leave_out(p, plan, "caustics and interreflection: not measured yet");
}

static void report_plan(struct pilot *p, struct relight_stats *stats)
{
    struct plan *plan = &stats->plan;
    const uint32_t behind = used(p, PILOT_EYE) ? p->find[p->choice.way[PILOT_EYE]].behind : 0;

    *plan = (struct plan){
        .caustics = estimator_of(p, PATH_CAUSTICS),
        .indirect = estimator_of(p, PATH_INDIRECT_LIT),
        .indirect_caustics = estimator_of(p, PATH_INDIRECT_CAUSTIC),
        .behind_caustics = behind & PATH_CAUSTICS,
        .behind_indirect = behind & PATH_INDIRECT,
        .particles = stats->light.particles,
        .eye_paths = used(p, PILOT_EYE) ? (uint32_t)lround(p->choice.n[PILOT_EYE]) : 0,
    };
    report_absent(p, plan);
    report_missing(p, plan);
    if (stats->direct.strata && !stats->direct.sun)
        leave_out(p, plan, "samples of the sun: this sky has none apart");
}

static void report_part(const struct pilot *p, enum pilot_part part, struct pilot_part_stats *out)
{
    const uint32_t way = p->choice.way[part];

    for (uint32_t k = 0; k < WAYS; k++)
        out->there |= pilot_part_of(k) == part && p->offered[k];
    out->name = "";
    out->error = pilot_missing(p, part);
    if (way == WAY_NONE)
        return;
    out->name = part == PILOT_DIRECT ? techniques[way].name : pilot_part_name(part);
    out->n = part >= PILOT_AIMED ? p->choice.n[part] * UNIT_PARTICLES : p->choice.n[part];
    out->seconds = p->ran_s[part];
    out->error = model_error(&p->model[way], p->choice.n[part]);
}

void pilot_report(struct pilot *p, struct relight_stats *stats, struct pilot_stats *out)
{
    report_plan(p, stats);
    out->readings = UINT32_MAX;
    for (int part = 0; part < PILOT_PARTS; part++) {
        report_part(p, (enum pilot_part)part, &out->part[part]);
        if (used(p, (enum pilot_part)part))
            out->readings = (uint32_t)fmin(out->readings, p->model[p->choice.way[part]].fresh);
    }
    out->samples = (uint32_t)lround(out->part[PILOT_DIRECT].n);
    out->pilot_seconds = p->pilot_s;
    out->seconds = p->picture_s + p->pilot_s;
    out->error = pilot_error(p);
    out->met = p->budget.met;
    out->more = p->more;
    out->frames = p->frames;
}
