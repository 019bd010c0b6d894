#include "pilot_measure.h"

#include "scatter.h"

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
    *y = (struct yardstick){
        .rgb = rgb, .mask = mask, .width = width, .height = height, .place = PAIR_FIRST, .soft = 1e-2 * mean * mean
    };
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

void yardstick_spread(const float *a, const float *b, uint32_t width, uint32_t height, float *spare, float *out)
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
    }
}

static void add_neighbours(const struct yardstick *y, uint32_t pixel, double out[3])
{
    const uint32_t px = pixel % y->width, py = pixel / y->width;
    double weight = 0.0;

    out[0] = out[1] = out[2] = 0.0;
    for (uint32_t v = py ? py - 1 : 0; v <= py + 1 && v < y->height; v++)
        for (uint32_t u = px ? px - 1 : 0; u <= px + 1 && u < y->width; u++) {
            const size_t i = (size_t)v * y->width + u;
            if (!y->mask[i])
                continue;
            for (size_t c = 0; c < 3; c++)
                out[c] += y->rgb[3 * i + c];
            weight += 1.0;
        }
    for (int c = 0; c < 3; c++)
        out[c] /= weight > 0.0 ? weight : 1.0;
}

/* r^2 + 1e-2 mean(r)^2 of a pixel. */
static void measure_of(const struct yardstick *y, uint32_t pixel, const double a[3], const double b[3],
                       const double mean[3], double out[3])
{
    double near[3] = { 0.0, 0.0, 0.0 };

    if (y->smooth)
        add_neighbours(y, pixel, near);
    for (int c = 0; c < 3; c++) {
        const size_t i = 3 * (size_t)pixel + (size_t)c;
        double r = y->smooth ? near[c] : (double)y->rgb[i];
        if (y->part)
            r += (double)y->part[i];
        else if (y->place == PAIR_NONE)
            r += mean[c];
        else if (y->place == PAIR_FIRST && !y->smooth)
            r += 0.5 * (b[c] - a[c]);
        out[c] = r * r + y->soft;
    }
}

/* A pixel's value from its shade points, and by its heaviest entry alone. */
static void resolve(const struct gbuffer *g, uint32_t pixel, const bool kinds[SURFACE_KINDS], const float *lo,
                    double full[3], double one[3])
{
    double heaviest = -1.0, share[3] = { 0.0, 0.0, 0.0 };

    full[0] = full[1] = full[2] = one[0] = one[1] = one[2] = 0.0;
    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *entry = &g->entries[k];
        const uint32_t packet = entry->point / PACKET;
        const float *at = lo + (size_t)packet * 3 * PACKET + entry->point % PACKET;
        const double weight = (double)entry->weight[0] + (double)entry->weight[1] + (double)entry->weight[2];
        const bool wanted = kinds[surface_of(&g->packets[packet])];
        for (int c = 0; c < 3; c++) {
            const double value = wanted ? (double)at[c * PACKET] : 0.0;
            full[c] += entry->weight[c] * value;
            share[c] += entry->weight[c];
            if (weight > heaviest)
                one[c] = value;
        }
        heaviest = weight > heaviest ? weight : heaviest;
    }
    for (int c = 0; c < 3; c++)
        one[c] *= share[c];
}

static void add_pixel(const double a[3], const double b[3], const double measure[3], struct pair *out)
{
    for (int c = 0; c < 3; c++) {
        if (!(measure[c] > 0.0))
            continue;
        out->error += (a[c] - b[c]) * (a[c] - b[c]) / (6.0 * measure[c]);
        out->energy += a[c] * b[c] / (3.0 * measure[c]);
    }
    out->pixels++;
}

static double mean_of(const double rgb[3])
{
    return (rgb[0] + rgb[1] + rgb[2]) / 3.0;
}

static struct tile_mean *mean_near(const struct groups *s, uint32_t pixel)
{
    const uint32_t width = s->gbuffer->width;
    return &s->mean[pixel / width / s->side * s->across + pixel % width / s->side];
}

/* Both estimates' means over each neighbourhood's pixels of the group; returns that over all of them. */
static double note_means(struct groups *s, const struct group *group, const bool kinds[SURFACE_KINDS], const float *a,
                         const float *b)
{
    const struct gbuffer *g = s->gbuffer;
    double all = 0.0;

    memset(s->mean, 0, s->tiles * sizeof(*s->mean));
    for (uint32_t k = 0; k < group->pixel_count; k++) {
        struct tile_mean *mean = mean_near(s, group->pixels[k]);
        double first[3], second[3], one[3];
        resolve(g, group->pixels[k], kinds, a, first, one);
        resolve(g, group->pixels[k], kinds, b, second, one);
        for (int c = 0; c < 3; c++) {
            mean->first[c] += first[c];
            mean->second[c] += second[c];
        }
        mean->pixels += 1.0;
        all += (mean_of(first) + mean_of(second)) / (2.0 * group->pixel_count);
    }
    for (uint32_t k = 0; k < s->tiles; k++)
        for (int c = 0; c < 3 && s->mean[k].pixels > 0.0; c++) {
            struct tile_mean *mean = &s->mean[k];
            mean->first[c] /= mean->pixels;
            mean->second[c] /= mean->pixels;
            mean->both[c] = 0.5 * (mean->first[c] + mean->second[c]);
        }
    return all;
}

void pair_of_points(struct groups *s, const struct group *group, const bool kinds[SURFACE_KINDS], const float *a,
                    const float *b, const struct yardstick *y, struct pair *out)
{
    struct yardstick own = *y;
    double error = 0.0, energy = 0.0, edge = 0.0;

    if (y->place == PAIR_NONE) {
        const double mean = 10.0 * sqrt(y->soft) + note_means(s, group, kinds, a, b);
        own.soft = 1e-2 * mean * mean;
    }
#pragma omp parallel for schedule(static) reduction(+ : error, energy, edge)
    for (uint32_t k = 0; k < group->pixel_count; k++) {
        struct pair one = { 0 };
        double first[3], second[3], first_one[3], second_one[3], measure[3];
        resolve(s->gbuffer, group->pixels[k], kinds, a, first, first_one);
        resolve(s->gbuffer, group->pixels[k], kinds, b, second, second_one);
        const struct tile_mean *near = mean_near(s, group->pixels[k]);
        measure_of(&own, group->pixels[k], first, second, near->both, measure);
        add_pixel(first, second, measure, &one);
        if (y->place == PAIR_NONE && y->even) {
            struct pair means = { 0 };
            add_pixel(near->first, near->second, measure, &means);
            one.energy = means.energy;
        }
        error += one.error;
        energy += one.energy;
        for (int c = 0; c < 3 && measure[0] > 0.0; c++)
            edge += (first_one[c] - first[c]) * (second_one[c] - second[c]) / (3.0 * measure[c]);
    }
    *out = (struct pair){ error, energy, edge, group->pixel_count };
}

/* A pixel's difference is D = sum w_k d_k over its points. Each is charged with w_k d_k D, so that together they are
 * charged with D^2, whether they differ independently of each other or, as they share light samples, alike. */
static void add_points(const struct gbuffer *g, uint32_t pixel, const bool kinds[SURFACE_KINDS], const float *a,
                       const float *b, const double apart[3], const double measure[3], float (*error)[PACKET])
{
    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *entry = &g->entries[k];
        const uint32_t packet = entry->point / PACKET;
        const size_t at = (size_t)packet * 3 * PACKET + entry->point % PACKET;
        double sum = 0.0;
        if (!kinds[surface_of(&g->packets[packet])])
            continue;
        for (size_t c = 0; c < 3; c++) {
            const double own = (double)a[at + c * PACKET] - (double)b[at + c * PACKET];
            sum += measure[c] > 0.0 ? (double)entry->weight[c] * own * apart[c] / (6.0 * measure[c]) : 0.0;
        }
        error[packet][entry->point % PACKET] += (float)sum;
    }
}

void pair_by_point(const struct groups *s, const struct group *group, const bool kinds[SURFACE_KINDS], const float *a,
                   const float *b, const struct yardstick *y, float (*error)[PACKET])
{
    for (uint32_t k = 0; k < group->both.count; k++)
        memset(error[group->both.index[k]], 0, sizeof(*error));
#pragma omp parallel for schedule(static)
    for (uint32_t k = 0; k < group->pixel_count; k++) {
        double first[3], second[3], one[3], measure[3];
        resolve(s->gbuffer, group->pixels[k], kinds, a, first, one);
        resolve(s->gbuffer, group->pixels[k], kinds, b, second, one);
        measure_of(y, group->pixels[k], first, second, (const double[3]){ 0.0, 0.0, 0.0 }, measure);
        const double apart[3] = { first[0] - second[0], first[1] - second[1], first[2] - second[2] };
        add_points(s->gbuffer, group->pixels[k], kinds, a, b, apart, measure, error);
    }
}

void pair_of_pictures(const struct group *group, const float *a, const float *b, const struct yardstick *y,
                      struct pair *out)
{
    double error = 0.0, energy = 0.0;

#pragma omp parallel for schedule(static) reduction(+ : error, energy)
    for (uint32_t k = 0; k < group->pixel_count; k++) {
        const float *p = a + 3 * (size_t)group->pixels[k], *q = b + 3 * (size_t)group->pixels[k];
        const double first[3] = { p[0], p[1], p[2] }, second[3] = { q[0], q[1], q[2] };
        struct pair one = { 0 };
        double measure[3];
        if (first[0] + first[1] + first[2] + second[0] + second[1] + second[2] == 0.0)
            continue;
        measure_of(y, group->pixels[k], first, second, (const double[3]){ 0.0, 0.0, 0.0 }, measure);
        add_pixel(first, second, measure, &one);
        error += one.error;
        energy += one.energy;
    }
    *out = (struct pair){ .error = error, .energy = energy, .pixels = group->pixel_count };
}
