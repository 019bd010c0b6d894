#include "light/denoise/filter_kernel.h"

#include "base/mem.h"

#include <math.h>
#include <string.h>

#define LIKE_COSINE 0.9f /* of normals, from which points count as neighbours */
#define LIKE_WIDTHS 4.0f /* distance from the tangent plane, in pixel widths, below which they do */
#define COMPANY_LEAST 6  /* points of layers[1] have so many like them within 5 x 5 pixels, themselves included */

/* Zeros, by all threads: most of the time goes into the first access to each page, and the first live image waits. */
static float *make_planes(size_t count, size_t planes)
{
    float *p = mem_alloc_raw(count * planes, sizeof(*p));

    if (!p)
        return NULL;
#pragma omp parallel for schedule(static)
    for (size_t k = 0; k < planes; k++)
        memset(p + k * count, 0, count * sizeof(*p));
    return p;
}

static bool points_make(struct points *p, size_t count)
{
    p->count = count;
    p->surface = make_planes(count, SURFACE_PLANES);
    p->light = make_planes(count, LIGHT_PLANES);
    p->next = make_planes(count, LIGHT_PLANES);
    return p->surface && p->light && p->next;
}

static void points_free(struct points *p)
{
    mem_free(p->surface);
    mem_free(p->light);
    mem_free(p->next);
}

static void layer_free(struct layer *l)
{
    points_free(&l->points);
    mem_free(l->first);
    mem_free(l->point);
    *l = (struct layer){ .point = NULL };
}

static float weight_of(const struct gbuffer_entry *e)
{
    return fabsf(e->weight[0]) + fabsf(e->weight[1]) + fabsf(e->weight[2]);
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

/* Whether points may be averaged: s, and point i of p. */
static bool is_like(const float s[SURFACE_PLANES], const struct points *p, size_t i)
{
    const float *q = p->surface + i;
    float cosine = 0.0f, off = 0.0f;

    if (q[SURFACE_KIND * p->count] != s[SURFACE_KIND])
        return false;
    for (size_t c = 0; c < 3; c++) {
        cosine += s[SURFACE_NORMAL + c] * q[(SURFACE_NORMAL + c) * p->count];
        off += s[SURFACE_NORMAL + c] * (q[(SURFACE_PLACE + c) * p->count] - s[SURFACE_PLACE + c]);
    }
    return cosine > LIKE_COSINE && fabsf(off) < LIKE_WIDTHS * s[SURFACE_WIDTH];
}

/* Whether so many of the layer's points in the 5 x 5 pixels around pixel x, y are like this point, itself included. */
static bool are_like(const struct filter *f, const struct view *v, const struct layer *l, uint32_t x, uint32_t y,
                     uint32_t point, uint32_t many)
{
    const uint32_t top = y > FILTER_RADIUS ? y - FILTER_RADIUS : 0, left = x > FILTER_RADIUS ? x - FILTER_RADIUS : 0;
    float s[SURFACE_PLANES];
    uint32_t count = 0;

    put_surface(f, v, point, s, 1, 0);
    for (uint32_t j = top; j <= y + FILTER_RADIUS && j < f->g->height; j++)
        for (uint32_t i = left; i <= x + FILTER_RADIUS && i < f->g->width; i++)
            if (is_like(s, &l->points, j * f->pitch + i) && ++count == many)
                return true;
    return false;
}

/* The point of pixel x, y with the largest weight, of those that may be in the layer; or NOWHERE. */
static uint32_t heaviest(const struct filter *f, const struct view *v, uint32_t layer, const uint8_t *taken, uint32_t x,
                         uint32_t y)
{
    const struct gbuffer *g = f->g;
    const size_t pixel = (size_t)y * g->width + x;
    uint32_t best = NOWHERE;
    float most = 0.0f;

    for (uint32_t k = g->entry_first[pixel]; k < g->entry_first[pixel + 1]; k++) {
        const struct gbuffer_entry *e = &g->entries[k];
        if (!(weight_of(e) > most))
            continue;
        if (layer && (taken[e->point] || are_like(f, v, &f->layers[0], x, y, e->point, 1)))
            continue;
        most = weight_of(e);
        best = e->point;
    }
    return best;
}

/* Finds the points of a layer, after those of layers[0], and marks them: taken[point] = 1. No two pixels have the same
 * point. */
static void choose_points(struct filter *f, const struct view *v, uint32_t layer, uint8_t *taken)
{
#pragma omp parallel for schedule(dynamic, 8)
    for (uint32_t y = 0; y < f->g->height; y++)
        for (uint32_t x = 0; x < f->pitch; x++) {
            const uint32_t best = x < f->g->width ? heaviest(f, v, layer, taken, x, y) : NOWHERE;
            f->layers[layer].point[y * f->pitch + x] = best;
            if (best != NOWHERE)
                taken[best] = 1;
        }
}

/* Leaves only points in layers[1] that have others like them around; the rest would gain nothing. Returns their number.
 */
static size_t drop_lonely(struct filter *f, const struct view *v, uint8_t *taken)
{
    struct layer *l = &f->layers[1];
    size_t left = 0;

#pragma omp parallel for schedule(dynamic, 8)
    for (uint32_t y = 0; y < f->g->height; y++)
        for (uint32_t x = 0; x < f->g->width; x++) {
            const uint32_t point = l->point[y * f->pitch + x];
            if (point != NOWHERE && !are_like(f, v, l, x, y, point, COMPANY_LEAST))
                taken[point] = 0;
        }
    for (size_t i = 0; i < l->points.count; i++) {
        if (l->point[i] == NOWHERE)
            continue;
        if (taken[l->point[i]]) {
            left++;
            continue;
        }
        l->point[i] = NOWHERE;
        for (size_t c = 0; c < 3; c++)
            l->points.surface[(SURFACE_NORMAL + c) * l->points.count + i] = 0.0f;
    }
    return left;
}

/* The points that are in no layer. Returns their number; f->rest_point NULL: only counts. */
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

static void put_surfaces(const struct filter *f, const struct view *v, const uint32_t *point, struct points *to)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < to->count; i++)
        if (point[i] != NOWHERE)
            put_surface(f, v, point[i], to->surface, to->count, i);
        else
            to->surface[SURFACE_WIDTH * to->count + i] = 1.0f;
}

static bool fill_layer(struct filter *f, const struct view *v, uint32_t k, uint8_t *taken)
{
    struct layer *l = &f->layers[k];
    const size_t count = f->pitch * f->g->height;

    l->point = mem_alloc(count, sizeof(uint32_t));
    l->first = mem_alloc(count, sizeof(float));
    if (!l->point || !l->first || !points_make(&l->points, count))
        return false;
    choose_points(f, v, k, taken);
    put_surfaces(f, v, l->point, &l->points);
    return true;
}

static bool fill_layers(struct filter *f, const struct view *v, uint8_t *taken)
{
    if (!fill_layer(f, v, 0, taken) || !fill_layer(f, v, 1, taken))
        return false;
    f->layer_count = drop_lonely(f, v, taken) > 0 ? 2 : 1;
    if (f->layer_count == 1)
        layer_free(&f->layers[1]);
    return true;
}

static bool fill(struct filter *f, const struct view *v, uint8_t *taken)
{
    f->pitch = (f->g->width + PACKET - 1) / PACKET * PACKET;
    if (!fill_layers(f, v, taken))
        return false;
    const size_t rest = list_rest(f, taken);
    f->rest_point = mem_alloc(rest, sizeof(uint32_t));
    f->rest_pixel = mem_alloc(rest, sizeof(uint32_t));
    if (!f->rest_point || !f->rest_pixel || !points_make(&f->rest, rest))
        return false;
    list_rest(f, taken);
    put_surfaces(f, v, f->rest_point, &f->rest);
    return true;
}

bool filter_layers_make(struct filter *f, const struct view *v)
{
    uint8_t *taken = mem_alloc((size_t)f->g->packet_count * PACKET, 1);
    const bool all = taken && fill(f, v, taken);

    mem_free(taken);
    return all;
}

void filter_layers_free(struct filter *f)
{
    for (int k = 0; k < 2; k++)
        layer_free(&f->layers[k]);
    points_free(&f->rest);
    mem_free(f->rest_point);
    mem_free(f->rest_pixel);
}
