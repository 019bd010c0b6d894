#include "history/stated.h"

#include "base/mem.h"

#include <math.h>

#define SOFT 1e-2      /* of relMSE */
#define AROUND 0.25f   /* of the mean of the pixels around: x at least */
#define DARK_FROM 4.0f /* squared differences, in variances, from which x is not P */
#define KEPT 0.8       /* of a measurement's weight, by each further one: the ratio falls in the first pictures */

struct stated {
    const struct gbuffer *g;
    double *row[2];  /* [height]: sums over its pixels; of their squares */
    float *noise_at; /* [height][width]: squared noise of the halves' mean, summed over r, g and b */
    float *x;        /* [height][width][3] */
    float *scale;    /* [height][width][3]: 1 / (x^2 + 1e-2 m^2) */
    bool seen;       /* it is filled, and `noise` is that picture's V */
    double noise;
    double m, v, square; /* weighted sums of M, of V and of the variances of M; v 0: nothing was measured */
};

struct stated *stated_create(const struct gbuffer *g)
{
    struct stated *s = mem_alloc(1, sizeof(*s));

    if (!s)
        return NULL;
    s->g = g;
    s->scale = mem_alloc((size_t)g->width * g->height, 3 * sizeof(float));
    s->x = mem_alloc((size_t)g->width * g->height, 3 * sizeof(float));
    s->noise_at = mem_alloc((size_t)g->width * g->height, sizeof(float));
    for (int k = 0; k < 2; k++)
        s->row[k] = mem_alloc(g->height, sizeof(double));
    if (s->scale && s->x && s->noise_at && s->row[0] && s->row[1])
        return s;
    stated_destroy(s);
    return NULL;
}

void stated_destroy(struct stated *s)
{
    if (!s)
        return;
    mem_free(s->scale);
    mem_free(s->x);
    mem_free(s->noise_at);
    mem_free(s->row[0]);
    mem_free(s->row[1]);
    mem_free(s);
}

void stated_forget(struct stated *s)
{
    s->m = s->v = s->square = 0.0;
    s->seen = false;
}

/* The picture's light of `points` in a pixel. */
static void add_points(const struct gbuffer *g, uint32_t pixel, const float *points, float out[3])
{
    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *e = &g->entries[k];
        const size_t at = (size_t)(e->point / PACKET) * 3 * PACKET + e->point % PACKET;
        for (size_t c = 0; c < 3; c++)
            out[c] += e->weight[c] * points[at + c * PACKET];
    }
}

/* The mean over 3 x 3 pixels of channel c of a picture of n channels. */
static float mean_around(const struct gbuffer *g, const float *of, uint32_t x, uint32_t y, size_t n, size_t c)
{
    float sum = 0.0f, count = 0.0f;

    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < g->height; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < g->width; u++, count += 1.0f)
            sum += of[n * ((size_t)v * g->width + u) + c];
    return sum / count;
}

/* noise_at and, in x, the picture with what the halves say of thin shadows. */
static void find_x(struct stated *s, const float *rgb, const struct stated_light *light)
{
    const uint32_t width = s->g->width, height = s->g->height;

#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < width * height; i++) {
        float h[2][3] = { { 0.0f } };
        for (int k = 0; k < 2; k++)
            add_points(s->g, i, light->half[k], h[k]);
        s->noise_at[i] = 0.0f;
        for (int c = 0; c < 3; c++)
            s->noise_at[i] += 0.25f * (h[0][c] - h[1][c]) * (h[0][c] - h[1][c]);
    }
#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < width * height; i++) {
        float h[2][3] = { { 0.0f } }, shown[3] = { 0.0f }, sum[3] = { 0.0f }, off = 0.0f;
        add_points(s->g, i, light->shown, shown);
        for (int k = 0; k < 2; k++)
            add_points(s->g, i, light->half[k], h[k]);
        for (int c = 0; c < 3; c++) {
            const float d = 0.5f * (h[0][c] + h[1][c]) - shown[c];
            sum[0] += h[0][c];
            sum[1] += h[1][c];
            sum[2] += shown[c];
            off += d * d;
        }
        const float noise = DARK_FROM * mean_around(s->g, s->noise_at, i % width, i / width, 1, 0);
        const float w = fmaxf(sum[0], sum[1]) < sum[2] && off > noise ? noise / off : 1.0f;
        for (int c = 0; c < 3; c++)
            s->x[3 * (size_t)i + c] =
                fmaxf(rgb[3 * (size_t)i + c] + (1.0f - w) * (0.5f * (h[0][c] + h[1][c]) - shown[c]), 0.0f);
    }
}

/* k 0: the mean over all values, 1: the variance of that mean, if pixels are independent. The same bits at any number
 * of threads. */
static double mean_of_rows(const struct stated *s, int k)
{
    const double values = 3.0 * s->g->width * s->g->height;
    double sum = 0.0;

    for (uint32_t y = 0; y < s->g->height; y++)
        sum += s->row[k][y];
    return sum / (k ? values * values : values);
}

static double noise_of(const struct stated *s, const float *apart)
{
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < s->g->height; y++) {
        s->row[0][y] = 0.0;
        for (uint32_t i = y * s->g->width; i < (y + 1) * s->g->width; i++) {
            float off[3] = { 0.0f };
            add_points(s->g, i, apart, off);
            for (size_t c = 0; c < 3; c++)
                s->row[0][y] += (double)(s->scale[3 * (size_t)i + c] * off[c] * off[c]);
        }
    }
    return mean_of_rows(s, 0);
}

void stated_see(struct stated *s, const float *rgb, const struct stated_light *light)
{
    const struct gbuffer *g = s->g;
    const size_t values = 3 * (size_t)g->width * g->height;
    double mean = 0.0;

    for (size_t i = 0; i < values; i++)
        mean += (double)rgb[i] / (double)values;
    const float soft = (float)(SOFT * mean * mean + 1e-30);
    find_x(s, rgb, light);
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < g->height; y++)
        for (uint32_t i = 0; i < 3 * g->width; i++) {
            const size_t at = 3 * (size_t)y * g->width + i;
            const float x = fmaxf(s->x[at], AROUND * mean_around(g, rgb, i / 3, y, 3, i % 3));
            s->scale[at] = 1.0f / (x * x + soft);
        }
    s->noise = noise_of(s, light->apart);
    s->seen = true;
}

static double pixel_error(const struct stated *s, uint32_t pixel, const float *const half[2],
                          const float *const more[2], const float *shown)
{
    float off[2][3] = { { 0.0f } }, was[3] = { 0.0f };
    double out = 0.0;

    add_points(s->g, pixel, shown, was);
    for (int j = 0; j < 2; j++) {
        add_points(s->g, pixel, half[j], off[j]);
        if (more[j])
            add_points(s->g, pixel, more[j], off[j]);
    }
    for (size_t c = 0; c < 3; c++)
        out += (double)(s->scale[3 * (size_t)pixel + c] * (off[0][c] - was[c]) * (off[1][c] - was[c]));
    return out;
}

void stated_take(struct stated *s, const float *const half[2], const float *const more[2], const float *shown)
{
    if (!s->seen)
        return;
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < s->g->height; y++) {
        s->row[0][y] = s->row[1][y] = 0.0;
        for (uint32_t i = y * s->g->width; i < (y + 1) * s->g->width; i++) {
            const double m = pixel_error(s, i, half, more, shown);
            s->row[0][y] += m;
            s->row[1][y] += m * m;
        }
    }
    const double m = STATED_PER * mean_of_rows(s, 0), square = STATED_PER * STATED_PER * mean_of_rows(s, 1);
    s->m = KEPT * s->m + m;
    s->v = KEPT * s->v + s->noise;
    s->square = KEPT * KEPT * s->square + square;
    s->seen = false;
}

double stated_error(const struct stated *s)
{
    const double wide = STATED_RATIO_OFF * STATED_RATIO_OFF;

    if (!(s->v > 0.0))
        return 0.0;
    return s->noise * fmax(1.0, (wide * s->m * s->v + s->square * STATED_RATIO) / (wide * s->v * s->v + s->square));
}
