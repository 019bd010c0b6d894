#include "light/pilot_parts.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>

const char *pilot_part_name(enum pilot_part part)
{
    static const char *const names[] = { "direct", "eye paths", "light tracer at mirrors and glass", "light tracer" };
    return names[part];
}

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

/* What each part that is left out would bring. */
static void report_missing(struct pilot *p, struct plan *plan)
{
    static const char *const what[PILOT_PARTS] = {
        [PILOT_EYE] = "light by eye paths",
        [PILOT_AIMED] = "caustics by the light tracer",
        [PILOT_WHOLE] = "interreflection by the light tracer",
    };

    for (int part = PILOT_EYE; part < PILOT_PARTS; part++) {
        const uint32_t way = pilot_routes[p->choice.route][part - PILOT_EYE];
        if (used(p, (enum pilot_part)part) || way == WAY_NONE || !p->offered[way])
            continue;
        if (!p->model[way].known)
            leave_out(p, plan, "%s: not measured yet", what[part]);
        else
            leave_out(p, plan, "%s: %.2g of the relative squared error of %.2g, less than its time gains elsewhere",
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

/* Reasons that come before any measurement are those of the plan. */
static void report_plan(struct pilot *p, struct relight_stats *stats)
{
    const struct plan_wish wish = {
        .caustics = p->light->classes & PATH_CAUSTICS,
        .indirect = p->light->classes & PATH_INDIRECT,
        .caustics_by = p->light->caustics,
        .indirect_by = p->light->indirect == PLAN_AUTO ? PLAN_EYE : p->light->indirect,
    };
    const uint32_t behind = used(p, PILOT_EYE) ? p->find[p->choice.way[PILOT_EYE]].behind : 0;
    struct plan *plan = &stats->plan;

    plan_make(&p->set->facts, &wish, plan);
    plan->caustics = estimator_of(p, PATH_CAUSTICS);
    plan->indirect = estimator_of(p, PATH_INDIRECT_LIT);
    plan->indirect_caustics = estimator_of(p, PATH_INDIRECT_CAUSTIC);
    plan->behind_caustics = behind & PATH_CAUSTICS;
    plan->behind_indirect = behind & PATH_INDIRECT;
    plan->particles = stats->light.particles;
    plan->eye_paths = used(p, PILOT_EYE) ? (uint32_t)lround(p->choice.n[PILOT_EYE]) : 0;
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

void pilot_report(struct pilot *p, const struct pilot_target *target, const float *rgb, struct relight_stats *stats,
                  struct pilot_stats *out)
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
    out->more = p->more;
    out->frames = p->frames;
    relighter_state_error(p->relighter, p->environment, p->light, true, rgb, stats);
    /* The choice promised the error before the picture was measured and audited. */
    out->met = p->budget.met || !(target->seconds > 0.0);
    if (target->error > 0.0)
        out->met &= fmax(out->error, stats->error) <= target->error;
}
