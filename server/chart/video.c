#include "video_runs.h"

#include "chart.h"
#include "clock.h"
#include "mem.h"
#include "motion.h"
#include "panel.h"
#include "progress.h"
#include "resolve.h"
#include "source.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define DEGREES 0.25 /* a frame, or a column of the map: at 24 frames a second a quarter of the sky in 15 seconds */
#define STILL 0.05
#define TRUTH_QUICK 64
#define TRUTH_FULL 512
#define PACE_RUNS 5
#define SEEDS_QUICK 3
#define SEEDS_FULL 8

const struct video_way video_ways[VIDEO_WAYS] = {
    { "mis", "mis", "the same random numbers in each frame, so that noise stands still", false, 0xdd4b4e },
    { "mis, reseeded", "mis", "other random numbers in each frame (--reseed)", true, 0x3f95cf },
    { "faces", "faces", "the same random numbers in each frame", false, 0xef8122 },
    { "mis+sun", "mis+sun", "the same random numbers in each frame", false, 0xd1359b },
    { "auto", "auto", "what the pilot chooses in the time that mis takes, the same random numbers in each frame", false,
      0 },
};

#define BUDGETS 3
static const uint32_t budgets_quick[BUDGETS] = { 4, 8, 16 }, budgets_full[BUDGETS] = { 4, 16, 64 };

static const struct technique *technique_of(const char *techniques, const struct video_way *way)
{
    size_t count;
    const struct technique *all = technique_all(&count);

    for (size_t k = 0; k < count; k++)
        if (all[k].light_class == LIGHT_DIRECT && strcmp(all[k].name, way->technique) == 0)
            return panel_takes(techniques, &all[k]) ? &all[k] : NULL;
    return NULL;
}

bool video_takes_any(const char *techniques)
{
    for (int w = 0; w < VIDEO_WAYS; w++)
        if (technique_of(techniques, &video_ways[w]))
            return true;
    return false;
}

static struct video shape_of(const struct video_desc *d)
{
    struct video v = {
        .width = d->quick ? 48 : 96,
        .height = d->quick ? 27 : 54,
        .frames = d->quick ? 12 : 48,
        .seeds = d->quick ? SEEDS_QUICK : SEEDS_FULL,
        .budget_count = BUDGETS,
        .truth_samples = d->quick ? TRUTH_QUICK : TRUTH_FULL,
        .still = STILL,
    };
    memcpy(v.budgets, d->quick ? budgets_quick : budgets_full, sizeof(budgets_full));
    if (d->width && d->height && (uint64_t)d->width * d->height < (uint64_t)v.width * v.height) {
        v.width = d->width;
        v.height = d->height;
    }
    for (int w = 0; w < VIDEO_WAYS; w++)
        v.takes[w] = technique_of(d->techniques, &video_ways[w]) != NULL;
    return v;
}

/* Samples of all ways and budgets under one seed. */
static uint64_t work_of_seed(const struct video *v)
{
    uint64_t work = 0;

    for (int w = 0; w < VIDEO_WAYS; w++)
        for (uint32_t k = 0; k < v->budget_count && v->takes[w]; k++)
            work += 4 + v->budgets[k] / 4;
    return work;
}

static uint64_t work_of_frame(const struct video *v)
{
    return v->truth_samples / 2 + v->seeds * work_of_seed(v);
}

static uint32_t count_sources(const char *list)
{
    char title[128], spec[4096];
    uint32_t n = 0;

    while (n < VIDEO_SEQUENCES_MAX && chart_next_item(&list, title, spec))
        n++;
    return n;
}

uint64_t video_work(const struct video_desc *desc)
{
    const struct video v = shape_of(desc);
    return count_sources(desc->sources) * v.frames * work_of_frame(&v) + video_step_work(desc);
}

/* A lat-long map turns by whole columns, which costs no new table of resampling. */
static enum err keep_columns(struct video_light *l, struct reason *why)
{
    const struct image *im = &l->environment->image;
    const bool latlong = im->width == 2 * im->height && (im->layout == LAYOUT_AUTO || im->layout == LAYOUT_LATLONG);

    if (!latlong || 360.0 / im->width > 2.0 * DEGREES)
        return ERR_OK;
    const enum err e = frame_reserve_texels(&l->turned, im->width, im->height);
    if (e)
        return err_say(why, e, "no memory for a sky of %ux%u", im->width, im->height);
    l->columns = (uint32_t)lround(fmax(1.0, DEGREES / 360.0 * im->width));
    l->degrees = 360.0 * l->columns / im->width;
    l->texels = mem_alloc(3 * (size_t)im->width * im->height, sizeof(float));
    if (!l->texels)
        return err_say(why, ERR_NOMEM, "no memory for a sky of %ux%u", im->width, im->height);
    memcpy(l->texels, im->rgb, 3 * (size_t)im->width * im->height * sizeof(float));
    return ERR_OK;
}

enum err video_light_init(struct video_light *l, const char *source, struct reason *why)
{
    const struct source_desc d = { .spec = source };

    *l = (struct video_light){
        .environment = environment_create(&(struct environment_desc){ .n = 0 }),
        .degrees = DEGREES,
    };
    if (!l->environment)
        return err_say(why, ERR_NOMEM, "no memory for a sky");
    enum err e = source_first(&d, &l->frame, why);
    if (!e)
        e = environment_update(l->environment, &l->frame, why);
    if (!e)
        e = keep_columns(l, why);
    return e ? e : video_light_turn(l, 0, why);
}

enum err video_light_turn(struct video_light *l, uint32_t steps, struct reason *why)
{
    if (!l->columns) {
        environment_set(l->environment, &(struct environment_desc){ .n = 0, .rotation_degrees = steps * l->degrees });
        return environment_update(l->environment, &l->frame, why);
    }
    const size_t row = 3 * (size_t)l->turned.width;
    const size_t first = 3 * ((size_t)steps * l->columns % l->turned.width);
    for (uint32_t y = 0; y < l->turned.height; y++) {
        const float *from = l->texels + y * row;
        memcpy(l->turned.rgb + y * row, from + first, (row - first) * sizeof(float));
        memcpy(l->turned.rgb + y * row + row - first, from, first * sizeof(float));
    }
    return environment_update(l->environment, &l->turned, why);
}

void video_light_finish(struct video_light *l)
{
    frame_finish(&l->frame);
    frame_finish(&l->turned);
    mem_free(l->texels);
    environment_destroy(l->environment);
    *l = (struct video_light){ .environment = NULL };
}

enum err video_truth(const struct video_runs *r, const struct video_light *l, struct truth *truth, struct judge *judge,
                     struct reason *why)
{
    const struct truth_desc d = {
        .set = r->set,
        .environment = l->environment,
        .frame = l->columns ? &l->turned : &l->frame,
        .classes = light_class_paths(LIGHT_DIRECT),
        .samples = r->video->truth_samples,
        .cache = r->desc->cache,
    };
    enum err e = truth_make(&d, truth, why);

    if (e)
        return e;
    e = judge_init(judge, truth->half[0], truth->half[1], r->mask, r->video->width, r->video->height, why);
    if (e)
        truth_finish(truth);
    return e;
}

enum err video_stage_init(struct technique_stage *s, const struct video_runs *r, int way, struct reason *why)
{
    *s = (struct technique_stage){ .relighter = NULL };
    if (!r->techniques[way])
        return ERR_OK;
    if (r->techniques[way]->kind == TECHNIQUE_AUTO)
        s->pilot = pilot_create(r->set, r->desc->kernels, &(struct pilot_desc){ .price = NULL });
    else
        s->relighter = relighter_create(r->set, r->desc->kernels);
    return s->pilot || s->relighter ? ERR_OK : err_say(why, ERR_NOMEM, "no memory for moving pictures");
}

void video_stage_finish(struct technique_stage *s)
{
    pilot_destroy(s->pilot);
    relighter_destroy(s->relighter);
    *s = (struct technique_stage){ .relighter = NULL };
}

enum err video_pace(const struct video_runs *r, const struct video_light *l, uint32_t budget, float *rgb,
                    double *seconds, struct reason *why)
{
    struct technique_stage s = {
        .relighter = relighter_create(r->set, r->desc->kernels),
        .environment = l->environment,
    };
    struct technique_cost cost;
    double values[PACE_RUNS];
    struct band pace = { .median = 0.0 };
    enum err e = s.relighter ? ERR_OK : ERR_NOMEM;

    for (uint32_t k = 0; k < PACE_RUNS && !e; k++) {
        e = technique_run(technique_pace(LIGHT_DIRECT), &s, budget, k, rgb, &cost, why);
        values[k] = cost.seconds;
    }
    if (!e)
        e = series_band(values, PACE_RUNS, &pace);
    *seconds = pace.median;
    relighter_destroy(s.relighter);
    return e;
}

enum err video_run(const struct video_runs *r, struct technique_stage *stage, int way, const struct video_light *l,
                   uint32_t budget, uint32_t seed, uint32_t frame, float *rgb, double *seconds, struct reason *why)
{
    struct technique t = *r->techniques[way];
    struct technique_cost cost;

    stage->environment = l->environment;
    t.light.direct.pass = video_ways[way].reseed ? frame : 0; /* as relightd's --reseed */
    const enum err e = technique_run(&t, stage, budget, seed, rgb, &cost, why);
    *seconds = cost.seconds;
    return e;
}

/* A sequence while it is made. */
struct reel {
    const struct video_runs *runs;
    struct truth *truths;           /* [frames] */
    struct judge *judges;           /* [frames] */
    uint32_t made;                  /* of these */
    size_t takes;                   /* VIDEO_WAYS * budgets * seeds */
    struct technique_stage *stages; /* [takes]: what a way remembers is its own */
    float *pictures;                /* [takes][frames][height][width][3] */
    double *seconds;                /* [takes]: sums over frames */
    double *errors;                 /* [takes]: likewise */
};

static size_t take_index(const struct video *v, int way, uint32_t budget, uint32_t seed)
{
    return ((size_t)way * v->budget_count + budget) * v->seeds + seed;
}

static float *picture_of(const struct reel *r, size_t take, uint32_t frame)
{
    const struct video *v = r->runs->video;
    return r->pictures + (take * v->frames + frame) * 3 * v->width * v->height;
}

static void reel_finish(struct reel *r)
{
    for (uint32_t t = 0; t < r->made; t++) {
        truth_finish(&r->truths[t]);
        judge_finish(&r->judges[t]);
    }
    for (size_t k = 0; k < r->takes && r->stages; k++)
        video_stage_finish(&r->stages[k]);
    mem_free(r->truths);
    mem_free(r->judges);
    mem_free(r->stages);
    mem_free(r->pictures);
    mem_free(r->seconds);
    mem_free(r->errors);
}

static enum err reel_init(struct reel *r, const struct video_runs *runs, struct reason *why)
{
    const struct video *v = runs->video;
    bool made = true;

    *r = (struct reel){ .runs = runs, .takes = (size_t)VIDEO_WAYS * v->budget_count * v->seeds };
    r->truths = mem_alloc(v->frames, sizeof(*r->truths));
    r->judges = mem_alloc(v->frames, sizeof(*r->judges));
    r->stages = mem_alloc(r->takes, sizeof(*r->stages));
    r->pictures = mem_alloc(r->takes * v->frames * 3 * v->width * v->height, sizeof(float));
    r->seconds = mem_alloc(r->takes, sizeof(double));
    r->errors = mem_alloc(r->takes, sizeof(double));
    for (size_t k = 0; k < r->takes && r->stages && made; k++)
        made = !video_stage_init(&r->stages[k], runs, (int)(k / (v->budget_count * v->seeds)), why);
    if (made && r->truths && r->judges && r->stages && r->pictures && r->seconds && r->errors)
        return ERR_OK;
    reel_finish(r);
    *r = (struct reel){ .takes = 0 };
    return err_say(why, ERR_NOMEM, "no memory for %u frames of %zu sequences", v->frames, r->takes);
}

/* Pilots get their wish, and some frames to learn in that do not count. */
static enum err teach_pilots(struct reel *r, const struct video_light *l, struct reason *why)
{
    const struct video *v = r->runs->video;
    double pace, seconds;
    enum err e = ERR_OK;

    for (int way = 0; way < VIDEO_WAYS; way++)
        for (uint32_t budget = 0; budget < v->budget_count && !e; budget++) {
            if (!r->stages[take_index(v, way, budget, 0)].pilot)
                continue;
            e = video_pace(r->runs, l, v->budgets[budget], r->pictures, &pace, why);
            for (uint32_t k = 0; k < PILOT_FRAMES * v->seeds && !e; k++) {
                struct technique_stage *s = &r->stages[take_index(v, way, budget, k % v->seeds)];
                s->seconds = pace;
                e = video_run(r->runs, s, way, l, v->budgets[budget], k % v->seeds, 0, r->pictures, &seconds, why);
            }
        }
    return e;
}

/* Everything that is made of one frame. */
static enum err run_frame(struct reel *r, const struct video_light *l, uint32_t frame, struct reason *why)
{
    const struct video *v = r->runs->video;
    enum err e = video_truth(r->runs, l, &r->truths[frame], &r->judges[frame], why);

    r->made += !e;
    for (uint32_t seed = 0; seed < v->seeds && !e; seed++)
        for (uint32_t budget = 0; budget < v->budget_count && !e; budget++)
            for (int way = 0; way < VIDEO_WAYS && !e; way++) {
                const size_t k = take_index(v, way, budget, seed);
                double seconds;
                if (!v->takes[way])
                    continue;
                e = video_run(r->runs, &r->stages[k], way, l, v->budgets[budget], seed, frame, picture_of(r, k, frame),
                              &seconds, why);
                r->seconds[k] += e ? 0.0 : seconds / v->frames;
                r->errors[k] += e ? 0.0 : judge_error(&r->judges[frame], picture_of(r, k, frame)) / v->frames;
            }
    progress_step(r->runs->desc->line, work_of_frame(v));
    return e;
}

/* One way at one budget, from all its seeds. */
static enum err find_point(const struct reel *r, const struct motion *m, int way, uint32_t budget, float *map,
                           struct video_point *out)
{
    const struct video *v = r->runs->video;
    double values[4][SEEDS_FULL];
    const float **x = mem_alloc(v->frames, sizeof(*x));
    enum err e = x ? ERR_OK : ERR_NOMEM;

    for (uint32_t seed = 0; seed < v->seeds && x; seed++) {
        const size_t k = take_index(v, way, budget, seed);
        for (uint32_t t = 0; t < v->frames; t++)
            x[t] = picture_of(r, k, t);
        values[0][seed] = motion_flicker(m, x, seed == 0 ? map : NULL);
        values[1][seed] = motion_change(m, x);
        values[2][seed] = r->errors[k];
        values[3][seed] = 1e3 * r->seconds[k];
    }
    struct band *const bands[4] = { &out->flicker, &out->change, &out->error, &out->milliseconds };
    for (int q = 0; q < 4 && !e; q++)
        e = series_band(values[q], v->seeds, bands[q]);
    mem_free(x);
    return e;
}

static enum err find_points(const struct reel *r, struct video_sequence *s, struct reason *why)
{
    const struct video *v = r->runs->video;
    const size_t pixels = (size_t)v->width * v->height;
    struct motion m;

    enum err e = motion_init(&m, r->judges, v->frames, v->still, why);
    if (e)
        return e;
    s->still_share = m.still_share;
    s->picture = mem_alloc(3 * pixels, sizeof(float));
    if (!s->picture)
        e = ERR_NOMEM;
    else
        memcpy(s->picture, r->judges[0].mean, 3 * pixels * sizeof(float));
    for (int way = 0; way < VIDEO_WAYS && !e; way++) {
        s->maps[way] = mem_alloc(pixels, sizeof(float));
        e = s->maps[way] ? ERR_OK : ERR_NOMEM;
        for (uint32_t k = 0; k < v->budget_count && v->takes[way] && !e; k++)
            e = find_point(r, &m, way, k, k == v->budget_count / 2 ? s->maps[way] : NULL, &s->points[way][k]);
    }
    motion_finish(&m);
    return e ? err_say(why, e, "no memory to judge moving pictures") : ERR_OK;
}

static enum err measure_sequence(const struct video_runs *runs, const char *source, struct video_sequence *s,
                                 struct reason *why)
{
    const struct video *v = runs->video;
    struct video_light l;
    struct reel r = { .takes = 0 };

    enum err e = video_light_init(&l, source, why);
    s->degrees = l.degrees;
    if (!e)
        e = reel_init(&r, runs, why);
    if (!e)
        e = teach_pilots(&r, &l, why);
    for (uint32_t t = 0; t < v->frames && !e; t++) {
        e = video_light_turn(&l, t, why);
        if (!e)
            e = run_frame(&r, &l, t, why);
    }
    if (!e)
        e = find_points(&r, s, why);
    reel_finish(&r);
    video_light_finish(&l);
    return e;
}

static enum err prepare(struct video_runs *r, struct reason *why)
{
    const struct set_desc d = {
        .scene = r->desc->scene_spec,
        .width = r->video->width,
        .height = r->video->height,
    };
    const enum err e = set_create(&d, &r->set, why);

    if (e)
        return e;
    r->mask = mem_alloc((size_t)r->video->width * r->video->height, 1);
    if (!r->mask)
        return err_say(why, ERR_NOMEM, "no memory for a mask");
    resolve_mask(r->set->gbuffer, r->mask);
    for (int w = 0; w < VIDEO_WAYS; w++)
        r->techniques[w] = technique_of(r->desc->techniques, &video_ways[w]);
    return ERR_OK;
}

enum err video_measure(const struct video_desc *desc, struct video **out, struct reason *why)
{
    const double start = clock_seconds();
    struct video *v = mem_alloc(1, sizeof(*v));
    struct video_runs r = { .desc = desc, .video = v };
    const char *list = desc->sources;
    char spec[4096];

    *out = NULL;
    if (!v)
        return err_say(why, ERR_NOMEM, "no memory for moving pictures");
    *v = shape_of(desc);
    snprintf(v->scene, sizeof(v->scene), "%s", desc->scene);
    enum err e = prepare(&r, why);
    while (!e && v->sequence_count < VIDEO_SEQUENCES_MAX &&
           chart_next_item(&list, v->sequences[v->sequence_count].source, spec)) {
        e = measure_sequence(&r, spec, &v->sequences[v->sequence_count], why);
        v->sequence_count++;
    }
    if (!e)
        e = video_measure_step(&r, why);
    mem_free(r.mask);
    set_destroy(r.set);
    v->seconds = clock_seconds() - start;
    if (e)
        video_destroy(v);
    else
        *out = v;
    return e;
}

void video_destroy(struct video *v)
{
    if (!v)
        return;
    for (int k = 0; k < VIDEO_SEQUENCES_MAX; k++) {
        for (int w = 0; w < VIDEO_WAYS; w++)
            mem_free(v->sequences[k].maps[w]);
        mem_free(v->sequences[k].picture);
    }
    mem_free(v);
}
