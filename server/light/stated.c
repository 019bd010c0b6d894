#include "light/stated.h"

#include "base/cancel.h"
#include "base/clock.h"
#include "base/mem.h"
#include "base/rng.h"
#include "audit/trace.h"
#include "light/facts.h"
#include "history/denoise.h"
#include "history/history.h"
#include "light/relighter.h"
#include "resolve/resolve.h"

#define LEAST_RAYS 20000 /* that an audit is worth; live pictures that cost little pay for one together */

struct stated {
    struct audit *audit;
    struct audit_numbers *numbers;
    uint8_t *mask;  /* [pixels] */
    float *half[2]; /* [height][width][3]; NULL until a picture has halves */
    double rays;    /* left of what live pictures have paid */
};

void stated_destroy(struct stated *s)
{
    if (!s)
        return;
    audit_destroy(s->audit);
    mem_free(s->numbers);
    mem_free(s->mask);
    mem_free(s->half[0]);
    mem_free(s->half[1]);
    mem_free(s);
}

static struct stated *create(const struct gbuffer *g)
{
    struct stated *s = mem_alloc(1, sizeof(*s));

    if (!s)
        return NULL;
    s->audit = audit_create(g->width, g->height);
    s->numbers = mem_alloc(1, sizeof(*s->numbers));
    s->mask = mem_alloc((size_t)g->width * g->height, 1);
    if (!s->audit || !s->numbers || !s->mask) {
        stated_destroy(s);
        return NULL;
    }
    audit_numbers_fill(s->numbers);
    resolve_mask(g, s->mask);
    return s;
}

static bool by_particles(const struct plan *p)
{
    return p->caustics == PLAN_LIGHT || p->caustics == PLAN_STORED || p->indirect_caustics == PLAN_LIGHT ||
           p->indirect_caustics == PLAN_STORED;
}

/* The classes of the truth. False: it cannot be audited. */
static bool find_classes(const struct set *set, const struct environment *e, const struct relight_desc *desc,
                         bool measured, const struct plan *plan, struct audit_world *w)
{
    const uint32_t asked = desc->classes ? desc->classes : PATH_BACKGROUND | PATH_DIRECT;
    const bool caustics = set->facts.casters > 0 && asked & (PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC);

    w->whole = method_is_reference(desc->direct.method);
    w->background = asked & PATH_BACKGROUND;
    w->classes = asked;
    if (set->scene->ground.radius > 0.0f || desc->direct.method == METHOD_COMPONENTS || desc->direct.no_visibility)
        return false;
    if (caustics && ((!w->whole && by_particles(plan)) || facts_peakedness(e) >= PLAN_PEAKED))
        return false;
    if (!w->whole && (desc->caustics == PLAN_NONE || (!measured && plan->caustics == PLAN_NONE)))
        w->classes &= ~(uint32_t)PATH_CAUSTICS;
    if (!w->whole && (desc->indirect == PLAN_NONE || (!measured && plan->indirect == PLAN_NONE)))
        w->classes &= ~(uint32_t)PATH_INDIRECT;
    w->behind = w->classes;
    return true;
}

/* Rays for this picture. */
static uint64_t pay(struct stated *s, const struct relight_desc *desc, const struct relight_stats *stats)
{
    const double own = (double)(stats->direct.rays + stats->eye.rays + stats->light.rays + stats->reference_rays);

    s->rays = (desc->audit_live ? s->rays : LEAST_RAYS) + desc->audit * own;
    return s->rays >= LEAST_RAYS ? (uint64_t)s->rays : 0;
}

/* NULLs when there are none, or no memory: they only guide the choice of pixels. */
static void resolve_halves(struct stated *s, const struct gbuffer *g, const struct environment *e,
                           const float *const half[2], const float *out[2])
{
    const size_t pixels = (size_t)g->width * g->height;

    out[0] = out[1] = NULL;
    for (int k = 0; k < 2 && half; k++)
        if (!s->half[k])
            s->half[k] = mem_alloc(pixels, 3 * sizeof(float));
    if (!half || !s->half[0] || !s->half[1])
        return;
    for (int k = 0; k < 2; k++) {
        resolve_pixels(g, half[k], e, s->half[k]);
        out[k] = s->half[k];
    }
}

static void audit_it(struct stated **stated, const struct set *set, const struct environment *e,
                     const struct relight_desc *desc, const float *const half[2], bool measured, const float *rgb,
                     struct relight_stats *stats)
{
    struct audit_world world = {
        .scene = set->scene, .rays = set->rays, .gbuffer = set->gbuffer, .view = &set->view, .environment = e
    };
    struct audit_result found;
    const double start = clock_seconds();

    stats->error = stats->error_at_most = 0.0;
    if (!(desc->audit > 0.0) || is_cancelled(desc->direct.cancel) || !(e->total_energy > 0.0) ||
        !find_classes(set, e, desc, measured, &stats->plan, &world))
        return;
    if (!*stated)
        *stated = create(set->gbuffer);
    struct stated *s = *stated;
    if (!s)
        return;
    environment_complete(e);
    world.numbers = s->numbers;
    struct audit_desc audit = {
        .trace = audit_trace,
        .self = &world,
        .mask = world.whole ? NULL : s->mask,
        .key = rng_mix(facts_sky_digest(e), (uint64_t)world.classes << 1 | world.whole),
        .seed = rng_mix(desc->direct.seed, 0x617564),
        .rays = pay(s, desc, stats),
        .cancel = desc->direct.cancel,
    };
    if (!desc->audit_live)
        audit_forget(s->audit);
    if (audit.rays > 0)
        resolve_halves(s, set->gbuffer, world.background ? e : NULL, half, audit.half);
    audit_picture(s->audit, &audit, rgb, &found);
    s->rays -= (double)found.rays;
    stats->error = found.states;
    stats->error_at_most = found.at_most;
    stats->audited.pixels = found.pixels;
    stats->audited.rays = found.rays;
    stats->audited.ms = 1e3 * (clock_seconds() - start);
}

void relighter_state_error(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                           bool measured, const float *rgb, struct relight_stats *stats)
{
    const bool filtered = desc->denoise && r->denoiser && !measured && !method_is_reference(desc->direct.method);
    const float *half[2] = { NULL, NULL };

    for (int k = 0; k < 2 && filtered; k++)
        half[k] = r->history ? history_half(r->history, k) : denoiser_half(r->denoiser, k);
    if (!r->team) /* else other processes have part of the points */
        audit_it(&r->stated, r->set, e, desc, filtered ? half : NULL, measured, rgb, stats);
}
