#include "light/frame/layers.h"

#include "base/mem.h"
#include "base/rng.h"
#include "light/denoise/denoise.h"
#include "light/estimators/method.h"
#include "light/frame/frame_plan.h"
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

/* Leaves these classes alone, without the filter. */
static struct frame_plan of_classes(const struct frame_plan *all, uint32_t classes)
{
    struct frame_plan p = *all;

    frame_plan_keep(&p, classes);
    frame_plan_drop(&p, PASS_FILTER);
    return p;
}

/* The passes' light before the denoiser: the mean of its two input halves, plus particles. */
static enum err run_unfiltered(struct relighter *r, const struct environment *e, struct frame_plan *p, bool halves,
                               float *scratch, float *rgb, struct relight_stats *stats)
{
    struct frame_plan half, rest;
    enum err result;

    if (!halves)
        return relighter_run_plan(r, e, p, rgb, stats);
    rest = of_classes(p, PATH_ALL & ~(uint32_t)PATH_DIRECT);
    frame_plan_drop(&rest, PASS_EYE);
    result = relighter_run_plan(r, e, &rest, rgb, stats);
    for (int k = 0; k < 2 && !result; k++) {
        frame_plan_half(p, k, &half);
        half.background = false;
        frame_plan_drop(&half, PASS_PARTICLES);
        frame_plan_drop(&half, PASS_STORED);
        result = relighter_run_plan(r, e, &half, scratch, stats);
        if (!result)
            add(relighter_set(r), rgb, 0.5f, scratch);
    }
    return result;
}

/* The layer of one class. Indirect light by the cache comes together with direct light, so its layer is the
 * difference. */
static enum err run_class(struct relighter *r, const struct environment *e, const struct frame_plan *all,
                          enum light_layer layer, struct layers *l, struct relight_stats *stats)
{
    const enum plan_estimator indirect = stats->plan.indirect;
    const bool cache = frame_plan_has(all, PASS_CACHED) && indirect == PLAN_CACHE;
    const uint32_t classes = layer == LAYER_BACKGROUND ? PATH_BACKGROUND : classes_of[layer];
    struct frame_plan p = of_classes(all, classes);

    if (layer == LAYER_INDIRECT && cache)
        p.pass[0] = all->pass[0]; /* of the cache */
    if (layer == LAYER_DIRECT)
        stats->plan.indirect = PLAN_NONE;
    const enum err result = run_unfiltered(r, e, &p, frame_plan_is_filtered(all), l->scratch, l->light[layer], stats);
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
static enum err run_sun(struct relighter *r, struct environment *e, const struct frame_plan *all, struct layers *l,
                        struct relight_stats *stats)
{
    struct frame_plan p = of_classes(all, PATH_DIRECT);
    struct pass *s = &p.pass[0]; /* direct light comes first */
    const bool cached = s->kind == PASS_CACHED;
    const enum strata_kind strata = cached ? STRATA_LATLONG : method_recipe(s->direct.method)->strata;
    const bool fresh = strata == STRATA_LATLONG || strata == STRATA_ROWS;
    struct texel *texels = e->texels;
    struct relight_stats own = { .plan = { .indirect = PLAN_NONE } };

    if (cached)
        *s = (struct pass){ PASS_DIRECT, .half = -1, .classes = PATH_DIRECT, .direct = s->request->direct };
    if (fresh)
        s->direct.method = METHOD_AUTO;
    s->direct.keep = !fresh;
    if (!fresh && s->direct.method == METHOD_AUTO) { /* without its correction, which is the sky's */
        s->direct.method = METHOD_MIS;
        s->direct.sun = true;
        s->direct.compensate = COMPENSATE_ON;
    }
    environment_complete(e); /* by all its texels, before some are black */
    environment_complete_pyramid(e);
    relighter_hold_ground(r, true);
    e->texels = l->sun;
    const enum err result =
        run_unfiltered(r, e, &p, frame_plan_is_filtered(all), l->scratch, l->light[LAYER_SUN], &own);
    e->texels = texels;
    relighter_hold_ground(r, false);
    stats->shade_ms += own.shade_ms;
    return result;
}

static enum err split_direct(struct relighter *r, struct environment *e, const struct frame_plan *all, struct layers *l,
                             struct relight_stats *stats)
{
    const struct prepared_scene *set = relighter_set(r);
    enum err result = ERR_OK;

    memset(l->light[LAYER_SUN], 0, 3 * pixels_of(set) * sizeof(float));
    memcpy(l->light[LAYER_SKY], l->light[LAYER_DIRECT], 3 * pixels_of(set) * sizeof(float));
    if (!(all->pass[0].classes & PATH_DIRECT) || !find_sun(l, e, &result))
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

/* Half as many samples, by other random numbers. `by`: 1 if counts are those of a half already, else 2. */
static void sample_again(struct pass *s, uint32_t by, struct relight_desc *cached)
{
    switch (s->kind) {
    case PASS_CACHED:
        *cached = *s->request;
        cached->direct.seed = rng_mix(cached->direct.seed, SEED_AGAIN);
        cached->direct.samples = (cached->direct.samples + by - 1) / by;
        s->request = cached;
        break;
    case PASS_DIRECT:
        s->direct.seed = rng_mix(s->direct.seed, SEED_AGAIN);
        s->direct.samples = (s->direct.samples + by - 1) / by;
        break;
    case PASS_EYE:
        s->eye.seed = rng_mix(s->eye.seed, SEED_AGAIN);
        s->eye.paths = (s->eye.paths + by - 1) / by;
        break;
    case PASS_PARTICLES:
        s->light.seed = rng_mix(s->light.seed, SEED_AGAIN);
        s->light.particles = (s->light.particles + 1) / 2;
        break;
    default: break;
    }
}

/* By a second image. */
static enum err estimate_error(struct relighter *r, const struct environment *e, const struct frame_plan *all,
                               struct layers *l, struct relight_stats *stats)
{
    const struct gbuffer *g = relighter_set(r)->gbuffer;
    const uint32_t by = frame_plan_is_filtered(all) ? 1 : 2;
    struct relight_stats own = { .plan = stats->plan };
    struct frame_plan p = *all;
    struct relight_desc cached;

    frame_plan_drop(&p, PASS_FILTER);
    for (uint32_t k = 0; k < p.count; k++)
        sample_again(&p.pass[k], by, &cached);
    const enum err result = relighter_run_plan(r, e, &p, l->scratch, &own);
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
    struct frame_plan all;
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
    if (result || frame_plan_is_filtered(&all))
        return result ? result : relighter_run_plan(r, e, &all, rgb, stats);
    memcpy(rgb, l->unfiltered, bytes);
    return ERR_OK;
}
