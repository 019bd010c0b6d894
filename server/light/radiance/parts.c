#include "light/radiance/components.h"

#include "base/file_store.h"
#include "base/half.h"
#include "base/log.h"
#include "base/mem.h"
#include "image/codec/decode.h"
#include "light/cache/memory.h"
#include "sky/daylight/reinhart.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define PATCHES_MOST 2306 /* of MF:4, the finest that --reinhart offers */
#define BLOCK 2048        /* pixels that one thread adds up at a time: they stay in its first cache */

struct parts {
    uint32_t mf, count;
    uint32_t width, height;
    uint16_t *plane; /* [count][3][pixels]: half floats */
    float *scale;    /* [count][3]: a texel is the half float times this */
    float (*radiance)[3];
    char placed[FREE_VIEW_TEXT]; /* of the set that they light; "": none yet */
};

static size_t pixels_of(const struct parts *p)
{
    return (size_t)p->width * p->height;
}

/* ---- Reading ---- */

static enum err reserve(struct parts *p, const struct parts_desc *d, uint32_t count, struct reason *why)
{
    p->width = d->width;
    p->height = d->height;
    p->count = count;
    p->mf = reinhart_subdivision(count);
    assert(p->mf > 0);
    if (!cache_memory_suffices(d->max_bytes, parts_bytes(p)))
        return err_say(why, ERR_RANGE,
                       "--parts '%s': %" PRIu32 " parts of %" PRIu32 "x%" PRIu32
                       " take %.0f MB, above the %.0f MB of --cache-memory",
                       d->from, count, d->width, d->height, 1e-6 * (double)parts_bytes(p),
                       1e-6 * (double)cache_memory_limit(d->max_bytes));
    p->plane = mem_alloc_raw((size_t)count * 3 * pixels_of(p), sizeof(*p->plane));
    p->scale = mem_alloc((size_t)count * 3, sizeof(*p->scale));
    p->radiance = mem_alloc(count, sizeof(*p->radiance));
    return p->plane && p->scale && p->radiance ? ERR_OK
                                               : err_say(why, ERR_NOMEM, "--parts '%s': out of memory", d->from);
}

/* Takes part k from float[pixels][3]. Powers of two keep the bits of what is scaled. */
static void take_part(struct parts *p, uint32_t k, const float *rgb)
{
    const size_t pixels = pixels_of(p);

    for (uint32_t c = 0; c < 3; c++) {
        uint16_t *out = p->plane + ((size_t)k * 3 + c) * pixels;
        float most = 0.0f;
        int exponent = 0;
        for (size_t i = 0; i < pixels; i++)
            most = fmaxf(most, rgb[3 * i + c]);
        if (most > 0.0f)
            (void)frexpf(most, &exponent);
        const float to_half = ldexpf(1.0f, 15 - exponent);
        for (size_t i = 0; i < pixels; i++) {
            const float v = to_half * rgb[3 * i + c];
            out[i] = v >= 0x1p-14f ? half_round(v) : 0;
        }
        p->scale[(size_t)3 * k + c] = most > 0.0f ? ldexpf(1.0f, exponent - 15) : 0.0f;
    }
}

/* How many files there are from number 0 on. */
static enum err count_files(const struct file_pattern *pattern, uint32_t *count, struct reason *why)
{
    char name[4096];
    enum err e = ERR_OK;

    for (*count = 0; !e && *count <= PATCHES_MOST; ++*count) {
        e = file_pattern_name(pattern, *count, name, sizeof(name), why);
        if (!e && access(name, R_OK) != 0)
            break;
    }
    if (e || reinhart_subdivision(*count))
        return e;
    if (*count > PATCHES_MOST)
        return err_say(why, ERR_FORMAT, "%s is one too many: a sky has 146, 578 or 2306 patches, numbered from 0",
                       name);
    const uint32_t next = *count < 146 ? 146 : *count < 578 ? 578 : 2306;
    const bool no_ground = *count == 145 || *count == 577 || *count == 2305;
    return err_say(why, ERR_FORMAT,
                   "%s is missing or not readable: there are %" PRIu32 " files from number 0 on, and a sky of Reinhart "
                   "MF:%" PRIu32 " has %" PRIu32 " patches%s",
                   name, *count, reinhart_subdivision(next), next,
                   no_ground ? ", of which 0 is the ground: is it missing?" : "");
}

static enum err read_file(struct parts *p, const struct file_pattern *pattern, uint32_t k, struct image *im,
                          struct reason *why)
{
    char name[4096];
    enum err e = file_pattern_name(pattern, k, name, sizeof(name), why);

    if (!e)
        e = decode_file(name, im, why);
    if (e)
        return e;
    if (im->width != p->width || im->height != p->height)
        return err_say(why, ERR_USAGE,
                       "%s: is %" PRIu32 "x%" PRIu32 " pixels, and the image %" PRIu32 "x%" PRIu32 ": %s", name,
                       im->width, im->height, p->width, p->height,
                       k == 0 ? "set its size with --size" : "all parts must have the same size");
    take_part(p, k, im->rgb);
    return ERR_OK;
}

static enum err read_files(struct parts *p, const struct parts_desc *d, const struct file_pattern *pattern,
                           struct reason *why)
{
    struct image im = { .middle = true };
    uint32_t count = 0;
    enum err e = count_files(pattern, &count, why);

    if (!e)
        e = reserve(p, d, count, why);
    for (uint32_t k = 0; k < count && !e; k++)
        e = read_file(p, pattern, k, &im, why);
    image_finish(&im);
    return e;
}

static enum err read_matrix(struct parts *p, const struct parts_desc *d, struct reason *why)
{
    struct radiance_matrix m;
    enum err e = radiance_matrix_read(d->from, (size_t)d->width * d->height, &m, why);

    if (e)
        return e;
    if (!reinhart_subdivision(m.columns))
        e = err_say(why, ERR_FORMAT,
                    "%s: has %zu columns; a sky has 146, 578 or 2306 patches, of which 0 is the ground", d->from,
                    m.columns);
    else if (m.rows != (size_t)d->width * d->height)
        e = err_say(why, ERR_USAGE,
                    "%s: has %zu rows, and an image of %" PRIu32 "x%" PRIu32 " %zu pixels: set its size with --size",
                    d->from, m.rows, d->width, d->height, (size_t)d->width * d->height);
    else
        e = reserve(p, d, (uint32_t)m.columns, why);
    for (uint32_t k = 0; k < m.columns && !e; k++)
        take_part(p, k, m.value[(size_t)k * m.rows]);
    mem_free(m.value);
    return e;
}

enum err parts_create(const struct parts_desc *desc, struct parts **out, struct reason *why)
{
    struct file_pattern pattern;
    struct parts *p = mem_alloc(1, sizeof(*p));

    *out = NULL;
    if (!p)
        return err_say(why, ERR_NOMEM, "out of memory");
    enum err e = file_pattern_parse(desc->from, "--parts", &pattern, why);
    if (!e)
        e = pattern.length ? read_files(p, desc, &pattern, why) : read_matrix(p, desc, why);
    if (e) {
        parts_destroy(p);
        return e;
    }
    log_info("%s: %" PRIu32 " parts of %" PRIu32 "x%" PRIu32 ", %.0f MB", desc->from, p->count, p->width, p->height,
             1e-6 * (double)parts_bytes(p));
    *out = p;
    return ERR_OK;
}

void parts_destroy(struct parts *p)
{
    if (!p)
        return;
    mem_free(p->plane);
    mem_free(p->scale);
    mem_free(p->radiance);
    mem_free(p);
}

uint64_t parts_bytes(const struct parts *p)
{
    return (uint64_t)p->count * 3 * pixels_of(p) * sizeof(*p->plane);
}

/* ---- Images ---- */

/* Adds one plane of a part to so many sums. */
static void add(const uint16_t *restrict half, float weight, size_t count, float *restrict sum)
{
    for (size_t i = 0; i < count; i++)
        sum[i] += weight * half_widen(half[i]);
}

void parts_image(const struct parts *p, const float (*radiance)[3], float *rgb)
{
    const size_t pixels = pixels_of(p);

#pragma omp parallel for schedule(static)
    for (size_t from = 0; from < pixels; from += BLOCK) {
        const size_t count = pixels - from < BLOCK ? pixels - from : BLOCK;
        float sum[3][BLOCK];
        memset(sum, 0, sizeof(sum));
        for (uint32_t k = 0; k < p->count; k++)
            for (uint32_t c = 0; c < 3; c++) {
                const float weight = radiance[k][c] * p->scale[(size_t)3 * k + c];
                if (weight > 0.0f)
                    add(p->plane + ((size_t)k * 3 + c) * pixels + from, weight, count, sum[c]);
            }
        for (size_t i = 0; i < count; i++)
            for (uint32_t c = 0; c < 3; c++)
                rgb[3 * (from + i) + c] = sum[c][i];
    }
}

static enum err light(void *self, const struct prepared_scene *set, const struct environment *e, float *rgb,
                      struct reason *why)
{
    struct parts *p = self;

    if (!p->placed[0])
        snprintf(p->placed, sizeof(p->placed), "%s", set->placed);
    if (strcmp(p->placed, set->placed) != 0)
        return err_say(why, ERR_UNSUPPORTED,
                       "the components show one view; another camera needs components of its own, or another method");
    const enum err failed = sky_patches(e, p->mf, p->radiance);
    if (!failed)
        parts_image(p, (const float(*)[3])p->radiance, rgb);
    return failed;
}

struct relight_whole parts_whole(struct parts *p)
{
    return (struct relight_whole){ light, p, "the sky, sun included, is averaged over its patches" };
}
