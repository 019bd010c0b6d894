/* From lists of overlaps to one, sorted. */
#include "sky/tables/resample.h"

#include "base/mem.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

enum err overlaps_add(struct overlaps *o, uint32_t texel, uint32_t block, double solid_angle)
{
    if (o->count == o->capacity) {
        const size_t capacity = o->capacity ? 2 * o->capacity : 64;
        struct overlap *grown = mem_alloc_raw(capacity, sizeof(*grown));
        if (!grown)
            return ERR_NOMEM;
        if (o->count)
            memcpy(grown, o->items, o->count * sizeof(*grown));
        mem_free(o->items);
        o->items = grown;
        o->capacity = capacity;
    }
    o->items[o->count++] = (struct overlap){ texel, block, solid_angle };
    return ERR_OK;
}

static int by_block(const void *a, const void *b)
{
    const struct overlap *x = a, *y = b;
    return (x->block > y->block) - (x->block < y->block);
}

#define SORT_FEW 32 /* up to here, insertion is faster */

/* Stable, as sums depend on the order of equal blocks. */
static void sort_by_block(struct overlap *items, size_t count)
{
    if (count > SORT_FEW) {
        qsort(items, count, sizeof(*items), by_block);
        return;
    }
    for (size_t i = 1; i < count; i++) {
        const struct overlap item = items[i];
        size_t k = i;
        for (; k > 0 && items[k - 1].block > item.block; k--)
            items[k] = items[k - 1];
        items[k] = item;
    }
}

#define QUARTERS 4

/* A quarter turn, by which azimuths increase: where it moves texel (i, j) of a face, start + i * row + j * column. */
struct turn {
    struct {
        int64_t start, row, column;
    } face[CUBE_FACES];
};

static int64_t turned_texel(uint32_t n, uint32_t face, uint32_t i, uint32_t j)
{
    double w[3];
    float u, v;

    cube_direction(face, (2.0 * j + 1.0) / n - 1.0, (2.0 * i + 1.0) / n - 1.0, w);
    return cube_texel(n, (const float[]){ (float)w[2], (float)w[1], -(float)w[0] }, &u, &v);
}

static struct turn quarter_turn(uint32_t n)
{
    struct turn t;

    for (uint32_t f = 0; f < CUBE_FACES; f++) {
        t.face[f].start = turned_texel(n, f, 0, 0);
        t.face[f].row = turned_texel(n, f, 1, 0) - t.face[f].start;
        t.face[f].column = turned_texel(n, f, 0, 1) - t.face[f].start;
    }
    return t;
}

/* The texels that one stands for, itself first. */
static void turn_texel(const struct turn *t, uint32_t n, size_t texel, size_t out[QUARTERS])
{
    out[0] = texel;
    for (uint32_t q = 1; q < QUARTERS; q++) {
        const size_t face = out[q - 1] / ((size_t)n * n), i = out[q - 1] / n % n, j = out[q - 1] % n;
        out[q] = (size_t)(t->face[face].start + (int64_t)i * t->face[face].row + (int64_t)j * t->face[face].column);
    }
}

static bool stands_for_others(uint32_t n, size_t texel)
{
    const size_t face = texel / ((size_t)n * n), i = texel / n % n, j = texel % n;
    return face == 0 || (face / 2 == 1 && i < n / 2 && j < n / 2);
}

/* Copies a texel's overlaps to those that it stands for. Columns are counted against azimuths. */
static void copy_turned(const struct blocks *b, const struct resample_sorted *s, const size_t turned[QUARTERS])
{
    const uint32_t from = s->first[turned[0]], count = s->first[turned[0] + 1] - from;

    for (uint32_t q = 1; q < QUARTERS; q++) {
        const uint32_t shift = (QUARTERS - q) * (b->columns / QUARTERS);
        struct overlap *to = s->items + s->first[turned[q]];
        for (uint32_t k = 0; k < count; k++) {
            const uint32_t block = s->items[from + k].block, column = block % b->columns;
            to[k].texel = (uint32_t)turned[q];
            to[k].block = block + shift - (column + shift < b->columns ? 0 : b->columns);
            to[k].solid_angle = s->items[from + k].solid_angle;
        }
        sort_by_block(to, count);
    }
}

/* Sets s->first from the texels' numbers of overlaps, of which all lists have `total`. ERR_NOMEM. */
static enum err make_room(const struct blocks *b, uint32_t n, const struct turn *t, uint32_t *counts, size_t total,
                          struct resample_sorted *s)
{
    const size_t texels = (size_t)CUBE_FACES * n * n;
    const bool fourfold = resample_is_fourfold(b, n);

    assert((fourfold ? QUARTERS : 1) * total < UINT32_MAX);
    s->first = mem_alloc_raw(texels + 1, sizeof(*s->first));
    s->items = mem_alloc_raw((fourfold ? QUARTERS : 1) * total, sizeof(*s->items));
    if (!s->first || !s->items)
        return ERR_NOMEM;
    for (size_t k = 0; fourfold && k < texels; k++) {
        size_t turned[QUARTERS];
        if (!stands_for_others(n, k))
            continue;
        turn_texel(t, n, k, turned);
        for (uint32_t q = 1; q < QUARTERS; q++)
            counts[turned[q]] = counts[k];
    }
    s->first[0] = 0;
    for (size_t k = 0; k < texels; k++)
        s->first[k + 1] = s->first[k] + counts[k];
    return ERR_OK;
}

enum err resample_gather(const struct blocks *b, uint32_t n, struct overlaps *lists, uint32_t count,
                         struct resample_sorted *s)
{
    const size_t texels = (size_t)CUBE_FACES * n * n;
    const bool fourfold = resample_is_fourfold(b, n);
    const struct turn t = fourfold ? quarter_turn(n) : (struct turn){ 0 };
    size_t total = 0;

    for (uint32_t i = 0; i < count; i++) {
        if (lists[i].e)
            return lists[i].e;
        total += lists[i].count;
    }
    uint32_t *left = mem_alloc(texels, sizeof(*left)); /* numbers of overlaps; then of those not yet in place */
    if (!left)
        return ERR_NOMEM;
    for (uint32_t i = 0; i < count; i++)
        for (size_t k = 0; k < lists[i].count; k++)
            left[lists[i].items[k].texel]++;
    const enum err e = make_room(b, n, &t, left, total, s);
    for (uint32_t i = 0; i < count && !e; i++) {
        for (size_t k = 0; k < lists[i].count; k++) {
            const uint32_t texel = lists[i].items[k].texel;
            s->items[s->first[texel + 1] - left[texel]--] = lists[i].items[k];
        }
        mem_free(lists[i].items);
        lists[i].items = NULL;
    }
    mem_free(left);
    if (e)
        return e;
#pragma omp parallel for schedule(dynamic, 1024)
    for (size_t k = 0; k < texels; k++) {
        size_t turned[QUARTERS];
        if (fourfold && !stands_for_others(n, k))
            continue;
        sort_by_block(s->items + s->first[k], s->first[k + 1] - s->first[k]);
        if (!fourfold)
            continue;
        turn_texel(&t, n, k, turned);
        copy_turned(b, s, turned);
    }
    return ERR_OK;
}
