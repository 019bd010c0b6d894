/* Errors of direct light by the cache of light transport. */
#include "measure/bench/bench.h"

#include "base/luminance.h"
#include "base/mem.h"
#include "light/cache_direct/internal.h"
#include "light/resolve/resolve.h"
#include "measure/compare/metrics.h"
#include "sky/tables/pyramid.h"
#include "sky/tables/sky_split.h"

#include <math.h>
#include <stdlib.h>

#define KEY 0.18         /* middle grey */
#define CLAMP_TIMES 8    /* the level falls with each clipping, and soon converges */
#define SEAM_WIDTH 320   /* of the image whose cache is kept without compression: four times as large is 1 GB */
#define SEAM_CODES 1.0   /* a visible difference */
#define STEP_DEGREES 0.1 /* a frame */
#define STEP_FRAMES 24
#define TILE 16u           /* pixels along an edge: the remaining noise is then some percent at most */
#define BINS 65536         /* of second differences */
#define BINS_PER_CODE 4096 /* up to 16 codes, and what is above */

/* ---- The sky without its sun ---- */

static void clamp_image(struct environment *e, float level)
{
    const size_t count = (size_t)e->image.width * e->image.height;

    for (size_t i = 0; i < count; i++) {
        float *t = e->image.rgb + 3 * i;
        const float g = rgb_luminance(t[0], t[1], t[2]);
        for (int k = 0; k < 3 && g > level; k++)
            t[k] *= level / g;
    }
}

/* Clips the source's texels at the level of the split, which makes a sky like any other, for which references can be
 * computed. *out: owned by the caller, after an error too. */
static enum err without_sun(const struct bench *b, struct environment **out)
{
    struct environment *e = environment_create(&(struct environment_desc){ .n = b->skies[0].environment->n });
    struct sky_split sky = { .level = 0.0f };
    struct reason why;
    enum err result = e ? environment_update(e, b->skies[0].frame, &why) : ERR_NOMEM;

    *out = e;
    for (int k = 0; k < CLAMP_TIMES && !result; k++) {
        result = sky_split_take(&sky, e);
        if (result || sky.sun_count == 0)
            break;
        clamp_image(e, sky.level);
        result = environment_rebuild(e, &why);
    }
    sky_split_finish(&sky);
    return result;
}

/* A sky of which hardly any is lit has no level: all of it is its sun. */
static bool has_level(struct bench *b, struct bench_row *row, enum err *e)
{
    struct sky_split sky = { .level = 0.0f };

    *e = sky_split_take(&sky, b->skies[0].environment);
    const bool has = sky.level > 0.0f;
    sky_split_finish(&sky);
    if (!*e && !has)
        bench_skip(row, "hardly any of the sky is lit: it is bright as a whole");
    return !*e && has;
}

/* ---- Bias ---- */

struct tile {
    uint32_t width; /* of the image */
    uint32_t left, top, right, bottom;
};

static double gain_of(const float *rgb, const uint8_t *mask, uint32_t width, uint32_t height)
{
    double log2_mean = log2(KEY);

    (void)exposure_log2_mean(rgb, mask, width, height, &log2_mean);
    return KEY / exp2(log2_mean);
}

/* The sum of delta E^2 over a tile's pixels, as a scalar product of the differences from both halves, in which their
 * noise cancels; *count: pixels. */
static double crosswise_square(const struct cached *c, const struct cached_truth *t, double gain, const struct tile *at,
                               uint32_t *count)
{
    double sum = 0.0;

    *count = 0;
    for (uint32_t y = at->top; y < at->bottom; y++)
        for (uint32_t x = at->left; x < at->right; x++) {
            const size_t i = (size_t)y * at->width + x;
            if (!c->mask[i])
                continue;
            const struct lab ours = lab_of_pixel(c->rgb + 3 * i, gain), p = lab_of_pixel(t->half[0] + 3 * i, gain);
            const struct lab q = lab_of_pixel(t->half[1] + 3 * i, gain);
            sum += (ours.l - p.l) * (ours.l - q.l) + (ours.a - p.a) * (ours.a - q.a) + (ours.b - p.b) * (ours.b - q.b);
            ++*count;
        }
    return sum;
}

/* Roots of mean squares within tiles, their mean over all pixels. The mean of delta E, from which noise cannot be
 * taken, is no more than this. */
static double crosswise_delta_e(const struct cached *c, const struct cached_truth *t, uint32_t width, uint32_t height)
{
    const double gain = gain_of(t->half[0], c->mask, width, height);
    double roots = 0.0;
    uint64_t pixels = 0;

    for (uint32_t y = 0; y < height; y += TILE)
        for (uint32_t x = 0; x < width; x += TILE) {
            const struct tile at = { width, x, y, x + TILE < width ? x + TILE : width,
                                     y + TILE < height ? y + TILE : height };
            uint32_t count;
            const double sum = crosswise_square(c, t, gain, &at, &count);
            roots += count ? count * sqrt(fmax(0.0, sum / count)) : 0.0;
            pixels += count;
        }
    return pixels ? roots / (double)pixels : 0.0;
}

enum err cached_bias(struct bench *b, struct cached *c, bool sun, struct bench_row *rel_mse, struct bench_row *delta_e)
{
    struct environment *clamped = NULL;
    struct cached_truth t = { { NULL } };
    enum err e;

    if (!has_level(b, rel_mse, &e)) {
        *delta_e = *rel_mse;
        return e;
    }
    if (sun)
        e = without_sun(b, &clamped);
    const struct environment *sky = sun ? clamped : b->skies[0].environment;
    if (!e)
        e = cached_truth_make(c, sky, &t);
    if (!e)
        e = relighter_run(c->relighter, sky, &c->light, c->rgb, &c->stats);
    if (!e)
        e = cached_rel_mse(b, c, t.half, c->rgb, &rel_mse->ours);
    if (!e)
        delta_e->ours = crosswise_delta_e(c, &t, b->desc->width, b->desc->height);
    cached_truth_finish(&t);
    environment_destroy(clamped);
    return e;
}

/* ---- 8-bit codes ---- */

/* Linear light to codes by the filmic curve, not rounded; in place. */
static void to_codes(float *rgb, size_t values, double gain)
{
    flip_tone(rgb, values, gain, rgb);
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < values; i++)
        rgb[i] = (float)(255.0 * srgb_encode((double)rgb[i]));
}

/* ---- Seams ---- */

struct seams {
    struct prepared_scene *set;
    struct transport *cache[2]; /* compressed, and not */
    float *lo, *image[2];
    uint8_t *mask;
    uint32_t *block_of; /* [packet_count] */
    size_t pixels;
};

static enum err seams_init(struct seams *s, const struct bench *b, struct bench_row *row)
{
    const bool large = b->desc->width > SEAM_WIDTH;
    const struct prepared_scene_desc desc = {
        .scene = b->desc->scene,
        .reading = b->desc->reading,
        .width = large ? SEAM_WIDTH : b->desc->width,
        .kernels = b->kernels,
        .height = large ? (b->desc->height * SEAM_WIDTH + b->desc->width / 2) / b->desc->width : b->desc->height,
    };
    struct reason why = { "" };
    enum err e = set_create(&desc, &s->set, &why);

    for (int k = 0; k < 2 && !e; k++) {
        const float tolerance = k == 0 ? 0.0f : -1.0f;
        const struct transport_desc t = { .tolerance = tolerance,
                                          .tolerance_glossy = tolerance,
                                          .max_bytes = (uint64_t)4 << 30 };
        e = transport_create(s->set->gbuffer, s->set->rays, b->kernels, &t, &s->cache[k], &why);
    }
    if (e) {
        bench_skip(row, "%.150s", why.text[0] ? why.text : err_text(e));
        return ERR_OK;
    }
    s->pixels = (size_t)desc.width * desc.height;
    s->lo = mem_alloc(s->set->gbuffer->packet_count, 3 * PACKET * sizeof(float));
    s->block_of = mem_alloc(s->set->gbuffer->packet_count, sizeof(*s->block_of));
    s->mask = mem_alloc(s->pixels, 1);
    for (int k = 0; k < 2; k++)
        s->image[k] = mem_alloc(3 * s->pixels, sizeof(float));
    if (!s->lo || !s->block_of || !s->mask || !s->image[0] || !s->image[1])
        return ERR_NOMEM;
    resolve_mask(s->set->gbuffer, s->mask);
    for (uint32_t k = 0; k < s->cache[0]->block_count; k++)
        for (uint32_t i = 0; i < s->cache[0]->blocks[k].packets; i++)
            s->block_of[s->cache[0]->blocks[k].first + i] = k;
    return ERR_OK;
}

static void seams_finish(struct seams *s)
{
    for (int k = 0; k < 2; k++) {
        transport_destroy(s->cache[k]);
        mem_free(s->image[k]);
    }
    mem_free(s->lo);
    mem_free(s->mask);
    mem_free(s->block_of);
    set_destroy(s->set);
}

/* Of the shade point that counts most in a pixel. */
static uint32_t pixel_block(const struct seams *s, size_t pixel)
{
    const struct gbuffer *g = s->set->gbuffer;
    uint32_t best = g->entry_first[pixel];

    for (uint32_t k = best; k < g->entry_first[pixel + 1]; k++)
        if (g->entries[k].weight[1] > g->entries[best].weight[1])
            best = k;
    return s->block_of[g->entries[best].point / PACKET];
}

/* Whether what compression does to two pixels differs by more than a code, in any colour. */
static bool differ(const struct seams *s, size_t i, size_t j)
{
    for (int c = 0; c < 3; c++) {
        const double here = (double)s->image[0][3 * i + c] - (double)s->image[1][3 * i + c];
        const double there = (double)s->image[0][3 * j + c] - (double)s->image[1][3 * j + c];
        if (fabs(here - there) > SEAM_CODES)
            return true;
    }
    return false;
}

/* Pixels with a neighbour of another block to the right or below, and those of them that differ from it. */
static void count_seams(const struct seams *s, uint64_t *all, uint64_t *seen)
{
    const uint32_t width = s->set->gbuffer->width;

    for (size_t i = 0; i < s->pixels; i++) {
        const size_t next[2] = { i % width + 1 < width ? i + 1 : i, i + width < s->pixels ? i + width : i };
        bool has = false, seam = false;
        for (int k = 0; k < 2 && s->mask[i]; k++) {
            if (next[k] == i || !s->mask[next[k]] || pixel_block(s, i) == pixel_block(s, next[k]))
                continue;
            has = true;
            seam |= differ(s, i, next[k]);
        }
        *all += has;
        *seen += seam;
    }
}

static enum err measure_seams(struct seams *s, struct bench *b, struct bench_row *row)
{
    const struct transport_frame frame = { .end = 0 };
    const struct gbuffer *g = s->set->gbuffer;
    struct transport_frame_stats stats;
    uint64_t all = 0, seen = 0;
    enum err e = ERR_OK;

    for (int k = 0; k < 2 && !e; k++) {
        e = transport_shade(s->cache[k], b->skies[0].environment, &frame, s->lo, &stats);
        resolve_pixels(g, s->lo, b->skies[0].environment, s->image[k]);
    }
    if (e)
        return e;
    const double gain = gain_of(s->image[1], s->mask, g->width, g->height);
    for (int k = 0; k < 2; k++)
        to_codes(s->image[k], 3 * s->pixels, gain);
    count_seams(s, &all, &seen);
    if (all == 0)
        bench_skip(row, "no two blocks meet");
    else
        row->ours = 100.0 * (double)seen / (double)all;
    return ERR_OK;
}

enum err cached_seams(struct bench *b, struct bench_row *row)
{
    struct seams s = { .set = NULL };

    enum err e = seams_init(&s, b, row);
    if (!e && !row->skipped[0])
        e = measure_seams(&s, b, row);
    seams_finish(&s);
    return e;
}

/* ---- A sky that moves ---- */

struct motion {
    struct bench *b;
    struct cached *c;
    struct environment *sky;
    struct sky_split split;
    float *codes[3]; /* of the last frames: frame i in i % 3 */
    double gain;
    uint64_t bins[BINS];
};

static void rebuild_pyramid(const struct environment *e)
{
    pyramid_begin(e->pyramid, &e->texels->r);
    for (uint32_t face = 0; face < CUBE_FACES; face++)
        for (uint32_t b = 0; b < (e->n + 7) / 8; b++)
            pyramid_band(e->pyramid, face, b);
    pyramid_end(e->pyramid);
}

/* The lower part of the split, as the cache takes it: with nothing above the level it is all in the cells. */
static enum err keep_lower(struct motion *m)
{
    const size_t count = (size_t)CUBE_FACES * m->sky->n * m->sky->n;
    const enum err e = sky_split_take(&m->split, m->sky);

    for (size_t i = 0; i < count && !e; i++) {
        struct texel *t = &m->sky->texels[i];
        const float g = rgb_luminance(t->r, t->g, t->b);
        const float kept = sky_lower(m->split.level, g);
        t->r *= kept;
        t->g *= kept;
        t->b *= kept;
    }
    if (!e)
        rebuild_pyramid(m->sky);
    return e;
}

static enum err make_frame(struct motion *m, int i)
{
    const struct relight_desc light = { .direct = m->c->light.direct, .classes = PATH_DIRECT };
    const struct environment_desc turned = { .rotation_degrees = STEP_DEGREES * i };
    struct relight_stats stats;
    struct reason why;
    float *to = m->codes[i % 3];

    environment_configure(m->sky, &turned);
    enum err e = environment_rebuild(m->sky, &why);
    if (!e)
        e = keep_lower(m);
    if (!e)
        e = relighter_run(m->c->relighter, m->sky, &light, to, &stats);
    if (e)
        return e;
    if (i == 0)
        m->gain = gain_of(to, m->c->mask, m->b->desc->width, m->b->desc->height);
    to_codes(to, m->c->values, m->gain);
    return ERR_OK;
}

static void count_differences(struct motion *m, int i)
{
    const float *now = m->codes[i % 3], *last = m->codes[(i + 2) % 3], *first = m->codes[(i + 1) % 3];

    for (size_t k = 0; k < m->c->values; k++)
        if (m->c->mask[k / 3]) {
            const double d = fabs((double)now[k] - 2.0 * (double)last[k] + (double)first[k]);
            m->bins[(size_t)fmin(d * BINS_PER_CODE, BINS - 1)]++;
        }
}

/* The least number of codes that all but this share of the differences stay below. */
static double percentile(const struct motion *m, double rest)
{
    uint64_t all = 0, above = 0;
    size_t k = BINS;

    for (size_t i = 0; i < BINS; i++)
        all += m->bins[i];
    while (k > 0 && (double)(above + m->bins[k - 1]) <= rest * (double)all)
        above += m->bins[--k];
    return (double)k / BINS_PER_CODE;
}

static enum err motion_run(struct motion *m, struct bench_row *row)
{
    struct reason why;
    bool room = true;

    for (int k = 0; k < 3; k++) {
        m->codes[k] = mem_alloc(m->c->values, sizeof(float));
        room = room && m->codes[k];
    }
    m->sky = environment_create(&(struct environment_desc){ .n = m->b->skies[0].environment->n });
    enum err e = room && m->sky ? environment_update(m->sky, m->b->skies[0].frame, &why) : ERR_NOMEM;
    for (int i = 0; i < STEP_FRAMES && !e; i++) {
        e = make_frame(m, i);
        if (!e && i >= 2)
            count_differences(m, i);
    }
    row->ours = percentile(m, 1e-4);
    return e;
}

enum err cached_motion(struct bench *b, struct cached *c, struct bench_row *row)
{
    struct motion *m = mem_alloc(1, sizeof(*m)); /* half a megabyte of bins */
    enum err e = ERR_OK;

    if (!m)
        return ERR_NOMEM;
    m->b = b;
    m->c = c;
    if (has_level(b, row, &e))
        e = motion_run(m, row);
    for (int k = 0; k < 3; k++)
        mem_free(m->codes[k]);
    sky_split_finish(&m->split);
    environment_destroy(m->sky);
    mem_free(m);
    return e;
}
