/* server/chart/measure.c: the runs that fill a panel (panel.h). */
#include "chart/panel.h"

#include "base/clock.h"
#include "film/film.h"
#include "codec/jpeg.h"
#include "base/mem.h"
#include "base/progress.h"
#include "light/resolve.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define JPEG_QUALITY 92 /* relightd's own default */
#define WARM_UP_SEED UINT64_MAX
#define PACE_RUNS 3                    /* whose median is a pilot's wish */
#define JUDGE_WORK 4                   /* of comparing a picture, in the units of work_of */
#define PICTURES_MAX ((size_t)8 << 30) /* bytes */

struct bench { /* what the runs share */
    const struct panel_desc *desc;
    struct panel *panel;
    struct technique_stage stage[BUDGETS_MAX]; /* of each budget, with its own pilot and its wish */
    struct jpeg_encoder *jpeg;
    uint8_t *display;             /* [height][width][3] */
    float *pictures;              /* [curve_count][budget_count][seeds][height][width][3] */
    double *common[COMMON_PARTS]; /* [rounds] milliseconds */
    uint32_t rounds;
};

static size_t values_of(const struct panel *p)
{
    return 3 * (size_t)p->width * p->height;
}

static float *picture_of(const struct bench *b, size_t curve, uint32_t budget, uint32_t seed)
{
    const struct panel *p = b->panel;
    return b->pictures + ((curve * p->budget_count + budget) * p->seeds + seed) * values_of(p);
}

/* About how long a run takes: rays are its cost, and something a frame. */
static uint64_t work_of(const struct technique *t, uint32_t budget)
{
    return 8 + (t->kind == TECHNIQUE_BASELINE ? 2 : t->light_class == LIGHT_DIRECT ? 1 : 3) * (uint64_t)budget;
}

static uint64_t truth_work(const struct panel_desc *d)
{
    const uint64_t parts = (d->truth_samples + TRUTH_PART - 1) / TRUTH_PART;
    return 2 * parts * TRUTH_PART;
}

uint64_t panel_work(const struct panel_desc *desc)
{
    size_t count;
    const struct technique *all = technique_all(&count);
    uint64_t work = truth_work(desc);

    for (size_t t = 0; t < count; t++)
        for (uint32_t k = 0; k < desc->budget_count; k++)
            if (all[t].light_class == desc->light_class && panel_takes(desc->techniques, &all[t]))
                work += desc->seeds * (JUDGE_WORK + work_of(&all[t], desc->budgets[k])) +
                        (all[t].kind == TECHNIQUE_AUTO ? PILOT_FRAMES * work_of(&all[t], desc->budgets[k]) : 0);
    return work;
}

static enum err make_curves(struct panel *p, const struct panel_desc *d)
{
    size_t count;
    const struct technique *all = technique_all(&count);
    const size_t runs = (size_t)p->budget_count * p->seeds;

    p->curves = mem_alloc(count, sizeof(*p->curves));
    for (size_t t = 0; t < count && p->curves; t++) {
        if (all[t].light_class != d->light_class || !panel_takes(d->techniques, &all[t]))
            continue;
        struct panel_curve *c = &p->curves[p->curve_count++];
        c->technique = &all[t];
        c->points = mem_alloc(p->budget_count, sizeof(*c->points));
        c->seconds = mem_alloc(runs, sizeof(double));
        c->errors = mem_alloc(ERROR_KINDS * runs, sizeof(double));
        c->pictures = mem_alloc(p->budget_count * values_of(p), sizeof(float));
        if (!c->points || !c->seconds || !c->errors || !c->pictures)
            return ERR_NOMEM;
    }
    return p->curves ? ERR_OK : ERR_NOMEM;
}

static enum err set_up(struct bench *b, struct reason *why)
{
    const struct panel_desc *d = b->desc;
    struct panel *p = b->panel;
    enum err e = make_curves(p, d);

    b->jpeg = jpeg_encoder_create();
    b->display = mem_alloc(values_of(p), 1);
    const size_t bytes = p->curve_count * p->budget_count * p->seeds * values_of(p) * sizeof(float);
    if (bytes > PICTURES_MAX)
        return err_say(why, ERR_RANGE,
                       "the pictures of %zu techniques, %u budgets and %u seeds take %.1f GB, at most %.1f: "
                       "make them smaller, or fewer",
                       p->curve_count, p->budget_count, p->seeds, 1e-9 * (double)bytes, 1e-9 * (double)PICTURES_MAX);
    b->pictures = mem_alloc_raw(bytes, 1);
    p->mask = mem_alloc((size_t)p->width * p->height, 1);
    for (int k = 0; k < COMMON_PARTS; k++) {
        b->common[k] = mem_alloc((size_t)p->budget_count * p->seeds, sizeof(double));
        if (!b->common[k])
            e = ERR_NOMEM;
    }
    struct relighter *relighter = relighter_create(d->set, d->kernels);
    for (uint32_t k = 0; k < p->budget_count; k++) {
        b->stage[k].relighter = relighter;
        b->stage[k].environment = d->environment;
        b->stage[k].pilot = relighter ? pilot_create(relighter, NULL) : NULL;
        if (!b->stage[k].pilot)
            e = ERR_NOMEM;
    }
    if (e || !relighter || !b->jpeg || !b->display || !b->pictures || !p->mask)
        return err_say(why, ERR_NOMEM, "no memory for the pictures of %zu techniques under %u seeds", p->curve_count,
                       p->seeds);
    resolve_mask(d->set->gbuffer, p->mask);
    return ERR_OK;
}

static enum err find_truth(struct bench *b, struct reason *why)
{
    const struct panel_desc *d = b->desc;
    struct panel *p = b->panel;
    const struct truth_desc t = {
        .set = d->set,
        .environment = d->environment,
        .frame = d->frame,
        .classes = light_class_paths(d->light_class),
        .samples = d->truth_samples,
        .cache = d->cache,
        .line = d->line,
    };
    struct reason said = { "" };

    enum err e = truth_make(&t, &p->truth, why);
    if (!e && judge_init(&p->judge, p->truth.half[0], p->truth.half[1], p->mask, p->width, p->height, &said))
        e = err_say(why, ERR_RANGE, "%s under %s cannot be charted: %s", p->scene, p->source, said.text);
    if (!e && !exposure_log2_mean(p->judge.mean, p->mask, p->width, p->height, &p->gain_log2))
        p->gain_log2 = 0.0;
    return e;
}

/* What would be the same as its neighbour in this scene is not run. */
static void leave_out(const struct bench *b, struct panel_curve *c)
{
    if (b->desc->set->facts.casters == 0 && c->technique->light.caustics == PLAN_LIGHT)
        snprintf(c->left_out.text, sizeof(c->left_out.text),
                 "the scene has no mirror and no glass, so that no path from the light is asked for");
}

/* What pilots are told, and their first frames, in which they learn. */
static enum err teach_pilots(struct bench *b, const struct technique *automatic, struct reason *why)
{
    const struct panel *p = b->panel;
    float *rgb = picture_of(b, 0, 0, 0);
    enum err e = ERR_OK;

    for (uint32_t k = 0; k < p->budget_count && !e; k++) {
        struct technique_cost cost;
        double seconds[PACE_RUNS];
        struct band pace = { 0 };
        for (uint64_t s = 0; s < PACE_RUNS && !e; s++) {
            e = technique_run(technique_pace(p->light_class), &b->stage[k], p->budgets[k], WARM_UP_SEED - s, rgb, &cost,
                              why);
            seconds[s] = cost.seconds;
        }
        if (!e)
            e = series_band(seconds, PACE_RUNS, &pace);
        b->stage[k].seconds = pace.median;
        for (uint64_t s = 0; s < PILOT_FRAMES && !e; s++)
            e = technique_run(automatic, &b->stage[k], p->budgets[k], WARM_UP_SEED - s, rgb, &cost, why);
        progress_step(b->desc->line, PILOT_FRAMES * work_of(automatic, p->budgets[k]));
    }
    return e;
}

/* One run that is not measured: code and memory are warm then, and what a method cannot do is known. */
static enum err warm_up(struct bench *b, struct reason *why)
{
    struct panel *p = b->panel;
    struct technique_cost cost;

    for (size_t c = 0; c < p->curve_count; c++) {
        struct reason said = { "" };
        leave_out(b, &p->curves[c]);
        if (p->curves[c].left_out.text[0])
            continue;
        if (p->curves[c].technique->kind == TECHNIQUE_AUTO) {
            const enum err taught = teach_pilots(b, p->curves[c].technique, why);
            if (taught)
                return taught;
        }
        const enum err e = technique_run(p->curves[c].technique, &b->stage[0], p->budgets[0], WARM_UP_SEED,
                                         picture_of(b, c, 0, 0), &cost, &said);
        if (e == ERR_UNSUPPORTED || e == ERR_USAGE || e == ERR_RANGE)
            err_say(&p->curves[c].left_out, e, "%s", said.text[0] ? said.text : err_text(e));
        else if (e)
            return err_say(why, e, "%s", said.text[0] ? said.text : err_text(e));
        p->curves[c].bias = cost.bias;
        p->curves[c].prepared_ms = 1e3 * cost.prepared;
        p->curves[c].prepared_bytes = cost.prepared_bytes;
    }
    return ERR_OK;
}

/* What comes before and after every technique's own work, once: the picture is that of one of them. */
static enum err run_common(struct bench *b, const float *rgb, struct reason *why)
{
    const struct panel_desc *d = b->desc;
    const struct panel *p = b->panel;
    const uint8_t *bytes;
    double at[COMMON_PARTS + 1] = { clock_seconds() };
    size_t size;

    enum err e = environment_decode(d->environment, d->frame, why);
    at[1] = clock_seconds();
    if (!e)
        e = environment_rebuild(d->environment, why);
    at[2] = clock_seconds();
    tone_map(rgb, p->width, p->height, &(struct tone_desc){ 0.18 / exp2(p->gain_log2), TONE_FILMIC, d->kernels->level },
             b->display);
    at[3] = clock_seconds();
    if (!e)
        e = jpeg_encode(b->jpeg, b->display, p->width, p->height, JPEG_QUALITY, &bytes, &size);
    at[4] = clock_seconds();
    for (int k = 0; k < COMMON_PARTS; k++)
        b->common[k][b->rounds] = 1e3 * (at[k + 1] - at[k]);
    b->rounds++;
    return e;
}

/* Every technique once, with one budget and seed. Who begins changes from seed to seed. */
static enum err run_round(struct bench *b, uint32_t budget, uint32_t seed, struct reason *why)
{
    struct panel *p = b->panel;
    enum err e = ERR_OK;

    for (size_t k = 0; k < p->curve_count && !e; k++) {
        const size_t c = (k + seed) % p->curve_count;
        struct panel_curve *curve = &p->curves[c];
        struct panel_point *point = &curve->points[budget];
        struct technique_cost cost;

        if (!curve->left_out.text[0]) {
            float *rgb = picture_of(b, c, budget, seed);
            e = technique_run(curve->technique, &b->stage[budget], p->budgets[budget], seed, rgb, &cost, why);
            curve->seconds[(size_t)budget * p->seeds + seed] = cost.seconds;
            point->budget = p->budgets[budget];
            point->samples = cost.samples;
            point->eye_paths = cost.eye_paths;
            point->particles = cost.particles;
            point->rays = cost.rays;
            point->expected += cost.expected / p->seeds;
        }
        progress_step(b->desc->line, work_of(curve->technique, p->budgets[budget]));
    }
    return e;
}

/* The errors of one technique's pictures at one budget. errors: [ERROR_KINDS][seeds] of scratch. */
static enum err judge_point(struct bench *b, size_t c, uint32_t budget, double *pairs, double *errors)
{
    struct panel *p = b->panel;
    struct panel_curve *curve = &p->curves[c];
    const float *x[SEEDS_MAX];
    double energy[SEEDS_MAX];

    for (uint32_t s = 0; s < p->seeds; s++) {
        x[s] = picture_of(b, c, budget, s);
        energy[s] = judge_energy(&p->judge, x[s]);
    }
    judge_pairs(&p->judge, x, p->seeds, pairs);
    const enum err e = errors_of(&p->judge, p->mask, x, pairs, p->seeds, errors);
    if (e)
        return e;
    for (size_t k = 0; k < ERROR_KINDS; k++)
        memcpy(curve->errors + (k * p->budget_count + budget) * p->seeds, errors + k * p->seeds,
               p->seeds * sizeof(*errors));
    judge_floor(&p->judge, pairs, energy, p->seeds, &curve->points[budget].floor);
    memcpy(curve->pictures + budget * values_of(p), x[0], values_of(p) * sizeof(float));
    return ERR_OK;
}

/* A picture by one technique or another; where there is none, the truth. */
static const float *some_picture(const struct bench *b, uint32_t budget, uint32_t seed)
{
    for (size_t k = 0; k < b->panel->curve_count; k++) {
        const size_t c = (k + seed) % b->panel->curve_count;
        if (!b->panel->curves[c].left_out.text[0])
            return picture_of(b, c, budget, seed);
    }
    return b->panel->judge.mean;
}

static enum err run_all(struct bench *b, double *pairs, struct reason *why)
{
    struct panel *p = b->panel;
    enum err e = ERR_OK;

    for (uint32_t s = 0; s < p->seeds; s++)
        for (uint32_t k = 0; k < p->budget_count && !e; k++) {
            e = run_round(b, k, s, why);
            if (!e)
                e = run_common(b, some_picture(b, k, s), why);
        }
    for (size_t c = 0; c < p->curve_count; c++)
        for (uint32_t k = 0; k < p->budget_count && !e; k++) {
            if (!p->curves[c].left_out.text[0])
                e = judge_point(b, c, k, pairs, pairs + (size_t)p->seeds * p->seeds);
            progress_step(b->desc->line, JUDGE_WORK * p->seeds);
        }
    return e;
}

/* Medians of what is common, added to every run, and the bands of all points. */
static enum err summarise(struct bench *b)
{
    struct panel *p = b->panel;
    double common = 0.0;
    enum err e = ERR_OK;

    for (int k = 0; k < COMMON_PARTS && !e; k++) {
        struct band band;
        e = series_band(b->common[k], b->rounds, &band);
        p->common_ms[k] = band.median;
        common += 1e-3 * band.median;
    }
    for (size_t c = 0; c < p->curve_count && !e; c++) {
        struct panel_curve *curve = &p->curves[c];
        for (size_t i = 0; i < (size_t)p->budget_count * p->seeds; i++)
            curve->seconds[i] += common;
        for (uint32_t k = 0; k < p->budget_count && !e; k++) {
            e = series_band(curve->seconds + (size_t)k * p->seeds, p->seeds, &curve->points[k].seconds);
            for (int m = 0; m < ERROR_KINDS && !e; m++)
                e = series_band(curve->errors + ((size_t)m * p->budget_count + k) * p->seeds, p->seeds,
                                &curve->points[k].errors[m]);
        }
    }
    return e;
}

static enum err measure(struct bench *b, struct reason *why)
{
    struct panel *p = b->panel;
    double *pairs = mem_alloc((size_t)p->seeds * (p->seeds + ERROR_KINDS), sizeof(*pairs));
    enum err e = pairs ? set_up(b, why) : ERR_NOMEM;

    if (!e)
        e = find_truth(b, why);
    if (!e)
        e = warm_up(b, why);
    if (!e)
        e = run_all(b, pairs, why);
    if (!e)
        e = summarise(b);
    mem_free(pairs);
    relighter_destroy(b->stage[0].relighter);
    for (uint32_t k = 0; k < p->budget_count; k++)
        pilot_destroy(b->stage[k].pilot);
    jpeg_encoder_destroy(b->jpeg);
    mem_free(b->display);
    mem_free(b->pictures);
    for (int k = 0; k < COMMON_PARTS; k++)
        mem_free(b->common[k]);
    return e;
}

enum err panel_measure(const struct panel_desc *desc, struct panel **out, struct reason *why)
{
    struct panel *p = mem_alloc(1, sizeof(*p));
    const struct set *set = desc->set;

    *out = NULL;
    if (!p)
        return err_say(why, ERR_NOMEM, "out of memory");
    snprintf(p->scene, sizeof(p->scene), "%s", desc->scene);
    snprintf(p->source, sizeof(p->source), "%s", desc->source);
    p->light_class = desc->light_class;
    p->width = set->view.width;
    p->height = set->view.height;
    p->seeds = desc->seeds;
    p->budget_count = desc->budget_count;
    memcpy(p->budgets, desc->budgets, desc->budget_count * sizeof(*p->budgets));
    p->load_ms = set->load_ms;
    p->bvh_ms = set->bvh_ms;
    p->gbuffer_ms = set->gbuffer_ms;
    p->table_ms = desc->table_ms;
    p->points = set->gbuffer->point_count;
    p->casters = set->facts.casters;
    p->behind = set->facts.behind;
    p->gbuffer_bytes = set->gbuffer->bytes;
    struct bench b = { .desc = desc, .panel = p };
    const enum err e = measure(&b, why);
    if (e) {
        panel_destroy(p);
        return why->text[0] ? e : err_say(why, e, "%s", err_text(e));
    }
    *out = p;
    return ERR_OK;
}
