#include "motion.h"

#include "mem.h"

#include <assert.h>
#include <math.h>

static size_t pixels_of(const struct motion *m)
{
    return (size_t)m->frames[0].width * m->frames[0].height;
}

/* Whether the mean of both references keeps to its own mean over time. The judge's weights are over three times the
 * pixels that count, and are 0 where a pixel does not. */
static bool is_still(const struct motion *m, size_t pixel, double share)
{
    double mean[3] = { 0.0, 0.0, 0.0 };

    if (!(m->frames[0].weight[3 * pixel] > 0.0f))
        return false;
    for (uint32_t t = 0; t < m->count; t++)
        for (size_t c = 0; c < 3; c++)
            mean[c] += (double)m->frames[t].mean[3 * pixel + c] / m->count;
    for (uint32_t t = 0; t < m->count; t++) {
        const struct judge *j = &m->frames[t];
        double square = 0.0;
        for (size_t c = 0; c < 3; c++) {
            const double d = (double)j->mean[3 * pixel + c] - mean[c];
            square += (double)j->weight[3 * pixel + c] * (double)j->pixels * d * d;
        }
        if (!(square <= share * share))
            return false;
    }
    return true;
}

enum err motion_init(struct motion *m, const struct judge *frames, uint32_t count, double share, struct reason *why)
{
    assert(count >= 2);
    *m = (struct motion){ .frames = frames, .count = count };
    m->still = mem_alloc(pixels_of(m), 1);
    if (!m->still)
        return err_say(why, ERR_NOMEM, "no memory to tell what moves");
    for (size_t pixel = 0; pixel < pixels_of(m); pixel++) {
        m->still[pixel] = is_still(m, pixel, share);
        m->still_pixels += m->still[pixel];
    }
    m->still_share = (double)m->still_pixels / (double)frames[0].pixels;
    return ERR_OK;
}

void motion_finish(struct motion *m)
{
    mem_free(m->still);
    *m = (struct motion){ .count = 0 };
}

/* Covariance over time of x - a and x - b, that of the truth's own error: the noises of a and b know nothing of each
 * other. Weighed by the mean of the frames' weights, times 3 and the pixels that count. */
static double variance_at(const struct motion *m, const float *const *x, size_t v)
{
    double by_a = 0.0, by_b = 0.0, product = 0.0, weight = 0.0;

    for (uint32_t t = 0; t < m->count; t++) { /* means first: the two passes lose no digits */
        const struct judge *j = &m->frames[t];
        by_a += ((double)x[t][v] - (double)j->a[v]) / m->count;
        by_b += ((double)x[t][v] - (double)j->b[v]) / m->count;
        weight += (double)j->weight[v] * 3.0 * (double)j->pixels / m->count;
    }
    for (uint32_t t = 0; t < m->count; t++) {
        const struct judge *j = &m->frames[t];
        product += ((double)x[t][v] - (double)j->a[v] - by_a) * ((double)x[t][v] - (double)j->b[v] - by_b);
    }
    return weight * product / (m->count - 1);
}

double motion_flicker(const struct motion *m, const float *const *x, float *map)
{
    double sum = 0.0;

    for (size_t pixel = 0; pixel < pixels_of(m); pixel++) {
        double own = 0.0;
        for (size_t c = 0; c < 3 && m->still[pixel]; c++)
            own += variance_at(m, x, 3 * pixel + c) / 3.0;
        sum += own;
        if (map)
            map[pixel] = m->still[pixel] ? (float)sqrt(fmax(own, 0.0)) : NAN;
    }
    if (m->still_pixels == 0)
        return NAN;
    return isfinite(sum) ? sqrt(fmax(sum, 0.0) / (double)m->still_pixels) : INFINITY;
}

static double change_of(const struct judge *now, const struct judge *before, const float *x, const float *x_before)
{
    const size_t values = 3 * (size_t)now->width * now->height;
    double sum = 0.0;

    for (size_t v = 0; v < values; v++) {
        if (!(now->weight[v] > 0.0f))
            continue;
        const double d = (double)x[v] - (double)x_before[v];
        const double by_a = d - ((double)now->a[v] - (double)before->a[v]);
        const double by_b = d - ((double)now->b[v] - (double)before->b[v]);
        sum += (double)now->weight[v] * by_a * by_b;
    }
    return sum;
}

double motion_change(const struct motion *m, const float *const *x)
{
    double sum = 0.0;

    for (uint32_t t = 1; t < m->count; t++)
        sum += change_of(&m->frames[t], &m->frames[t - 1], x[t], x[t - 1]) / (m->count - 1);
    return isfinite(sum) ? sum : INFINITY;
}

uint32_t motion_settled(const double *values, uint32_t n, double bound)
{
    uint32_t from = n;

    while (from > 0 && values[from - 1] <= bound)
        from--;
    return from;
}
