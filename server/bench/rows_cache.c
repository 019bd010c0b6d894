/* Speed of frames by the cache of light transport. */
#include "bench/cached.h"

#include "base/clock.h"
#include "base/mem.h"
#include "resolve/resolve.h"
#include "base/rng.h"

#include <math.h>

#define TRUTH_PASSES 32 /* at most, of */
#define TRUTH_SAMPLES 64
#define TRUTH_SECONDS 20.0    /* for pictures of TRUTH_VALUES; larger ones in proportion, so that theirs are as good */
#define TRUTH_VALUES 691200.0 /* 640 x 360 of three colours */

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

/* ---- References ---- */

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
    /* In pairs, so that both have the same number. */
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

enum err cached_rel_mse(const struct bench *b, const struct cached_truth *t, const float *x, double *out)
{
    struct reason why;
    struct judge j;
    const enum err e = judge_init(&j, t->half[0], t->half[1], b->cached->mask, b->desc->width, b->desc->height, &why);

    *out = e ? 0.0 : judge_error(&j, x);
    judge_finish(&j);
    return e == ERR_RANGE ? ERR_OK : e; /* a black picture has no error */
}

/* ---- Shading ---- */

struct shading {
    struct bench *b;
    struct cached *c;
    struct part *part;
    double seconds; /* of the last frame */
};

/* Direct light by the cache: the sky is split, projected, expanded, and rays are traced to what is bright. Neither the
 * sky's tables nor the sum of the pixels is in the seconds. */
static enum err shade_cached(void *context)
{
    struct shading *s = context;
    struct cached *c = s->c;
    const enum err e = relighter_run(c->relighter, s->b->environment, &c->light, c->rgb, &c->stats);

    s->seconds = 1e-3 * c->stats.shade_ms;
    return e;
}

static enum err shade_bare(void *context)
{
    return bench_part_replay(((struct shading *)context)->part);
}

/* The cache's picture must be no worse than that of mis with as many samples. */
static enum err judge_shading(struct bench *b, struct cached *c, struct bench_row *row)
{
    const struct relight_desc mis = { .direct = { .method = METHOD_MIS, .samples = CACHED_SAMPLES },
                                      .classes = c->light.classes };
    struct relight_stats stats;
    double ours = 0.0, theirs = 0.0;
    enum err e = cached_truth_make(c, b->environment, &c->truth);

    if (!e)
        e = relighter_run(c->relighter, b->environment, &c->light, c->rgb, &c->stats);
    if (!e)
        e = cached_rel_mse(b, &c->truth, c->rgb, &ours);
    if (!e)
        e = relighter_run(c->relighter, b->environment, &mis, c->rgb, &stats);
    if (!e)
        e = cached_rel_mse(b, &c->truth, c->rgb, &theirs);
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
    const struct direct_desc mis = { .method = METHOD_MIS, .samples = CACHED_SAMPLES };
    struct shading s = { .b = b };
    uint64_t rays = 0;
    enum err e = cached_get(b, row, &s.c);

    if (e || !s.c)
        return e;
    row->target = s.c->bright ? 6.0 : 40.0;
    e = bench_part_create(b, &mis, &s.part, &rays);
    /* From the part's rays to CACHED_SAMPLES per shade point of the whole picture. */
    const double part = (double)rays / (CACHED_SAMPLES * (double)b->set->gbuffer->point_count);
    const struct bench_pair pair = { { shade_cached, shade_bare }, &s, { 1.0, part }, true, { &s.seconds } };
    if (!bench_part_skip(&e, rays, row))
        e = bench_time(b, &pair, row);
    bench_part_destroy(s.part);
    return e || row->skipped[0] ? e : judge_shading(b, s.c, row);
}

/* ---- Whole pictures ---- */

/* The target of frames per second by size and sky; 0: there is none. */
static double target_rate(const struct bench *b, const struct cached *c)
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

    enum err e = cached_get(b, row, &c);
    if (e || !c)
        return e;
    row->target = target_rate(b, c);
    row->sense = row->target > 0.0 ? BENCH_AT_LEAST : BENCH_STATED;
    e = bench_pipeline_rate(b, c->relighter, &c->light, row, &busy);
    snprintf(row->note, sizeof(row->note),
             "from EXR to JPEG, decode of the next, light of this and encoding of the "
             "last at once; %s; %.3g ms of processor time an image, which leaves room for %.3g a second on %d "
             "threads; targets: 640x360 with a bright part 30, 1280x720 with one 15, without 40",
             c->bright ? "the sky has a bright part" : "the sky has no bright part", 1e3 * busy, b->threads / busy,
             b->threads);
    return e;
}

/* ---- Interreflection ---- */

struct bounce_frames {
    struct bench *b;
    struct cached *c;
    struct relight_desc with;
    struct relight_stats stats; /* of the last frame with it */
    double seconds[2], eye_s;   /* of the last frames; of eye paths, the mean */
    uint64_t frames;
};

static enum err frame_with(void *context)
{
    struct bounce_frames *f = context;
    const enum err e = relighter_run(f->c->relighter, f->b->environment, &f->with, f->c->rgb, &f->stats);

    f->seconds[0] = 1e-3 * (f->stats.shade_ms + f->stats.eye_ms);
    f->eye_s += (1e-3 * f->stats.eye_ms - f->eye_s) / (double)++f->frames;
    return e;
}

static enum err frame_without(void *context)
{
    struct bounce_frames *f = context;
    struct relight_stats stats;
    const enum err e = relighter_run(f->c->relighter, f->b->environment, &f->c->light, f->c->rgb, &stats);

    f->seconds[1] = 1e-3 * stats.shade_ms;
    return e;
}

/* Direct light with interreflection, and without. */
enum err bench_cached_bounce(struct bench *b, struct bench_row *row)
{
    struct bounce_frames f = { .b = b };
    const struct bench_pair pair = {
        { frame_with, frame_without }, &f, { 1e3, 1e3 }, .seconds = { &f.seconds[0], &f.seconds[1] }
    };
    enum err e = cached_get(b, row, &f.c);

    if (e || !f.c)
        return e;
    f.with = f.c->light;
    f.with.classes |= PATH_INDIRECT;
    if (scene_casters(b->set->scene, NULL, 0) > 0) { /* whose light on other surfaces comes from the stored paths */
        f.with.classes |= PATH_CAUSTICS;
        f.with.stored_paths = (uint64_t)b->desc->width * b->desc->height;
    }
    e = frame_with(&f);
    if (!e && f.stats.plan.indirect != PLAN_CACHE) {
        bench_skip(row, "the cache has none: the surfaces are too dark, or memory does not suffice");
        return ERR_OK;
    }
    const double built = 1e-3 * f.stats.cache_ms;
    if (!e)
        e = bench_time(b, &pair, row);
    const struct relight_stats *s = &f.stats;
    snprintf(row->note, sizeof(row->note),
             "bare: direct light alone; %llu eye paths with %llu rays, for packets with the narrowest lobes and for "
             "what mirrors and glass show, %.3g ms; %u records, %u coefficients, %.0f MB, %.0f s",
             (unsigned long long)s->eye.paths, (unsigned long long)s->eye.rays, 1e3 * f.eye_s, s->bounce.records,
             s->bounce.basis, 1e-6 * (double)s->bounce.bytes, built);
    return e;
}
