#include "sky/daylight/measures.h"

#include "base/mem.h"
#include "base/vec.h"

#include <math.h>

#define DEGREE (PI / 180.0)
#define EV_EXPONENT 1.87 /* of the formula below */

double glare_position_index(const double w[3], const double ahead[3], const double up[3])
{
    const double depth = dot3(w, ahead), high = dot3(w, up);
    const double side = sqrt(fmax(0.0, 1.0 - depth * depth - high * high));
    const double sigma = acos(fmin(1.0, fmax(-1.0, depth))) / DEGREE;
    double p;

    if (high >= 0.0) {
        const double tau = side > 0.0 || high > 0.0 ? atan2(side, high) / DEGREE : 0.0;
        p = exp(1e-3 * sigma * (35.2 - 0.31889 * tau - 1.22 * exp(-2.0 * tau / 9.0)) +
                1e-5 * sigma * sigma * (21.0 + 0.26667 * tau - 0.002963 * tau * tau));
    } else {
        const double r = depth > 1e-6 ? sqrt(high * high + side * side) / depth : INFINITY;
        p = r < 0.6 ? 1.0 + 0.8 * r : 1.0 + 1.2 * r;
    }
    return fmin(16.0, fmax(1.0, p));
}

double glare_probability(double vertical_lux, double sum)
{
    const double contrast = vertical_lux > 0.0 ? sum / pow(vertical_lux, EV_EXPONENT) : 0.0;
    return fmin(1.0, 5.87e-5 * vertical_lux + 9.18e-2 * log10(1.0 + contrast) + 0.16);
}

/* A source: sums over its pixels, weighted by solid angle. */
struct source_sum {
    double sr, lum, w[3];
};

/* Takes the pixels that hang together with `first`; marks them in `taken`. stack: room for all pixels. */
static void collect(const struct glare_desc *d, uint32_t first, uint8_t *taken, uint32_t *stack, struct source_sum *out)
{
    uint32_t depth = 0;

    stack[depth++] = first;
    taken[first] = 1;
    while (depth > 0) {
        const uint32_t i = stack[--depth], x = i % d->width, y = i / d->width;
        const double sr = d->solid_angle[i];
        out->sr += sr;
        out->lum += sr * d->luminance[i];
        for (int k = 0; k < 3; k++)
            out->w[k] += sr * d->luminance[i] * d->direction[i][k];
        for (int k = 0; k < 9; k++) {
            const int64_t nx = (int64_t)x + k % 3 - 1, ny = (int64_t)y + k / 3 - 1;
            if (nx < 0 || ny < 0 || nx >= d->width || ny >= d->height)
                continue;
            const uint32_t to = (uint32_t)(ny * d->width + nx);
            if (taken[to] || !(d->solid_angle[to] > 0.0f) || !(d->luminance[to] >= GLARE_THRESHOLD))
                continue;
            taken[to] = 1;
            stack[depth++] = to;
        }
    }
}

/* The source's term of the sum. */
static double weigh(const struct glare_desc *d, const struct source_sum *s)
{
    const double length = sqrt(dot3(s->w, s->w)), lum = s->lum / s->sr;
    const double w[3] = { s->w[0] / length, s->w[1] / length, s->w[2] / length };
    const double p = glare_position_index(w, d->ahead, d->up);

    return lum * lum * s->sr / (p * p);
}

enum err glare_measure(const struct glare_desc *d, struct glare *out)
{
    const uint32_t pixels = d->width * d->height;
    uint8_t *taken = mem_alloc(pixels, 1);
    uint32_t *stack = mem_alloc(pixels, sizeof(*stack));
    enum err e = taken && stack ? ERR_OK : ERR_NOMEM;
    double sum = 0.0, bright = 0.0;

    *out = (struct glare){ .sources = 0 };
    for (uint32_t i = 0; i < pixels && !e; i++) {
        const double w[3] = { d->direction[i][0], d->direction[i][1], d->direction[i][2] };
        const double cosine = dot3(w, d->ahead);
        if (cosine > 0.0)
            out->vertical_lux += cosine * d->solid_angle[i] * d->luminance[i];
        if (taken[i] || !(d->solid_angle[i] > 0.0f) || !(d->luminance[i] >= GLARE_THRESHOLD))
            continue;
        struct source_sum s = { .sr = 0.0 };
        collect(d, i, taken, stack, &s);
        sum += weigh(d, &s);
        bright += s.lum;
        out->source_sr += s.sr;
        out->sources++;
    }
    out->source_lum = out->source_sr > 0.0 ? bright / out->source_sr : 0.0;
    out->dgp = glare_probability(out->vertical_lux, sum);
    mem_free(taken);
    mem_free(stack);
    return e;
}
