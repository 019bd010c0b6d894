#include "measure/bench/bench.h"

#include "base/clock.h"
#include "base/mem.h"
#include "base/setting.h"
#include "base/sort.h"
#include "image/codec/encode.h"
#include "measure/chart/script.h"
#include "sky/source/source.h"

#include <math.h>
#include <omp.h>
#include <stdarg.h>
#include <string.h>

#define SAMPLE_SECONDS 4e-3 /* shorter work is called several times in a row */
#define REPEATS_MAX 64
#define ROW_SECONDS 10.0  /* a row that would take longer has fewer rounds */
#define SHORT_SECONDS 0.4 /* a row that would take less has more, */
#define SHORT_ROUNDS 31   /* at most this many: few short rounds say little on a busy machine; */
#define LEAST_ROUNDS 3    /* unless this is asked for */
#define STEP_SPEED "0.25" /* minutes from frame to frame of a computed sky */
#define TURN_DEGREES 3.0  /* of a frame that is taken again */
#define FIRST_WAITS 150   /* of 200 ms */

/* In the order of the pipeline, with their targets: that of a row without a bare figure is one of `ours`. */
static const struct {
    enum err (*run)(struct bench *, struct bench_row *);
    const char *name, *unit, *sense; /* sense: at_least or at_most; NULL: there is no target */
    double target;
} rows[] = {
    { bench_decode, "EXR decode", "ms", NULL, 0.0 },
    { bench_rebuild, "resample, CDFs, samples / copy", "ms", "at_most", 4.0 },
    { bench_shadow_rays, "shadow rays of the direct stage", "Mrays/s", "at_least", 0.85 },
    { bench_terms, "shading a sample at a point", "ns core", NULL, 0.0 },
    { bench_light_rays, "rays of the light tracer", "Mrays/s", NULL, 0.0 },
    { bench_tone, "tone map / copy", "ms", "at_most", 3.0 },
    { bench_jpeg, "JPEG / libjpeg-turbo", "ms", "at_most", 1.05 },
    { bench_delivery, "delivery / bare sockets", "ms", NULL, 0.0 },
    { bench_pipeline, "pipeline / its slowest stage", "ms", "at_most", 1.15 },
    { bench_threads_light, "light: one thread / all", "ms", "at_least", 1.9 },
    { bench_threads_whole, "one thread / pipeline", "ms", "at_least", 1.9 },
    { bench_pixels, "four times the pixels", "ms", "at_most", 4.1 },
    { bench_triangles, "16 times the triangles", "ms", "at_most", 2.0 },
    { bench_allocations, "allocations after frame 10", "per frame", "at_most", 0.0 },
    { bench_no_visibility, "no visibility, 60 samples", "frames/s", NULL, 0.0 },
};

#define ROWS (sizeof(rows) / sizeof(rows[0]))

double bench_median(double *v, int n)
{
    sort_doubles(v, (size_t)n);
    return n % 2 ? v[n / 2] : 0.5 * (v[n / 2 - 1] + v[n / 2]);
}

void bench_take(struct bench_row *row, double *ours, double *bare, int rounds)
{
    double ratios[BENCH_ROUNDS_MAX];

    for (int i = 0; i < rounds; i++)
        ratios[i] = ours[i] / bare[i];
    row->ratio = bench_median(ratios, rounds);
    row->ours = bench_median(ours, rounds);
    row->bare = bench_median(bare, rounds);
    row->rounds = rounds;
}

static int rounds_of(const struct bench *b, double seconds)
{
    const double those_of_short = fmin(SHORT_ROUNDS, SHORT_SECONDS / fmax(seconds, 1e-9));
    const double more = b->desc->rounds > LEAST_ROUNDS ? those_of_short : LEAST_ROUNDS;

    return (int)fmax(fmin(fmax(ROW_SECONDS / fmax(seconds, 1e-9), LEAST_ROUNDS), b->desc->rounds), more);
}

void bench_skip(struct bench_row *row, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    vsnprintf(row->skipped, sizeof(row->skipped), format, args);
    va_end(args);
}

/* A sky that neither the last call nor the last one of this side had: how often each side is called depends on the
 * clock, so one count for both would come back to the same sky in each round of eight calls. */
static void next_sky_of(struct bench *b, int side)
{
    do
        b->turns[side]++;
    while ((b->turns[side] - b->turn) % BENCH_SKIES == 0);
    b->turn = b->turns[side] - 1;
    bench_next_sky(b);
}

/* Seconds a call, by the clock or as the work itself has counted them, and what it did. */
static enum err time_calls(struct bench *b, const struct bench_pair *p, int side, int repeats, double *seconds,
                           double *units)
{
    const double start = clock_seconds();
    double own = 0.0, done = 0.0;
    enum err e = ERR_OK;

    for (int k = 0; k < repeats && !e; k++) {
        next_sky_of(b, side);
        e = p->work[side](p->context);
        own += p->seconds[side] ? *p->seconds[side] : 0.0;
        done += p->units[side] ? *p->units[side] : 1.0;
    }
    *seconds = (p->seconds[side] ? own : clock_seconds() - start) / repeats;
    *units = done / repeats;
    return e;
}

enum err bench_time(struct bench *b, const struct bench_pair *p, struct bench_row *row)
{
    double figure[2][BENCH_ROUNDS_MAX], round = 0.0, seconds, units;
    const int sides = p->work[1] ? 2 : 1;
    int repeats[2] = { 1, 1 };
    enum err e = ERR_OK;

    b->computed = 1.0;
    for (int k = 0; k < sides && !e; k++) { /* warms up, and finds how often to call */
        double start = clock_seconds();
        e = time_calls(b, p, k, 1, &seconds, &units);
        if (!e && clock_seconds() - start < SAMPLE_SECONDS) {
            start = clock_seconds();
            e = time_calls(b, p, k, 1, &seconds, &units);
        }
        const double once = clock_seconds() - start;
        repeats[k] = (int)fmin(fmax(ceil(SAMPLE_SECONDS / once), 1.0), REPEATS_MAX);
        round += once * repeats[k];
    }
    const int rounds = rounds_of(b, round);
    for (int i = 0; i < rounds && !e; i++) {
        for (int j = 0; j < sides && !e; j++) {
            const int k = sides == 2 ? (i + j) % 2 : 0; /* each goes first in half of the rounds */
            e = time_calls(b, p, k, repeats[k], &seconds, &units);
            figure[k][i] = p->rate ? p->scale[k] * units / seconds : p->scale[k] * seconds / units;
        }
        progress_step(&b->line, 1);
    }
    if (e)
        return e;
    if (sides == 2)
        bench_take(row, figure[0], figure[1], rounds);
    else
        bench_state(row, bench_median(figure[0], rounds), rounds);
    if (b->computed < BENCH_COMPUTED)
        bench_skip(row, "refused: %.0f %% of the frame was computed", 100.0 * b->computed);
    return ERR_OK;
}

void bench_state(struct bench_row *row, double figure, int rounds)
{
    row->ours = row->ratio = figure;
    row->rounds = rounds;
}

enum err bench_threads(const struct bench *b, int count, enum err (*work)(void *), void *context)
{
    omp_set_num_threads(count);
    const enum err e = work(context);
    omp_set_num_threads(b->threads);
    return e;
}

enum err image_maker_init(struct image_maker *m, struct bench *b, const struct prepared_scene *set)
{
    const size_t values = 3 * (size_t)set->gbuffer->width * set->gbuffer->height;

    *m = (struct image_maker){
        .bench = b,
        .relighter = relighter_create(set, b->kernels),
        .light = &b->light,
        .level = b->kernels->level,
        .jpeg = jpeg_encoder_create(),
        .rgb = mem_alloc(values, sizeof(float)),
        .display = mem_alloc(values, 1),
        .width = set->gbuffer->width,
        .height = set->gbuffer->height,
    };
    exposure_init(&m->exposure);
    return m->relighter && m->jpeg && m->rgb && m->display ? ERR_OK : ERR_NOMEM;
}

void image_maker_finish(struct image_maker *m)
{
    relighter_destroy(m->relighter);
    jpeg_encoder_destroy(m->jpeg);
    mem_free(m->rgb);
    mem_free(m->display);
    *m = (struct image_maker){ 0 };
}

enum err image_maker_light(struct image_maker *m)
{
    struct relight_stats stats = { 0 };
    const enum err e = relighter_run(m->relighter, m->bench->sky->environment, m->light, m->rgb, &stats);

    bench_count(m->bench, &stats);
    return e;
}

enum err image_maker_encode(struct image_maker *m)
{
    const struct tone_desc tone = { .gain = exposure_step(&m->exposure, m->rgb, m->width, m->height, 1),
                                    .level = m->level };
    const uint8_t *bytes;
    size_t size;

    tone_map(m->rgb, m->width, m->height, &tone, m->display);
    return jpeg_encode(m->jpeg, m->display, m->width, m->height, BENCH_QUALITY, &bytes, &size);
}

/* ---- Skies ---- */

void bench_next_sky(struct bench *b)
{
    b->sky = &b->skies[++b->turn % BENCH_SKIES];
}

void bench_first_sky(struct bench *b)
{
    b->turn = 0;
    b->sky = b->skies;
}

void bench_count(struct bench *b, const struct relight_stats *stats)
{
    const struct transport_frame_stats *f = &stats->cache_frame;
    const double all = (f->sun > 0 ? 2.0 : 1.0) * stats->cache.packets;

    if (all > 0.0) /* lit by the cache */
        b->computed = fmin(b->computed, (f->lit + (f->sun > 0 ? f->shone : 0.0)) / all);
}

void bench_make_lean(struct bench *b, bool lean)
{
    for (uint32_t k = 0; k < BENCH_SKIES; k++)
        environment_configure(
            b->skies[k].environment,
            &(struct environment_desc){ .rotation_degrees = TURN_DEGREES * (k / b->frame_count), .lean = lean });
}

enum err bench_read_sky(const struct bench_sky *sky)
{
    struct reason why;

    return environment_update(sky->environment, sky->file, &why);
}

const char *bench_skies_text(const struct bench *b, char out[80])
{
    if (b->frame_count == BENCH_SKIES)
        snprintf(out, 80, "%d frames", BENCH_SKIES);
    else
        snprintf(out, 80, "%d skies: %u frame%s, turned by %g degrees each time", BENCH_SKIES, b->frame_count,
                 b->frame_count == 1 ? "" : "s", TURN_DEGREES);
    return out;
}

static bool is_one_exr(const struct frame *f)
{
    static const uint8_t magic[4] = { 0x76, 0x2f, 0x31, 0x01 };
    return f->kind == FRAME_FILE && !f->faces[0] && f->size > sizeof(magic) && memcmp(f->bytes, magic, 4) == 0;
}

/* A frame as an OpenEXR file: as it came, or written here in half floats, which are usual. */
static enum err make_file(const struct frame *from, const struct image *im, struct frame *out, struct reason *why)
{
    const struct exr_desc d = { .rgb = im->rgb, .width = im->width, .height = im->height, .depth = EXR_HALF };

    snprintf(out->name, sizeof(out->name), "a sky");
    if (!is_one_exr(from)) {
        out->kind = FRAME_FILE;
        return exr_encode(&d, &out->bytes, &out->size, why);
    }
    if (frame_reserve_bytes(out, from->size))
        return err_say(why, ERR_NOMEM, "out of memory");
    memcpy(out->bytes, from->bytes, from->size);
    return ERR_OK;
}

static void drop_frames(struct bench *b)
{
    for (int k = 0; k < BENCH_SKIES; k++) {
        frame_finish(&b->frames[k]);
        frame_finish(&b->files[k]);
        b->frames[k] = b->files[k] = (struct frame){ .kind = FRAME_NONE };
    }
    b->frame_count = 0;
}

/* Up to as many frames as there are skies. */
static enum err read_frames(struct bench *b, const char *spec, struct reason *why)
{
    const bool moves = strncmp(spec, "sky:", 4) != 0 || strstr(spec, "speed=");
    struct source *source = NULL;
    char text[4096];

    snprintf(text, sizeof(text), "%s%s", spec, moves ? "" : spec[4] ? ",speed=" STEP_SPEED : "speed=" STEP_SPEED);
    enum err e = source_open(&(struct source_desc){ .spec = text }, &source, why);
    for (int waits = 0; !e && b->frame_count < BENCH_SKIES && waits < FIRST_WAITS; waits++) {
        struct frame *f = &b->frames[b->frame_count];
        e = source_next(source, f, why);
        b->frame_count += !e && f->kind != FRAME_NONE;
    }
    source_close(source);
    if ((e == ERR_END || !e) && b->frame_count == 0)
        return err_say(why, ERR_IO, "%s: contains no frame", spec);
    return e == ERR_END ? ERR_OK : e;
}

enum err bench_take_skies(struct bench *b, const char *source, struct reason *why)
{
    const struct image *first = &b->skies[0].environment->image;

    drop_frames(b);
    enum err e = read_frames(b, source, why);
    if (!e)
        bench_make_lean(b, false);
    for (uint32_t k = 0; k < BENCH_SKIES && !e; k++) {
        struct bench_sky *sky = &b->skies[k];
        const uint32_t from = k % b->frame_count;
        const struct image *im = &sky->environment->image;
        sky->frame = &b->frames[from];
        sky->file = &b->files[from];
        e = environment_update(sky->environment, sky->frame, why);
        if (!e && k < b->frame_count)
            e = make_file(sky->frame, im, &b->files[from], why);
        if (!e && (im->width != first->width || im->height != first->height))
            e = err_say(why, ERR_UNSUPPORTED, "%s: frames of different sizes cannot be compared", source);
    }
    bench_first_sky(b);
    return e;
}

/* Images, for the rows of the film. */
static enum err make_images(struct bench *b, struct reason *why)
{
    const uint32_t width = b->desc->width, height = b->desc->height;
    struct image_maker m;
    enum err e = image_maker_init(&m, b, b->set);

    for (int k = 0; k < BENCH_SKIES && !e; k++, bench_next_sky(b)) {
        struct bench_sky *s = b->sky;
        s->rgb = mem_alloc((size_t)width * height, 3 * sizeof(float));
        s->display = mem_alloc((size_t)width * height, 3);
        e = s->rgb && s->display ? image_maker_light(&m) : ERR_NOMEM;
        if (e)
            break;
        memcpy(s->rgb, m.rgb, 3 * sizeof(float) * width * height);
        s->gain = (float)exposure_step(&m.exposure, s->rgb, width, height, 1);
        tone_map(s->rgb, width, height, &(struct tone_desc){ .gain = (double)s->gain, .level = b->kernels->level },
                 s->display);
    }
    image_maker_finish(&m);
    return e ? err_say(why, e, "no image could be made: %s", err_text(e)) : ERR_OK;
}

enum err bench_begin(struct bench *b, struct reason *why)
{
    const struct bench_desc *d = b->desc;
    struct prepared_scene_desc set = {
        .scene = d->scene, .reading = d->reading, .width = d->width, .height = d->height, .progress = d->progress
    };

    if (d->threads)
        omp_set_num_threads(d->threads);
    b->threads = omp_get_max_threads();
    enum err e = kernels_select(d->cpu, &b->kernels, why);
    set.kernels = b->kernels;
    if (!e)
        e = set_create(&set, &b->set, why);
    if (e)
        return e;
    b->light.direct.method = d->method;
    b->light.direct.samples = d->samples;
    for (int k = 0; k < BENCH_SKIES; k++) {
        b->skies[k].environment = environment_create(&(struct environment_desc){ .like = b->skies[0].environment });
        if (!b->skies[k].environment)
            return err_say(why, ERR_NOMEM, "out of memory");
    }
    bench_first_sky(b);
    return ERR_OK;
}

void bench_end(struct bench *b)
{
    drop_frames(b);
    for (int k = 0; k < BENCH_SKIES; k++) {
        environment_destroy(b->skies[k].environment);
        mem_free(b->skies[k].rgb);
        mem_free(b->skies[k].display);
    }
    set_destroy(b->set);
}

json_t *bench_row_json(const struct bench_row *row)
{
    json_t *o = json_pack("{s:i, s:o, s:o, s:o}", "rounds", row->rounds, "ours", script_number(row->ours), "bare",
                          script_number(row->bare), "ratio", script_number(row->ratio));

    json_object_set_new(o, "note", words_to_json(row->note));
    json_object_set_new(o, "skipped", words_to_json(row->skipped));
    return o;
}

static json_t *title(const struct bench *b)
{
    const struct environment *sky = b->skies[0].environment;
    char text[1024], skies[80];

    snprintf(
        text, sizeof(text),
        "%s, %llu triangles, %s (%ux%u, %s), %ux%u, %s, %u samples, %d of %d threads, kernels %s, medians of about %d "
        "rounds",
        b->set->name, (unsigned long long)b->set->scene->triangle_count, sky->name, sky->image.width, sky->image.height,
        bench_skies_text(b, skies), b->desc->width, b->desc->height, method_name(b->desc->method), b->desc->samples,
        b->threads, omp_get_num_procs(), b->kernels->level, b->desc->rounds);
    return words_to_json(text);
}

static enum err run_row(struct bench *b, size_t i, json_t *all, struct reason *why)
{
    struct bench_row row = { .rounds = 0 };

    progress_begin(&b->line, rows[i].name, (uint64_t)b->desc->rounds, b->desc->progress ? stderr : NULL);
    const enum err e = rows[i].run(b, &row);
    progress_end(&b->line);
    if (e)
        return err_say(why, e, "%s: %s", rows[i].name, err_text(e));
    json_t *o = bench_row_json(&row);
    json_object_set_new(o, "name", json_string(rows[i].name));
    json_object_set_new(o, "unit", json_string(rows[i].unit));
    if (rows[i].sense)
        json_object_set_new(o, rows[i].sense, json_real(rows[i].target));
    json_array_append_new(all, o);
    return ERR_OK;
}

enum err bench_run(const struct bench_desc *desc, struct script *to, struct reason *why)
{
    struct bench b = { .desc = desc };
    json_t *report = NULL;

    enum err e = bench_begin(&b, why);
    if (!e)
        e = bench_take_skies(&b, desc->source, why);
    if (!e)
        e = make_images(&b, why);
    if (!e)
        report = json_pack("{s:o, s:o, s:[]}", "title", title(&b), "machine",
                           script_machine(b.threads, b.kernels->level), "rows");
    for (size_t i = 0; i < ROWS && !e; i++)
        e = run_row(&b, i, json_object_get(report, "rows"), why);
    if (!e)
        e = script_tell(to, report, why);
    else
        json_decref(report);
    bench_end(&b);
    return e;
}
