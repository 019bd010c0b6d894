#include "measure/bench/speed.h"

#include "base/clock.h"
#include "base/mem.h"
#include "image/codec/exr_write.h"
#include "measure/bench/cached.h"
#include "measure/chart/chart.h"
#include "measure/chart/truth.h"

#define TRUTH_PARTS 2 /* of each half: little noise, which multiplying crosswise takes out of the mean */

struct speed {
    struct bench b;
    struct cached *c;
    struct relight_desc all, direct;
    struct part *part;      /* whose rays are the bare ones */
    double per_image;     /* all of the image's bare rays over those of the part */
    double all_s, direct_s; /* of the last images */
    double exr_ms;          /* from a sky to a float EXR */
};

static enum err shade(struct speed *s, const struct relight_desc *light, double *seconds)
{
    struct relight_stats *stats = &s->c->stats;
    const enum err e = relighter_run(s->c->relighter, s->b.sky->environment, light, s->c->rgb, stats);

    bench_count(&s->b, stats);
    *seconds = 1e-3 * (stats->shade_ms + stats->eye_ms + stats->light_ms);
    return e;
}

/* Without frames that were not computed whole. */
static enum err time_pair(struct speed *s, const struct bench_pair *pair, struct bench_row *row)
{
    const enum err e = bench_time(&s->b, pair, row);

    return e || !row->skipped[0] ? e : err_say(&s->c->why, ERR_RANGE, "%s", row->skipped);
}

static enum err shade_all(void *context)
{
    struct speed *s = context;

    s->all.turn++;
    return shade(s, &s->all, &s->all_s);
}

static enum err shade_direct(void *context)
{
    struct speed *s = context;

    return shade(s, &s->direct, &s->direct_s);
}

static enum err bare(void *context)
{
    return bench_part_replay(((struct speed *)context)->part);
}

/* The rays of an image by `mis` under this sky. */
static enum err record_bare(struct speed *s)
{
    const struct direct_desc mis = { .method = METHOD_MIS, .samples = CACHED_SAMPLES };
    uint64_t rays = 0;

    const enum err e = bench_part_create(&s->b, &mis, &s->part, &rays);
    s->per_image = rays ? CACHED_SAMPLES * (double)s->b.set->gbuffer->point_count / (double)rays : 0.0;
    return e == ERR_RANGE ? ERR_OK : e;
}

static enum err measure_shading(struct speed *s, struct speed_sky *out)
{
    struct bench_row row = { .name = NULL };
    const struct bench_pair against = {
        { shade_all, shade_direct }, s, { 1e3, 1e3 }, .seconds = { &s->all_s, &s->direct_s }
    };
    enum err e = time_pair(s, &against, &row);

    if (e)
        return e;
    out->all_ms = row.ours;
    out->direct_ms = row.bare;
    out->all_over_direct = row.ratio;
    e = record_bare(s);
    const struct bench_pair pair[2] = {
        { { bare, shade_all }, s, { s->per_image, 1.0 }, .seconds = { NULL, &s->all_s } },
        { { bare, shade_direct }, s, { s->per_image, 1.0 }, .seconds = { NULL, &s->direct_s } },
    };
    double *const ratio[2] = { &out->bare_all, &out->bare_direct };
    for (int k = 0; k < 2 && !e && s->per_image > 0.0; k++) {
        e = time_pair(s, &pair[k], &row);
        *ratio[k] = row.ratio;
    }
    bench_part_destroy(s->part);
    s->part = NULL;
    return e;
}

/* From the sky's file to a float EXR in memory. */
static enum err write_exr(void *context)
{
    struct speed *s = context;
    const struct bench *b = &s->b;
    const struct exr_desc d = { .rgb = s->c->rgb, .width = b->desc->width, .height = b->desc->height };
    struct reason why;
    double ignored;
    uint8_t *bytes = NULL;
    size_t size;
    enum err e = bench_read_sky(b->sky);

    if (!e)
        e = shade(s, &s->direct, &ignored);
    if (!e)
        e = exr_encode(&d, &bytes, &size, &why);
    mem_free(bytes);
    return e;
}

static enum err time_exr(void *context)
{
    struct speed *s = context;
    struct bench_row row = { .name = NULL };
    const struct bench_pair pair = { { write_exr }, s, .scale = { 1e3 } };
    const enum err e = time_pair(s, &pair, &row);

    s->exr_ms = row.ours;
    return e;
}

static enum err measure_images(struct speed *s, struct speed_sky *out)
{
    const struct relight_desc *const light[2] = { &s->all, &s->direct };
    double *const jpeg[2] = { &out->jpeg_all, &out->jpeg_direct };
    struct bench_row row = { .name = NULL };
    enum err e = ERR_OK;

    for (int k = 0; k < 2 && !e; k++) {
        e = bench_pipeline_rate(&s->b, s->c->relighter, light[k], &row, jpeg[k]);
        *jpeg[k] *= 1e3;
        if (!e && row.skipped[0])
            e = err_say(&s->c->why, ERR_RANGE, "%s", row.skipped);
    }
    if (!e)
        e = bench_threads(&s->b, 1, time_exr, s);
    out->exr_direct = s->exr_ms;
    return e;
}

/* Of the cache and of `mis`, with this light. */
static enum err judge(struct speed *s, const struct relight_desc *light, double *ours, double *theirs)
{
    const struct relight_desc mis = { .direct = { .method = METHOD_MIS, .samples = SPEED_MIS_SAMPLES },
                                      .classes = light->classes };
    const struct truth_desc by_path = { .set = s->b.set,
                                        .environment = s->b.skies[0].environment,
                                        .frame = s->b.skies[0].frame,
                                        .classes = light->classes,
                                        .samples = TRUTH_PARTS * TRUTH_PART };
    struct truth truth;
    double ignored;

    bench_first_sky(&s->b);
    enum err e = truth_make(&by_path, &truth, &s->c->why);
    if (!e)
        e = shade(s, light, &ignored);
    if (!e)
        e = cached_rel_mse(&s->b, s->c, truth.half, s->c->rgb, ours);
    if (!e)
        e = shade(s, &mis, &ignored);
    if (!e)
        e = cached_rel_mse(&s->b, s->c, truth.half, s->c->rgb, theirs);
    truth_finish(&truth);
    return e;
}

static enum err measure_bias(struct speed *s, struct speed_sky *out)
{
    s->c->light.classes = s->direct.classes;
    out->judged = true;
    bench_first_sky(&s->b);
    enum err e = cached_bias(&s->b, s->c, out->sun, &out->bias, &out->colour);
    if (!e)
        e = cached_seams(&s->b, &out->seams);
    return e ? e : cached_motion(&s->b, s->c, &out->motion);
}

static enum err measure_sky(struct speed *s, const char *source, bool judged, struct speed_sky *out, struct reason *why)
{
    out->error_direct = out->error_all = -1.0;
    enum err e = bench_take_skies(&s->b, source, why);
    if (e)
        return e;
    e = measure_shading(s, out);
    out->sun = s->c->stats.cache_frame.sun > 0;
    if (!e)
        e = measure_images(s, out);
    if (!e && judged)
        e = judge(s, &s->direct, &out->error_direct, &out->mis_direct);
    if (!e && judged)
        e = judge(s, &s->all, &out->error_all, &out->mis_all);
    if (!e && judged)
        e = measure_bias(s, out);
    return e ? err_say(why, e, "%s: %s", out->title, s->c->why.text[0] ? s->c->why.text : err_text(e)) : ERR_OK;
}

/* The cache of direct light and what all light needs besides. */
static enum err precompute(struct speed *s, struct speed_case *out, struct reason *why)
{
    const double start = clock_seconds(), busy = clock_processor();
    double ms;
    enum err e = cached_create(&s->b, &s->c, why);

    if (e)
        return e;
    s->direct = s->all = s->c->light;
    s->all.classes = PATH_ALL;
    s->all.renew = CAUSTIC_PARTS;
    e = relighter_prepare(s->c->relighter, &s->all, false, &ms);
    if (!e)
        e = relighter_run(s->c->relighter, s->b.sky->environment, &s->all, s->c->rgb, &s->c->stats);
    out->wall_s = clock_seconds() - start;
    out->processor_s = clock_processor() - busy;
    out->direct_bytes = s->c->stats.cache.bytes;
    out->bytes = out->direct_bytes + s->c->stats.indirect.bytes + s->c->stats.stored.bytes;
    return e ? err_say(why, e, "%s", s->c->why.text[0] ? s->c->why.text : err_text(e)) : ERR_OK;
}

static enum err measure_growth(struct speed *s, struct speed_case *out, struct reason *why)
{
    out->pixels.name = "four times the pixels";
    out->growth.name = "16 times the triangles";
    enum err e = bench_pixels(&s->b, &out->pixels);
    if (!e)
        e = bench_triangles(&s->b, &out->growth);
    return e ? err_say(why, e, "%s", err_text(e)) : ERR_OK;
}

enum err speed_measure(const struct bench_desc *desc, bool judged, struct speed_case *out, struct reason *why)
{
    struct speed *s = mem_alloc(1, sizeof(*s));
    const char *skies = desc->sources;
    char title[128], spec[4096];

    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    s->b.desc = desc;
    enum err e = bench_begin(&s->b, why);
    while (!e && out->count < SPEED_SKIES && chart_next_item(&skies, title, spec)) {
        struct speed_sky *sky = &out->skies[out->count++];
        snprintf(sky->title, sizeof(sky->title), "%.*s", SPEED_TITLE - 1, title);
        if (!s->c && !(e = bench_take_skies(&s->b, spec, why)))
            e = precompute(s, out, why);
        if (!e)
            e = measure_sky(s, spec, judged, sky, why);
    }
    if (!e && judged && s->c)
        e = measure_growth(s, out, why);
    out->level = s->b.kernels ? s->b.kernels->level : "";
    out->width = desc->width;
    out->height = desc->height;
    cached_destroy(s->c);
    bench_end(&s->b);
    mem_free(s);
    return e;
}
