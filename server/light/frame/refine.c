#include "light/frame/refine.h"

#include "base/mem.h"
#include "base/rng.h"
#include "light/resolve/resolve.h"

#include <math.h>
#include <string.h>

#define TILE 32          /* pixels; chosen, not measured */
#define SAMPLES_LEAST 16 /* a pass: below, tables weigh more than samples */
#define KNOWN 0.25       /* of V: below, D - V is not known */

struct tile {
    double own, off; /* sums of V and D over its pixels and channels */
    double first;    /* w in its middle */
    uint64_t pixels;
};

struct refiner {
    const struct prepared_scene *set;
    struct relighter *relighter; /* separate, so that the images' own relighter keeps its state */
    uint8_t *mask;
    float *first, *pass; /* [height][width][3], as what follows */
    double *sum;
    float *scatter; /* sum over the passes of (x - m)^2 */
    struct tile *tile, *spread;
    uint32_t across, down;
    uint64_t passes;
    bool weighed; /* since it was begun */
};

struct refiner *refiner_create(const struct prepared_scene *set, const struct kernels *kernels)
{
    struct refiner *s = mem_alloc(1, sizeof(*s));
    const struct gbuffer *g = set->gbuffer;
    const size_t pixels = (size_t)g->width * g->height;

    if (!s)
        return NULL;
    s->set = set;
    s->across = (g->width + TILE - 1) / TILE;
    s->down = (g->height + TILE - 1) / TILE;
    s->relighter = relighter_create(set, kernels);
    s->mask = mem_alloc(pixels, 1);
    s->first = mem_alloc(pixels, 3 * sizeof(float));
    s->pass = mem_alloc(pixels, 3 * sizeof(float));
    s->sum = mem_alloc(pixels, 3 * sizeof(double));
    s->scatter = mem_alloc(pixels, 3 * sizeof(float));
    s->tile = mem_alloc((size_t)s->across * s->down, sizeof(*s->tile));
    s->spread = mem_alloc((size_t)s->across * s->down, sizeof(*s->spread));
    if (!s->relighter || !s->mask || !s->first || !s->pass || !s->sum || !s->scatter || !s->tile || !s->spread) {
        refiner_destroy(s);
        return NULL;
    }
    resolve_mask(g, s->mask);
    return s;
}

void refiner_destroy(struct refiner *s)
{
    if (!s)
        return;
    relighter_destroy(s->relighter);
    mem_free(s->mask);
    mem_free(s->first);
    mem_free(s->pass);
    mem_free(s->sum);
    mem_free(s->scatter);
    mem_free(s->tile);
    mem_free(s->spread);
    mem_free(s);
}

void refiner_begin(struct refiner *s, const float *first)
{
    const size_t values = (size_t)s->set->gbuffer->width * s->set->gbuffer->height * 3;

    memcpy(s->first, first, values * sizeof(float));
    memset(s->sum, 0, values * sizeof(double));
    memset(s->scatter, 0, values * sizeof(float));
    for (uint32_t t = 0; t < s->across * s->down; t++)
        s->tile[t].first = 1.0;
    s->passes = 0;
    s->weighed = false;
}

/* The unbiased light of a pass, with random numbers that no image uses. */
static struct relight_desc unbiased(const struct refiner *s, const struct relight_desc *light)
{
    struct relight_desc d = *light;

    if (d.direct.method == METHOD_CACHED)
        d.direct.method = METHOD_AUTO;
    if (d.caustics == PLAN_STORED) /* one store is one sample, however often it is lit */
        d.caustics = PLAN_AUTO;
    if (d.direct.samples < SAMPLES_LEAST)
        d.direct.samples = SAMPLES_LEAST;
    d.direct.seed = rng_mix(d.direct.seed, 0x7374696c6c);
    d.direct.pass = s->passes;
    d.denoise = d.remember = false; /* passes are independent of each other */
    d.audit = 0.0;                  /* their scatter states the error */
    return d;
}

/* Running sums of squares about the mean [Welford 1962]. */
static void add_pass(struct refiner *s)
{
    const size_t values = (size_t)s->set->gbuffer->width * s->set->gbuffer->height * 3;
    const double before = s->passes ? 1.0 / (double)s->passes : 0.0, after = 1.0 / (double)(s->passes + 1);

#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < values; i++) {
        const double x = (double)s->pass[i], from = x - before * s->sum[i];
        s->sum[i] += x;
        if (s->passes > 0)
            s->scatter[i] += (float)(from * (x - after * s->sum[i]));
    }
    s->passes++;
}

enum err refiner_pass(struct refiner *s, const struct environment *e, const struct relight_desc *light)
{
    const struct relight_desc desc = unbiased(s, light);
    struct relight_stats stats;
    const enum err result = relighter_run(s->relighter, e, &desc, s->pass, &stats);

    if (!result && !(desc.direct.cancel && atomic_load(desc.direct.cancel)))
        add_pass(s);
    return result;
}

/* w at a pixel: between the tiles' middles, evenly. */
static double first_at(const struct refiner *s, uint32_t x, uint32_t y)
{
    const double u = fmin(fmax((x + 0.5) / TILE - 0.5, 0.0), s->across - 1.0),
                 v = fmin(fmax((y + 0.5) / TILE - 0.5, 0.0), s->down - 1.0);
    const uint32_t i = (uint32_t)u, j = (uint32_t)v;
    const uint32_t right = i + 1 < s->across ? 1 : 0, below = j + 1 < s->down ? s->across : 0;
    const struct tile *t = &s->tile[(size_t)j * s->across + i];
    const double top = t[0].first + (u - i) * (t[right].first - t[0].first),
                 bottom = t[below].first + (u - i) * (t[below + right].first - t[below].first);

    return top + (v - j) * (bottom - top);
}

static double shown_at(const struct refiner *s, size_t value, double first)
{
    const double mean = s->passes ? s->sum[value] / (double)s->passes : 0.0;

    return s->passes ? mean + first * ((double)s->first[value] - mean) : (double)s->first[value];
}

/* 1e-2 mean(r)^2 of the passes, whose mean is more accurate than any pixel. */
static double softness(const struct refiner *s)
{
    const size_t count = (size_t)s->set->gbuffer->width * s->set->gbuffer->height;
    double sum = 0.0;
    uint64_t pixels = 0;

    for (size_t p = 0; p < count; p++) /* in one order, for the same bits */
        if (s->mask[p]) {
            sum += s->sum[3 * p] + s->sum[3 * p + 1] + s->sum[3 * p + 2];
            pixels++;
        }
    const double mean = pixels ? sum / (3.0 * (double)pixels * (double)s->passes) : 0.0;
    return 1e-2 * mean * mean;
}

static void sum_tile(const struct refiner *s, uint32_t index, double soft, struct tile *out)
{
    const struct gbuffer *g = s->set->gbuffer;
    const uint32_t left = index % s->across * TILE, top = index / s->across * TILE;
    const double n = (double)s->passes, scale = 1.0 / (n * (n - 1.0));

    out->own = out->off = 0.0;
    out->pixels = 0;
    for (uint32_t y = top; y < top + TILE && y < g->height; y++)
        for (uint32_t x = left; x < left + TILE && x < g->width; x++) {
            const size_t pixel = (size_t)y * g->width + x;
            if (!s->mask[pixel])
                continue;
            const double first = first_at(s, x, y);
            for (size_t i = 3 * pixel; i < 3 * pixel + 3; i++) {
                const double r = shown_at(s, i, first), off = s->sum[i] / n - (double)s->first[i];
                const double per = r * r + soft > 0.0 ? 1.0 / (r * r + soft) : 0.0;
                out->own += scale * (double)s->scatter[i] * per;
                out->off += off * off * per;
            }
            out->pixels++;
        }
}

/* A tile's sums plus those of its neighbours, weighted by 1 2 1 along either axis. */
static void spread_tile(const struct refiner *s, uint32_t index, double *own, double *off)
{
    const int64_t i = index % s->across, j = index / s->across;

    *own = *off = 0.0;
    for (int64_t y = j - 1; y <= j + 1; y++)
        for (int64_t x = i - 1; x <= i + 1; x++) {
            if (x < 0 || y < 0 || x >= s->across || y >= s->down)
                continue;
            const struct tile *t = &s->spread[y * s->across + x];
            const double by = (x == i ? 2.0 : 1.0) * (y == j ? 2.0 : 1.0);
            *own += by * t->own;
            *off += by * t->off;
        }
}

static void weigh_tiles(struct refiner *s)
{
    const uint32_t tiles = s->across * s->down;
    const double soft = softness(s);

#pragma omp parallel for schedule(dynamic, 1)
    for (uint32_t t = 0; t < tiles; t++)
        sum_tile(s, t, soft, &s->spread[t]);
    for (uint32_t t = 0; t < tiles; t++) {
        double own, off;
        spread_tile(s, t, &own, &off);
        s->tile[t] = s->spread[t];
        s->tile[t].first = own < off ? own / off : off > 0.0 ? 1.0 : 0.0;
    }
}

void refiner_look(struct refiner *s, const struct refiner_wish *wish, struct refiner_stats *out)
{
    double own = 0.0, shown = 0.0, first = 0.0, pixels = 0.0;

    *out = (struct refiner_stats){ .passes = s->passes, .first = 1.0 };
    if (s->passes >= 2) {
        weigh_tiles(s);
        if (!s->weighed) /* by the first image alone, which may be too noisy to be measured by */
            weigh_tiles(s);
        s->weighed = true;
        for (uint32_t t = 0; t < s->across * s->down; t++) {
            const struct tile *tile = &s->tile[t];
            const double w = tile->first;
            own += tile->own;
            shown += w * w * (tile->off - tile->own) + (1.0 - w) * (1.0 - w) * tile->own;
            first += w * (double)tile->pixels;
            pixels += (double)tile->pixels;
        }
        if (pixels > 0.0) {
            out->mean = own / (3.0 * pixels);
            out->error = fmax(shown, KNOWN * own) / (3.0 * pixels);
            out->first = first / pixels;
        }
    }
    out->converged = (s->passes >= 2 && out->error <= wish->error) || (wish->passes && s->passes >= wish->passes);
}

void refiner_image(const struct refiner *s, float *rgb)
{
    const struct gbuffer *g = s->set->gbuffer;

#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < g->height; y++)
        for (uint32_t x = 0; x < g->width; x++) {
            const double first = first_at(s, x, y);
            for (size_t k = 0; k < 3; k++) {
                const size_t i = 3 * ((size_t)y * g->width + x) + k;
                rgb[i] = (float)shown_at(s, i, first);
            }
        }
}
