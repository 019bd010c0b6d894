/* server/chart/video_step.c: the sun comes out (video.h). */
#include "video_runs.h"

#include "film.h"
#include "mem.h"
#include "metrics.h"
#include "progress.h"

#include <math.h>
#include <string.h>

#define FRAMES (VIDEO_BEFORE + VIDEO_AFTER)

/* Without a sun to speak of, and a fifth as bright as such a sky is by itself, as under thick cloud; and with the sun:
 * the same place, hour and day. */
static const char *const skies[2] = { "sky:hour=12,turbidity=10,sun_ratio=1,scale=0.0013", "sky:hour=12" };

struct state { /* of one way under one seed, from frame to frame */
    struct technique_stage stage;
    struct exposure exposure;
    double error[FRAMES], display[FRAMES];
};

struct steps {
    const struct video_runs *runs;
    struct video_light lights[2];
    struct truth truths[2];
    struct judge judges[2];
    int made;             /* of lights, truths and judges */
    struct state *states; /* [VIDEO_WAYS][seeds] */
    float *rgb, *shown;   /* [height][width][3] */
};

uint64_t video_step_work(const struct video_desc *desc)
{
    (void)desc;
    return FRAMES * 16;
}

/* Delta E of x under the exposure's present gain against the truth under the gain that it settles at, over the whole
 * picture, since that is what exposure follows. */
static enum err display_error(struct steps *s, struct exposure *exposure, const float *x, const struct judge *truth,
                              double *out)
{
    const uint32_t width = truth->width, height = truth->height;
    double log2_mean = log2(exposure->key);
    struct metrics m;

    (void)exposure_log2_mean(truth->mean, NULL, width, height, &log2_mean);
    const double settled = exposure->key / exp2(log2_mean);
    const double gain = exposure_step(exposure, x, width, height, 1);
    for (size_t v = 0; v < 3 * (size_t)width * height; v++)
        s->shown[v] = (float)((double)x[v] * gain / settled);
    if (!metrics_compare(s->shown, truth->mean, NULL, width, height, 0.0, NULL, &m))
        return ERR_NOMEM;
    *out = m.delta_e;
    return ERR_OK;
}

static enum err run_frame(struct steps *s, uint32_t frame, struct reason *why)
{
    const struct video *v = s->runs->video;
    const int sky = frame >= VIDEO_BEFORE;
    const uint32_t budget = v->budgets[v->budget_count / 2];
    enum err e = ERR_OK;

    for (int way = 0; way < VIDEO_WAYS && !e; way++)
        for (uint32_t seed = 0; seed < v->seeds && v->takes[way] && !e; seed++) {
            struct state *state = &s->states[(uint32_t)way * v->seeds + seed];
            double seconds;
            e = video_run(s->runs, &state->stage, way, &s->lights[sky], budget, seed, frame, s->rgb, &seconds, why);
            if (e)
                break;
            state->error[frame] = judge_error(&s->judges[sky], s->rgb);
            e = display_error(s, &state->exposure, s->rgb, &s->judges[sky], &state->display[frame]);
        }
    progress_step(s->runs->desc->line, 16);
    return e;
}

static enum err prepare(struct steps *s, struct reason *why)
{
    const struct video *v = s->runs->video;
    double pace = 0.0;
    enum err e = ERR_OK;

    s->states = mem_alloc((size_t)VIDEO_WAYS * v->seeds, sizeof(*s->states));
    s->rgb = mem_alloc(3 * (size_t)v->width * v->height, sizeof(float));
    s->shown = mem_alloc(3 * (size_t)v->width * v->height, sizeof(float));
    if (!s->states || !s->rgb || !s->shown)
        return err_say(why, ERR_NOMEM, "no memory for the step");
    for (uint32_t k = 0; k < VIDEO_WAYS * v->seeds; k++) {
        e = video_stage_init(&s->states[k].stage, s->runs, (int)(k / v->seeds), why);
        if (e)
            return e;
        exposure_init(&s->states[k].exposure);
    }
    while (s->made < 2 && !e) {
        e = video_light_init(&s->lights[s->made], skies[s->made], why); /* not turned */
        if (!e)
            e = video_truth(s->runs, &s->lights[s->made], &s->truths[s->made], &s->judges[s->made], why);
        if (e)
            video_light_finish(&s->lights[s->made]);
        else
            s->made++;
    }
    if (!e)
        e = video_pace(s->runs, &s->lights[0], v->budgets[v->budget_count / 2], s->rgb, &pace, why);
    for (uint32_t k = 0; k < VIDEO_WAYS * v->seeds; k++)
        s->states[k].stage.seconds = pace; /* whoever has a pilot learns from the first frame on, as a stream does */
    return e;
}

static enum err summarize(struct steps *s)
{
    struct video *v = s->runs->video;
    double values[64];
    struct band band;
    enum err e = ERR_OK;

    for (int way = 0; way < VIDEO_WAYS; way++)
        for (uint32_t t = 0; t < FRAMES && v->takes[way] && !e; t++) {
            const struct state *of = &s->states[(uint32_t)way * v->seeds];
            for (uint32_t k = 0; k < v->seeds; k++)
                values[k] = of[k].error[t];
            e = series_band(values, v->seeds, &band);
            v->step.error[way][t] = band.median;
            for (uint32_t k = 0; k < v->seeds; k++)
                values[k] = of[k].display[t];
            if (!e)
                e = series_band(values, v->seeds, &band);
            v->step.display[way][t] = band.median;
        }
    return e;
}

/* What a renderer without any error would show. */
static enum err run_truth(struct steps *s)
{
    struct exposure exposure = { .key = 0.0 };
    enum err e = ERR_OK;

    exposure_init(&exposure);
    for (uint32_t t = 0; t < FRAMES && !e; t++) {
        const struct judge *j = &s->judges[t >= VIDEO_BEFORE];
        e = display_error(s, &exposure, j->mean, j, &s->runs->video->step.exposure[t]);
    }
    return e;
}

enum err video_measure_step(const struct video_runs *runs, struct reason *why)
{
    struct steps s = { .runs = runs };
    enum err e = prepare(&s, why);

    for (uint32_t t = 0; t < FRAMES && !e; t++)
        e = run_frame(&s, t, why);
    if (!e)
        e = run_truth(&s);
    if (!e)
        e = summarize(&s);
    for (int k = 0; k < s.made; k++) {
        judge_finish(&s.judges[k]);
        truth_finish(&s.truths[k]);
        video_light_finish(&s.lights[k]);
    }
    for (uint32_t k = 0; s.states && k < VIDEO_WAYS * runs->video->seeds; k++)
        video_stage_finish(&s.states[k].stage);
    mem_free(s.states);
    mem_free(s.rgb);
    mem_free(s.shown);
    return e && !why->text[0] ? err_say(why, e, "%s", err_text(e)) : e;
}
