#include "light/plan/pilot_measure.h"

#include "base/mem.h"

#include <math.h>
#include <string.h>

/* Pixels per side. Packets hold points from a neighbourhood of 16 x 16 (gbuffer_pack.c): if the image is large enough
 * for groups of many such tiles, no packet is in two groups. */
#define TILE 16u
#define TILE_SMALL 8u
#define TILES_A_GROUP 10u /* at least: with fewer, one group shows what another does not */
#define GOLDEN 0.6180339887498949
#define SPREAD 5u /* pixels to either side */

static uint32_t tile_of(const struct gbuffer *g, const struct tiles *t, size_t pixel)
{
    return (uint32_t)(pixel / g->width) / t->side * t->across + (uint32_t)(pixel % g->width) / t->side;
}

static bool has_points(const struct gbuffer *g, size_t pixel)
{
    return g->entry_first[pixel + 1] > g->entry_first[pixel];
}

static void cut(struct tiles *t, const struct gbuffer *g, uint32_t side)
{
    t->side = side;
    t->across = (g->width + side - 1) / side;
    t->count = t->across * ((g->height + side - 1) / side);
}

/* Assigns the tiles with shade points by a sequence that spreads each group over the image. */
static void deal(const struct tiles *t, const struct gbuffer *g, uint32_t groups)
{
    uint32_t rank = 0;

    for (size_t i = 0; i < (size_t)g->width * g->height; i++)
        t->group[tile_of(g, t, i)] |= has_points(g, i);
    for (uint32_t k = 0; k < t->count; k++)
        if (t->group[k])
            t->group[k] = (uint8_t)(fmod(GOLDEN * rank++, 1.0) * groups);
}

/* The pixels of one group, or of all (tiles NULL), and their packets, which `seen` marks. */
static bool fill_group(const struct gbuffer *g, const struct tiles *t, uint32_t number, uint8_t *seen,
                       struct group *out)
{
    const size_t pixels = (size_t)g->width * g->height;

    out->pixels = mem_alloc_raw(pixels, sizeof(*out->pixels)); /* what is not written takes no memory */
    out->index = mem_alloc_raw(g->packet_count, sizeof(*out->index));
    if (!out->pixels || !out->index)
        return false;
    memset(seen, 0, g->packet_count);
    for (size_t i = 0; i < pixels; i++) {
        if (!has_points(g, i) || (t && t->group[tile_of(g, t, i)] != number))
            continue;
        out->pixels[out->pixel_count++] = (uint32_t)i;
        for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++)
            seen[g->entries[k].point / PACKET] = 1;
    }
    for (uint32_t i = 0; i < g->packet_count; i++)
        if (seen[i]) {
            out->index[out->list.count++] = i;
            out->points += g->packets[i].count;
        }
    out->list.index = out->index;
    return true;
}

bool groups_init(struct groups *s, const struct gbuffer *g)
{
    struct tiles *t = &s->tiles;

    *s = (struct groups){ .gbuffer = g };
    cut(t, g, TILE);
    if (t->count < TILES_A_GROUP * GROUPS_MAX)
        cut(t, g, TILE_SMALL);
    s->count = (uint32_t)fmin(fmax(t->count / TILES_A_GROUP, 1), GROUPS_MAX);
    t->group = mem_alloc(t->count, 1);
    uint8_t *seen = mem_alloc(g->packet_count, 1);
    bool all = t->group && seen && fill_group(g, NULL, 0, seen, &s->all);
    if (all)
        deal(t, g, s->count);
    for (uint32_t k = 0; k < s->count && all; k++)
        all = fill_group(g, t, k, seen, &s->group[k]);
    mem_free(seen);
    return all;
}

void groups_finish(struct groups *s)
{
    for (uint32_t k = 0; k <= GROUPS_MAX; k++) {
        struct group *g = k < GROUPS_MAX ? &s->group[k] : &s->all;
        mem_free(g->pixels);
        mem_free(g->index);
    }
    mem_free(s->tiles.group);
    *s = (struct groups){ .count = 0 };
}

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

/* Means of 3 values along rows, or along columns of row means: `count` positions `step` values apart, each without its
 * own and the two beside it. */
static void spread_line(const float *from, size_t step, uint32_t count, float *to)
{
    for (uint32_t i = 0; i < count; i++) {
        float sum = 0.0f, many = 0.0f;
        for (uint32_t k = i > SPREAD ? i - SPREAD : 0; k <= i + SPREAD && k < count; k++)
            if (k + 1 < i || k > i + 1) {
                sum += from[k * step];
                many += 1.0f;
            }
        to[i * step] = sum / fmaxf(many, 1.0f);
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
#pragma omp for schedule(static)
        for (size_t i = 0; i < row * height; i++)
            out[i] -= 0.5f * (a[i] + b[i]);
    }
}

/* r^2 + 1e-2 mean(r)^2 of a pixel. */
static void measure_of(const struct yardstick *y, uint32_t pixel, double out[3])
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
        const double r = sum[c] / fmax(weight, 1.0);
        out[c] = r * r + y->soft;
    }
}

/* A pixel of float[packet_count][3][16] by its shade points; without g of float[height][width][3]. */
static void read_pixel(const struct gbuffer *g, uint32_t pixel, const float *from, double out[3])
{
    for (int c = 0; c < 3; c++)
        out[c] = g ? 0.0 : (double)from[3 * (size_t)pixel + (size_t)c];
    for (uint32_t k = g ? g->entry_first[pixel] : 0; g && k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *entry = &g->entries[k];
        const float *at = from + (size_t)(entry->point / PACKET) * 3 * PACKET + entry->point % PACKET;
        for (int c = 0; c < 3; c++)
            out[c] += (double)entry->weight[c] * (double)at[c * PACKET];
    }
}

static double error_of(const double a[3], const double b[3], const double measure[3])
{
    double error = 0.0;

    for (int c = 0; c < 3; c++)
        error += measure[c] > 0.0 ? (a[c] - b[c]) * (a[c] - b[c]) / (6.0 * measure[c]) : 0.0;
    return error;
}

/* A pixel's difference is D = sum w_k d_k over its points. Each point gets w_k d_k D, so that their sum is D^2, whether
 * their errors are independent or, because of shared light samples, correlated. */
static void add_points(const struct gbuffer *g, uint32_t pixel, const float *a, const float *b, const double first[3],
                       const double second[3], const double measure[3], float (*error)[PACKET])
{
    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *entry = &g->entries[k];
        const uint32_t packet = entry->point / PACKET;
        const size_t at = (size_t)packet * 3 * PACKET + entry->point % PACKET;
        double sum = 0.0;
        for (size_t c = 0; c < 3; c++) {
            const double own = (double)a[at + c * PACKET] - (double)b[at + c * PACKET];
            sum +=
                measure[c] > 0.0 ? (double)entry->weight[c] * own * (first[c] - second[c]) / (6.0 * measure[c]) : 0.0;
        }
        error[packet][entry->point % PACKET] += (float)sum;
    }
}

/* The mean of pair_of_points; without g that of pair_of_images. */
static double pair_of_group(const struct gbuffer *g, const struct group *group, const float *a, const float *b,
                            const struct yardstick *y, float (*error)[PACKET])
{
    double noise = 0.0;

#pragma omp parallel for schedule(static) reduction(+ : noise)
    for (uint32_t k = 0; k < group->pixel_count; k++) {
        const uint32_t pixel = group->pixels[k];
        double first[3], second[3], measure[3];
        read_pixel(g, pixel, a, first);
        read_pixel(g, pixel, b, second);
        measure_of(y, pixel, measure);
        if (error)
            add_points(g, pixel, a, b, first, second, measure, error);
        noise += error_of(first, second, measure);
    }
    return noise / fmax(1.0, group->pixel_count);
}

double pair_of_points(const struct groups *s, const struct group *group, const float *a, const float *b,
                      const struct yardstick *y, float (*error)[PACKET])
{
    for (uint32_t k = 0; error && k < group->list.count; k++)
        memset(error[group->list.index[k]], 0, sizeof(*error));
    return pair_of_group(s->gbuffer, group, a, b, y, error);
}

double pair_of_images(const struct group *group, const float *a, const float *b, const struct yardstick *y)
{
    return pair_of_group(NULL, group, a, b, y, NULL);
}
