#include "measure/chart/chart.h"

#include "base/clock.h"
#include "base/mem.h"
#include "base/progress.h"
#include "base/setting.h"
#include "base/sort.h"
#include "image/codec/encode.h"
#include "image/film/film.h"
#include "light/resolve/resolve.h"
#include "measure/chart/judge.h"
#include "measure/chart/script.h"

#include <math.h>
#include <string.h>

#define JPEG_QUALITY 92 /* relightd's own default */
#define WARM_UP_SEED UINT64_MAX
#define OTHER_SIZE 16                /* texels */
#define PACE_RUNS 3                  /* whose median is the time of auto */
#define JUDGE_WORK 4                 /* of comparing an image, in the units of work_of */
#define IMAGES_MAX ((size_t)8 << 30) /* bytes */

struct curve {
    const struct technique *technique;
    bool left_out;
    json_t *out; /* borrowed */
};

struct runs { /* of one panel */
    const struct panel_desc *desc;
    json_t *out, *common; /* the panel; its common_ms, borrowed */
    uint32_t width, height, seeds, budget_count;
    struct curve curves[TECHNIQUES_MAX];
    size_t curve_count;
    struct technique_stage stage[BUDGETS_MAX]; /* of each budget, with its own time */
    struct environment *other;
    struct jpeg_encoder *jpeg;
    struct truth truth;
    struct judge judge;
    double gain;      /* the reference's exposure: its log-average luminance to middle grey */
    uint8_t *mask;    /* [height][width]: pixels that see a surface */
    uint8_t *display; /* [height][width][3] */
    float *images;    /* [curve_count][budget_count][seeds][height][width][3] */
};

static size_t values_of(const struct runs *r)
{
    return 3 * (size_t)r->width * r->height;
}

static float *image_of(const struct runs *r, size_t curve, uint32_t budget, uint32_t seed)
{
    return r->images + ((curve * r->budget_count + budget) * r->seeds + seed) * values_of(r);
}

static json_t *point_of(const struct runs *r, size_t curve, uint32_t budget)
{
    return json_array_get(json_object_get(r->curves[curve].out, "points"), budget);
}

/* About how long a run takes: mostly its rays. */
static uint64_t work_of(const struct technique *t, uint32_t budget)
{
    return 8 + (t->kind == TECHNIQUE_BASELINE ? 2 : t->light_class == LIGHT_DIRECT ? 1 : 3) * (uint64_t)budget;
}

uint64_t panel_work(const struct panel_desc *desc)
{
    size_t count;
    const struct technique *all = technique_all(&count);
    const uint64_t truth_parts = (desc->truth_samples + TRUTH_PART - 1) / TRUTH_PART; /* of each reference */
    uint64_t work = 2 * truth_parts * TRUTH_PART;

    for (size_t t = 0; t < count; t++)
        for (uint32_t k = 0; k < desc->budget_count; k++)
            if (all[t].light_class == desc->light_class && technique_listed(desc->techniques, &all[t]))
                work += desc->seeds * (JUDGE_WORK + work_of(&all[t], desc->budgets[k]));
    return work;
}

static void add_curve(struct runs *r, const struct technique *t)
{
    json_t *points = json_array();

    for (uint32_t k = 0; k < r->budget_count; k++)
        json_array_append_new(
            points, json_pack("{s:I, s:[], s:[]}", "budget", (json_int_t)r->desc->budgets[k], "seconds", "expected"));
    json_t *out = json_pack("{s:s, s:s, s:i, s:s, s:s, s:n, s:o}", "technique", t->name, "about", t->about, "colour",
                            (int)t->colour, "kind", technique_kinds[t->kind], "method",
                            method_name(t->light.direct.method), "left_out", "points", points);
    json_array_append_new(json_object_get(r->out, "curves"), out);
    r->curves[r->curve_count++] = (struct curve){ .technique = t, .out = out };
}

static void begin(struct runs *r)
{
    const struct panel_desc *d = r->desc;
    const struct prepared_scene *set = d->set;
    size_t count;
    const struct technique *all = technique_all(&count);

    r->out =
        json_pack("{s:o, s:o, s:s, s:s, s:i, s:i, s:i, s:I, s:I, s:f, s:f, s:f, s:f, s:{s:[], s:[], s:[], s:[]}, s:[]}",
                  "scene", words_to_json(d->scene), "source", words_to_json(d->source), "light",
                  d->light_class == LIGHT_DIRECT ? "direct" : "all", "pace", technique_pace(d->light_class)->name,
                  "width", (int)r->width, "height", (int)r->height, "seeds", (int)r->seeds, "points",
                  (json_int_t)set->gbuffer->point_count, "gbuffer_bytes", (json_int_t)set->gbuffer->bytes, "load_ms",
                  set->load_ms, "bvh_ms", set->bvh_ms, "gbuffer_ms", set->gbuffer_ms, "table_ms", d->table_ms,
                  "common_ms", "decode", "rebuild", "tone", "encode", "curves");
    r->common = json_object_get(r->out, "common_ms");
    for (size_t t = 0; t < count; t++)
        if (all[t].light_class == d->light_class && technique_listed(d->techniques, &all[t]))
            add_curve(r, &all[t]);
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
    const size_t bytes = r->curve_count * r->budget_count * r->seeds * values_of(r) * sizeof(float);

    if (bytes > IMAGES_MAX)
        return err_say(why, ERR_RANGE,
                       "the images of %zu techniques, %u budgets and %u seeds take %.1f GB, at most %.1f: "
                       "make them smaller, or fewer",
                       r->curve_count, r->budget_count, r->seeds, 1e-9 * (double)bytes, 1e-9 * (double)IMAGES_MAX);
    const enum err e = make_other(r, why);
    r->jpeg = jpeg_encoder_create();
    r->display = mem_alloc(values_of(r), 1);
    r->images = mem_alloc_raw(bytes, 1);
    r->mask = mem_alloc((size_t)r->width * r->height, 1);
    struct relighter *relighter = relighter_create(d->set, d->kernels);
    for (uint32_t k = 0; k < r->budget_count; k++) {
        r->stage[k].relighter = relighter;
        r->stage[k].environment = d->environment;
        r->stage[k].other = r->other;
    }
    if (e || !relighter || !r->jpeg || !r->display || !r->images || !r->mask)
        return err_say(why, ERR_NOMEM, "no memory for the images of %zu techniques under %u seeds", r->curve_count,
                       r->seeds);
    resolve_mask(d->set->gbuffer, r->mask);
    return ERR_OK;
}

struct truth_desc panel_truth(const struct panel_desc *d)
{
    return (struct truth_desc){
        .set = d->set,
        .environment = d->environment,
        .frame = d->frame,
        .classes = d->light_class == LIGHT_DIRECT ? PATH_BACKGROUND | PATH_DIRECT : PATH_ALL,
        .samples = d->truth_samples,
        .cache = d->cache,
        .line = d->line,
    };
}

static enum err find_truth(struct runs *r, struct reason *why)
{
    const struct truth_desc t = panel_truth(r->desc);
    struct judge *j = &r->judge;
    struct reason fault = { "" };
    double log2_mean = 0.0;

    enum err e = truth_make(&t, &r->truth, why);
    if (!e && judge_init(j, r->truth.half[0], r->truth.half[1], r->mask, r->width, r->height, &fault))
        e = err_say(why, ERR_RANGE, "%s under %s cannot be charted: %s", r->desc->scene, r->desc->source, fault.text);
    if (e)
        return e;
    (void)exposure_log2_mean(j->mean, r->mask, r->width, r->height, &log2_mean);
    r->gain = 0.18 / exp2(log2_mean);
    json_object_set_new(r->out, "reference_samples", json_integer(r->truth.samples[0] + r->truth.samples[1]));
    json_object_set_new(r->out, "reference_noise", script_number(j->noise));
    json_object_set_new(r->out, "reference_doubt", script_number(j->doubt));
    return json_object_set_new(r->out, "truth", thumb_image(j, r->gain, j->mean)) ? ERR_NOMEM : ERR_OK;
}

static void leave_out(struct curve *c, const char *reason)
{
    c->left_out = true;
    json_object_set_new(c->out, "left_out", words_to_json(reason));
}

/* Sets the times of auto. */
static enum err pace_auto(struct runs *r, struct reason *why)
{
    float *rgb = image_of(r, 0, 0, 0);
    enum err e = ERR_OK;

    for (uint32_t k = 0; k < r->budget_count && !e; k++) {
        struct technique_cost cost;
        double seconds[PACE_RUNS] = { 0.0 };
        for (uint64_t s = 0; s < PACE_RUNS && !e; s++) {
            e = technique_run(technique_pace(r->desc->light_class), &r->stage[k], r->desc->budgets[k], WARM_UP_SEED - s,
                              rgb, &cost, why);
            seconds[s] = e ? 0.0 : cost.seconds;
        }
        sort_doubles(seconds, PACE_RUNS);
        r->stage[k].seconds = seconds[PACE_RUNS / 2];
    }
    return e;
}

/* One run of each that is not measured warms up code and memory, and finds what cannot be run. */
static enum err warm_up(struct runs *r, struct reason *why)
{
    for (size_t k = 0; k < r->curve_count; k++) {
        struct curve *c = &r->curves[k];
        struct technique_cost cost = { .bias = NULL };
        struct reason fault = { "" };
        if (r->desc->set->facts.casters == 0 && c->technique->light.caustics == PLAN_LIGHT) {
            leave_out(c, "the scene has no mirror or glass, hence no caustics"); /* it would repeat another one */
            continue;
        }
        enum err e = c->technique->kind == TECHNIQUE_AUTO ? pace_auto(r, why) : ERR_OK;
        if (e)
            return e;
        e = technique_run(c->technique, &r->stage[0], r->desc->budgets[0], WARM_UP_SEED, image_of(r, k, 0, 0), &cost,
                          &fault);
        if (e == ERR_UNSUPPORTED || e == ERR_USAGE || e == ERR_RANGE)
            leave_out(c, fault.text[0] ? fault.text : err_text(e));
        else if (e)
            return err_say(why, e, "%s", fault.text[0] ? fault.text : err_text(e));
        json_object_set_new(c->out, "bias", cost.bias ? json_string(cost.bias) : json_null());
        json_object_set_new(c->out, "prepared_ms", json_real(1e3 * cost.prepared));
        json_object_set_new(c->out, "prepared_bytes", json_integer((json_int_t)cost.prepared_bytes));
    }
    return ERR_OK;
}

/* The common stages, once, with the image of one technique. */
static enum err run_common(struct runs *r, const float *rgb, struct reason *why)
{
    const struct panel_desc *d = r->desc;
    const uint8_t *bytes;
    double at[5] = { clock_seconds() };
    json_t *part;
    const char *name;
    size_t size, k = 0;

    enum err e = environment_decode(d->environment, d->frame, why);
    at[1] = clock_seconds();
    if (!e)
        e = environment_rebuild(d->environment, why);
    at[2] = clock_seconds();
    tone_map(rgb, r->width, r->height, &(struct tone_desc){ r->gain, TONE_FILMIC, d->kernels->level }, r->display);
    at[3] = clock_seconds();
    if (!e)
        e = jpeg_encode(r->jpeg, r->display, r->width, r->height, JPEG_QUALITY, &bytes, &size);
    at[4] = clock_seconds();
    json_object_foreach(r->common, name, part) /* in their order */
    {
        json_array_append_new(part, json_real(1e3 * (at[k + 1] - at[k])));
        k++;
    }
    return e;
}

static void add_run(json_t *point, const struct technique_cost *cost)
{
    json_array_append_new(json_object_get(point, "seconds"), json_real(cost->seconds));
    json_array_append_new(json_object_get(point, "expected"), script_number(cost->expected));
    json_object_update_new(point, json_pack("{s:I, s:I, s:I, s:I}", "samples", (json_int_t)cost->samples, "eye_paths",
                                            (json_int_t)cost->eye_paths, "particles", (json_int_t)cost->particles,
                                            "rays", (json_int_t)cost->rays));
}

/* Every technique once, with one budget and seed. The first one changes with the seed. */
static enum err run_round(struct runs *r, uint32_t budget, uint32_t seed, struct reason *why)
{
    const uint32_t n = r->desc->budgets[budget];
    enum err e = ERR_OK;

    for (size_t k = 0; k < r->curve_count && !e; k++) {
        const size_t c = (k + seed) % r->curve_count;
        const struct technique *t = r->curves[c].technique;
        struct technique_cost cost;

        if (!r->curves[c].left_out) {
            e = technique_run(t, &r->stage[budget], n, seed, image_of(r, c, budget, seed), &cost, why);
            if (!e)
                add_run(point_of(r, c, budget), &cost);
        }
        progress_step(r->desc->line, work_of(t, n));
    }
    return e;
}

static json_t *numbers(const double *v, uint32_t n)
{
    json_t *out = json_array();

    for (uint32_t k = 0; k < n; k++)
        json_array_append_new(out, script_number(v[k]));
    return out;
}

/* The errors of one technique's images at one budget. pairs, errors: [seeds][seeds], [ERROR_KINDS][seeds] of scratch.
 */
static enum err judge_point(struct runs *r, size_t c, uint32_t budget, double *pairs, double *errors)
{
    json_t *point = point_of(r, c, budget), *kinds = json_object();
    const float *x[SEEDS_MAX];
    double energy[SEEDS_MAX];
    struct judge_floor f;

    for (uint32_t s = 0; s < r->seeds; s++) {
        x[s] = image_of(r, c, budget, s);
        energy[s] = judge_energy(&r->judge, x[s]);
    }
    judge_pairs(&r->judge, x, r->seeds, pairs);
    enum err e = errors_of(&r->judge, r->mask, x, pairs, r->seeds, errors);
    for (int k = 0; k < ERROR_KINDS && !e; k++)
        json_object_set_new(kinds, error_names[k], numbers(errors + (size_t)k * r->seeds, r->seeds));
    judge_floor(&r->judge, pairs, energy, r->seeds, &f);
    json_object_set_new(point, "errors", kinds);
    json_object_set_new(point, "floor",
                        json_pack("{s:o, s:o, s:o, s:o, s:o, s:o, s:o}", "error", script_number(f.error), "bias",
                                  script_number(f.bias), "doubt", script_number(f.doubt), "z", script_number(f.z),
                                  "variance", script_number(f.variance), "energy", script_number(f.energy),
                                  "energy_doubt", script_number(f.energy_doubt)));
    if (json_object_set_new(point, "image", thumb_image(&r->judge, r->gain, x[0])) ||
        json_object_set_new(point, "map", thumb_errors(&r->judge, x[0])))
        e = ERR_NOMEM;
    return e;
}

/* An image by any technique; the truth if there is none. */
static const float *some_image(const struct runs *r, uint32_t budget, uint32_t seed)
{
    for (size_t k = 0; k < r->curve_count; k++) {
        const size_t c = (k + seed) % r->curve_count;
        if (!r->curves[c].left_out)
            return image_of(r, c, budget, seed);
    }
    return r->judge.mean;
}

static enum err run_all(struct runs *r, struct reason *why)
{
    double *scratch = mem_alloc((size_t)r->seeds * (r->seeds + ERROR_KINDS), sizeof(*scratch));
    enum err e = scratch ? ERR_OK : ERR_NOMEM;

    for (uint32_t s = 0; s < r->seeds; s++)
        for (uint32_t k = 0; k < r->budget_count && !e; k++) {
            e = run_round(r, k, s, why);
            if (!e)
                e = run_common(r, some_image(r, k, s), why);
        }
    for (size_t c = 0; c < r->curve_count; c++)
        for (uint32_t k = 0; k < r->budget_count && !e; k++) {
            if (!r->curves[c].left_out)
                e = judge_point(r, c, k, scratch, scratch + (size_t)r->seeds * r->seeds);
            progress_step(r->desc->line, JUDGE_WORK * r->seeds);
        }
    mem_free(scratch);
    return e;
}

enum err panel_measure(const struct panel_desc *desc, json_t **out, struct reason *why)
{
    struct runs r = {
        .desc = desc,
        .width = desc->set->view.width,
        .height = desc->set->view.height,
        .seeds = desc->seeds,
        .budget_count = desc->budget_count,
    };

    begin(&r);
    enum err e = set_up(&r, why);
    if (!e)
        e = find_truth(&r, why);
    if (!e)
        e = warm_up(&r, why);
    if (!e)
        e = run_all(&r, why);
    relighter_destroy(r.stage[0].relighter);
    environment_destroy(r.other);
    jpeg_encoder_destroy(r.jpeg);
    judge_finish(&r.judge);
    truth_finish(&r.truth);
    mem_free(r.mask);
    mem_free(r.display);
    mem_free(r.images);
    *out = r.out;
    return e && !why->text[0] ? err_say(why, e, "%s", err_text(e)) : e;
}
