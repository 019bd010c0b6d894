#include "filter/filter.h"

#include "base/mem.h"
#include "filter/filter_kernel.h"

#include <math.h>
#include <string.h>

#define REFLECTANCE_LEAST 0.02f /* light is divided by it */
#define AGREED 0.03f            /* difference of the halves, in means, below which a point is as bright as it seems */
#define NOWHERE UINT32_MAX
#define DARK_FROM 4.0f /* squared differences, in variances, from which a point stays darker than its neighbours */

/* Points that are not the largest of their pixel lie anywhere behind frosted glass, without similar ones: clamped to
 * the brightest pixel, such glass lost a quarter of its light. */
#define REST_CLAMP 4.0f

/* Points side by side: planes of `count` floats each. */
struct points {
    size_t count;
    float *surface, *light, *next; /* [SURFACE_PLANES], [LIGHT_PLANES], [LIGHT_PLANES] planes */
};

/* The pixel image holds each pixel's point with the largest weight; all points take their neighbours' light from it.
 * The other points, at edges, are `rest`. */
struct filter {
    const struct gbuffer *g;
    const struct filter_kernel *kernel;
    size_t pitch; /* of the image, floats */
    struct points image, rest;
    float *first;          /* [height * pitch]: variances before the first level */
    uint32_t *image_point; /* [height * pitch]: packet * 16 + lane, or NOWHERE */
    uint32_t *rest_point;  /* [rest.count] */
    uint32_t *rest_pixel;  /* y * width + x of the first pixel that shows it */
};

static bool points_make(struct points *p, size_t count)
{
    p->count = count;
    p->surface = mem_alloc(count * SURFACE_PLANES, sizeof(float));
    p->light = mem_alloc(count * LIGHT_PLANES, sizeof(float));
    p->next = mem_alloc(count * LIGHT_PLANES, sizeof(float));
    return p->surface && p->light && p->next;
}

static void points_free(struct points *p)
{
    mem_free(p->surface);
    mem_free(p->light);
    mem_free(p->next);
}

void filter_destroy(struct filter *f)
{
    if (!f)
        return;
    points_free(&f->image);
    points_free(&f->rest);
    mem_free(f->first);
    mem_free(f->image_point);
    mem_free(f->rest_point);
    mem_free(f->rest_pixel);
    mem_free(f);
}

static float weight_of(const struct gbuffer_entry *e)
{
    return fabsf(e->weight[0]) + fabsf(e->weight[1]) + fabsf(e->weight[2]);
}

/* Finds the point of every pixel of the image, and marks it: taken[point] = 1. */
static void choose_points(struct filter *f, uint8_t *taken)
{
    const struct gbuffer *g = f->g;

    for (uint32_t y = 0; y < g->height; y++)
        for (uint32_t x = 0; x < f->pitch; x++) {
            uint32_t *best = &f->image_point[y * f->pitch + x];
            const size_t pixel = (size_t)y * g->width + x;
            float most = 0.0f;
            *best = NOWHERE;
            if (x >= g->width)
                continue;
            for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++)
                if (weight_of(&g->entries[k]) > most) {
                    most = weight_of(&g->entries[k]);
                    *best = g->entries[k].point;
                }
            if (*best != NOWHERE)
                taken[*best] = 1;
        }
}

/* The points that are not in the pixel image. Returns their number; f->rest_point NULL: only counts. */
static size_t list_rest(struct filter *f, uint8_t *taken)
{
    const struct gbuffer *g = f->g;
    const uint8_t listed = f->rest_point ? 3 : 2;
    size_t count = 0;

    for (size_t pixel = 0; pixel < (size_t)g->width * g->height; pixel++)
        for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
            const uint32_t point = g->entries[k].point;
            if (taken[point] == 1 || taken[point] == listed)
                continue;
            taken[point] = listed;
            if (f->rest_point) {
                f->rest_point[count] = point;
                f->rest_pixel[count] = (uint32_t)pixel;
            }
            count++;
        }
    return count;
}

/* Lambert surfaces may share light after division by reflectance; others only with the same layer of a material. */
static float kind_of(const struct shade_packet *p, uint32_t lane)
{
    const uint32_t lobe = p->kind == LOBE_LAMBERT ? 0 : 1 + p->material[lane];

    return (float)(2 * lobe + p->behind[lane]) + 0.25f * (float)p->layer[lane];
}

static void put_surface(const struct filter *f, const struct view *v, uint32_t point, float *surface, size_t count,
                        size_t i)
{
    const struct shade_packet *p = &f->g->packets[point / PACKET];
    const uint32_t lane = point % PACKET;
    const float place[3] = { p->x[lane], p->y[lane], p->z[lane] };
    const float normal[3] = { p->ns_x[lane], p->ns_y[lane], p->ns_z[lane] };
    double far = 0.0;

    for (int c = 0; c < 3; c++) {
        surface[(size_t)(SURFACE_NORMAL + c) * count + i] = normal[c];
        surface[(size_t)(SURFACE_PLACE + c) * count + i] = place[c];
        far += (place[c] - v->origin[c]) * (place[c] - v->origin[c]);
    }
    surface[SURFACE_WIDTH * count + i] = (float)(sqrt(far) * f->g->pixel_angle) + 1e-20f;
    surface[SURFACE_KIND * count + i] = kind_of(p, lane);
}

static void put_surfaces(struct filter *f, const struct view *v)
{
    for (size_t i = 0; i < f->image.count; i++)
        if (f->image_point[i] != NOWHERE)
            put_surface(f, v, f->image_point[i], f->image.surface, f->image.count, i);
        else
            f->image.surface[SURFACE_WIDTH * f->image.count + i] = 1.0f;
    for (size_t i = 0; i < f->rest.count; i++)
        put_surface(f, v, f->rest_point[i], f->rest.surface, f->rest.count, i);
}

static bool fill(struct filter *f, const struct view *v, uint8_t *taken)
{
    const struct gbuffer *g = f->g;

    f->pitch = (g->width + PACKET - 1) / PACKET * PACKET;
    f->image_point = mem_alloc(f->pitch * g->height, sizeof(uint32_t));
    f->first = mem_alloc(f->pitch * g->height, sizeof(float));
    if (!f->image_point || !f->first || !points_make(&f->image, f->pitch * g->height))
        return false;
    choose_points(f, taken);
    const size_t rest = list_rest(f, taken);
    f->rest_point = mem_alloc(rest, sizeof(uint32_t));
    f->rest_pixel = mem_alloc(rest, sizeof(uint32_t));
    if (!f->rest_point || !f->rest_pixel || !points_make(&f->rest, rest))
        return false;
    list_rest(f, taken);
    put_surfaces(f, v);
    return true;
}

struct filter *filter_create(const struct gbuffer *g, const struct view *v, const char *level)
{
    struct filter *f = mem_alloc(1, sizeof(*f));
    uint8_t *taken = mem_alloc((size_t)g->packet_count * PACKET, 1);

    if (f) {
        f->g = g;
        f->kernel = filter_kernel_select(level);
    }
    const bool all = f && taken && fill(f, v, taken);
    mem_free(taken);
    if (!all) {
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

/* Channel c of the brightest pixel next to this one, or around it; below 0: there is no surface. */
static float brightest(const struct filter *f, uint32_t pixel, int c)
{
    const uint32_t width = f->g->width, x = pixel % width, y = pixel / width;
    const float *a = f->image.light + (size_t)c * f->image.count, *b = a + 3 * f->image.count;
    float most = -1.0f;

    for (uint32_t v = y > FILTER_RADIUS ? y - FILTER_RADIUS : 0; v <= y + FILTER_RADIUS && v < f->g->height; v++)
        for (uint32_t u = x > FILTER_RADIUS ? x - FILTER_RADIUS : 0; u <= x + FILTER_RADIUS && u < width; u++) {
            const size_t i = (size_t)v * f->pitch + u;
            if (f->image_point[i] != NOWHERE && (u != x || v != y))
                most = fmaxf(most, 0.5f * (a[i] + b[i]));
        }
    return most;
}

/* A point keeps its noise if it has no similar neighbours, or if both halves found something bright by chance. Unless
 * they agree, it is clamped to a multiple of the brightest pixel around it. */
static float without_speck(const struct filter *f, uint32_t pixel, int c, float times, float a, float b)
{
    const float mean = 0.5f * (a + b);

    if (!(fabsf(a - b) > AGREED * mean))
        return mean;
    const float limit = times * brightest(f, pixel, c);
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

/* Writes point i's light from the filtered halves. pixel: the one that shows it. */
static void take_point(const struct filter *f, const struct points *from, size_t i, uint32_t pixel, float times,
                       float light[3])
{
    for (int c = 0; c < 3; c++) {
        const float a = from->light[(size_t)c * from->count + i], b = from->light[(size_t)(3 + c) * from->count + i];
        light[c] = without_speck(f, pixel, c, times, a, b);
    }
}

static void put_point(const struct filter *f, uint32_t point, const float light[3], float *to)
{
    for (int c = 0; c < 3; c++)
        to[at(point, c)] = reflectance(&f->g->packets[point / PACKET], c, point % PACKET) * light[c];
}

static void take_image(const struct filter *f, const float *const half[2], float *to)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < f->image.count; i++) {
        const uint32_t point = f->image_point[i], pixel = (uint32_t)(i / f->pitch * f->g->width + i % f->pitch);
        float light[3], own[2][3];
        if (point == NOWHERE)
            continue;
        take_point(f, &f->image, i, pixel, 1.0f, light);
        for (int k = 0; k < 6; k++)
            own[k / 3][k % 3] =
                half[k / 3][at(point, k % 3)] / reflectance(&f->g->packets[point / PACKET], k % 3, point % PACKET);
        const float w = filtered_share(own, light, f->first[i]);
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
        take_point(f, &f->rest, i, f->rest_pixel[i], REST_CLAMP, light);
        put_point(f, f->rest_point[i], light, to);
    }
}

static struct filter_picture picture_of(const struct filter *f)
{
    struct filter_picture p = { .width = f->g->width, .height = f->g->height, .pitch = f->pitch };

    for (size_t k = 0; k < SURFACE_PLANES; k++)
        p.surface[k] = f->image.surface + k * f->image.count;
    for (size_t k = 0; k < LIGHT_PLANES; k++)
        p.light[k] = f->image.light + k * f->image.count;
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

/* One level over the image; step 0: the mean of the variances. */
static void run_image(struct filter *f, uint32_t step)
{
    const struct filter_picture p = picture_of(f);

#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t y = 0; y < p.height; y++)
        for (uint32_t x = 0; x < p.width; x += FILTER_COUNT_MAX) {
            const uint32_t count = p.width - x < FILTER_COUNT_MAX ? p.width - x : FILTER_COUNT_MAX;
            const struct filter_points row = points_at(&f->image, y * f->pitch + x, count, x, y);
            if (step)
                f->kernel->level(&p, &row, step);
            else
                f->kernel->spread(&p, &row);
        }
}

/* Points outside the image take filtered light from the pixels around them, whose noise was that of `first`. */
static void run_rest(struct filter *f)
{
    struct filter_picture p = picture_of(f);

    p.light[LIGHT_VARIANCE] = f->first;
#pragma omp parallel for schedule(dynamic, 256)
    for (size_t i = 0; i < f->rest.count; i++) {
        const struct filter_points one =
            points_at(&f->rest, i, 1, f->rest_pixel[i] % p.width, f->rest_pixel[i] / p.width);
        f->kernel->level(&p, &one, 1);
    }
}

/* What was written becomes the next one's light. */
static void turn(struct points *p)
{
    float *old = p->light;

    p->light = p->next;
    p->next = old;
}

void filter_run(struct filter *f, const float *const half[2], float *to)
{
    const size_t count = f->image.count;

    put_light(f, half, f->image_point, &f->image);
    put_light(f, half, f->rest_point, &f->rest);
    run_image(f, 0);
    memcpy(f->first, f->image.next + LIGHT_VARIANCE * count, count * sizeof(float));
    memcpy(f->image.light + LIGHT_VARIANCE * count, f->first, count * sizeof(float));
    for (int k = 0; k < FILTER_LEVELS; k++) {
        run_image(f, 1u << k);
        turn(&f->image);
    }
    run_rest(f);
    turn(&f->rest);
    take_image(f, half, to);
    take_rest(f, to);
}

extern const struct filter_kernel filter_kernel_baseline, filter_kernel_v3, filter_kernel_v4;

const struct filter_kernel *filter_kernel_select(const char *level)
{
    static const struct filter_kernel *const by_level[CPU_LEVELS] = KERNEL_TABLE(filter_kernel);
    enum cpu_level chosen;
    struct reason ignored;

    return by_level[cpu_select(level, &chosen, &ignored) ? cpu_best() : chosen];
}
