#include "light/frame/pilot.h"

#include <math.h>

const char *pilot_part_name(enum pilot_part part)
{
    static const char *const names[] = { "direct", "eye paths", "light tracer at mirrors and glass", "light tracer" };
    return names[part];
}

static void report_part(const struct pilot *p, enum pilot_part part, struct pilot_part_stats *out)
{
    out->there = p->offered[part];
    out->name = !out->there ? "" : part == PILOT_DIRECT ? "light and lobes, the sun apart" : pilot_part_name(part);
    if (!out->there)
        return;
    out->n = part >= PILOT_AIMED ? p->n[part] * UNIT_PARTICLES : p->n[part];
    out->seconds = p->ran_s[part];
    out->error = model_error(&p->model[part], p->n[part]);
}

void pilot_report(struct pilot *p, const struct budget_target *target, const float *rgb, struct relight_stats *stats,
                  struct pilot_stats *out)
{
    out->readings = UINT32_MAX;
    for (int part = 0; part < PILOT_PARTS; part++) {
        report_part(p, (enum pilot_part)part, &out->part[part]);
        if (p->offered[part])
            out->readings = (uint32_t)fmin(out->readings, p->model[part].fresh);
    }
    stats->plan = p->plan;
    stats->plan.particles = stats->light.particles;
    stats->plan.eye_paths = p->offered[PILOT_EYE] ? (uint32_t)lround(p->n[PILOT_EYE]) : 0;
    if (p->denoised)
        stats->bias = "light averaged over neighbouring points: the time pays for few samples";
    out->samples = (uint32_t)lround(out->part[PILOT_DIRECT].n);
    out->pilot_seconds = p->pilot_s;
    out->seconds = p->image_s + p->pilot_s;
    out->error = pilot_error(p);
    out->denoised = p->denoised;
    out->frames = p->frames;
    relighter_state_error(p->relighter, p->environment, p->light, true, rgb, stats);
    /* The choice promised the error before the image was measured and audited. */
    out->in_time = p->budget.met || !(target->seconds > 0.0);
    out->met = out->in_time;
    if (target->error > 0.0)
        out->met &= fmax(out->error, stats->error) <= target->error;
}
