#include "measure/chart/series.h"

#include "base/mem.h"
#include "base/rng.h"
#include "base/sort.h"

#include <math.h>
#include <string.h>

#define LOW 0.1
#define HIGH 0.9
#define CONFIDENCE 0.9

/* Of sorted values. Between a number and infinity there is infinity. */
static double quantile(const double *sorted, uint32_t n, double share)
{
    const double at = share * (n - 1);
    const uint32_t i = (uint32_t)at;
    const double part = at - i;

    return i + 1 < n && part > 0.0 ? sorted[i] * (1.0 - part) + sorted[i + 1] * part : sorted[i];
}

static void sort_values(double *v, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++)
        if (isnan(v[i]))
            v[i] = INFINITY;
    sort_doubles(v, n);
}

enum err series_band(const double *values, uint32_t n, struct band *out)
{
    double *v = mem_alloc(n, sizeof(*v));

    if (!v)
        return ERR_NOMEM;
    memcpy(v, values, n * sizeof(*v));
    sort_values(v, n);
    *out = (struct band){ quantile(v, n, LOW), quantile(v, n, 0.5), quantile(v, n, HIGH) };
    mem_free(v);
    return ERR_OK;
}

bool series_at(const double *x, const double *y, uint32_t n, double at, double *out)
{
    for (uint32_t k = 0; k < n; k++) {
        const uint32_t next = k + 1 < n ? k + 1 : k;
        if (!(at >= x[k] && at <= x[next]) || !(y[k] > 0.0) || !(y[next] > 0.0))
            continue;
        const double span = log(x[next] / x[k]);
        const double part = span > 0.0 ? log(at / x[k]) / span : 0.0;
        *out = exp(log(y[k]) * (1.0 - part) + log(y[next]) * part);
        return true;
    }
    return false;
}

bool series_reach(const double *x, const double *y, uint32_t n, double goal, double *out, bool *at_most)
{
    *at_most = false;
    for (uint32_t k = 0; k < n; k++) {
        if (!(y[k] <= goal))
            continue;
        if (k == 0) {
            *out = x[0];
            *at_most = true;
        } else if (y[k] > 0.0 && isfinite(y[k - 1])) {
            *out = x[k - 1] * pow(x[k] / x[k - 1], log(y[k - 1] / goal) / log(y[k - 1] / y[k]));
        } else {
            *out = x[k];
        }
        return true;
    }
    return false;
}

/* A line of points in ascending x. */
static void sort_line(double *x, double *y, uint32_t n)
{
    for (uint32_t i = 1; i < n; i++)
        for (uint32_t k = i; k > 0 && x[k] < x[k - 1]; k--) {
            const double tx = x[k], ty = y[k];
            x[k] = x[k - 1];
            y[k] = y[k - 1];
            x[k - 1] = tx;
            y[k - 1] = ty;
        }
}

/* Medians over the seeds, or with rng over as many that are drawn from them. scratch: [2 seeds]. */
static void line_of(const struct curve *c, struct rng *rng, double *scratch, double *x, double *y)
{
    const uint32_t n = c->seeds;

    for (uint32_t p = 0; p < c->points; p++) {
        for (uint32_t s = 0; s < n; s++) {
            const uint32_t drawn = rng ? (uint32_t)(rng_next(rng) * n) : s;
            scratch[s] = c->seconds[(size_t)p * n + drawn];
            scratch[n + s] = c->errors[(size_t)p * n + drawn];
        }
        sort_values(scratch, n);
        sort_values(scratch + n, n);
        x[p] = quantile(scratch, n, 0.5);
        y[p] = quantile(scratch + n, n, 0.5);
    }
    sort_line(x, y, c->points);
}

enum err series_medians(const struct curve *c, double *seconds, double *errors)
{
    double *scratch = mem_alloc(2 * (size_t)c->seeds, sizeof(*scratch));

    if (!scratch)
        return ERR_NOMEM;
    line_of(c, NULL, scratch, seconds, errors);
    mem_free(scratch);
    return ERR_OK;
}

struct lines { /* of the others and of the tested one, all in one block */
    double *x, *y;
    double *scratch;
    uint32_t stride;
};

/* The largest ratio of the last line over the envelope of the others, and where it is; 0 where none can be told. */
static double worst_ratio(const struct lines *l, const struct curve *others, uint32_t count, const struct curve *tested,
                          double *seconds)
{
    const double *x = l->x + (size_t)count * l->stride, *y = l->y + (size_t)count * l->stride;
    double worst = 0.0;

    for (uint32_t p = 0; p < tested->points; p++) {
        double least = INFINITY, e;
        for (uint32_t c = 0; c < count; c++)
            if (series_at(l->x + (size_t)c * l->stride, l->y + (size_t)c * l->stride, others[c].points, x[p], &e))
                least = fmin(least, e);
        if (isfinite(least) && y[p] / least > worst) {
            worst = y[p] / least;
            *seconds = x[p];
        }
    }
    return worst;
}

static void draw_lines(const struct lines *l, const struct curve *others, uint32_t count, const struct curve *tested,
                       struct rng *rng)
{
    for (uint32_t c = 0; c <= count; c++)
        line_of(c < count ? &others[c] : tested, rng, l->scratch, l->x + (size_t)c * l->stride,
                l->y + (size_t)c * l->stride);
}

enum err series_envelope(const struct curve *others, uint32_t count, const struct curve *tested, double limit,
                         uint32_t rounds, uint64_t seed, struct envelope_verdict *out)
{
    struct lines l = { .stride = tested->points };
    struct rng rng = { seed };
    uint32_t seeds = tested->seeds, within = 0;
    double unused;

    *out = (struct envelope_verdict){ .known = false };
    for (uint32_t c = 0; c < count; c++) {
        l.stride = others[c].points > l.stride ? others[c].points : l.stride;
        seeds = others[c].seeds > seeds ? others[c].seeds : seeds;
    }
    l.x = mem_alloc((size_t)(count + 1) * l.stride, sizeof(double));
    l.y = mem_alloc((size_t)(count + 1) * l.stride, sizeof(double));
    l.scratch = mem_alloc(2 * (size_t)seeds, sizeof(double));
    double *ratios = mem_alloc(rounds, sizeof(double));
    const bool room = l.x && l.y && l.scratch && ratios;
    if (room) {
        draw_lines(&l, others, count, tested, NULL);
        out->worst = worst_ratio(&l, others, count, tested, &out->worst_seconds);
        out->known = out->worst > 0.0 && rounds > 0;
    }
    for (uint32_t r = 0; r < rounds && out->known; r++) {
        draw_lines(&l, others, count, tested, &rng);
        ratios[r] = worst_ratio(&l, others, count, tested, &unused);
        within += ratios[r] <= limit;
    }
    if (out->known) {
        sort_values(ratios, rounds);
        out->upper = quantile(ratios, rounds, CONFIDENCE);
        out->confidence = (double)within / rounds;
        out->within = out->confidence >= CONFIDENCE;
    }
    mem_free(l.x);
    mem_free(l.y);
    mem_free(l.scratch);
    mem_free(ratios);
    return room ? ERR_OK : ERR_NOMEM;
}
