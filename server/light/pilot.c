#include "light/pilot_parts.h"

#include "base/cancel.h"
#include "base/mem.h"
#include "base/rng.h"
#include "resolve/resolve.h"

#include <math.h>

#define SMOOTH 0.3
#define LIGHT_SOON 4      /* readings of particles in use; after that */
#define LIGHT_EVERY 4     /* frames */
#define OTHER_LEAST 0.002 /* seconds */
#define NOISY 0.05        /* relMSE above which single pixels are no yardstick */
#define FIRST_LEAST 0.3   /* seconds that the first frame may take longer, if time is limited */
#define FIRST_SHARE 0.2   /* of the first frame's extra time, for a whole picture's direct light, */
#define FIRST_SAMPLES 4.0 /* with so many samples a point, */
#define FIRST_SAMPLES_MOST 64.0
#define PASS_OWN (UINT64_C(1) << 40) /* no picture has so high a pass */

const struct technique techniques[TECHNIQUES] = {
    { "light and lobes, the sun apart", { .method = METHOD_AUTO } }, /* the rule of auto */
    { "lobes alone", { .method = METHOD_BRDF } },
    { "light by cells and lobes", { .method = METHOD_MIS, .cells = 4, .sun = true, .compensate = COMPENSATE_ON } },
};

enum pilot_part pilot_part_of(uint32_t way)
{
    return way < WAY_EYE_ALL  ? PILOT_DIRECT
           : way < WAY_AIMED  ? PILOT_EYE
           : way == WAY_AIMED ? PILOT_AIMED
                              : PILOT_WHOLE;
}

double pilot_seconds(const struct pilot *p, const struct pilot_work *work, double by_clock)
{
    return p->desc.price ? p->desc.price(work) : by_clock;
}

uint64_t pilot_pass(struct pilot *p)
{
    return PASS_OWN + p->pass++;
}

static bool allocate(struct pilot *p)
{
    const struct gbuffer *g = p->set->gbuffer;
    const size_t pixels = (size_t)g->width * g->height;
    bool all = groups_init(&p->groups, g);

    for (int k = 0; k < 2; k++) {
        all = all && allot_init(&p->allot[k], g, &p->groups.all.list);
        all = (p->pair[k] = mem_alloc(g->packet_count, 3 * PACKET * sizeof(float))) && all;
        all = (p->spread[k] = mem_alloc(pixels, 3 * sizeof(float))) && all;
    }
    all = (p->mask = mem_alloc(pixels, 1)) && all;
    all = (p->point_error = mem_alloc(g->packet_count, sizeof(*p->point_error))) && all;
    return (p->passes = relighter_passes(p->relighter)) && all;
}

struct pilot *pilot_create(struct relighter *r, const struct pilot_desc *desc)
{
    struct pilot *p = mem_alloc(1, sizeof(*p));

    if (!p)
        return NULL;
    p->relighter = r;
    p->set = relighter_set(r);
    if (desc)
        p->desc = *desc;
    if (!allocate(p)) {
        pilot_destroy(p);
        return NULL;
    }
    resolve_mask(p->set->gbuffer, p->mask);
    return p;
}

void pilot_destroy(struct pilot *p)
{
    if (!p)
        return;
    for (int k = 0; k < 2; k++) {
        allot_finish(&p->allot[k]);
        mem_free(p->pair[k]);
        mem_free(p->spread[k]);
    }
    groups_finish(&p->groups);
    mem_free(p->mask);
    mem_free(p->point_error);
    mem_free(p);
}

/* Half of the samples are light samples, half BRDF samples: an odd count costs as much as the next even one. */
struct allot_count pilot_count(const struct pilot *p, uint32_t way, double n)
{
    const float lobes = way < WAY_EYE_ALL ? method_recipe(techniques[way].desc.method)->brdf_part : 0.0f;
    const uint32_t step = lobes == 0.5f ? 2 : 1;

    return (struct allot_count){ fmax(way >= WAY_EYE_ALL && p->eye_paths ? p->eye_paths : n, step), step,
                                 lobes == 1.0f };
}

struct direct_desc pilot_direct(struct pilot *p, uint32_t way, double n, uint64_t pass, const struct packet_list *only)
{
    const struct direct_desc *asked = &p->light->direct;
    const struct allot_count count = pilot_count(p, way, n);
    struct direct_desc desc = techniques[way].desc;

    desc.samples = allot_counts(&p->allot[PILOT_DIRECT], &count, only);
    desc.counts = p->allot[PILOT_DIRECT].counts;
    desc.seed = asked->seed;
    desc.pass = pass;
    desc.no_visibility = asked->no_visibility;
    desc.interleave = asked->interleave;
    desc.only = only;
    desc.cancel = asked->cancel;
    desc.why = asked->why;
    return desc;
}

struct eye_paths_desc pilot_eye(struct pilot *p, uint32_t way, double n, uint64_t pass, const struct packet_list *only)
{
    const struct direct_desc *asked = &p->light->direct;
    const struct allot_count count = pilot_count(p, way, n);

    return (struct eye_paths_desc){
        .classes = p->find[way].classes,
        .behind_classes = p->find[way].behind,
        .paths = p->eye_paths ? p->eye_paths : allot_counts(&p->allot[PILOT_EYE], &count, only),
        .counts = p->eye_paths ? NULL : p->allot[PILOT_EYE].counts,
        .only = only,
        .seed = rng_mix(rng_mix(asked->seed, 0x657965), pass),
        .cancel = asked->cancel,
        .scratch = p->passes->scratch,
    };
}

struct light_tracer_desc pilot_light(struct pilot *p, uint32_t way, double n, uint64_t pass)
{
    return (struct light_tracer_desc){
        .classes = p->find[way].classes,
        .particles = 2 * (uint64_t)(0.5 * n * UNIT_PARTICLES),
        .seed = rng_mix(p->light->direct.seed, 0x6c6967),
        .pass = pass,
        .start = p->light->start,
        .cancel = p->light->direct.cancel,
    };
}

struct picture_passes pilot_passes(struct pilot *p, uint64_t pass)
{
    const struct choice *c = &p->choice;
    const struct packet_list *all = &p->groups.all.list;
    struct picture_passes out = {
        .halves = true,
        .background = p->light->classes & PATH_BACKGROUND || p->light->classes == 0,
    };

    if (c->way[PILOT_DIRECT] != WAY_NONE && all->count > 0)
        out.direct = pilot_direct(p, c->way[PILOT_DIRECT], c->n[PILOT_DIRECT], pass, all);
    if (c->way[PILOT_EYE] != WAY_NONE && all->count > 0)
        out.eye[0] = pilot_eye(p, c->way[PILOT_EYE], c->n[PILOT_EYE], pass, all);
    for (int k = 0; k < 2; k++)
        if (c->way[PILOT_AIMED + k] != WAY_NONE)
            out.light[k] = pilot_light(p, c->way[PILOT_AIMED + k], c->n[PILOT_AIMED + k], pass);
    return out;
}

/* Learns the times of a whole picture's parts. A black sky takes no time and is not measured. */
static void learn_times(struct pilot *p, const struct relight_stats *stats, const struct pass_costs *costs)
{
    const struct gbuffer *g = p->set->gbuffer;
    const uint64_t rays[PILOT_PARTS] = { stats->direct.rays, stats->eye.rays, costs->light_rays[0],
                                         costs->light_rays[1] };
    const double by_clock[PILOT_PARTS] = { costs->direct_s, costs->eye_s, costs->light_s[0], costs->light_s[1] };
    const struct pilot_work pixels = { PILOT_PARTS, g->point_count, 0, 0.0 };

    p->picture_s = pilot_seconds(p, &pixels, costs->pixels_s);
    p->other_s += SMOOTH * (fmin(p->picture_s, 2.0 * p->other_s + OTHER_LEAST) - p->other_s);
    for (int part = 0; part < PILOT_PARTS; part++) {
        const uint32_t way = p->choice.way[part];
        const double n = p->choice.n[part];
        const struct pilot_work work = { (enum pilot_part)part, part < PILOT_AIMED ? g->point_count : 0, rays[part],
                                         n };
        p->ran_s[part] = way != WAY_NONE ? pilot_seconds(p, &work, by_clock[part]) : 0.0;
        p->picture_s += p->ran_s[part];
        if (p->ran_s[part] > 0.0 && p->environment->total_energy > 0.0)
            model_ran(&p->model[way], n, p->ran_s[part]);
    }
}

/* Renders the picture of the choice and learns from it, unless it was cancelled. */
static enum err make_picture(struct pilot *p, uint64_t pass, float *rgb, struct relight_stats *stats)
{
    const struct gbuffer *g = p->set->gbuffer;
    const struct picture_passes passes = pilot_passes(p, pass);
    struct pass_costs costs;

    *stats = (struct relight_stats){ 0 };
    const enum err e = relighter_run_passes(p->relighter, p->environment, &passes, rgb, stats, &costs);
    if (e || is_cancelled(p->light->direct.cancel))
        return e;
    learn_times(p, stats, &costs);
    const bool lacked = p->yardstick.lacks_part;
    yardstick_init(&p->yardstick, rgb, p->mask, g->width, g->height);
    p->yardstick.lacks_part = p->choice.way[PILOT_EYE] == WAY_NONE;
    for (uint32_t way = 0; way < WAYS; way++) /* relative to another image, the readings so far count as one */
        if (lacked != p->yardstick.lacks_part && p->model[way].count > 1)
            p->model[way].count = 1;
    p->yardstick.noisy = !p->begun || pilot_error(p) > NOISY;
    for (int part = PILOT_AIMED; part < PILOT_PARTS; part++) {
        const uint32_t way = p->choice.way[part];
        if (way != WAY_NONE && p->environment->total_energy > 0.0 &&
            (p->model[way].fresh < LIGHT_SOON || p->runs % LIGHT_EVERY == 0))
            pilot_read_light(p, way, p->choice.n[part], p->passes->half[part - PILOT_AIMED]);
    }
    return ERR_OK;
}

/* Before the first picture: a quick one as a yardstick, and direct light twice over the whole picture, to find where it
 * is difficult. */
static enum err begin(struct pilot *p, const struct pilot_target *target, float *rgb, struct relight_stats *stats)
{
    pilot_choose(p, target);
    p->choice.n[PILOT_DIRECT] = FIRST_SAMPLES;
    enum err e = make_picture(p, pilot_pass(p), rgb, stats);
    if (e || is_cancelled(p->light->direct.cancel))
        return e;
    const double seconds = p->picture_s;
    p->bank_s = target->seconds > 0.0 ? fmax(FIRST_LEAST, 0.5 * target->seconds) : INFINITY;
    if (p->choice.way[PILOT_DIRECT] != WAY_NONE && p->groups.all.list.count > 0)
        e = pilot_probe_first(
            p, fmin(FIRST_SAMPLES_MOST, fmax(FIRST_SAMPLES, FIRST_SAMPLES * floor(FIRST_SHARE * p->bank_s / seconds))));
    if (!e && !is_cancelled(p->light->direct.cancel))
        e = pilot_probe(p, target);
    p->begun = !e && !is_cancelled(p->light->direct.cancel);
    p->bank_s = 0.0;
    p->pilot_s += seconds;
    return e;
}

enum err pilot_run(struct pilot *p, const struct environment *e, const struct relight_desc *light,
                   const struct pilot_target *target, float *rgb, struct relight_stats *stats,
                   struct pilot_stats *measured)
{
    enum err result = ERR_OK;

    *measured = (struct pilot_stats){ 0 };
    p->environment = e;
    p->light = light;
    p->pilot_s = 0.0;
    pilot_take_request(p, light);
    pilot_look_at_sky(p);
    if (!p->begun && e->total_energy > 0.0)
        result = begin(p, target, rgb, stats);
    if (result || is_cancelled(p->light->direct.cancel))
        return result;
    pilot_choose(p, target);
    for (int part = 0; part < PILOT_PARTS; part++)
        if (p->choice.way[part] != WAY_NONE)
            measured->part[part].expected_seconds = model_seconds(&p->model[p->choice.way[part]], p->choice.n[part]);
    result = make_picture(p, light->direct.pass, rgb, stats);
    if (result || is_cancelled(p->light->direct.cancel))
        return result;
    if (p->runs > 0 && e->total_energy > 0.0)
        result = pilot_probe(p, target);
    p->frames++;
    p->runs++;
    p->frame_s += (p->frame_s > 0.0 ? SMOOTH : 1.0) * (p->picture_s - p->frame_s);
    pilot_report(p, target, rgb, stats, measured);
    return result;
}
