/* The runs that fill a panel (panel.h). */
#include "measure/chart/panel.h"

#include "base/clock.h"
#include "base/mem.h"
#include "base/progress.h"
#include "image/codec/jpeg.h"
#include "image/film/film.h"
#include "light/resolve/resolve.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define JPEG_QUALITY 92 /* relightd's own default */
#define WARM_UP_SEED UINT64_MAX
#define OTHER_SIZE 16                  /* texels */
#define PACE_RUNS 3                    /* whose median is the time of auto */
#define JUDGE_WORK 4                   /* of comparing an image, in the units of work_of */
#define IMAGES_MAX ((size_t)8 << 30) /* bytes */

struct runs { /* of one panel */
    const struct panel_desc *desc;
    struct panel *panel;
    struct technique_stage stage[BUDGETS_MAX]; /* of each budget, with its own time */
    struct environment *other;
    struct jpeg_encoder *jpeg;
    uint8_t *display;             /* [height][width][3] */
    float *images;              /* [curve_count][budget_count][seeds][height][width][3] */
    double *common[COMMON_PARTS]; /* [rounds] milliseconds */
    uint32_t rounds;
};

static size_t values_of(const struct panel *p)
{
    return 3 * (size_t)p->width * p->height;
}

static float *image_of(const struct runs *r, size_t curve, uint32_t budget, uint32_t seed)
{
    const struct panel *p = r->panel;
    return r->images + ((curve * p->budget_count + budget) * p->seeds + seed) * values_of(p);
}

/* About how long a run takes: mostly its rays. */
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
                work += desc->seeds * (JUDGE_WORK + work_of(&all[t], desc->budgets[k]));
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
        c->images = mem_alloc(p->budget_count * values_of(p), sizeof(float));
        if (!c->points || !c->seconds || !c->errors || !c->images)
            return ERR_NOMEM;
    }
    return p->curves ? ERR_OK : ERR_NOMEM;
}

/* A sky like no other. */
static enum err make_other(struct runs *r, struct reason *why)
{
    struct frame f = { .kind = FRAME_NONE };
    enum err e = frame_reserve_texels(&f, OTHER_SIZE, OTHER_SIZE / 2);

    for (size_t i = 0; !e && i < 3 * OTHER_SIZE * OTHER_SIZE / 2; i++)
        f.rgb[i] = 1.0f + (float)(i % 7);
    r->other = environment_create(&(struct environment_desc){ .n = r->desc->environment->n });
    e = e || !r->other ? ERR_NOMEM : environment_update(r->other, &f, why);
    frame_finish(&f);
    return e;
}

static enum err set_up(struct runs *r, struct reason *why)
{
    const struct panel_desc *d = r->desc;
    struct panel *p = r->panel;
    enum err e = make_curves(p, d);

    if (!e)
        e = make_other(r, why);
    r->jpeg = jpeg_encoder_create();
    r->display = mem_alloc(values_of(p), 1);
    const size_t bytes = p->curve_count * p->budget_count * p->seeds * values_of(p) * sizeof(float);
    if (bytes > IMAGES_MAX)
        return err_say(why, ERR_RANGE,
                       "the images of %zu techniques, %u budgets and %u seeds take %.1f GB, at most %.1f: "
                       "make them smaller, or fewer",
                       p->curve_count, p->budget_count, p->seeds, 1e-9 * (double)bytes, 1e-9 * (double)IMAGES_MAX);
    r->images = mem_alloc_raw(bytes, 1);
    p->mask = mem_alloc((size_t)p->width * p->height, 1);
    for (int k = 0; k < COMMON_PARTS; k++) {
        r->common[k] = mem_alloc((size_t)p->budget_count * p->seeds, sizeof(double));
        if (!r->common[k])
            e = ERR_NOMEM;
    }
    struct relighter *relighter = relighter_create(d->set, d->kernels);
    for (uint32_t k = 0; k < p->budget_count; k++) {
        r->stage[k].relighter = relighter;
        r->stage[k].environment = d->environment;
        r->stage[k].other = r->other;
    }
    if (e || !relighter || !r->jpeg || !r->display || !r->images || !p->mask)
        return err_say(why, ERR_NOMEM, "no memory for the images of %zu techniques under %u seeds", p->curve_count,
                       p->seeds);
    resolve_mask(d->set->gbuffer, p->mask);
    return ERR_OK;
}

struct truth_desc panel_truth(const struct panel_desc *d)
{
    return (struct truth_desc){
        .set = d->set,
        .environment = d->environment,
        .frame = d->frame,
        .classes = light_class_paths(d->light_class),
        .samples = d->truth_samples,
        .cache = d->cache,
        .line = d->line,
    };
}

static enum err find_truth(struct runs *r, struct reason *why)
{
    struct panel *p = r->panel;
    const struct truth_desc t = panel_truth(r->desc);
    struct reason fault = { "" };

    enum err e = truth_make(&t, &p->truth, why);
    if (!e && judge_init(&p->judge, p->truth.half[0], p->truth.half[1], p->mask, p->width, p->height, &fault))
        e = err_say(why, ERR_RANGE, "%s under %s cannot be charted: %s", p->scene, p->source, fault.text);
    if (!e && !exposure_log2_mean(p->judge.mean, p->mask, p->width, p->height, &p->gain_log2))
        p->gain_log2 = 0.0;
    return e;
}

/* Leaves out what would repeat another technique in this scene. */
static void leave_out(const struct runs *r, struct panel_curve *c)
{
    if (r->desc->set->facts.casters == 0 && c->technique->light.caustics == PLAN_LIGHT)
        snprintf(c->left_out.text, sizeof(c->left_out.text), "the scene has no mirror or glass, hence no caustics");
}

/* Sets the times of auto. */
static enum err pace_auto(struct runs *r, struct reason *why)
{
    const struct panel *p = r->panel;
    float *rgb = image_of(r, 0, 0, 0);
    enum err e = ERR_OK;

    for (uint32_t k = 0; k < p->budget_count && !e; k++) {
        struct technique_cost cost;
        double seconds[PACE_RUNS];
        struct band pace = { 0 };
        for (uint64_t s = 0; s < PACE_RUNS && !e; s++) {
            e = technique_run(technique_pace(p->light_class), &r->stage[k], p->budgets[k], WARM_UP_SEED - s, rgb, &cost,
                              why);
            seconds[s] = cost.seconds;
        }
        if (!e)
            e = series_band(seconds, PACE_RUNS, &pace);
        r->stage[k].seconds = pace.median;
    }
    return e;
}

/* One run of each that is not measured warms up code and memory, and finds what cannot be run. */
static enum err warm_up(struct runs *r, struct reason *why)
{
    struct panel *p = r->panel;
    struct technique_cost cost;

    for (size_t c = 0; c < p->curve_count; c++) {
        struct reason fault = { "" };
        leave_out(r, &p->curves[c]);
        if (p->curves[c].left_out.text[0])
            continue;
        if (p->curves[c].technique->kind == TECHNIQUE_AUTO) {
            const enum err paced = pace_auto(r, why);
            if (paced)
                return paced;
        }
        const enum err e = technique_run(p->curves[c].technique, &r->stage[0], p->budgets[0], WARM_UP_SEED,
                                         image_of(r, c, 0, 0), &cost, &fault);
        if (e == ERR_UNSUPPORTED || e == ERR_USAGE || e == ERR_RANGE)
            err_say(&p->curves[c].left_out, e, "%s", fault.text[0] ? fault.text : err_text(e));
        else if (e)
            return err_say(why, e, "%s", fault.text[0] ? fault.text : err_text(e));
        p->curves[c].bias = cost.bias;
        p->curves[c].prepared_ms = 1e3 * cost.prepared;
        p->curves[c].prepared_bytes = cost.prepared_bytes;
    }
    return ERR_OK;
}

/* The common stages, once, with the image of one technique. */
static enum err run_common(struct runs *r, const float *rgb, struct reason *why)
{
    const struct panel_desc *d = r->desc;
    const struct panel *p = r->panel;
    const uint8_t *bytes;
    double at[COMMON_PARTS + 1] = { clock_seconds() };
    size_t size;

    enum err e = environment_decode(d->environment, d->frame, why);
    at[1] = clock_seconds();
    if (!e)
        e = environment_rebuild(d->environment, why);
    at[2] = clock_seconds();
    tone_map(rgb, p->width, p->height, &(struct tone_desc){ 0.18 / exp2(p->gain_log2), TONE_FILMIC, d->kernels->level },
             r->display);
    at[3] = clock_seconds();
    if (!e)
        e = jpeg_encode(r->jpeg, r->display, p->width, p->height, JPEG_QUALITY, &bytes, &size);
    at[4] = clock_seconds();
    for (int k = 0; k < COMMON_PARTS; k++)
        r->common[k][r->rounds] = 1e3 * (at[k + 1] - at[k]);
    r->rounds++;
    return e;
}

/* Every technique once, with one budget and seed. The first one changes with the seed. */
static enum err run_round(struct runs *r, uint32_t budget, uint32_t seed, struct reason *why)
{
    struct panel *p = r->panel;
    enum err e = ERR_OK;

    for (size_t k = 0; k < p->curve_count && !e; k++) {
        const size_t c = (k + seed) % p->curve_count;
        struct panel_curve *curve = &p->curves[c];
        struct panel_point *point = &curve->points[budget];
        struct technique_cost cost;

        if (!curve->left_out.text[0]) {
            float *rgb = image_of(r, c, budget, seed);
            e = technique_run(curve->technique, &r->stage[budget], p->budgets[budget], seed, rgb, &cost, why);
            curve->seconds[(size_t)budget * p->seeds + seed] = cost.seconds;
            point->budget = p->budgets[budget];
            point->samples = cost.samples;
            point->eye_paths = cost.eye_paths;
            point->particles = cost.particles;
            point->rays = cost.rays;
            point->expected += cost.expected / p->seeds;
        }
        progress_step(r->desc->line, work_of(curve->technique, p->budgets[budget]));
    }
    return e;
}

/* The errors of one technique's images at one budget. errors: [ERROR_KINDS][seeds] of scratch. */
static enum err judge_point(struct runs *r, size_t c, uint32_t budget, double *pairs, double *errors)
{
    struct panel *p = r->panel;
    struct panel_curve *curve = &p->curves[c];
    const float *x[SEEDS_MAX];
    double energy[SEEDS_MAX];

    for (uint32_t s = 0; s < p->seeds; s++) {
        x[s] = image_of(r, c, budget, s);
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
    memcpy(curve->images + budget * values_of(p), x[0], values_of(p) * sizeof(float));
    return ERR_OK;
}

/* An image by any technique; the truth if there is none. */
static const float *some_image(const struct runs *r, uint32_t budget, uint32_t seed)
{
    for (size_t k = 0; k < r->panel->curve_count; k++) {
        const size_t c = (k + seed) % r->panel->curve_count;
        if (!r->panel->curves[c].left_out.text[0])
            return image_of(r, c, budget, seed);
    }
    return r->panel->judge.mean;
}

static enum err run_all(struct runs *r, double *pairs, struct reason *why)
{
    struct panel *p = r->panel;
    enum err e = ERR_OK;

    for (uint32_t s = 0; s < p->seeds; s++)
        for (uint32_t k = 0; k < p->budget_count && !e; k++) {
            e = run_round(r, k, s, why);
            if (!e)
                e = run_common(r, some_image(r, k, s), why);
        }
    for (size_t c = 0; c < p->curve_count; c++)
        for (uint32_t k = 0; k < p->budget_count && !e; k++) {
            if (!p->curves[c].left_out.text[0])
                e = judge_point(r, c, k, pairs, pairs + (size_t)p->seeds * p->seeds);
            progress_step(r->desc->line, JUDGE_WORK * p->seeds);
        }
    return e;
}

/* Medians of what is common, added to every run, and the bands of all points. */
static enum err summarise(struct runs *r)
{
    struct panel *p = r->panel;
    double common = 0.0;
    enum err e = ERR_OK;

    for (int k = 0; k < COMMON_PARTS && !e; k++) {
        struct band band;
        e = series_band(r->common[k], r->rounds, &band);
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

static enum err measure(struct runs *r, struct reason *why)
{
    struct panel *p = r->panel;
    double *pairs = mem_alloc((size_t)p->seeds * (p->seeds + ERROR_KINDS), sizeof(*pairs));
    enum err e = pairs ? set_up(r, why) : ERR_NOMEM;

    if (!e)
        e = find_truth(r, why);
    if (!e)
        e = warm_up(r, why);
    if (!e)
        e = run_all(r, pairs, why);
    if (!e)
        e = summarise(r);
    mem_free(pairs);
    relighter_destroy(r->stage[0].relighter);
    environment_destroy(r->other);
    jpeg_encoder_destroy(r->jpeg);
    mem_free(r->display);
    mem_free(r->images);
    for (int k = 0; k < COMMON_PARTS; k++)
        mem_free(r->common[k]);
    return e;
}

enum err panel_measure(const struct panel_desc *desc, struct panel **out, struct reason *why)
{
    struct panel *p = mem_alloc(1, sizeof(*p));
    const struct prepared_scene *set = desc->set;

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
    struct runs r = { .desc = desc, .panel = p };
    const enum err e = measure(&r, why);
    if (e) {
        panel_destroy(p);
        return why->text[0] ? e : err_say(why, e, "%s", err_text(e));
    }
    *out = p;
    return ERR_OK;
}
