/* Whole frames: how the stages overlap, and how their time grows. */
#include "measure/bench/bench.h"

#include "base/clock.h"
#include "base/handoff.h"
#include "base/mem.h"
#include "import/reader/reader.h"

#include <math.h>
#include <omp.h>
#include <pthread.h>
#include <string.h>

#define WARM 4          /* images before the first that counts: more than slots */
#define RUN_SECONDS 0.4 /* that a run of counted images takes at least */
#define IMAGES_MAX 64   /* of them */
#define TRIANGLES_MAX 4000000u
#define FRAMES_WARM 10 /* before allocations count */
#define FRAMES_COUNTED 10

/* ---- The pipeline, as relightd has it: decode of the next frame, light of this one, encoding of the last ---- */

struct pipeline {
    struct bench *b;
    struct image_maker maker; /* its relighter is the middle thread's, the rest the last one's */
    uint64_t decoded;
    const struct bench_sky *sky[HANDOFF_SLOTS]; /* of the bench's, which are more than slots */
    float *image[HANDOFF_SLOTS];
    struct handoff skies, images;
    int count;          /* of images in one run */
    uint64_t turn;      /* of the next image */
    enum err failed[3]; /* by stage */
    double seconds;     /* per image, of the last run */
    double processor;   /* of all threads, the mean over the runs */
    int runs;
    bool borrowed;             /* the relighter is not ours */
    enum err (*alone)(void *); /* what is timed beside it */
};

static void *decode_main(void *arg)
{
    struct pipeline *p = arg;

    omp_set_num_threads(1);
    for (int i = 0; i < WARM + p->count && !p->failed[0] && !handoff_is_closed(&p->skies); i++) {
        const int slot = handoff_begin(&p->skies);
        p->sky[slot] = &p->b->skies[p->decoded++ % BENCH_SKIES];
        p->failed[0] = bench_read_sky(p->sky[slot]);
        if (p->failed[0])
            break;
        handoff_publish(&p->skies, slot);
        while (!handoff_wait_taken(&p->skies, 100) && !handoff_is_closed(&p->skies))
            continue;
    }
    if (p->failed[0])
        handoff_close(&p->skies);
    return NULL;
}

static void *encode_main(void *arg)
{
    struct pipeline *p = arg;
    struct image_maker last = p->maker;

    omp_set_num_threads(1);
    for (int i = 0; i < WARM + p->count && !p->failed[2]; i++) {
        int slot;
        while ((slot = handoff_take(&p->images, 100)) == HANDOFF_NONE)
            if (handoff_is_closed(&p->images))
                return NULL;
        last.rgb = p->image[slot];
        p->failed[2] = image_maker_encode(&last);
        handoff_release(&p->images, slot);
    }
    return NULL;
}

/* No image is dropped: each waits until the one before has been taken. */
static void light_all(struct pipeline *p)
{
    struct relight_desc light = *p->maker.light;
    struct relight_stats stats = { 0 };
    double start = 0.0, processor = 0.0;

    for (int i = 0; i < WARM + p->count && !p->failed[1]; i++) {
        int sky;
        while ((sky = handoff_take(&p->skies, 100)) == HANDOFF_NONE)
            if (handoff_is_closed(&p->skies))
                return;
        const int slot = handoff_begin(&p->images);
        light.turn = p->turn++;
        p->failed[1] = relighter_run(p->maker.relighter, p->sky[sky]->environment, &light, p->image[slot], &stats);
        bench_count(p->b, &stats);
        handoff_release(&p->skies, sky);
        handoff_publish(&p->images, slot);
        while (!handoff_wait_taken(&p->images, 100) && !p->failed[2])
            continue;
        if (i == WARM - 1) {
            start = clock_seconds();
            processor = clock_processor();
        }
    }
    p->seconds = (clock_seconds() - start) / p->count;
    p->processor += ((clock_processor() - processor) / p->count - p->processor) / ++p->runs;
}

static enum err pipeline_run(struct pipeline *p)
{
    pthread_t decode, encode;

    handoff_init(&p->skies);
    handoff_init(&p->images);
    memset(p->failed, 0, sizeof(p->failed));
    if (pthread_create(&decode, NULL, decode_main, p))
        return ERR_NOMEM;
    if (pthread_create(&encode, NULL, encode_main, p)) {
        handoff_close(&p->skies);
        pthread_join(decode, NULL);
        return ERR_NOMEM;
    }
    light_all(p);
    if (p->failed[0] || p->failed[1] || p->failed[2]) {
        handoff_close(&p->skies);
        handoff_close(&p->images);
    }
    pthread_join(decode, NULL);
    pthread_join(encode, NULL);
    handoff_finish(&p->skies);
    handoff_finish(&p->images);
    return p->failed[0] ? p->failed[0] : p->failed[1] ? p->failed[1] : p->failed[2];
}

static enum err pipeline_work(void *context)
{
    return pipeline_run(context);
}

/* ---- Its stages alone ---- */

static enum err decode_alone(void *context)
{
    return bench_read_sky(((struct pipeline *)context)->b->sky);
}

static enum err light_alone(void *context)
{
    return image_maker_light(&((struct pipeline *)context)->maker);
}

static enum err encode_alone(void *context)
{
    return image_maker_encode(&((struct pipeline *)context)->maker);
}

static enum err all_in_sequence(void *context)
{
    enum err e = decode_alone(context);

    if (!e)
        e = light_alone(context);
    return e ? e : encode_alone(context);
}

static enum err stage_alone(void *context)
{
    struct pipeline *p = context;

    return bench_threads(p->b, p->alone == light_alone ? p->b->threads : 1, p->alone, p);
}

static enum err seconds_of(enum err (*work)(void *), struct pipeline *p, double *out)
{
    double v[3];
    enum err e = (p->alone = work)(p);

    for (int i = 0; i < 3 && !e; i++) {
        bench_next_sky(p->b);
        const double start = clock_seconds();
        e = stage_alone(p);
        v[i] = clock_seconds() - start;
    }
    *out = e ? 1.0 : bench_median(v, 3);
    return e;
}

/* r and light: another relighter and its request; NULL: those of the bench. */
static enum err pipeline_init(struct pipeline *p, struct bench *b, struct relighter *r,
                              const struct relight_desc *light)
{
    double seconds = 1.0;
    *p = (struct pipeline){ .b = b };
    enum err e = image_maker_init(&p->maker, b, b->set);

    if (r) {
        relighter_destroy(p->maker.relighter);
        p->maker.relighter = r;
        p->maker.light = light;
        p->borrowed = true;
    }
    bench_make_lean(b, p->maker.light->direct.method == METHOD_CACHED);
    for (int k = 0; k < HANDOFF_SLOTS && !e; k++) {
        p->image[k] = mem_alloc((size_t)b->desc->width * b->desc->height, 3 * sizeof(float));
        e = p->image[k] ? ERR_OK : ERR_NOMEM;
    }
    if (!e)
        e = seconds_of(light_alone, p, &seconds);
    p->count = (int)fmin(fmax(ceil(RUN_SECONDS / seconds), 3.0), IMAGES_MAX);
    return e;
}

static void pipeline_finish(struct pipeline *p)
{
    if (p->borrowed)
        p->maker.relighter = NULL;
    image_maker_finish(&p->maker);
    for (int k = 0; k < HANDOFF_SLOTS; k++)
        mem_free(p->image[k]);
    bench_make_lean(p->b, false);
    for (int k = 0; k < BENCH_SKIES; k++)
        environment_complete(p->b->skies[k].environment);
}

enum err bench_pipeline(struct bench *b, struct bench_row *row)
{
    static const struct {
        enum err (*work)(void *);
        const char *name;
    } parts[] = { { decode_alone, "decode and tables" }, { light_alone, "light" }, { encode_alone, "encoding" } };
    double ms[3] = { 0.0, 0.0, 0.0 };
    struct pipeline p;
    const struct bench_pair pair = {
        { pipeline_work, stage_alone }, &p, .scale = { 1e3, 1e3 }, .seconds = { &p.seconds }
    };
    int slowest = 0;

    enum err e = pipeline_init(&p, b, NULL, NULL);
    for (int k = 0; k < 3 && !e; k++) {
        e = seconds_of(parts[k].work, &p, &ms[k]);
        ms[k] *= 1e3;
        slowest = ms[k] > ms[slowest] ? k : slowest;
    }
    p.alone = parts[slowest].work;
    if (!e)
        e = bench_time(b, &pair, row);
    snprintf(
        row->note, sizeof(row->note),
        "bare: %s alone; ms alone: decode and tables %.3g (1 thread), light %.3g (%d), exposure, tone, JPEG %.3g (1)",
        parts[slowest].name, ms[0], ms[1], b->threads, ms[2]);
    pipeline_finish(&p);
    return e;
}

enum err bench_threads_whole(struct bench *b, struct bench_row *row)
{
    struct pipeline p;
    const struct bench_pair pair = {
        { stage_alone, pipeline_work }, &p, .scale = { 1e3, 1e3 }, .seconds = { NULL, &p.seconds }
    };

    snprintf(row->note, sizeof(row->note),
             "whole frames from EXR to JPEG: stages in sequence on one thread, and the pipeline on %d", b->threads);
    if (b->threads < 2) {
        bench_skip(row, "there is one thread only");
        return ERR_OK;
    }
    enum err e = pipeline_init(&p, b, NULL, NULL);
    p.alone = all_in_sequence;
    if (!e)
        e = bench_time(b, &pair, row);
    pipeline_finish(&p);
    return e;
}

enum err bench_pipeline_rate(struct bench *b, struct relighter *r, const struct relight_desc *light,
                             struct bench_row *row, double *processor)
{
    struct pipeline p;
    const struct bench_pair pair = { { pipeline_work }, &p, .scale = { 1.0 }, .rate = true, .seconds = { &p.seconds } };
    enum err e = pipeline_init(&p, b, r, light);

    if (!e)
        e = bench_time(b, &pair, row);
    *processor = p.processor;
    pipeline_finish(&p);
    return e;
}

/* ---- How time grows ---- */

struct threads {
    struct image_maker maker;
    const struct bench *b;
};

static enum err threads_all(void *context)
{
    return image_maker_light(&((struct threads *)context)->maker);
}

static enum err threads_one(void *context)
{
    return bench_threads(((struct threads *)context)->b, 1, threads_all, context);
}

enum err bench_threads_light(struct bench *b, struct bench_row *row)
{
    struct threads t = { .b = b };
    const struct bench_pair pair = { { threads_one, threads_all }, &t, .scale = { 1e3, 1e3 } };

    snprintf(row->note, sizeof(row->note), "direct light and the sum of the pixels; second figure: on %d threads",
             b->threads);
    if (b->threads < 2) {
        bench_skip(row, "there is one thread only");
        return ERR_OK;
    }
    enum err e = image_maker_init(&t.maker, b, b->set);
    if (!e)
        e = bench_time(b, &pair, row);
    image_maker_finish(&t.maker);
    return e;
}

struct two { /* images of two sets */
    struct image_maker large, small;
    bool encodes;
};

static enum err make_one(struct image_maker *m, bool encodes)
{
    const enum err e = image_maker_light(m);
    return e || !encodes ? e : image_maker_encode(m);
}

static enum err make_large(void *context)
{
    struct two *t = context;
    return make_one(&t->large, t->encodes);
}

static enum err make_small(void *context)
{
    struct two *t = context;
    return make_one(&t->small, t->encodes);
}

static enum err time_two(struct bench *b, const struct prepared_scene *large, bool encodes, struct bench_row *row)
{
    struct two t = { .encodes = encodes };
    const struct bench_pair pair = { { make_large, make_small }, &t, .scale = { 1e3, 1e3 } };
    enum err e = image_maker_init(&t.large, b, large);

    if (!e)
        e = image_maker_init(&t.small, b, b->set);
    if (!e)
        e = bench_time(b, &pair, row);
    image_maker_finish(&t.large);
    image_maker_finish(&t.small);
    return e;
}

enum err bench_pixels(struct bench *b, struct bench_row *row)
{
    const struct prepared_scene_desc desc = {
        .scene = b->desc->scene,
        .reading = b->desc->reading,
        .width = 2 * b->desc->width,
        .height = 2 * b->desc->height,
        .kernels = b->kernels,
    };
    struct reason why = { "" };
    struct prepared_scene *large = NULL;
    enum err e = ERR_OK;

    snprintf(row->note, sizeof(row->note), "%ux%u over %ux%u: light, exposure, tone curve, JPEG, one after another",
             desc.width, desc.height, b->desc->width, b->desc->height);
    if (set_create(&desc, &large, &why))
        bench_skip(row, "%.150s", why.text);
    else
        e = time_two(b, large, true, row);
    set_destroy(large);
    return e;
}

/* The same scene with each triangle cut into 16. */
static enum err make_fine(const struct bench *b, struct prepared_scene *fine, struct reason *why)
{
    enum err e = ERR_OK;

    *fine = *b->set;
    fine->scene = NULL;
    fine->rays = NULL;
    fine->gbuffer = NULL;
    if (b->desc->scene)
        e = scene_load(b->desc->scene, &b->desc->reading, &fine->scene, NULL, why);
    else
        fine->scene = scene_create_builtin();
    if (!e)
        e = fine->scene ? subdivide(fine->scene, 2) : ERR_NOMEM;
    if (!e)
        fine->rays = rays_create_for(fine->scene, b->kernels->cpu);
    if (!e && !fine->rays)
        e = ERR_NOMEM;
    const struct gbuffer_desc g = { .camera = e ? NULL : scene_camera(fine->scene, NULL),
                                    .width = b->desc->width,
                                    .height = b->desc->height };
    return e ? e : gbuffer_create(fine->scene, fine->rays, &g, &fine->gbuffer, why);
}

enum err bench_triangles(struct bench *b, struct bench_row *row)
{
    const struct prepared_scene_desc given = { .scene = b->desc->scene_fine,
                                               .reading = b->desc->reading,
                                               .width = b->desc->width,
                                               .height = b->desc->height,
                                               .kernels = b->kernels };
    struct prepared_scene made = { .scene = NULL }, *loaded = NULL;
    struct reason why = { "" };
    enum err e;

    if (!given.scene && b->set->scene->triangle_count > TRIANGLES_MAX) {
        bench_skip(row, "16 times as many would be more than %u", 16 * TRIANGLES_MAX);
        return ERR_OK;
    }
    e = given.scene ? set_create(&given, &loaded, &why) : make_fine(b, &made, &why);
    if (e) {
        bench_skip(row, "%.150s", why.text[0] ? why.text : err_text(e));
        e = ERR_OK;
    } else {
        const struct prepared_scene *fine = loaded ? loaded : &made;
        snprintf(row->note, sizeof(row->note), "light alone; %llu triangles over %llu",
                 (unsigned long long)fine->scene->triangle_count, (unsigned long long)b->set->scene->triangle_count);
        e = time_two(b, fine, false, row);
    }
    set_destroy(loaded);
    gbuffer_destroy(made.gbuffer);
    rays_destroy(made.rays);
    scene_destroy(made.scene);
    return e;
}

/* ---- Memory ---- */

/* The mean over frames by this light, from decoding to JPEG. */
static enum err count_allocations(struct bench *b, const struct relight_desc *light, double *mean)
{
    struct image_maker m;
    uint64_t at[2] = { 0 };
    enum err e = image_maker_init(&m, b, b->set);

    m.light = light;
    for (int i = 0; i <= FRAMES_WARM + FRAMES_COUNTED && !e; i++, bench_next_sky(b)) {
        if (i >= FRAMES_WARM)
            allocations_count(&at[i > FRAMES_WARM]);
        e = bench_read_sky(b->sky);
        if (!e)
            e = image_maker_light(&m);
        if (!e)
            e = image_maker_encode(&m);
    }
    *mean = (double)(at[1] - at[0]) / FRAMES_COUNTED;
    image_maker_finish(&m);
    return e;
}

/* Of the row's method, and of live images of all light while there is no cache. */
enum err bench_allocations(struct bench *b, struct bench_row *row)
{
    const struct relight_desc live = { .direct = { .method = METHOD_AUTO, .samples = b->desc->samples },
                                       .classes = PATH_ALL,
                                       .denoise = true,
                                       .remember = true };
    double mean[2] = { 0.0 };
    uint64_t ignored;
    enum err e = count_allocations(b, &b->light, &mean[0]);

    if (!e)
        e = count_allocations(b, &live, &mean[1]);
    bench_state(row, fmax(mean[0], mean[1]), FRAMES_COUNTED);
    snprintf(row->note, sizeof(row->note), "%s %g, denoised live images of all light %g; without delivery",
             method_name(b->light.direct.method), mean[0], mean[1]);
    if (!allocations_count(&ignored))
        bench_skip(row, "this build has an allocator of its own, whose calls are not counted");
    return e;
}
