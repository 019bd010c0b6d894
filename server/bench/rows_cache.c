/* Frames by the cache of light transport: how fast. */
#include "bench/cached.h"

#include "base/clock.h"
#include "base/mem.h"
#include "light/resolve.h"
#include "base/rng.h"

#include <math.h>
#include <string.h>

#define TRUTH_PASSES 32 /* at most, of */
#define TRUTH_SAMPLES 64
#define TRUTH_SECONDS 20.0    /* for pictures of TRUTH_VALUES; larger ones in proportion, so that theirs are as good */
#define TRUTH_VALUES 691200.0 /* 640 x 360 of three colours */
#define SHORT_SECONDS 4e-3    /* frames that are shorter are made several times in a row, */
#define REPEATS_MAX 64        /* at most so many */

/* ---- The cache ---- */

static enum err make(struct bench *b, struct cached *c)
{
    const size_t pixels = (size_t)b->desc->width * b->desc->height;
    double ms = 0.0;

    c->light = (struct relight_desc){
        .direct = { .method = METHOD_CACHED, .samples = CACHED_SAMPLES, .why = &c->why },
        .classes = PATH_BACKGROUND | PATH_DIRECT,
    };
    c->values = 3 * pixels;
    c->relighter = relighter_create(b->set, b->kernels);
    c->rgb = mem_alloc(c->values, sizeof(*c->rgb));
    c->mask = mem_alloc(pixels, 1);
    if (!c->relighter || !c->rgb || !c->mask)
        return ERR_NOMEM;
    resolve_mask(b->set->gbuffer, c->mask);
    enum err e = relighter_prepare(c->relighter, &c->light, false, &ms);
    c->seconds = 1e-3 * ms;
    c->refused = e == ERR_RANGE;
    if (!e)
        e = relighter_run(c->relighter, b->environment, &c->light, c->rgb, &c->stats);
    c->bright = c->stats.cache_frame.bright > 0;
    return c->refused ? ERR_OK : e;
}

enum err cached_get(struct bench *b, struct bench_row *row, struct cached **out)
{
    enum err e = ERR_OK;

    *out = NULL;
    if (!b->cached) {
        b->cached = mem_alloc(1, sizeof(*b->cached));
        e = b->cached ? make(b, b->cached) : ERR_NOMEM;
    }
    if (e)
        return e;
    if (b->cached->refused)
        bench_skip(row, "%.150s", b->cached->why.text);
    else
        *out = b->cached;
    return ERR_OK;
}

void cached_destroy(struct cached *c)
{
    if (!c)
        return;
    relighter_destroy(c->relighter);
    environment_destroy(c->clamped);
    cached_truth_finish(&c->truth);
    mem_free(c->rgb);
    mem_free(c->mask);
    mem_free(c);
}

/* ---- What it should be ---- */

enum err cached_truth_make(struct cached *c, const struct environment *e, struct cached_truth *t)
{
    struct relight_desc light = {
        .direct = { .method = METHOD_AUTO, .samples = TRUTH_SAMPLES, .seed = rng_mix(1, 0x7472757468u) },
        .classes = c->light.classes,
    };
    struct relight_stats stats;
    const double start = clock_seconds(), most = TRUTH_SECONDS * fmax(1.0, (double)c->values / TRUTH_VALUES);
    uint32_t passes = 0;
    enum err result = ERR_OK;

    if (t->half[0])
        return ERR_OK;
    for (int k = 0; k < 2; k++)
        t->half[k] = mem_alloc(c->values, sizeof(float));
    if (!t->half[0] || !t->half[1])
        return ERR_NOMEM;
    /* By twos, so that both have as many. */
    for (; passes < TRUTH_PASSES && !result && (passes % 2 || clock_seconds() - start < most); passes++) {
        float *to = t->half[passes % 2];
        light.direct.pass = passes;
        result = relighter_run(c->relighter, e, &light, c->rgb, &stats);
        for (size_t i = 0; i < c->values && !result; i++)
            to[i] += c->rgb[i];
    }
    for (int k = 0; k < 2; k++)
        for (size_t i = 0; i < c->values; i++)
            t->half[k][i] *= 2.0f / (float)passes;
    t->samples = passes * TRUTH_SAMPLES;
    return result;
}

void cached_truth_finish(struct cached_truth *t)
{
    mem_free(t->half[0]);
    mem_free(t->half[1]);
    *t = (struct cached_truth){ .samples = 0 };
}

double cached_rel_mse(const struct cached *c, const struct cached_truth *t, const float *x)
{
    double mean = 0.0, sum = 0.0;
    uint64_t count = 0;

    for (size_t i = 0; i < c->values; i++)
        if (c->mask[i / 3]) {
            mean += 0.5 * ((double)t->half[0][i] + (double)t->half[1][i]);
            count++;
        }
    if (count == 0 || mean <= 0.0)
        return 0.0;
    mean /= (double)count;
    for (size_t i = 0; i < c->values; i++)
        if (c->mask[i / 3]) {
            const double p = x[i], q = t->half[0][i], r = t->half[1][i], middle = 0.5 * (q + r);
            sum += (p - q) * (p - r) / (middle * middle + 1e-2 * mean * mean);
        }
    return sum / (double)count;
}

/* ---- Shading ---- */

struct shading {
    struct bench *b;
    struct cached *c;
    struct part *part;
    int repeats;  /* of a frame, in one round */
    double scale; /* from the part's rays to CACHED_SAMPLES a shade point of the whole picture */
};

/* Seconds of direct light by the cache: the sky is split, projected, expanded, and rays are traced to what is bright.
 * Neither the sky's tables nor the sum of the pixels. */
static enum err time_cached(const struct shading *s, double *seconds)
{
    enum err e = ERR_OK;

    *seconds = 0.0;
    for (int k = 0; k < s->repeats && !e; k++) {
        e = relighter_run(s->c->relighter, s->b->environment, &s->c->light, s->c->rgb, &s->c->stats);
        *seconds += 1e-3 * s->c->stats.shade_ms / s->repeats;
    }
    return e;
}

static enum err time_bare(const struct shading *s, double *seconds)
{
    const double start = clock_seconds();
    const enum err e = bench_part_replay(s->part);

    *seconds = s->scale * (clock_seconds() - start);
    return e;
}

static enum err shade_in_turns(struct shading *s, struct bench_row *row)
{
    double ours[BENCH_ROUNDS_MAX], bare[BENCH_ROUNDS_MAX], once = 1.0, alone = 1.0;

    s->repeats = 2;
    enum err e = time_cached(s, &once);
    if (!e)
        e = time_bare(s, &alone);
    s->repeats = (int)fmin(fmax(ceil(SHORT_SECONDS / fmax(once, 1e-9)), 1.0), REPEATS_MAX);
    const int rounds = bench_rounds(s->b, s->repeats * once + alone / s->scale);
    for (int i = 0; i < rounds && !e; i++) {
        for (int j = 0; j < 2 && !e; j++) { /* each goes first in half of the rounds */
            const bool first = (i + j) % 2 == 0;
            double *to = first ? &ours[i] : &bare[i];
            e = (first ? time_cached : time_bare)(s, to);
            *to = 1.0 / *to;
        }
        progress_step(&s->b->line, 1);
    }
    if (!e)
        bench_take(row, ours, bare, rounds);
    return e;
}

/* The picture of the cache must be no worse than that of as many samples. */
static enum err judge_shading(struct bench *b, struct cached *c, struct bench_row *row)
{
    const struct relight_desc mis = { .direct = { .method = METHOD_MIS, .samples = CACHED_SAMPLES },
                                      .classes = c->light.classes };
    struct relight_stats stats;
    enum err e = cached_truth_make(c, b->environment, &c->truth);

    if (!e)
        e = relighter_run(c->relighter, b->environment, &c->light, c->rgb, &c->stats);
    const double ours = e ? 0.0 : cached_rel_mse(c, &c->truth, c->rgb);
    if (!e)
        e = relighter_run(c->relighter, b->environment, &mis, c->rgb, &stats);
    const double theirs = e ? 0.0 : cached_rel_mse(c, &c->truth, c->rgb);
    row->broken = ours > theirs;
    snprintf(row->note, sizeof(row->note),
             "bare: %d rays a shade point, as rtcOccluded16 answers those of mis; relMSE %.2g, of mis with %d samples "
             "%.2g (%u samples of auto); cache: %.0f s, %.0f MB; bright part: %.3g of the light, %llu rays, %u of %u "
             "packets in penumbrae",
             CACHED_SAMPLES, ours, CACHED_SAMPLES, theirs, c->truth.samples, c->seconds,
             1e-6 * (double)c->stats.cache.bytes, c->stats.cache_frame.share,
             (unsigned long long)c->stats.cache_frame.rays, c->stats.cache_frame.penumbra, c->stats.cache.packets);
    return e;
}

enum err bench_cached_shading(struct bench *b, struct bench_row *row)
{
    struct shading s = { .b = b };
    uint64_t rays = 0;

    row->name = "cached: shading";
    row->unit = "frames/s";
    enum err e = cached_get(b, row, &s.c);
    if (e || !s.c)
        return e;
    row->sense = BENCH_AT_LEAST;
    row->target = s.c->bright ? 6.0 : 40.0;
    e = bench_part_create(b, CACHED_SAMPLES, &s.part, &rays);
    s.scale = CACHED_SAMPLES * (double)b->set->gbuffer->point_count / (double)rays;
    if (e == ERR_RANGE || (!e && rays == 0)) {
        bench_skip(row, e ? "too many rays to write down" : "nothing is lit, so that no ray is traced");
        e = ERR_OK;
    } else if (!e) {
        e = shade_in_turns(&s, row);
    }
    bench_part_destroy(s.part);
    return e || row->skipped[0] ? e : judge_shading(b, s.c, row);
}

/* ---- Whole pictures ---- */

/* Frames a second that are wished for, by size and sky; 0: nothing is. */
static double wished_rate(const struct bench *b, const struct cached *c)
{
    const uint32_t width = b->desc->width, height = b->desc->height;

    if (width == 640 && height == 360 && c->bright)
        return 30.0;
    if (width == 1280 && height == 720)
        return c->bright ? 15.0 : 40.0;
    return 0.0;
}

enum err bench_cached_pipeline(struct bench *b, struct bench_row *row)
{
    struct cached *c;
    double busy = 1.0;

    row->name = "cached: whole pipeline";
    row->unit = "frames/s";
    enum err e = cached_get(b, row, &c);
    if (e || !c)
        return e;
    row->target = wished_rate(b, c);
    row->sense = row->target > 0.0 ? BENCH_AT_LEAST : BENCH_STATED;
    e = bench_pipeline_rate(b, c->relighter, &c->light, row, &busy);
    snprintf(row->note, sizeof(row->note),
             "from EXR to JPEG, decode of the next, light of this and encoding of the "
             "last at once; %s; %.3g ms of processor time a picture, which leaves room for %.3g a second on %d "
             "threads; targets: 640x360 with a bright part 30, 1280x720 with one 15, without 40",
             c->bright ? "the sky has a bright part" : "the sky has no bright part", 1e3 * busy, b->threads / busy,
             b->threads);
    return e;
}

/* ---- Interreflection ---- */

/* One frame's direct light, and what comes to it. */
static enum err time_light(struct bench *b, struct cached *c, const struct relight_desc *light, struct relight_stats *s,
                           double *ms)
{
    const enum err e = relighter_run(c->relighter, b->environment, light, c->rgb, s);

    *ms = s->shade_ms + s->eye_ms;
    return e;
}

/* Direct light with what comes to it, and without, in turns. */
enum err bench_cached_bounce(struct bench *b, struct bench_row *row)
{
    double with[BENCH_ROUNDS_MAX], without[BENCH_ROUNDS_MAX], eye[BENCH_ROUNDS_MAX];
    struct relight_stats s = { 0 }, direct;
    struct cached *c;

    row->name = "cached: interreflection";
    row->unit = "ms";
    enum err e = cached_get(b, row, &c);
    if (e || !c)
        return e;
    struct relight_desc light = c->light;
    row->sense = BENCH_AT_MOST;
    row->target = 1.2;
    light.classes |= PATH_INDIRECT;
    if (scene_casters(b->set->scene, NULL, 0) > 0) { /* whose light on other surfaces is then the stored paths' */
        light.classes |= PATH_CAUSTICS;
        light.stored_paths = (uint64_t)b->desc->width * b->desc->height;
    }
    e = relighter_run(c->relighter, b->environment, &light, c->rgb, &s);
    if (!e && s.plan.indirect != PLAN_CACHE) {
        bench_skip(row, "the cache has none: the surfaces are too dark, or memory does not suffice");
        return ERR_OK;
    }
    const double built = 1e-3 * s.cache_ms;
    const int rounds = e ? 0 : bench_rounds(b, 2e-3 * (s.shade_ms + s.eye_ms + s.resolve_ms + s.light_ms));
    for (int i = 0; i < rounds && !e; i++) {
        for (int j = 0; j < 2 && !e; j++) /* each goes first in half of the rounds */
            e = (i + j) % 2 == 0 ? time_light(b, c, &light, &s, &with[i])
                                 : time_light(b, c, &c->light, &direct, &without[i]);
        eye[i] = s.eye_ms;
        progress_step(&b->line, 1);
    }
    if (e)
        return e;
    bench_take(row, with, without, rounds);
    snprintf(
        row->note, sizeof(row->note),
        "bare: direct light alone, in turns; %llu eye paths with %llu rays, for packets with the narrowest lobes and "
        "for what mirrors and glass show, %.3g ms; %u records, %u coefficients, %.0f MB, %.0f s",
        (unsigned long long)s.eye.paths, (unsigned long long)s.eye.rays, bench_median(eye, rounds), s.bounce.records,
        s.bounce.basis, 1e-6 * (double)s.bounce.bytes, built);
    return ERR_OK;
}
