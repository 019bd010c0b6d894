#include "history/stated.h"

#include "base/mem.h"

#include <math.h>

#define SOFT 1e-2    /* of relMSE */
#define LEAST 1e-12f /* of an estimate, which may be below 0 */
#define AROUND 0.25f /* of the mean of the pixels around: x at least */
#define COUNTS 4     /* measurements */

struct stated {
    const struct gbuffer *g;
    float *scale;   /* [height][width][3]: 1 / (x^2 + 1e-2 m^2) */
    bool seen;      /* it is filled */
    double error;   /* 0: unknown */
    uint32_t taken; /* measurements in it */
};

struct stated *stated_create(const struct gbuffer *g)
{
    struct stated *s = mem_alloc(1, sizeof(*s));

    if (!s)
        return NULL;
    s->g = g;
    s->scale = mem_alloc((size_t)g->width * g->height, 3 * sizeof(float));
    if (s->scale)
        return s;
    stated_destroy(s);
    return NULL;
}

void stated_destroy(struct stated *s)
{
    if (!s)
        return;
    mem_free(s->scale);
    mem_free(s);
}

void stated_forget(struct stated *s)
{
    s->error = 0.0;
    s->taken = 0;
}

/* At least a part of the mean of the pixels around. */
static float light_at(const struct gbuffer *g, const float *rgb, uint32_t x, uint32_t y, size_t c)
{
    float sum = 0.0f, count = 0.0f;

    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < g->height; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < g->width; u++, count += 1.0f)
            sum += rgb[3 * ((size_t)v * g->width + u) + c];
    return fmaxf(rgb[3 * ((size_t)y * g->width + x) + c], AROUND * sum / count);
}

void stated_see(struct stated *s, const float *rgb)
{
    const struct gbuffer *g = s->g;
    const size_t values = 3 * (size_t)g->width * g->height;
    double mean = 0.0;

    for (size_t i = 0; i < values; i++)
        mean += (double)rgb[i] / (double)values;
    const float soft = (float)(SOFT * mean * mean + 1e-30);
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < g->height; y++)
        for (uint32_t i = 0; i < 3 * g->width; i++) {
            const float x = light_at(g, rgb, i / 3, y, i % 3);
            s->scale[3 * (size_t)y * g->width + i] = 1.0f / (x * x + soft);
        }
    s->seen = true;
}

static double pixel_error(const struct stated *s, uint32_t pixel, const float *const half[2],
                          const float *const more[2], const float *shown)
{
    const struct gbuffer *g = s->g;
    float off[2][3] = { { 0.0f } };
    double out = 0.0;

    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *entry = &g->entries[k];
        const size_t point = (size_t)(entry->point / PACKET) * 3 * PACKET + entry->point % PACKET;
        for (size_t c = 0; c < 3; c++)
            for (int j = 0; j < 2; j++) {
                const size_t at = point + c * PACKET;
                off[j][c] += entry->weight[c] * (half[j][at] + (more[j] ? more[j][at] : 0.0f) - shown[at]);
            }
    }
    for (size_t c = 0; c < 3; c++)
        out += (double)(s->scale[3 * (size_t)pixel + c] * off[0][c] * off[1][c]);
    return out;
}

void stated_take(struct stated *s, const float *const half[2], const float *const more[2], const float *shown,
                 double by)
{
    const uint32_t pixels = s->g->width * s->g->height;
    double sum = 0.0;

    for (uint32_t pixel = 0; pixel < pixels && s->seen; pixel++)
        sum += pixel_error(s, pixel, half, more, shown);
    if (!s->seen)
        return;
    s->taken = s->taken < COUNTS ? s->taken + 1 : COUNTS;
    const double to = STATED_PER * sum / (3.0 * pixels);
    s->error = fmax(sqrt(by) * (s->error + (to - s->error) / s->taken), LEAST);
}

double stated_error(const struct stated *s)
{
    return s->error;
}
