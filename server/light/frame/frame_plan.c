#include "light/frame/frame_plan.h"

#include "base/rng.h"
#include "light/frame/beside.h"
#include "light/frame/relight_cache.h"

/* One bounce between surfaces of this albedo changes a pixel by at most this share of its direct light: below 4 % the
 * change is hardly visible. */
#define ALBEDO_LEAST 0.04

/* ---- Which estimator brings which light ---- */

static void leave_out(struct plan *p, const char *why)
{
    if (p->left_out_count < PLAN_LEFT_OUT_MAX)
        p->left_out[p->left_out_count++] = why;
}

static void choose_caustics(const struct plan_facts *f, const struct relight_desc *desc, bool stored, struct plan *p)
{
    if (!(desc->classes & PATH_CAUSTICS)) {
        leave_out(p, "caustics: not requested");
    } else if (desc->caustics == PLAN_NONE) {
        leave_out(p, "caustics: switched off");
    } else if (f->casters == 0) {
        leave_out(p, "caustics: the scene has no mirror and no glass");
    } else {
        const enum plan_estimator by_sky = f->peakedness >= PLAN_PEAKED ? PLAN_LIGHT : PLAN_EYE;
        p->caustics = desc->caustics != PLAN_AUTO ? desc->caustics : stored ? PLAN_STORED : by_sky;
        p->behind_caustics = f->behind > 0;
    }
}

static void choose_indirect(const struct plan_facts *f, const struct relight_desc *desc, struct plan *p)
{
    if (!(desc->classes & PATH_INDIRECT)) {
        leave_out(p, "indirect light: not requested");
    } else if (desc->indirect == PLAN_NONE) {
        leave_out(p, "indirect light: switched off");
    } else if (desc->indirect == PLAN_AUTO && f->albedo < ALBEDO_LEAST) {
        leave_out(p, "indirect light: the surfaces are too dark for it to be seen");
    } else {
        p->indirect = desc->indirect == PLAN_AUTO ? PLAN_EYE : desc->indirect;
        p->behind_indirect = f->behind > 0;
    }
    /* Light that a mirror or glass has gathered comes from the particles aimed at them, if there are any. */
    const bool aimed = p->caustics == PLAN_LIGHT || p->caustics == PLAN_STORED;
    p->indirect_caustics = f->casters > 0 && aimed && p->indirect != PLAN_NONE ? p->caustics : p->indirect;
}

void plan_make(const struct plan_facts *f, const struct relight_desc *desc, bool stored, struct plan *p)
{
    *p = (struct plan){ .caustics = PLAN_NONE, .indirect = PLAN_NONE };
    choose_caustics(f, desc, stored, p);
    choose_indirect(f, desc, p);
    /* Two rays or so for each eye path, three for each particle: for every eight samples one of them costs about as
     * much as direct light does, as measured in docs/internals/mathematics.md. */
    const uint32_t per_point = desc->direct.samples / 8 ? desc->direct.samples / 8 : 1;
    if (p->caustics == PLAN_LIGHT || p->caustics == PLAN_STORED || p->indirect == PLAN_LIGHT)
        p->particles = desc->particles ? desc->particles : f->pixels * per_point;
    if (p->caustics == PLAN_EYE || p->indirect == PLAN_EYE || p->behind_caustics || p->behind_indirect)
        p->eye_paths = desc->eye_paths ? desc->eye_paths : per_point;
}

static void assign(const struct prepared_scene *set, const struct indirect_cache *indirect, const struct environment *e,
                   const struct relight_desc *desc, bool grown, struct plan *out)
{
    const bool live = beside_wanted(set, desc), cached = desc->direct.method == METHOD_CACHED;
    struct plan_facts facts = set->facts;
    struct relight_desc own = *desc;

    if (desc->classes & PATH_CAUSTICS && desc->caustics == PLAN_AUTO && facts.casters > 0 && e)
        facts.peakedness = facts_peakedness(e);
    if (live && own.particles == 0) /* those of the images before count too */
        own.particles = facts.pixels;
    plan_make(&facts, &own, cached && (grown || !live), out);
    if (live && out->caustics == PLAN_LIGHT && desc->caustics == PLAN_AUTO) /* what is accumulated is the store's */
        plan_make(&facts, &own, true, out);
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

uint32_t relight_plan_behind(const struct relight_desc *desc, const struct plan *p)
{
    const bool stored = relight_is_cached(desc) && desc->caustics == PLAN_AUTO && p->caustics == PLAN_STORED;

    if (!stored || !p->behind_caustics)
        return 0;
    return desc->classes & (PATH_CAUSTICS | (p->behind_indirect ? PATH_INDIRECT_CAUSTIC : 0));
}

uint32_t relight_plan_awaited(const struct prepared_scene *set, const struct relight_desc *desc, const struct plan *p)
{
    const bool waits = !desc->cache_background && !desc->denoise && !beside_wanted(set, desc);

    return waits ? relight_plan_behind(desc, p) : 0;
}

/* ---- The passes ---- */

static void add_direct(const struct relight_desc *desc, const struct plan *p, struct frame_plan *out)
{
    const bool wanted = desc->classes & PATH_DIRECT || desc->classes == 0;

    if (relight_is_cached(desc))
        frame_plan_add(out, PASS_CACHED, PATH_DIRECT | relight_plan_classes(p, PLAN_CACHE))->request = desc;
    else if (wanted)
        frame_plan_add(out, PASS_DIRECT, PATH_DIRECT)->direct = desc->direct;
    else
        frame_plan_add(out, PASS_DIRECT, 0);
}

/* Packets whose indirect light the cache leaves to eye paths. */
static const struct packet_list *left_by_cache(const struct indirect_cache *indirect, const struct plan *p)
{
    const struct packet_list *left = p->indirect == PLAN_CACHE && indirect ? indirect_left(indirect) : NULL;

    return left && left->count > 0 ? left : NULL;
}

static void add_eye(const struct eye_paths_desc *eye, struct frame_plan *out)
{
    if (eye->classes | eye->behind_classes)
        frame_plan_add(out, PASS_EYE, eye->classes | eye->behind_classes)->eye = *eye;
}

static void add_eye_paths(const struct prepared_scene *set, const struct indirect_cache *indirect,
                          struct scratch *scratch, const struct relight_desc *desc, const struct plan *p,
                          struct frame_plan *out)
{
    const uint32_t lit = p->indirect == PLAN_CACHE ? PATH_INDIRECT_CAUSTIC : PATH_INDIRECT;
    const uint32_t behind = (p->behind_caustics ? PATH_CAUSTICS : 0) | (p->behind_indirect ? lit : 0);
    const uint32_t stored = relight_plan_awaited(set, desc, p);
    const struct packet_list *left = left_by_cache(indirect, p);
    struct eye_paths_desc eye = {
        .classes = desc->classes & relight_plan_classes(p, PLAN_EYE),
        .behind_classes = desc->classes & behind & ~stored,
        .paths = p->eye_paths,
        .seed = rng_mix(desc->direct.seed, 0x657965),
        .pass = desc->direct.pass,
        .cancel = desc->direct.cancel,
        .scratch = scratch,
    };

    if (stored)
        frame_plan_add(out, PASS_BEHIND, stored);
    if (p->eye_paths == 0 || !(eye_paths_can_find(set->scene, &eye) || left))
        return;
    add_eye(&eye, out);
    eye.classes = eye.behind_classes = PATH_INDIRECT_LIT;
    eye.only = left;
    if (left)
        add_eye(&eye, out);
}

/* Particles aimed at the casters, and particles for the whole scene: each run has the plan's number. */
static void add_light_tracer(const struct relight_desc *desc, const struct plan *p, struct frame_plan *out)
{
    const uint32_t all = desc->classes & relight_plan_classes(p, PLAN_LIGHT);
    const uint32_t runs[2] = { all & (PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC), all & PATH_INDIRECT_LIT };

    for (int k = 0; k < 2; k++)
        if (runs[k] && p->particles > 0)
            frame_plan_add(out, PASS_PARTICLES, runs[k])->light = (struct light_tracer_desc){
                .classes = runs[k],
                .particles = p->particles,
                .seed = rng_mix(desc->direct.seed, 0x6c6967),
                .pass = desc->direct.pass,
                .start = desc->start,
                .cancel = desc->direct.cancel,
            };
}

void frame_plan_make(const struct prepared_scene *set, const struct indirect_cache *indirect, struct scratch *scratch,
                     const struct environment *e, const struct relight_desc *desc, bool grown, struct frame_plan *out)
{
    const struct plan *p = &out->light;

    assign(set, indirect, e, desc, grown, &out->light);
    const uint32_t stored = relight_plan_classes(p, PLAN_STORED);
    out->count = 0;
    out->background = desc->classes & PATH_BACKGROUND || desc->classes == 0;
    out->cancel = desc->direct.cancel;
    add_direct(desc, p, out);
    add_eye_paths(set, indirect, scratch, desc, p, out);
    frame_plan_add(out, PASS_RESOLVE, 0);
    if (stored)
        frame_plan_add(out, PASS_STORED, stored)->request = desc;
    add_light_tracer(desc, p, out);
    frame_plan_add(out, PASS_SPLATS, 0);
}

/* ---- Lists ---- */

struct pass *frame_plan_add(struct frame_plan *p, enum pass_kind kind, uint32_t classes)
{
    uint32_t k = p->count++;

    for (; k > 0 && p->pass[k - 1].kind > kind; k--)
        p->pass[k] = p->pass[k - 1];
    p->pass[k] = (struct pass){ .kind = kind, .half = -1, .classes = classes };
    return &p->pass[k];
}

struct pass *frame_plan_find(struct frame_plan *p, enum pass_kind kind)
{
    for (uint32_t k = 0; k < p->count; k++)
        if (p->pass[k].kind == kind)
            return &p->pass[k];
    return NULL;
}

bool frame_plan_has(const struct frame_plan *p, enum pass_kind kind)
{
    for (uint32_t k = 0; k < p->count; k++)
        if (p->pass[k].kind == kind)
            return true;
    return false;
}

void frame_plan_remove(struct frame_plan *p, struct pass *s)
{
    for (p->count--; s < p->pass + p->count; s++)
        *s = s[1];
}

void frame_plan_drop(struct frame_plan *p, enum pass_kind kind)
{
    for (uint32_t k = p->count; k-- > 0;)
        if (p->pass[k].kind == kind)
            frame_plan_remove(p, &p->pass[k]);
}

/* False: nothing is left of it. */
static bool keep_classes(struct pass *s, uint32_t classes)
{
    switch (s->kind) {
    case PASS_DIRECT:
    case PASS_CACHED:
        if (!(classes & PATH_DIRECT))
            *s = (struct pass){ .kind = PASS_DIRECT, .half = s->half };
        return true;
    case PASS_EYE:
        s->eye.classes &= classes;
        s->eye.behind_classes &= classes;
        s->classes &= classes;
        return s->classes;
    case PASS_PARTICLES: /* the same particles, of which others are seen */
        s->light.shown = s->classes &= classes;
        return s->classes;
    case PASS_STORED:
    case PASS_BEHIND: return classes & PATH_CAUSTICS;
    default: return true;
    }
}

void frame_plan_keep(struct frame_plan *p, uint32_t classes)
{
    for (uint32_t k = p->count; k-- > 0;)
        if (!keep_classes(&p->pass[k], classes))
            frame_plan_remove(p, &p->pass[k]);
    p->background = classes & PATH_BACKGROUND && p->background;
}

bool frame_plan_is_filtered(const struct frame_plan *p)
{
    return frame_plan_has(p, PASS_FILTER) || frame_plan_has(p, PASS_ACCUMULATE);
}

static void halve(struct pass *s, int k)
{
    if (s->kind == PASS_DIRECT) {
        s->direct.pass = 2 * s->direct.pass + (uint64_t)k;
        s->direct.scatter = true;
        s->direct.keep = s->direct.keep || k > 0;
    } else if (s->kind == PASS_EYE) {
        s->eye.pass = 2 * s->eye.pass + (uint64_t)k;
        s->eye.seed = rng_mix(s->eye.seed, (uint64_t)k);
    }
}

void frame_plan_half(const struct frame_plan *p, int k, struct frame_plan *out)
{
    *out = *p;
    frame_plan_drop(out, PASS_FILTER);
    frame_plan_drop(out, PASS_ACCUMULATE);
    for (uint32_t i = 0; i < out->count; i++)
        halve(&out->pass[i], k);
}

void frame_plan_split(struct frame_plan *p)
{
    struct frame_plan half[2];

    for (int k = 0; k < 2; k++)
        frame_plan_half(p, k, &half[k]);
    for (int kind = PASS_DIRECT; kind <= PASS_EYE; kind++) {
        frame_plan_drop(p, (enum pass_kind)kind);
        for (uint32_t i = 0; i < 2 * half[0].count; i++) {
            const int k = i >= half[0].count;
            const struct pass *s = &half[k].pass[i % half[0].count];
            if ((int)s->kind != kind)
                continue;
            struct pass *to = frame_plan_add(p, s->kind, s->classes);
            *to = *s;
            to->half = k;
        }
    }
}

uint64_t frame_plan_work(const struct prepared_scene *set, const struct frame_plan *p)
{
    const uint64_t packets = set->gbuffer->packet_count, runs = frame_plan_is_filtered(p) ? 2 : 1;
    uint64_t steps = 0, particles = 0;

    for (uint32_t k = 0; k < p->count; k++) {
        const struct pass *s = &p->pass[k];
        if (s->kind == PASS_DIRECT)
            steps += packets * s->direct.samples;
        else if (s->kind == PASS_EYE)
            steps += EYE_PATH_STEPS * (uint64_t)s->eye.paths * (s->eye.only ? s->eye.only->count : packets);
        else if (s->kind == PASS_PARTICLES)
            particles += s->light.particles;
    }
    return runs * steps + particles / PARTICLES_A_STEP;
}
