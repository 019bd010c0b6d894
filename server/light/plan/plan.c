#include "light/plan/plan.h"

/* One bounce between surfaces of this albedo changes a pixel by at most this share of its direct light: below 4 % the
 * change is hardly visible. */
#define ALBEDO_LEAST 0.04

static void leave_out(struct plan *p, const char *why)
{
    if (p->left_out_count < PLAN_LEFT_OUT_MAX)
        p->left_out[p->left_out_count++] = why;
}

static void choose_caustics(const struct plan_facts *f, const struct plan_wish *w, struct plan *p)
{
    p->caustics = PLAN_NONE;
    if (!w->caustics) {
        leave_out(p, "caustics: not requested");
    } else if (w->caustics_by == PLAN_NONE) {
        leave_out(p, "caustics: switched off");
    } else if (f->casters == 0) {
        leave_out(p, "caustics: the scene has no mirror and no glass");
    } else {
        const enum plan_estimator by_sky = f->peakedness >= PLAN_PEAKED ? PLAN_LIGHT : PLAN_EYE;
        p->caustics = w->caustics_by != PLAN_AUTO ? w->caustics_by : w->stored ? PLAN_STORED : by_sky;
        p->behind_caustics = f->behind > 0;
    }
}

static void choose_indirect(const struct plan_facts *f, const struct plan_wish *w, struct plan *p)
{
    p->indirect = PLAN_NONE;
    if (!w->indirect) {
        leave_out(p, "indirect light: not requested");
    } else if (w->indirect_by == PLAN_NONE) {
        leave_out(p, "indirect light: switched off");
    } else if (w->indirect_by == PLAN_AUTO && f->albedo < ALBEDO_LEAST) {
        leave_out(p, "indirect light: the surfaces are too dark for it to be seen");
    } else {
        p->indirect = w->indirect_by == PLAN_AUTO ? PLAN_EYE : w->indirect_by;
        p->behind_indirect = f->behind > 0;
    }
    /* Light that a mirror or glass has gathered comes from the particles aimed at them, if there are any. */
    const bool aimed = p->caustics == PLAN_LIGHT || p->caustics == PLAN_STORED;
    p->indirect_caustics = f->casters > 0 && aimed && p->indirect != PLAN_NONE ? p->caustics : p->indirect;
}

void plan_make(const struct plan_facts *f, const struct plan_wish *w, struct plan *p)
{
    *p = (struct plan){ .caustics = PLAN_NONE };
    choose_caustics(f, w, p);
    choose_indirect(f, w, p);
    /* Two rays or so for each eye path, three for each particle: for every eight samples one of them costs about as
     * much as direct light does, as measured in docs/internals/mathematics.md. */
    const uint32_t per_point = w->samples / 8 ? w->samples / 8 : 1;
    if (p->caustics == PLAN_LIGHT || p->caustics == PLAN_STORED || p->indirect == PLAN_LIGHT)
        p->particles = w->particles ? w->particles : f->pixels * per_point;
    if (p->caustics == PLAN_EYE || p->indirect == PLAN_EYE || p->behind_caustics || p->behind_indirect)
        p->eye_paths = w->eye_paths ? w->eye_paths : per_point;
}

const char *plan_estimator_name(enum plan_estimator e)
{
    static const char *const names[] = { "auto", "none", "light tracer", "eye paths", "stored light paths", "cache" };
    return names[e];
}

const struct setting_choice caustics_choices[] = {
    { "auto", PLAN_AUTO, "chosen for scene and environment", 0 },
    { "none", PLAN_NONE, "left out", 0 },
    { "light", PLAN_LIGHT, "light tracer", 0 },
    { "eye", PLAN_EYE, "eye paths", 0 },
    { "stored", PLAN_STORED, "stored light paths, relit in each frame; used by --method cached", 0 },
    { NULL, 0, NULL, 0 },
};

const struct setting_choice indirect_choices[] = {
    { "auto", PLAN_AUTO, "chosen for scene and environment", 0 },
    { "none", PLAN_NONE, "left out", 0 },
    { "light", PLAN_LIGHT, "light tracer", 0 },
    { "eye", PLAN_EYE, "eye paths", 0 },
    { NULL, 0, NULL, 0 },
};
