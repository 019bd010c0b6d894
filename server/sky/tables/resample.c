#include "sky/tables/resample.h"

#include "base/mem.h"

#include <assert.h>
#include <string.h>

enum err resampler_create(struct resample_tables *tables, const struct resample_key *key, struct resampler **out)
{
    struct resampler *r = mem_alloc(1, sizeof(*r));

    *out = NULL;
    if (!r)
        return ERR_NOMEM;
    r->tables = tables;
    enum err e = resample_table_take(tables, key, &r->taken);
    r->table = r->taken;
    if (!e && r->table->factor > 1) {
        r->reduced = mem_alloc(3 * (size_t)r->table->columns * r->table->rows, sizeof(*r->reduced));
        e = r->reduced ? ERR_OK : ERR_NOMEM;
    }
    if (e)
        resampler_destroy(r);
    else
        *out = r;
    return e;
}

void resampler_destroy(struct resampler *r)
{
    if (!r)
        return;
    resample_table_release(r->tables, r->taken);
    mem_free(r->reduced);
    mem_free(r);
}

void resampler_load(struct resampler *r, const float *rgb)
{
    const struct resample_table *t = r->table;
    double mean[3] = { 0.0, 0.0, 0.0 };

    r->source = rgb;
    if (t->factor > 1) {
        struct blocks b;
        blocks_init(&b, t->key.layout, t->key.width, t->key.height, t->factor);
#pragma omp parallel for schedule(static)
        for (uint32_t y = 0; y < t->rows; y++)
            resample_reduce_row(t, &b, rgb, y, r->reduced + 3 * (size_t)y * t->columns);
        r->source = r->reduced;
    }
    for (size_t k = 0; t->unseen && k < (size_t)t->columns * t->rows; k++)
        for (int c = 0; c < 3; c++)
            mean[c] += (double)t->block_sum[k] * r->source[3 * k + (size_t)c];
    for (int c = 0; c < 3; c++)
        r->mean[c] = (float)mean[c];
}

/* Loads four floats per texel instead of three, as one vector; the fourth is the next texel's red and is dropped. */
#define FOUR_FLOATS __attribute__((vector_size(4 * sizeof(float)))) float

static inline size_t place_of(const struct resample_table *t, const struct octet *e, uint32_t step, uint32_t lane)
{
    const size_t at = (size_t)8 * step + lane;
    return e->base + (size_t)(t->near ? t->near[at] : t->far[at]);
}

/* Sums one lane alone, in double: where a coarse cube map meets a fine source, thousands of terms add up. Also used at
 * the very end of the source, where there is no next texel to load. */
static void sum_lane(const struct resampler *r, const struct octet *e, uint32_t lane, float out[4])
{
    const struct resample_table *t = r->table;
    const uint32_t end = t->columns * t->rows - 1;
    uint32_t last = e[1].first;
    float few[3] = { 0.0f, 0.0f, 0.0f };
    double many[3] = { 0.0, 0.0, 0.0 };

    while (last > e->first && t->weight[(size_t)8 * (last - 1) + lane] == 0.0f)
        last--;
    const bool exact = last - e->first > RESAMPLE_MANY || (last > e->first && place_of(t, e, last - 1, lane) == end);
    for (uint32_t k = e->first; k < last; k++) {
        const float weight = t->weight[(size_t)8 * k + lane];
        const float *s = r->source + 3 * place_of(t, e, k, lane);
        for (int c = 0; c < 3; c++) {
            few[c] += weight * s[c];
            many[c] += (double)weight * s[c];
        }
    }
    for (int c = 0; c < 3; c++)
        out[c] = exact ? (float)many[c] : few[c];
}

static inline void sum_octet(const struct resample_table *t, const struct octet *e, const float *restrict source,
                             bool near, FOUR_FLOATS *restrict out)
{
    FOUR_FLOATS sum[8] = { { 0.0f } };
    const float *from = source + 3 * (size_t)e->base;
    const size_t end = (size_t)8 * e[1].first;

    for (size_t k = (size_t)8 * e->first; k < end; k += 8)
#pragma GCC unroll 8
        for (int l = 0; l < 8; l++) {
            FOUR_FLOATS s;
            memcpy(&s, from + 3 * (size_t)(near ? t->near[k + (size_t)l] : t->far[k + (size_t)l]), sizeof(s));
            sum[l] += t->weight[k + (size_t)l] * s;
        }
#pragma GCC unroll 8
    for (int l = 0; l < 8; l++)
        out[l] = sum[l];
}

/* Stores the sums of an octet, adding the mean for directions that the layout does not cover. */
static inline void finish_octet(const struct resampler *r, float gain, const struct octet *e, bool near,
                                FOUR_FLOATS out[8])
{
    const struct resample_table *t = r->table;

    if (e->careful) {
        for (uint32_t l = 0; l < 8; l++) {
            float sum[4] = { 0.0f };
            sum_lane(r, e, l, sum);
            memcpy(&out[l], sum, sizeof(sum));
        }
    } else {
        sum_octet(t, e, r->source, near, out);
    }
    if (t->unseen) {
        const float *unseen = t->unseen + 8 * (e - t->octets);
        const FOUR_FLOATS mean = { r->mean[0], r->mean[1], r->mean[2], 0.0f };
        for (int l = 0; l < 8; l++)
            out[l] += unseen[l] * mean;
    }
    for (int l = 0; l < 8; l++)
        out[l] *= gain;
}

static inline void fill_tile(const struct resampler *r, float gain, const struct octet *e, bool near, float *texels)
{
    const uint32_t pitch = 4 * RESAMPLE_PITCH(r->table->key.n);
    FOUR_FLOATS sum[8];

    for (uint32_t k = 0; k < OCTETS; k++, e++) {
        finish_octet(r, gain, e, near, sum);
        for (uint32_t l = 0; l < 8; l++)
            memcpy(texels + e->texel[l] / TILE * pitch + e->texel[l] % TILE * 4, &sum[l], sizeof(sum[l]));
    }
}

/* Prefetches what the next tile reads: its rows lie too far apart for the hardware prefetcher. This saves 12 to 19 % of
 * the time for sources of 1024x512 texels and more. */
static inline void fetch_tile(const struct resampler *r, size_t tile)
{
    const struct resample_table *t = r->table;
    const uintptr_t from = (uintptr_t)(r->source + 3 * (size_t)t->octets[OCTETS * tile].base) / LINE_BYTES;

    for (uint32_t k = t->line_first[tile]; k < t->line_first[tile + 1]; k++)
        __builtin_prefetch((const void *)((from + t->line[k]) * LINE_BYTES));
}

void resampler_band(const struct resampler *r, float gain, uint32_t face, uint32_t b, float *texels)
{
    const struct resample_table *t = r->table;
    const size_t first = ((size_t)face * t->across + b) * t->across;

    assert(face < CUBE_FACES && b < t->across && r->source);
    for (uint32_t k = 0; k < t->across; k++)
        if (t->near) {
            if (k + 1 < t->across)
                fetch_tile(r, first + k + 1);
            fill_tile(r, gain, t->octets + OCTETS * (first + k), true, texels + 4 * TILE * k);
        } else {
            fill_tile(r, gain, t->octets + OCTETS * (first + k), false, texels + 4 * TILE * k);
        }
}
