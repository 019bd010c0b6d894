#include "light/frame/layers.h"

#include "base/mem.h"
#include "base/rng.h"
#include "light/denoise/denoise.h"
#include "light/estimators/method.h"
#include "light/frame/relight_passes.h"
#include "sky/tables/sky_table.h"

#include <math.h>
#include <string.h>

#define SEED_AGAIN 0x6c61796572u /* of the second image, for the error */
#define REACH 2                  /* pixels around one, over which the squared error is averaged */

static const uint32_t classes_of[LAYER_BACKGROUND] = { PATH_DIRECT, PATH_INDIRECT, PATH_CAUSTICS };

static size_t pixels_of(const struct prepared_scene *set)
{
    return (size_t)set->gbuffer->width * set->gbuffer->height;
}

bool layers_init(struct layers *l, const struct prepared_scene *set)
{
    bool all = true;

    *l = (struct layers){ .sun = NULL };
    for (int k = 0; k < LAYER_COUNT; k++) {
        l->light[k] = mem_alloc(pixels_of(set), 3 * sizeof(float));
        all = all && l->light[k];
    }
    l->unfiltered = mem_alloc(pixels_of(set), 3 * sizeof(float));
    l->scratch = mem_alloc(pixels_of(set), 3 * sizeof(float));
    return all && l->unfiltered && l->scratch;
}

void layers_finish(struct layers *l)
{
    for (int k = 0; k < LAYER_COUNT; k++)
        mem_free(l->light[k]);
    mem_free(l->unfiltered);
    mem_free(l->sun);
    mem_free(l->scratch);
    *l = (struct layers){ .sun = NULL };
}

/* to += scale * from */
static void add(const struct prepared_scene *set, float *to, float scale, const float *from)
{
    const size_t values = 3 * pixels_of(set);

#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < values; i++)
        to[i] += scale * from[i];
}

/* relighter_run_passes, whose times are added up. */
static enum err run(struct relighter *r, const struct environment *e, const struct image_passes *p, float *rgb,
                    struct relight_stats *stats)
{
    const double before[] = { stats->shade_ms, stats->eye_ms, stats->light_ms, stats->filter_ms, stats->resolve_ms };
    struct pass_costs costs;
    const enum err e2 = relighter_run_passes(r, e, p, rgb, stats, &costs);

    stats->shade_ms += before[0];
    stats->eye_ms += before[1];
    stats->light_ms += before[2];
    stats->filter_ms += before[3];
    stats->resolve_ms += before[4];
    return e2;
}

/* Leaves these classes alone in the passes. */
static void keep_classes(struct image_passes *p, uint32_t classes)
{
    if (!(classes & PATH_DIRECT)) {
        p->cached = NULL;
        p->direct.samples = 0;
    }
    for (int k = 0; k < 2; k++) {
        p->eye[k].classes &= classes;
        p->eye[k].behind_classes &= classes;
        if (!(p->eye[k].classes | p->eye[k].behind_classes))
            p->eye[k].paths = 0;
        p->light[k].shown = p->light[k].classes & classes;
        if (!p->light[k].shown)
            p->light[k].particles = 0;
    }
    if (!(classes & PATH_CAUSTICS)) {
        p->stored = NULL;
        p->stored_behind = 0;
    }
    p->background = classes & PATH_BACKGROUND && p->background;
    p->denoiser = NULL;
}

static void drop_particles(struct image_passes *p)
{
    p->light[0].particles = p->light[1].particles = 0;
    p->stored = NULL;
}

/* The passes' light before the denoiser: the mean of its two input halves, plus particles. */
static enum err run_unfiltered(struct relighter *r, const struct environment *e, const struct image_passes *p,
                               bool halves, float *scratch, float *rgb, struct relight_stats *stats)
{
    struct image_passes half = *p, rest = *p;
    enum err result;

    if (!halves)
        return run(r, e, p, rgb, stats);
    keep_classes(&rest, PATH_ALL & ~(uint32_t)PATH_DIRECT);
    rest.eye[0].paths = rest.eye[1].paths = 0;
    result = run(r, e, &rest, rgb, stats);
    for (int k = 0; k < 2 && !result; k++) {
        passes_half(p, k, &half);
        half.background = false;
        drop_particles(&half);
        result = run(r, e, &half, scratch, stats);
        if (!result)
            add(relighter_set(r), rgb, 0.5f, scratch);
    }
    return result;
}

/* The layer of one class. Indirect light by the cache comes together with direct light, so its layer is the
 * difference. */
static enum err run_class(struct relighter *r, const struct environment *e, const struct image_passes *all,
                          enum light_layer layer, struct layers *l, struct relight_stats *stats)
{
    const enum plan_estimator indirect = stats->plan.indirect;
    const bool cache = all->cached && indirect == PLAN_CACHE;
    struct image_passes p = *all;

    keep_classes(&p, layer == LAYER_BACKGROUND ? PATH_BACKGROUND : classes_of[layer]);
    if (layer == LAYER_INDIRECT && cache)
        p.cached = all->cached;
    if (layer == LAYER_DIRECT)
        stats->plan.indirect = PLAN_NONE;
    const enum err result = run_unfiltered(r, e, &p, all->denoiser != NULL, l->scratch, l->light[layer], stats);
    stats->plan.indirect = indirect;
    if (!result && layer == LAYER_INDIRECT && cache)
        add(relighter_set(r), l->light[layer], -1.0f, l->light[LAYER_DIRECT]);
    return result;
}

/* ---- Sun and sky ---- */

/* Fills l->sun with the environment's texels, all black except the sun. False: there is no sun. */
static bool find_sun(struct layers *l, const struct environment *e, enum err *result)
{
    const size_t count = (size_t)CUBE_FACES * e->n * e->n;
    const struct sky_table_desc desc = { .cells = 1, .sun = true };
    struct sky_table table = { 0 };

    if (l->sun_n != e->n) {
        mem_free(l->sun);
        l->sun = mem_alloc(count, sizeof(*l->sun));
        l->sun_n = l->sun ? e->n : 0;
    }
    *result = l->sun ? sky_table_build(&table, e, &desc) : ERR_NOMEM;
    const bool found = !*result && table.has_sun;
    for (size_t i = 0; found && i < count; i++)
        l->sun[i] = (struct texel){ .density = e->texels[i].density };
    for (uint32_t i = 0; found && i < table.sun_count; i++)
        l->sun[table.sun_texels[i]] = e->texels[table.sun_texels[i]];
    sky_table_finish(&table);
    return found;
}

/* Direct light by the same samples, of which only those that hit the sun count. Techniques with tables of their own,
 * the cache and lat-long texels, sample the sun anew. */
static enum err run_sun(struct relighter *r, struct environment *e, const struct image_passes *all, struct layers *l,
                        struct relight_stats *stats)
{
    const enum strata_kind strata = all->cached ? STRATA_LATLONG : method_recipe(all->direct.method)->strata;
    const bool fresh = strata == STRATA_LATLONG || strata == STRATA_ROWS;
    struct texel *texels = e->texels;
    struct image_passes p = *all;
    struct relight_stats own = { .plan = { .indirect = PLAN_NONE } };

    keep_classes(&p, PATH_DIRECT);
    if (all->cached) {
        p.direct = all->cached->direct;
        p.cached = NULL;
    }
    if (fresh)
        p.direct.method = METHOD_AUTO;
    p.direct.keep = !fresh;
    environment_complete(e); /* by all its texels, before some are black */
    environment_complete_pyramid(e);
    relighter_hold_ground(r, true);
    e->texels = l->sun;
    const enum err result = run_unfiltered(r, e, &p, all->denoiser != NULL, l->scratch, l->light[LAYER_SUN], &own);
    e->texels = texels;
    relighter_hold_ground(r, false);
    stats->shade_ms += own.shade_ms;
    return result;
}

static enum err split_direct(struct relighter *r, struct environment *e, const struct image_passes *all,
                             struct layers *l, struct relight_stats *stats)
{
    const struct prepared_scene *set = relighter_set(r);
    enum err result = ERR_OK;

    memset(l->light[LAYER_SUN], 0, 3 * pixels_of(set) * sizeof(float));
    memcpy(l->light[LAYER_SKY], l->light[LAYER_DIRECT], 3 * pixels_of(set) * sizeof(float));
    if ((!all->cached && all->direct.samples == 0) || !find_sun(l, e, &result))
        return result;
    result = run_sun(r, e, all, l, stats);
    if (!result)
        add(set, l->light[LAYER_SKY], -1.0f, l->light[LAYER_SUN]);
    return result;
}

/* ---- Error ---- */

float layers_error(const float *whole, const float *half, uint32_t width, uint32_t height, uint32_t x, uint32_t y)
{
    double sum = 0.0, count = 0.0;

    for (uint32_t v = y > REACH ? y - REACH : 0; v <= y + REACH && v < height; v++)
        for (uint32_t u = x > REACH ? x - REACH : 0; u <= x + REACH && u < width; u++) {
            const size_t i = 3 * ((size_t)v * width + u);
            const float *a = whole + i, *b = half + i;
            const double d = (double)rgb_luminance(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
            sum += d * d;
            count += 1.0;
        }
    return (float)sqrt(sum / (3.0 * count));
}

/* By a second image of half as many samples and other random numbers. */
static enum err estimate_error(struct relighter *r, const struct environment *e, const struct image_passes *all,
                               struct layers *l, struct relight_stats *stats)
{
    const struct gbuffer *g = relighter_set(r)->gbuffer;
    const uint32_t by = all->denoiser ? 1 : 2; /* with the denoiser, counts are those of a half already */
    struct relight_stats own = { .plan = stats->plan };
    struct image_passes p = *all;
    struct relight_desc cached;

    p.denoiser = NULL;
    p.direct.seed = rng_mix(p.direct.seed, SEED_AGAIN);
    p.direct.samples = (p.direct.samples + by - 1) / by;
    if (p.cached) {
        cached = *p.cached;
        cached.direct.seed = p.direct.seed = rng_mix(cached.direct.seed, SEED_AGAIN);
        cached.direct.samples = (cached.direct.samples + by - 1) / by;
        p.cached = &cached;
    }
    for (int k = 0; k < 2; k++) {
        p.eye[k].seed = rng_mix(p.eye[k].seed, SEED_AGAIN);
        p.eye[k].paths = (p.eye[k].paths + by - 1) / by;
        p.light[k].seed = rng_mix(p.light[k].seed, SEED_AGAIN);
        p.light[k].particles = (p.light[k].particles + 1) / 2;
    }
    const enum err result = run(r, e, &p, l->scratch, &own);
    if (result)
        return result;
    stats->shade_ms += own.shade_ms;
    stats->eye_ms += own.eye_ms;
    stats->light_ms += own.light_ms;
    stats->resolve_ms += own.resolve_ms;
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < g->height; y++)
        for (uint32_t x = 0; x < g->width; x++)
            l->light[LAYER_ERROR][(size_t)y * g->width + x] =
                layers_error(l->unfiltered, l->scratch, g->width, g->height, x, y);
    return ERR_OK;
}

enum err relighter_run_layers(struct relighter *r, struct environment *e, const struct relight_desc *desc,
                              struct layers *l, float *rgb, struct relight_stats *stats)
{
    const size_t bytes = 3 * pixels_of(relighter_set(r)) * sizeof(float);
    struct image_passes all;
    enum err result = relighter_describe(r, e, desc, &all, stats);

    /* The sun directly after direct light, whose tables it shares. */
    for (int k = 0; k <= LAYER_BACKGROUND && !result; k++) {
        result = run_class(r, e, &all, (enum light_layer)k, l, stats);
        if (!result && k == LAYER_DIRECT)
            result = split_direct(r, e, &all, l, stats);
    }
    if (result)
        return result;
    memcpy(l->unfiltered, l->light[LAYER_DIRECT], bytes);
    for (int k = LAYER_DIRECT + 1; k <= LAYER_BACKGROUND; k++)
        add(relighter_set(r), l->unfiltered, 1.0f, l->light[k]);
    result = estimate_error(r, e, &all, l, stats);
    if (result || all.denoiser)
        return result ? result : run(r, e, &all, rgb, stats);
    memcpy(rgb, l->unfiltered, bytes);
    return ERR_OK;
}
