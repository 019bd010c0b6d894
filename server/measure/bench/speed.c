/* relight-bench --speed: every scene by both CPU levels at two sizes. */
#include "base/clock.h"
#include "base/mem.h"
#include "base/setting.h"
#include "image/codec/encode.h"
#include "measure/bench/bench.h"
#include "measure/chart/chart.h"
#include "measure/chart/judge.h"
#include "measure/chart/script.h"

#include <string.h>

#define MIS_SAMPLES 256 /* of the errors beside the cache's */
#define TRUTH_PARTS 2   /* of each half: little noise, which multiplying crosswise takes out of the mean */

struct speed {
    struct bench b;
    struct cached *c;
    struct relight_desc all, direct;
    struct part *part;      /* whose rays are the bare ones */
    double per_image;       /* all of the image's bare rays over those of the part */
    double all_s, direct_s; /* of the last images */
    double exr_ms;          /* from a sky to a float EXR */
};

static void set(json_t *o, const char *name, double v)
{
    json_object_set_new(o, name, script_number(v));
}

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

static enum err measure_shading(struct speed *s, json_t *out)
{
    static const char *const names[] = { "bare_all", "bare_direct" };
    struct bench_row row = { .ours = 0.0 };
    const struct bench_pair against = {
        { shade_all, shade_direct }, s, { 1e3, 1e3 }, .seconds = { &s->all_s, &s->direct_s }
    };
    enum err e = time_pair(s, &against, &row);

    if (e)
        return e;
    set(out, "all_ms", row.ours);
    set(out, "direct_ms", row.bare);
    set(out, "all_over_direct", row.ratio);
    e = record_bare(s);
    const struct bench_pair pair[2] = {
        { { bare, shade_all }, s, { s->per_image, 1.0 }, .seconds = { NULL, &s->all_s } },
        { { bare, shade_direct }, s, { s->per_image, 1.0 }, .seconds = { NULL, &s->direct_s } },
    };
    for (int k = 0; k < 2 && !e; k++) {
        row.ratio = 0.0; /* where there are no rays */
        if (s->per_image > 0.0)
            e = time_pair(s, &pair[k], &row);
        set(out, names[k], row.ratio);
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
    struct bench_row row = { .ours = 0.0 };
    const struct bench_pair pair = { { write_exr }, s, .scale = { 1e3 } };
    const enum err e = time_pair(s, &pair, &row);

    s->exr_ms = row.ours;
    return e;
}

static enum err measure_images(struct speed *s, json_t *out)
{
    static const char *const names[] = { "jpeg_all", "jpeg_direct" };
    struct bench_row row = { .ours = 0.0 };
    double processor = 0.0; /* seconds */
    enum err e = ERR_OK;

    for (int k = 0; k < 2 && !e; k++) {
        e = bench_pipeline_rate(&s->b, s->c->relighter, k ? &s->direct : &s->all, &row, &processor);
        set(out, names[k], 1e3 * processor);
        if (!e && row.skipped[0])
            e = err_say(&s->c->why, ERR_RANGE, "%s", row.skipped);
    }
    if (!e)
        e = bench_threads(&s->b, 1, time_exr, s);
    set(out, "exr_direct", s->exr_ms);
    return e;
}

/* Of the cache and of `mis`, with this light. */
static enum err judge(struct speed *s, const struct relight_desc *light, json_t *out)
{
    const struct relight_desc mis = { .direct = { .method = METHOD_MIS, .samples = MIS_SAMPLES },
                                      .classes = light->classes };
    const struct truth_desc by_path = { .set = s->b.set,
                                        .environment = s->b.skies[0].environment,
                                        .frame = s->b.skies[0].frame,
                                        .classes = light->classes,
                                        .samples = TRUTH_PARTS * TRUTH_PART };
    static const char *const names[2][2] = { { "error_direct", "error_all" }, { "mis_direct", "mis_all" } };
    struct truth truth;
    double ignored, error = 0.0;

    bench_first_sky(&s->b);
    enum err e = truth_make(&by_path, &truth, &s->c->why);
    for (int k = 0; k < 2 && !e; k++) {
        e = shade(s, k ? &mis : light, &ignored);
        if (!e)
            e = cached_rel_mse(&s->b, s->c, truth.half, s->c->rgb, &error);
        set(out, names[k][light == &s->all], error);
    }
    truth_finish(&truth);
    return e;
}

static enum err measure_bias(struct speed *s, bool sun, json_t *out)
{
    struct bench_row bias = { .ours = 0.0 }, colour = bias, seams = bias, motion = bias;

    s->c->light.classes = s->direct.classes;
    bench_first_sky(&s->b);
    enum err e = cached_bias(&s->b, s->c, sun, &bias, &colour);
    if (!e)
        e = cached_seams(&s->b, &seams);
    if (!e)
        e = cached_motion(&s->b, s->c, &motion);
    json_object_set_new(out, "bias",
                        json_pack("{s:o, s:o, s:o, s:o}", "relMSE", bench_row_json(&bias), "delta E",
                                  bench_row_json(&colour), "% of seams", bench_row_json(&seams),
                                  "second differences in codes", bench_row_json(&motion)));
    return e;
}

/* judged: errors and biases too. */
static enum err measure_sky(struct speed *s, const char *source, bool judged, json_t *out, struct reason *why)
{
    enum err e = bench_take_skies(&s->b, source, why);
    if (e)
        return e;
    e = measure_shading(s, out);
    const bool sun = s->c->stats.cache_frame.sun > 0;
    json_object_set_new(out, "sun", json_boolean(sun));
    if (!e)
        e = measure_images(s, out);
    if (!e && judged)
        e = judge(s, &s->direct, out);
    if (!e && judged)
        e = judge(s, &s->all, out);
    if (!e && judged)
        e = measure_bias(s, sun, out);
    return e ? err_say(why, e, "%s: %s", json_string_value(json_object_get(out, "title")),
                       s->c->why.text[0] ? s->c->why.text : err_text(e))
             : ERR_OK;
}

/* The cache of direct light and what all light needs besides. */
static enum err precompute(struct speed *s, json_t *out, struct reason *why)
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
    set(out, "wall_s", clock_seconds() - start);
    set(out, "processor_s", clock_processor() - busy);
    set(out, "direct_bytes", (double)s->c->stats.cache.bytes);
    set(out, "bytes", (double)(s->c->stats.cache.bytes + s->c->stats.indirect.bytes + s->c->stats.stored.bytes));
    return e ? err_say(why, e, "%s", s->c->why.text[0] ? s->c->why.text : err_text(e)) : ERR_OK;
}

static enum err measure_growth(struct speed *s, json_t *out, struct reason *why)
{
    struct bench_row pixels = { .ours = 0.0 }, triangles = pixels;
    enum err e = bench_pixels(&s->b, &pixels);

    if (!e)
        e = bench_triangles(&s->b, &triangles);
    json_object_set_new(out, "growth",
                        json_pack("{s:o, s:o}", "four times the pixels", bench_row_json(&pixels),
                                  "16 times the triangles", bench_row_json(&triangles)));
    return e ? err_say(why, e, "%s", err_text(e)) : ERR_OK;
}

/* One scene at one size by one level, under each source, into `out`. judged: errors, biases and growth too. */
static enum err measure_case(const struct bench_desc *desc, bool judged, json_t *out, struct reason *why)
{
    struct speed *s = mem_alloc(1, sizeof(*s));
    const char *list = desc->sources;
    char title[128], spec[4096];
    json_t *skies = json_array();

    json_object_set_new(out, "skies", skies);
    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    s->b.desc = desc;
    enum err e = bench_begin(&s->b, why);
    while (!e && chart_next_item(&list, title, spec)) {
        json_t *sky = json_pack("{s:o}", "title", words_to_json(title));
        json_array_append_new(skies, sky);
        if (!s->c && !(e = bench_take_skies(&s->b, spec, why)))
            e = precompute(s, out, why);
        if (!e)
            e = measure_sky(s, spec, judged, sky, why);
    }
    if (!e && !s->c)
        e = err_say(why, ERR_USAGE, "--scenes and --sources: at least one of each");
    if (!e && judged)
        e = measure_growth(s, out, why);
    json_object_set_new(out, "machine", script_machine(s->b.threads, s->b.kernels ? s->b.kernels->level : ""));
    json_object_set_new(out, "size", json_pack("[ii]", (int)desc->width, (int)desc->height));
    cached_destroy(s->c);
    bench_end(&s->b);
    mem_free(s);
    return e;
}

/* One scene: by the best kernels first, then by those for AVX2, each at both sizes; each is printed when it is done. */
static enum err run_scene(const struct bench_desc *desc, const char *title, const char *scene, struct script *to,
                          struct reason *why)
{
    bool one_level = false;
    enum err e = ERR_OK;

    for (int run = 0; run < 4 && !e; run++) {
        struct bench_desc own = *desc;
        own.scene = strcmp(scene, "builtin") == 0 ? NULL : scene;
        own.width <<= run % 2;
        own.height <<= run % 2;
        if (run >= 2 && one_level)
            break;
        own.cpu = run >= 2 ? "v3" : desc->cpu;
        json_t *out = json_pack("{s:o}", "scene", words_to_json(title));
        e = measure_case(&own, run == 0, out, why);
        const char *level = json_string_value(json_object_get(json_object_get(out, "machine"), "level"));
        one_level = desc->cpu || !level || strcmp(level, "v3") == 0;
        if (!e)
            e = script_tell(to, out, why);
        else
            json_decref(out);
    }
    return e;
}

enum err bench_speed(const struct bench_desc *desc, struct script *to, struct reason *why)
{
    const char *scenes = desc->scenes;
    char title[128], spec[4096];
    enum err e = ERR_OK;

    while (!e && chart_next_item(&scenes, title, spec))
        e = run_scene(desc, title, spec, to, why);
    return e;
}
