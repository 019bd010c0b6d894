#include "light/frame/relight_plan.h"

#include "base/rng.h"
#include "light/frame/beside.h"
#include "light/frame/facts.h"
#include "light/frame/relight_indirect.h"

void relight_plan(const struct prepared_scene *set, const struct indirect_cache *indirect, const struct environment *e,
                  const struct relight_desc *desc, bool grown, struct plan *out)
{
    const bool live = beside_wanted(set, desc);
    struct plan_wish wish = {
        .caustics = desc->classes & PATH_CAUSTICS,
        .indirect = desc->classes & PATH_INDIRECT,
        .caustics_by = desc->caustics,
        .indirect_by = desc->indirect,
        .particles = desc->particles,
        .eye_paths = desc->eye_paths,
        .samples = desc->direct.samples,
        .stored = desc->direct.method == METHOD_CACHED && (grown || !live),
    };
    struct plan_facts facts = set->facts;

    if (wish.caustics && wish.caustics_by == PLAN_AUTO && facts.casters > 0 && e)
        facts.peakedness = facts_peakedness(e);
    if (live && wish.particles == 0) /* those of the images before count too */
        wish.particles = facts.pixels;
    plan_make(&facts, &wish, out);
    if (live && out->caustics == PLAN_LIGHT && wish.caustics_by == PLAN_AUTO) { /* the history is that of the cache's */
        wish.stored = true;
        plan_make(&facts, &wish, out);
    }
    if (indirect && relight_indirect_wanted(set, desc))
        out->indirect = PLAN_CACHE;
}

bool relight_is_cached(const struct relight_desc *desc)
{
    return desc->direct.method == METHOD_CACHED && (desc->classes & PATH_DIRECT || desc->classes == 0);
}

uint32_t relight_plan_classes(const struct plan *p, enum plan_estimator who)
{
    return (p->caustics == who ? PATH_CAUSTICS : 0) | (p->indirect == who ? PATH_INDIRECT_LIT : 0) |
           (p->indirect_caustics == who ? PATH_INDIRECT_CAUSTIC : 0);
}

uint32_t relight_plan_later(const struct relight_desc *desc, const struct plan *p)
{
    if (p->caustics == PLAN_EYE && desc->caustics == PLAN_AUTO)
        return PATH_CAUSTICS | (p->indirect != PLAN_NONE ? PATH_INDIRECT_CAUSTIC : 0);
    return relight_plan_classes(p, PLAN_STORED);
}

/* Live images do not wait for stored paths; they have histories instead (beside.h). */
uint32_t relight_plan_behind(const struct prepared_scene *set, const struct relight_desc *desc, const struct plan *p)
{
    const bool stored = relight_is_cached(desc) && desc->caustics == PLAN_AUTO && p->caustics == PLAN_STORED;

    if (!stored || !p->behind_caustics || desc->cache_background || desc->denoise || beside_wanted(set, desc))
        return 0;
    return desc->classes & (PATH_CAUSTICS | (p->behind_indirect ? PATH_INDIRECT_CAUSTIC : 0));
}

/* Packets whose indirect light the cache leaves to eye paths. */
static const struct packet_list *left_by_cache(const struct indirect_cache *indirect, const struct plan *p)
{
    const struct packet_list *left = p->indirect == PLAN_CACHE && indirect ? indirect_left(indirect) : NULL;

    return left && left->count > 0 ? left : NULL;
}

static void add_eye_paths(const struct prepared_scene *set, const struct indirect_cache *indirect,
                          struct scratch *scratch, const struct relight_desc *desc, const struct plan *p,
                          struct image_passes *out)
{
    const uint32_t lit = p->indirect == PLAN_CACHE ? PATH_INDIRECT_CAUSTIC : PATH_INDIRECT;
    const uint32_t behind = (p->behind_caustics ? PATH_CAUSTICS : 0) | (p->behind_indirect ? lit : 0);
    const struct packet_list *left = left_by_cache(indirect, p);
    struct eye_paths_desc eye = {
        .classes = desc->classes & relight_plan_classes(p, PLAN_EYE),
        .behind_classes = desc->classes & behind,
        .paths = p->eye_paths,
        .seed = rng_mix(desc->direct.seed, 0x657965),
        .pass = desc->direct.pass,
        .cancel = desc->direct.cancel,
        .scratch = scratch,
    };

    out->stored_behind = relight_plan_behind(set, desc, p);
    eye.behind_classes &= ~out->stored_behind;
    if (p->eye_paths == 0 || !(eye_paths_can_find(set->scene, &eye) || left))
        return;
    if (eye.classes | eye.behind_classes)
        out->eye[0] = eye;
    if (!left)
        return;
    eye.classes = eye.behind_classes = PATH_INDIRECT_LIT;
    eye.only = left;
    out->eye[1] = eye;
}

/* Particles aimed at the casters, and particles for the whole scene: each run has the plan's number. */
static void add_light_tracer(const struct relight_desc *desc, const struct plan *p, struct image_passes *out)
{
    const uint32_t all = desc->classes & relight_plan_classes(p, PLAN_LIGHT);
    const uint32_t runs[2] = { all & (PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC), all & PATH_INDIRECT_LIT };

    for (int k = 0; k < 2; k++)
        out->light[k] = (struct light_tracer_desc){
            .classes = runs[k],
            .particles = runs[k] ? p->particles : 0,
            .seed = rng_mix(desc->direct.seed, 0x6c6967),
            .pass = desc->direct.pass,
            .start = desc->start,
            .cancel = desc->direct.cancel,
        };
}

void relight_plan_passes(const struct prepared_scene *set, const struct indirect_cache *indirect,
                         struct scratch *scratch, const struct relight_desc *desc, const struct plan *p,
                         struct image_passes *out)
{
    *out = (struct image_passes){ .background = desc->classes & PATH_BACKGROUND || desc->classes == 0 };
    if (relight_is_cached(desc))
        out->cached = desc;
    else if (desc->classes & PATH_DIRECT || desc->classes == 0)
        out->direct = desc->direct;
    if (relight_plan_classes(p, PLAN_STORED))
        out->stored = desc;
    add_eye_paths(set, indirect, scratch, desc, p, out);
    add_light_tracer(desc, p, out);
}
