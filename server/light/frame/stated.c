#include "light/frame/relighter.h"

#include "base/cancel.h"
#include "base/clock.h"
#include "base/mem.h"
#include "base/rng.h"
#include "light/audit/audit.h"
#include "light/denoise/denoise.h"
#include "light/frame/frame_plan.h"
#include "light/resolve/resolve.h"

#define UNEVEN 64.0         /* of audit_desc. A quarter of a cached image's error may lie in one pixel: */
#define UNEVEN_CACHED 300.0 /* so much is allowed for, and no estimate stated; */
#define HIDDEN_CACHED 1.0   /* often only half of it is found */

struct stated {
    struct audit *audit;
    struct audit_numbers *numbers;
    uint8_t *mask;  /* [pixels] */
    float *half[2]; /* [height][width][3]; NULL until an image has halves */
    struct purse purse;
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

/* What is traced again, and how: paths from the image's points or, on a ground or where other processes have those,
 * through its pixels, which bounds the error: in addition to the image's it has that of few points in a pixel. False:
 * it cannot be audited. bare: working memory. */
static bool find_truth(const struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                       bool measured, const struct plan *plan, struct audit_world *w, double bare[3])
{
    const uint32_t asked = desc->classes ? desc->classes : PATH_BACKGROUND | PATH_DIRECT;
    const bool caustics = r->set->facts.casters > 0 && asked & (PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC);
    const bool reference = method_is_reference(desc->direct.method), ground = r->set->scene->ground.radius > 0.0f;

    w->whole = reference || ground || r->team;
    w->background = asked & PATH_BACKGROUND;
    w->classes = asked;
    w->bare_ground = ground ? bare : NULL;
    if (desc->direct.method == METHOD_COMPONENTS || desc->direct.no_visibility || (ground && backplate_bare(e, bare)))
        return false;
    if (caustics && ((!reference && by_particles(plan)) || facts_peakedness(e) >= PLAN_PEAKED))
        return false;
    if (!reference && (desc->caustics == PLAN_NONE || (!measured && plan->caustics == PLAN_NONE)))
        w->classes &= ~(uint32_t)PATH_CAUSTICS;
    if (!reference && (desc->indirect == PLAN_NONE || (!measured && plan->indirect == PLAN_NONE)))
        w->classes &= ~(uint32_t)PATH_INDIRECT;
    w->behind = w->classes;
    return true;
}

/* A number of the way in which an image was made. */
static uint64_t way_of(const struct relight_desc *desc, const struct plan *p, bool settled)
{
    const uint64_t parts[] = { desc->direct.method, desc->direct.samples, desc->classes, desc->denoise, settled,
                               p->caustics,         p->indirect,          p->eye_paths,  p->particles };
    uint64_t out = 1;

    for (size_t k = 0; k < sizeof(parts) / sizeof(parts[0]); out = rng_mix(out, parts[k++]))
        ;
    return out;
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

/* half: NULL without a filter. */
static void audit_it(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                     const float *const half[2], bool measured, const float *rgb, struct relight_stats *stats)
{
    const bool cached = relight_is_cached(desc) && !stats->cache_refused, live = desc->audit_live;
    const bool settled = cached && relight_cache_is_settled(&r->cache);
    const double rays = (double)(stats->direct.rays + stats->eye.rays + stats->light.rays + stats->reference_rays);
    struct stated *s = r->stated;
    struct audit_world world = {
        .scene = r->set->scene,
        .rays = r->set->rays,
        .gbuffer = r->set->gbuffer,
        .view = &r->set->view,
        .environment = e,
        .numbers = s->numbers,
    };
    struct audit_result found;
    double bare[3];

    if (!find_truth(r, e, desc, measured, &stats->plan, &world, bare))
        return;
    struct audit_desc audit = {
        .trace = audit_trace,
        .self = &world,
        .mask = method_is_reference(desc->direct.method) ? NULL : s->mask,
        .key = rng_mix(environment_digest(e), (uint64_t)world.classes << 1 | world.whole),
        .like_last = live ? purse_like_last(&s->purse, e, way_of(desc, &stats->plan, settled)) : 0.0,
        .bounds = cached || (world.whole && !method_is_reference(desc->direct.method)),
        .uneven = cached ? UNEVEN_CACHED : UNEVEN,
        .hidden = cached ? HIDDEN_CACHED : 0.0,
        .seed = rng_mix(desc->direct.seed, 0x617564),
        .rays = purse_pay(&s->purse, live, settled, desc->audit * rays),
        .cancel = desc->direct.cancel,
    };
    if (desc->audit_most > 0.0)
        audit.rays = purse_limit(&s->purse, cached && !settled ? 0.5 * desc->audit_most : desc->audit_most,
                                 clock_processor(), audit.rays);
    if (!live)
        audit_forget(s->audit);
    if (audit.rays > 0) {
        environment_complete(e);
        resolve_halves(s, r->set->gbuffer, world.background ? e : NULL, half, audit.half);
    }
    audit_image(s->audit, &audit, rgb, &found);
    stats->error = found.states;
    stats->error_at_most = found.at_most;
    stats->audited.pixels = found.pixels;
    stats->audited.rays = found.rays;
    stats->audited.found = found.error;
}

void relighter_state_error(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                           bool measured, const float *rgb, struct relight_stats *stats)
{
    const bool filtered = desc->denoise && r->denoiser && !measured && !method_is_reference(desc->direct.method);
    const double start = clock_seconds(), used = clock_processor();
    const float *half[2] = { NULL, NULL };

    stats->error = stats->error_at_most = 0.0;
    if (!(desc->audit > 0.0) || is_cancelled(desc->direct.cancel) || !(e->total_energy > 0.0))
        return;
    for (int k = 0; k < 2 && filtered; k++)
        half[k] = r->accumulation ? accumulation_half(r->accumulation, k) : denoiser_half(r->denoiser, k);
    if (!r->stated)
        r->stated = create(r->set->gbuffer);
    if (!r->stated)
        return;
    audit_it(r, e, desc, filtered ? half : NULL, measured, rgb, stats);
    stats->audited.ms = 1e3 * (clock_seconds() - start);
    stats->audited.processor_s = clock_processor() - used;
    purse_spend(&r->stated->purse, desc->audit_live, stats->audited.rays, stats->audited.processor_s);
}
