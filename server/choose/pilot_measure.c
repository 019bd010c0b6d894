#include "choose/pilot_measure.h"

#include <math.h>
#include <string.h>

#define SPREAD 4u /* pixels to either side */

void yardstick_init(struct yardstick *y, const float *rgb, const uint8_t *mask, uint32_t width, uint32_t height)
{
    double sum = 0.0;
    uint64_t pixels = 0;

#pragma omp parallel for schedule(static) reduction(+ : sum, pixels)
    for (uint32_t row = 0; row < height; row++)
        for (size_t i = (size_t)row * width; i < (size_t)(row + 1) * width; i++)
            if (mask[i]) {
                sum += (double)rgb[3 * i] + (double)rgb[3 * i + 1] + (double)rgb[3 * i + 2];
                pixels++;
            }
    const double mean = pixels ? sum / (3.0 * (double)pixels) : 0.0;
    *y = (struct yardstick){ .rgb = rgb, .mask = mask, .width = width, .height = height, .soft = 1e-2 * mean * mean };
}

/* Means along rows of 3 values, or along columns of a row's values: `count` places `step` values apart. */
static void spread_line(const float *from, size_t step, uint32_t count, float *to)
{
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t first = i > SPREAD ? i - SPREAD : 0, last = i + SPREAD < count ? i + SPREAD : count - 1;
        float sum = 0.0f;
        for (uint32_t k = first; k <= last; k++)
            sum += from[k * step];
        to[i * step] = sum / (float)(last - first + 1);
    }
}

void yardstick_spread(const float *a, const float *b, bool in_picture, uint32_t width, uint32_t height, float *spare,
                      float *out)
{
    const size_t row = 3 * (size_t)width;

#pragma omp parallel
    {
#pragma omp for schedule(static)
        for (size_t i = 0; i < row * height; i++)
            out[i] = 0.5f * (a[i] + b[i]);
#pragma omp for schedule(static)
        for (uint32_t y = 0; y < height; y++)
            for (size_t c = 0; c < 3; c++)
                spread_line(out + y * row + c, 3, width, spare + y * row + c);
#pragma omp for schedule(static)
        for (size_t x = 0; x < row; x++)
            spread_line(spare + x, row, height, out + x);
#pragma omp for schedule(static)
        for (size_t i = 0; i < row * height; i++)
            out[i] -= in_picture ? 0.5f * (a[i] + b[i]) : 0.0f;
    }
}

/* r^2 + 1e-2 mean(r)^2 of a pixel; `part`: what its neighbourhood has of a part that the picture lacks. */
static void measure_of(const struct yardstick *y, uint32_t pixel, const double part[3], double out[3])
{
    const uint32_t px = pixel % y->width, py = pixel / y->width, far = y->noisy;
    double sum[3] = { 0.0 }, weight = 0.0;

    for (uint32_t v = py >= far ? py - far : 0; v <= py + far && v < y->height; v++)
        for (uint32_t u = px >= far ? px - far : 0; u <= px + far && u < y->width; u++) {
            const size_t i = (size_t)v * y->width + u;
            if (!y->mask[i])
                continue;
            for (size_t c = 0; c < 3; c++)
                sum[c] += (double)y->rgb[3 * i + c] + (y->more ? (double)y->more[3 * i + c] : 0.0);
            weight += 1.0;
        }
    for (int c = 0; c < 3; c++) {
        const double r = sum[c] / fmax(weight, 1.0) + part[c];
        out[c] = r * r + y->soft;
    }
}

static void resolve(const struct gbuffer *g, uint32_t pixel, const float *lo, double out[3])
{
    out[0] = out[1] = out[2] = 0.0;
    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *entry = &g->entries[k];
        const float *at = lo + (size_t)(entry->point / PACKET) * 3 * PACKET + entry->point % PACKET;
        for (int c = 0; c < 3; c++)
            out[c] += (double)entry->weight[c] * (double)at[c * PACKET];
    }
}

static struct tile_mean *tile_near(const struct groups *s, uint32_t pixel)
{
    const uint32_t width = s->gbuffer->width;
    return &s->mean[pixel / width / s->side * s->across + pixel % width / s->side];
}

/* Both estimates' mean over the pixels that the group has of each tile; returns that over all its pixels. */
static double note_means(struct groups *s, const struct group *group, const float *a, const float *b)
{
    double all = 0.0;

    memset(s->mean, 0, s->tiles * sizeof(*s->mean));
    for (uint32_t k = 0; k < group->pixel_count; k++) {
        struct tile_mean *mean = tile_near(s, group->pixels[k]);
        double first[3], second[3];
        resolve(s->gbuffer, group->pixels[k], a, first);
        resolve(s->gbuffer, group->pixels[k], b, second);
        mean->pixels += 1.0;
        for (int c = 0; c < 3; c++) {
            mean->sum[c] += 0.5 * (first[c] + second[c]);
            all += (first[c] + second[c]) / (6.0 * group->pixel_count);
        }
    }
    return all;
}

static struct pair pair_of(const double a[3], const double b[3], const double measure[3])
{
    struct pair out = { 0.0, 0.0 };

    for (int c = 0; c < 3; c++) {
        if (!(measure[c] > 0.0))
            continue;
        out.error += (a[c] - b[c]) * (a[c] - b[c]) / (6.0 * measure[c]);
        out.energy += a[c] * b[c] / (3.0 * measure[c]);
    }
    return out;
}

struct pair pair_of_points(struct groups *s, const struct group *group, const float *a, const float *b,
                           const struct yardstick *y)
{
    const double pixels = group->pixel_count ? group->pixel_count : 1.0;
    struct yardstick own = *y;
    double error = 0.0, energy = 0.0;

    if (y->lacks_part) {
        const double mean = 10.0 * sqrt(y->soft) + note_means(s, group, a, b);
        own.soft = 1e-2 * mean * mean;
    }
#pragma omp parallel for schedule(static) reduction(+ : error, energy)
    for (uint32_t k = 0; k < group->pixel_count; k++) {
        const struct tile_mean *tile = tile_near(s, group->pixels[k]);
        double first[3], second[3], measure[3], part[3] = { 0.0 };
        for (int c = 0; c < 3 && y->lacks_part; c++)
            part[c] = tile->sum[c] / tile->pixels;
        resolve(s->gbuffer, group->pixels[k], a, first);
        resolve(s->gbuffer, group->pixels[k], b, second);
        measure_of(&own, group->pixels[k], part, measure);
        const struct pair one = pair_of(first, second, measure);
        error += one.error;
        energy += one.energy;
    }
    return (struct pair){ error / pixels, energy / pixels };
}

/* A pixel's difference is D = sum w_k d_k over its points. Each is charged with w_k d_k D, so that together they are
 * charged with D^2, whether they differ independently of each other or, as they share light samples, alike. */
static void add_points(const struct gbuffer *g, uint32_t pixel, const float *a, const float *b, const double apart[3],
                       const double measure[3], float (*error)[PACKET])
{
    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *entry = &g->entries[k];
        const uint32_t packet = entry->point / PACKET;
        const size_t at = (size_t)packet * 3 * PACKET + entry->point % PACKET;
        double sum = 0.0;
        for (size_t c = 0; c < 3; c++) {
            const double own = (double)a[at + c * PACKET] - (double)b[at + c * PACKET];
            sum += measure[c] > 0.0 ? (double)entry->weight[c] * own * apart[c] / (6.0 * measure[c]) : 0.0;
        }
        error[packet][entry->point % PACKET] += (float)sum;
    }
}

void pair_by_point(const struct groups *s, const struct group *group, const float *a, const float *b,
                   const struct yardstick *y, float (*error)[PACKET])
{
    for (uint32_t k = 0; k < group->list.count; k++)
        memset(error[group->list.index[k]], 0, sizeof(*error));
#pragma omp parallel for schedule(static)
    for (uint32_t k = 0; k < group->pixel_count; k++) {
        double first[3], second[3], measure[3];
        resolve(s->gbuffer, group->pixels[k], a, first);
        resolve(s->gbuffer, group->pixels[k], b, second);
        measure_of(y, group->pixels[k], (const double[3]){ 0.0, 0.0, 0.0 }, measure);
        const double apart[3] = { first[0] - second[0], first[1] - second[1], first[2] - second[2] };
        add_points(s->gbuffer, group->pixels[k], a, b, apart, measure, error);
    }
}

struct pair pair_of_pictures(const struct group *group, const float *a, const float *b, const struct yardstick *y)
{
    const double pixels = group->pixel_count ? group->pixel_count : 1.0;
    double error = 0.0, energy = 0.0;

#pragma omp parallel for schedule(static) reduction(+ : error, energy)
    for (uint32_t k = 0; k < group->pixel_count; k++) {
        const float *p = a + 3 * (size_t)group->pixels[k], *q = b + 3 * (size_t)group->pixels[k];
        const double first[3] = { p[0], p[1], p[2] }, second[3] = { q[0], q[1], q[2] };
        double measure[3];
        if (first[0] + first[1] + first[2] + second[0] + second[1] + second[2] == 0.0)
            continue;
        measure_of(y, group->pixels[k], (const double[3]){ 0.0, 0.0, 0.0 }, measure);
        const struct pair one = pair_of(first, second, measure);
        error += one.error;
        energy += one.energy;
    }
    return (struct pair){ error / pixels, energy / pixels };
}
