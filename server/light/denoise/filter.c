#include "light/denoise/denoise.h"

#include "base/denormals.h"
#include "base/mem.h"
#include "light/denoise/filter_kernel.h"

#include <math.h>
#include <string.h>

#define REFLECTANCE_LEAST 0.02f /* light is divided by it */
#define AGREED 0.03f            /* difference of the halves, in means, below which a point is as bright as it seems */
#define DARK_FROM 4.0f /* squared differences, in variances, from which a point stays darker than its neighbours */

/* Points that are not the largest of their pixel lie anywhere behind frosted glass, without similar ones: clamped to
 * the brightest pixel, such glass lost a quarter of its light. */
#define REST_CLAMP 4.0f

void filter_destroy(struct filter *f)
{
    if (!f)
        return;
    filter_layers_free(f);
    mem_free(f);
}

struct filter *filter_create(const struct gbuffer *g, const struct view *v, const char *level)
{
    struct filter *f = mem_alloc(1, sizeof(*f));

    if (!f)
        return NULL;
    f->g = g;
    f->kernel = filter_kernel_select(level);
    if (!filter_layers_make(f, v)) {
        filter_destroy(f);
        return NULL;
    }
    return f;
}

static float reflectance(const struct shade_packet *p, int c, uint32_t lane)
{
    return fmaxf(p->diffuse[c][lane] + p->specular[c][lane], REFLECTANCE_LEAST);
}

static size_t at(uint32_t point, int c)
{
    return ((size_t)(point / PACKET) * 3 + (size_t)c) * PACKET + point % PACKET;
}

/* Divides the halves by reflectance, and estimates their variance from their difference. */
static void put_light(const struct filter *f, const float *const half[2], const uint32_t *point, struct points *to)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < to->count; i++) {
        float variance = 0.0f;
        for (int c = 0; c < 3 && point[i] != NOWHERE; c++) {
            const float r = 1.0f / reflectance(&f->g->packets[point[i] / PACKET], c, point[i] % PACKET);
            const float a = r * half[0][at(point[i], c)], b = r * half[1][at(point[i], c)];
            to->light[(size_t)c * to->count + i] = a;
            to->light[(size_t)(3 + c) * to->count + i] = b;
            variance += 0.5f * (a - b) * (a - b);
        }
        to->light[LIGHT_VARIANCE * to->count + i] = variance;
    }
}

/* Channel c of the brightest point of a layer next to this pixel, or around it; below 0: there is no surface. Stops at
 * one that is not below `enough`. */
static float brightest(const struct filter *f, const struct layer *l, uint32_t pixel, int c, float enough)
{
    const uint32_t width = f->g->width, x = pixel % width, y = pixel / width;
    const float *a = l->points.light + (size_t)c * l->points.count, *b = a + 3 * l->points.count;
    float most = -1.0f;

    for (uint32_t v = y > FILTER_RADIUS ? y - FILTER_RADIUS : 0; v <= y + FILTER_RADIUS && v < f->g->height; v++)
        for (uint32_t u = x > FILTER_RADIUS ? x - FILTER_RADIUS : 0; u <= x + FILTER_RADIUS && u < width; u++) {
            const size_t i = (size_t)v * f->pitch + u;
            if (l->point[i] == NOWHERE || (u == x && v == y) || !(0.5f * (a[i] + b[i]) > most))
                continue;
            most = 0.5f * (a[i] + b[i]);
            if (most >= enough)
                return most;
        }
    return most;
}

/* A point keeps its noise if it has no similar neighbours, or if both halves found something bright by chance. Unless
 * they agree, it is clamped to a multiple of the brightest pixel around it. */
static float without_speck(const struct filter *f, const struct layer *l, uint32_t pixel, int c, float times, float a,
                           float b)
{
    const float mean = 0.5f * (a + b);

    if (!(fabsf(a - b) > AGREED * mean))
        return mean;
    const float limit = times * brightest(f, l, pixel, c, mean / times);
    return limit >= 0.0f && mean > limit ? limit : mean;
}

/* The weight of filtered light against both halves' mean: below 1 in a shadow that is thinner than the filter, where
 * both halves are darker than the filtered light by more than their noise. What is brighter may be a lone bright path
 * instead, and what is black light that is rarely found. variance: of a half, around the point. */
static float filtered_share(const float half[2][3], const float light[3], float variance)
{
    float sum[2] = { 0.0f }, all = 0.0f, off = 0.0f;

    for (int c = 0; c < 3; c++) {
        const float d = 0.5f * (half[0][c] + half[1][c]) - light[c];
        sum[0] += half[0][c];
        sum[1] += half[1][c];
        all += light[c];
        off += d * d;
    }
    if (!(fmaxf(sum[0], sum[1]) < all && fminf(sum[0], sum[1]) > 0.0f))
        return 1.0f;
    const float noise = DARK_FROM * 0.5f * variance;
    return off > noise ? noise / off : 1.0f;
}

/* Writes the light of point i of `from`, filtered by layer l, from the halves. pixel: the one that shows it. */
static void take_point(const struct filter *f, const struct layer *l, const struct points *from, size_t i,
                       uint32_t pixel, float times, float light[3])
{
    for (int c = 0; c < 3; c++) {
        const float a = from->light[(size_t)c * from->count + i], b = from->light[(size_t)(3 + c) * from->count + i];
        light[c] = without_speck(f, l, pixel, c, times, a, b);
    }
}

static void put_point(const struct filter *f, uint32_t point, const float light[3], float *to)
{
    for (int c = 0; c < 3; c++)
        to[at(point, c)] = reflectance(&f->g->packets[point / PACKET], c, point % PACKET) * light[c];
}

static void take_layer(const struct filter *f, const struct layer *l, float times, const float *const half[2],
                       float *to)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < l->points.count; i++) {
        const uint32_t point = l->point[i], pixel = (uint32_t)(i / f->pitch * f->g->width + i % f->pitch);
        float light[3], own[2][3];
        if (point == NOWHERE)
            continue;
        take_point(f, l, &l->points, i, pixel, times, light);
        for (int k = 0; k < 6; k++)
            own[k / 3][k % 3] =
                half[k / 3][at(point, k % 3)] / reflectance(&f->g->packets[point / PACKET], k % 3, point % PACKET);
        /* in mirrors and behind glass, where few points share a variance, noise would pass for such a shadow */
        const bool behind = f->g->packets[point / PACKET].behind[point % PACKET];
        const float w = behind ? 1.0f : filtered_share(own, light, l->first[i]);
        for (int c = 0; c < 3 && w < 1.0f; c++) {
            const float mean = 0.5f * (own[0][c] + own[1][c]);
            light[c] = mean + w * (light[c] - mean);
        }
        put_point(f, point, light, to);
    }
}

static void take_rest(const struct filter *f, float *to)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < f->rest.count; i++) {
        float light[3];
        take_point(f, &f->layers[0], &f->rest, i, f->rest_pixel[i], REST_CLAMP, light);
        put_point(f, f->rest_point[i], light, to);
    }
}

static struct filter_image image_of(const struct filter *f, const struct layer *l)
{
    struct filter_image p = { .width = f->g->width, .height = f->g->height, .pitch = f->pitch };

    for (size_t k = 0; k < SURFACE_PLANES; k++)
        p.surface[k] = l->points.surface + k * l->points.count;
    for (size_t k = 0; k < LIGHT_PLANES; k++)
        p.light[k] = l->points.light + k * l->points.count;
    return p;
}

static struct filter_points points_at(const struct points *p, size_t first, uint32_t count, uint32_t x, uint32_t y)
{
    struct filter_points out = { .x = x, .y = y, .count = count };

    for (size_t k = 0; k < SURFACE_PLANES; k++)
        out.surface[k] = p->surface + k * p->count + first;
    for (size_t k = 0; k < LIGHT_PLANES; k++) {
        out.light[k] = p->light + k * p->count + first;
        out.out[k] = p->next + k * p->count + first;
    }
    return out;
}

static bool is_empty(const uint32_t *point, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++)
        if (point[i] != NOWHERE)
            return false;
    return true;
}

static void run_row(const struct filter *f, const struct layer *l, const struct filter_image *p, uint32_t y,
                    uint32_t step)
{
    for (uint32_t x = 0; x < p->width; x += FILTER_COUNT_MAX) {
        const uint32_t count = p->width - x < FILTER_COUNT_MAX ? p->width - x : FILTER_COUNT_MAX;
        const struct filter_points row = points_at(&l->points, y * f->pitch + x, count, x, y);
        if (is_empty(l->point + y * f->pitch + x, count))
            continue; /* no light there, in either buffer */
        if (step)
            f->kernel->level(p, &row, step);
        else
            f->kernel->spread(p, &row);
    }
}

/* One level over a layer; step 0: the mean of the variances. */
static void run_layer(const struct filter *f, const struct layer *l, uint32_t step)
{
    const struct filter_image p = image_of(f, l);

#pragma omp parallel
    {
        const unsigned before = denormals_flush();
#pragma omp for schedule(dynamic, 4)
        for (uint32_t y = 0; y < p.height; y++)
            run_row(f, l, &p, y, step);
        denormals_restore(before);
    }
}

/* Points in no layer take filtered light from the pixels around them, whose noise was that of `first`. */
static void run_rest(struct filter *f)
{
    struct filter_image p = image_of(f, &f->layers[0]);

    p.light[LIGHT_VARIANCE] = f->layers[0].first;
#pragma omp parallel
    {
        const unsigned before = denormals_flush();
#pragma omp for schedule(dynamic, 4)
        for (size_t i = 0; i < f->rest.count; i += FILTER_COUNT_MAX) {
            const size_t left = f->rest.count - i;
            struct filter_points at =
                points_at(&f->rest, i, left < FILTER_COUNT_MAX ? (uint32_t)left : FILTER_COUNT_MAX, 0, 0);
            at.pixel = f->rest_pixel + i;
            f->kernel->level(&p, &at, 1);
        }
        denormals_restore(before);
    }
}

/* What was written becomes the next one's light. */
static void turn(struct points *p)
{
    float *old = p->light;

    p->light = p->next;
    p->next = old;
}

static void begin_layer(const struct filter *f, struct layer *l, const float *const half[2])
{
    const size_t count = l->points.count;

    put_light(f, half, l->point, &l->points);
    run_layer(f, l, 0);
    memcpy(l->first, l->points.next + LIGHT_VARIANCE * count, count * sizeof(float));
    memcpy(l->points.light + LIGHT_VARIANCE * count, l->first, count * sizeof(float));
}

enum { LAYER_PARTS = 3 };

static void filter_layer(const struct filter *f, struct layer *l, uint32_t part, const float *const half[2])
{
    static const int levels[LAYER_PARTS + 1] = { 0, 0, 2, FILTER_LEVELS };

    if (part == 0)
        begin_layer(f, l, half);
    for (int k = levels[part]; k < levels[part + 1]; k++) {
        run_layer(f, l, 1u << k);
        turn(&l->points);
    }
}

uint32_t filter_parts(const struct filter *f)
{
    return LAYER_PARTS * f->layer_count + 2;
}

void filter_part(struct filter *f, uint32_t part, const float *const half[2], float *to)
{
    if (part < LAYER_PARTS * f->layer_count) {
        filter_layer(f, &f->layers[part / LAYER_PARTS], part % LAYER_PARTS, half);
    } else if (part + 1 < filter_parts(f)) {
        put_light(f, half, f->rest_point, &f->rest);
        run_rest(f);
        turn(&f->rest);
    } else {
        for (uint32_t k = 0; k < f->layer_count; k++)
            take_layer(f, &f->layers[k], k ? REST_CLAMP : 1.0f, half, to);
        take_rest(f, to);
    }
}

void filter_run(struct filter *f, const float *const half[2], float *to)
{
    for (uint32_t part = 0; part < filter_parts(f); part++)
        filter_part(f, part, half, to);
}

extern const struct filter_kernel filter_kernel_baseline, filter_kernel_v3, filter_kernel_v4;

const struct filter_kernel *filter_kernel_select(const char *level)
{
    static const struct filter_kernel *const by_level[CPU_LEVELS] = KERNEL_TABLE(filter_kernel);
    enum cpu_level chosen;
    struct reason ignored;

    return by_level[cpu_select(level, &chosen, &ignored) ? cpu_best() : chosen];
}
