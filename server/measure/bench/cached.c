#include "measure/bench/bench.h"

#include "base/clock.h"
#include "base/mem.h"
#include "base/rng.h"
#include "light/resolve/resolve.h"

#include <math.h>

#define TRUTH_PASSES 32 /* at most, of */
#define TRUTH_SAMPLES 64
#define TRUTH_SECONDS 20.0    /* for images of TRUTH_VALUES; larger ones in proportion, so that theirs are as good */
#define TRUTH_VALUES 691200.0 /* 640 x 360 of three colours */

/* ---- The cache ---- */

enum err cached_create(struct bench *b, struct cached **out, struct reason *why)
{
    const size_t pixels = (size_t)b->desc->width * b->desc->height;
    struct cached *c = mem_alloc(1, sizeof(*c));
    double ms = 0.0;

    *out = c;
    if (!c)
        return err_say(why, ERR_NOMEM, "out of memory");
    c->light = (struct relight_desc){
        .direct = { .method = METHOD_CACHED, .samples = CACHED_SAMPLES, .why = &c->why },
        .classes = PATH_BACKGROUND | PATH_DIRECT,
    };
    c->values = 3 * pixels;
    c->relighter = relighter_create(b->set, b->kernels);
    c->rgb = mem_alloc(c->values, sizeof(*c->rgb));
    c->mask = mem_alloc(pixels, 1);
    if (!c->relighter || !c->rgb || !c->mask)
        return err_say(why, ERR_NOMEM, "out of memory");
    resolve_mask(b->set->gbuffer, c->mask);
    enum err e = relighter_prepare(c->relighter, &c->light, false, &ms);
    if (!e)
        e = relighter_run(c->relighter, b->sky->environment, &c->light, c->rgb, &c->stats);
    return e ? err_say(why, e, "%s", c->why.text[0] ? c->why.text : err_text(e)) : ERR_OK;
}

void cached_destroy(struct cached *c)
{
    if (!c)
        return;
    relighter_destroy(c->relighter);
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
    return result;
}

void cached_truth_finish(struct cached_truth *t)
{
    mem_free(t->half[0]);
    mem_free(t->half[1]);
    *t = (struct cached_truth){ { NULL } };
}

enum err cached_rel_mse(const struct bench *b, const struct cached *c, float *const half[2], const float *x,
                        double *out)
{
    struct reason why;
    struct judge j;
    const enum err e = judge_init(&j, half[0], half[1], c->mask, b->desc->width, b->desc->height, &why);

    *out = e ? 0.0 : judge_error(&j, x);
    judge_finish(&j);
    return e == ERR_RANGE ? ERR_OK : e; /* a black image has no error */
}
