#include "bench/first_minute.h"

#include "base/clock.h"
#include "base/mem.h"
#include "base/progress.h"
#include "film/film.h"
#include "light/decide.h"
#include "source/source.h"

#include <math.h>
#include <omp.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define INTERVAL_S (1.0 / 30.0) /* between pictures */
#define TRUTH_SAMPLES 32
#define TRUTH_EYE_PATHS 32
#define AFTER 4           /* pictures after the cache is complete, while its last blocks fade in */
#define PATIENCE_S 600.0  /* for the cache, on a busy machine */
#define AGAIN_S 4.0       /* of pictures by the finished cache after the second start, */
#define AGAIN_MOST_S 30.0 /* and for the first of them */
#define SECOND_DIFFERENCES (4 * 255 + 1)
#define STATED_LEAST 0.67 /* of the true error, */
#define STATED_MOST 1.5   /* likewise */

static const double kept_s[] = { 0, 1, 1.5, 2, 3, 4, 5, 7, 10, 14, 20, 30, 45, 60, 90 };
enum { KEPT = sizeof(kept_s) / sizeof(kept_s[0]) };
_Static_assert(KEPT < FIRST_MINUTE_ROWS, "and a row for the last picture");

struct changes { /* second differences of all values, by size */
    uint64_t of[SECOND_DIFFERENCES];
};

/* A picture with its error. */
struct seen {
    struct first_minute_row row;
    bool cached; /* by the finished cache */
};

struct first_minute {
    const struct bench_desc *desc;
    const struct kernels *kernels;
    struct frame frame;
    struct set *set;
    struct environment *environment;
    enum err sky_error; /* of make_sky, with its reason */
    struct reason sky_why;
    struct relighter *relighter;
    struct decider decider;
    struct relight_desc light;
    struct reason why;
    double begun_s, begun_processor_s;
    uint64_t pictures;
    struct changes since, all; /* the last row; the start */
    uint8_t *codes[3];         /* the last pictures as shown, the newest first */
    double gain;
    size_t values;  /* of a picture */
    float *rgb;     /* the newest one */
    float *half[2]; /* of the truth: independent */
    float *per;     /* weights of relMSE */
    size_t next;    /* of kept_s */
    struct first_minute_result *out;
};

/* ---- What a process has: made again for each start ---- */

/* The sky's tables, beside the loading of the scene, as relightd's ingest thread makes them. */
static void *make_sky(void *arg)
{
    struct first_minute *m = arg;

    omp_set_num_threads(1);
    m->environment = environment_create(&(struct environment_desc){ .n = 0 });
    m->sky_error = m->environment ? environment_update(m->environment, &m->frame, &m->sky_why)
                                  : err_say(&m->sky_why, ERR_NOMEM, "out of memory");
    return NULL;
}

static struct set_desc describe(const struct first_minute *m)
{
    const struct bench_desc *d = m->desc;

    return (struct set_desc){ .scene = d->scene, .reading = d->reading, .width = d->width, .height = d->height };
}

/* live: its first image may show a coarse view, as relightd's. */
static enum err begin(struct first_minute *m, const char *folder, bool live, struct reason *why)
{
    struct set_desc set = describe(m);
    pthread_t sky;

    m->begun_s = clock_seconds();
    m->begun_processor_s = clock_processor();
    m->pictures = 0;
    m->light.cache_dir = folder;
    set.soon = live && !relight_may_be_kept(&set, &m->light);
    if (pthread_create(&sky, NULL, make_sky, m) != 0)
        return err_say(why, ERR_NOMEM, "a thread could not be started");
    const enum err e = set_create(&set, &m->set, why);
    pthread_join(sky, NULL);
    if (e)
        return e;
    if (m->sky_error)
        return err_say(why, m->sky_error, "%s", m->sky_why.text);
    m->relighter = relighter_create(m->set, m->kernels);
    return m->relighter ? ERR_OK : err_say(why, ERR_NOMEM, "out of memory");
}

/* After the first image: the complete view, if that was coarse. */
static enum err complete(struct first_minute *m)
{
    const struct set_desc desc = describe(m);
    struct progress line;
    struct set *set = NULL;

    if (!m->set->coarse)
        return ERR_OK;
    progress_begin(&line, "computing the view", desc.height, NULL);
    const enum err e = set_create_complete(m->set, &desc, &line, &set, &m->why);
    progress_end(&line);
    if (e)
        return e;
    decider_finish(&m->decider);
    relighter_destroy(m->relighter);
    set_hand_over(m->set, set);
    set_destroy(m->set);
    m->set = set;
    m->relighter = relighter_create(set, m->kernels);
    return m->relighter ? ERR_OK : ERR_NOMEM;
}

static void end(struct first_minute *m)
{
    decider_finish(&m->decider);
    relighter_destroy(m->relighter);
    environment_destroy(m->environment);
    set_destroy(m->set);
    m->relighter = NULL;
    m->environment = NULL;
    m->set = NULL;
}

static enum err prepare(struct first_minute *m, struct reason *why)
{
    const struct bench_desc *d = m->desc;
    const struct source_desc source = { .spec = d->source };
    enum err e = kernels_select(d->cpu, &m->kernels, why);

    if (d->threads)
        omp_set_num_threads(d->threads);
    if (!e)
        e = source_first(&source, &m->frame, why);
    if (e)
        return e;
    m->values = 3 * (size_t)d->width * d->height;
    m->rgb = mem_alloc(m->values, sizeof(*m->rgb));
    m->per = mem_alloc(m->values, sizeof(*m->per));
    for (int k = 0; k < 3; k++)
        m->codes[k] = mem_alloc(m->values, 1);
    for (int k = 0; k < 2; k++)
        m->half[k] = mem_alloc(m->values, sizeof(float));
    if (!m->rgb || !m->per || !m->codes[0] || !m->codes[1] || !m->codes[2] || !m->half[0] || !m->half[1])
        return err_say(why, ERR_NOMEM, "out of memory");
    m->light = (struct relight_desc){ .direct = { .method = METHOD_AUTO, .samples = 16, .why = &m->why },
                                      .classes = PATH_ALL,
                                      .cache_file = "",
                                      .renew = CAUSTIC_PARTS };
    return ERR_OK;
}

/* ---- The truth ---- */

/* Weights from the truth's own mean. */
static void weigh(struct first_minute *m)
{
    double mean = 0.0;

    for (size_t v = 0; v < m->values; v++)
        mean += 0.5 * ((double)m->half[0][v] + (double)m->half[1][v]) / (double)m->values;
    for (size_t v = 0; v < m->values; v++) {
        const double x = 0.5 * ((double)m->half[0][v] + (double)m->half[1][v]);
        m->per[v] = (float)(1.0 / (x * x + 1e-2 * mean * mean + 1e-30));
    }
}

/* Two halves of unbiased passes of all light. */
static enum err make_truth(struct first_minute *m)
{
    struct relight_desc light = m->light;
    struct relight_stats stats;
    enum err e = ERR_OK;

    light.direct.method = METHOD_MIS;
    light.direct.samples = TRUTH_SAMPLES;
    light.direct.seed = 77;
    light.eye_paths = TRUTH_EYE_PATHS;
    for (int i = 0; i < 2 * m->desc->rounds && !e; i++) {
        light.direct.pass = (uint64_t)i;
        e = relighter_run(m->relighter, m->environment, &light, m->rgb, &stats);
        for (size_t v = 0; v < m->values; v++)
            m->half[i % 2][v] += m->rgb[v] / (float)m->desc->rounds;
    }
    weigh(m);
    return e;
}

/* relMSE without the noise of the truth: the product of the differences from its two halves. */
static double error_of(const struct first_minute *m)
{
    double sum = 0.0;

#pragma omp parallel for schedule(static) reduction(+ : sum)
    for (size_t v = 0; v < m->values; v++)
        sum += (double)((m->rgb[v] - m->half[0][v]) * (m->rgb[v] - m->half[1][v]) * m->per[v]);
    return sum / (double)m->values;
}

/* ---- Flicker ---- */

/* How the newest picture continues the two before. */
static void watch(struct first_minute *m)
{
    const struct bench_desc *d = m->desc;
    struct exposure exposure;
    uint8_t *oldest = m->codes[2];

    exposure_init(&exposure);
    if (m->pictures == 1)
        m->gain = exposure_step(&exposure, m->rgb, d->width, d->height, 1);
    m->codes[2] = m->codes[1];
    m->codes[1] = m->codes[0];
    m->codes[0] = oldest;
    tone_map(m->rgb, d->width, d->height, &(struct tone_desc){ .gain = m->gain }, m->codes[0]);
    for (size_t v = 0; v < m->values && m->pictures >= 3; v++) {
        const int by = abs(m->codes[0][v] - 2 * m->codes[1][v] + m->codes[2][v]);
        m->since.of[by]++;
        m->all.of[by]++;
    }
}

static int flicker_of(const struct changes *c)
{
    uint64_t all = 0, below = 0;
    int code = 0;

    for (int k = 0; k < SECOND_DIFFERENCES; k++)
        all += c->of[k];
    if (all == 0)
        return -1;
    while (below + c->of[code] < 0.99 * (double)all)
        below += c->of[code++];
    return code;
}

/* ---- Pictures ---- */

static enum err make_picture(struct first_minute *m, struct seen *seen)
{
    struct frame_request request = {
        .light = &m->light, .background = true, .no_cache = m->set->coarse, .allow_bias = INFINITY
    };
    struct decision decision;
    struct relight_stats stats;
    struct pilot_stats measured;

    m->light.turn = m->pictures++;
    request.target.seconds = decider_target_s(&m->decider, m->relighter, INTERVAL_S);
    decider_begin(&m->decider, m->relighter, &request);
    request.target.seconds = decider_target_s(&m->decider, m->relighter, INTERVAL_S);
    decide(&m->decider, &request, &decision);
    const enum err e =
        decider_run(&m->decider, m->relighter, m->environment, &request, &decision, m->rgb, &stats, &measured);
    if (e)
        return e;
    const bool cached = decision.by == DECIDED_BY_CACHE;
    *seen = (struct seen){ { .wall_s = clock_seconds() - m->begun_s,
                             .processor_s = clock_processor() - m->begun_processor_s,
                             .share = stats.cache_share,
                             .error = error_of(m),
                             .stated = stats.error,
                             .flicker = -1,
                             .by = cached                   ? "cache"
                                   : decision.light.denoise ? "denoised"
                                                            : "samples" },
                           cached && stats.cache_share >= 1.0 };
    decider_learn(&m->decider, m->relighter, &request, &decision, &stats, &measured);
    return ERR_OK;
}

static void reach(double *when, bool is, const struct first_minute_row *row)
{
    if (!is)
        *when = -1.0;
    else if (*when < 0.0)
        *when = row->wall_s;
}

static void note(struct first_minute *m, const struct seen *seen, bool last)
{
    struct first_minute_result *out = m->out;
    const struct first_minute_row *row = &seen->row;

    if (m->pictures == 1)
        out->first_s = row->wall_s;
    reach(&out->good_s, row->error <= FIRST_MINUTE_GOOD, row);
    reach(&out->better_s, row->error <= FIRST_MINUTE_BETTER, row);
    out->stated += row->stated > 0.0;
    out->held += row->stated >= STATED_LEAST * row->error && row->stated <= STATED_MOST * row->error;
    if (!last && (m->next >= KEPT || row->wall_s < kept_s[m->next]))
        return;
    while (m->next < KEPT && kept_s[m->next] <= row->wall_s)
        m->next++; /* also of times without a picture of their own */
    if (m->desc->progress)
        fprintf(stderr, "%s under %s: %.1f s, relMSE %.1e, states %.1e, %.0f %% of the cache\n", m->set->name,
                m->desc->source, row->wall_s, row->error, row->stated, 100.0 * row->share);
    out->rows[out->count] = *row;
    out->rows[out->count++].flicker = flicker_of(&m->since);
    memset(&m->since, 0, sizeof(m->since));
}

static void wait_until(double when_s)
{
    const double wait_s = when_s - clock_seconds();

    if (wait_s > 0.0)
        nanosleep(&(struct timespec){ (time_t)wait_s, (long)(1e9 * fmod(wait_s, 1.0)) }, NULL);
}

static enum err live(struct first_minute *m, double least_s, bool until_complete)
{
    enum err e = ERR_OK;
    bool going = true;

    for (int after = 0; !e && going;) {
        struct seen seen;
        const double start = clock_seconds();
        e = make_picture(m, &seen);
        if (e)
            break;
        m->out->complete = m->decider.cache.begun && !decider_is_computing(&m->decider, m->relighter);
        after += m->out->complete;
        const double past_s = clock_seconds() - m->begun_s;
        going = until_complete ? (after < AFTER || past_s < least_s) && past_s < PATIENCE_S : past_s < least_s;
        watch(m);
        note(m, &seen, !going);
        e = complete(m);
        if (going)
            wait_until(start + fmax(decider_interval_s(&m->decider), INTERVAL_S));
    }
    m->out->flicker = flicker_of(&m->all);
    return e;
}

/* By the finished cache: the last picture's error is what it reaches; and when the first of them was as good. */
static enum err start_again(struct first_minute *m, const char *folder, struct reason *why)
{
    enum { MOST = 256 };
    struct first_minute_row rows[MOST];
    double first_s = -1.0;
    size_t count = 0;

    end(m);
    enum err e = begin(m, folder, true, why);
    while (!e && count < MOST) {
        struct seen seen;
        const double start = clock_seconds(), past_s = start - m->begun_s;
        if (first_s < 0.0 ? past_s > AGAIN_MOST_S : past_s > first_s + AGAIN_S)
            break;
        e = make_picture(m, &seen);
        if (!e && seen.cached) {
            rows[count++] = seen.row;
            first_s = first_s < 0.0 ? seen.row.wall_s : first_s;
        }
        wait_until(start + INTERVAL_S);
    }
    if (e || count == 0)
        return e;
    m->out->finished_error = rows[count - 1].error;
    for (size_t k = 0; k < count; k++)
        reach(&m->out->again_s, rows[k].error <= FIRST_MINUTE_EQUAL * m->out->finished_error, &rows[k]);
    return ERR_OK;
}

static void release(struct first_minute *m)
{
    end(m);
    frame_finish(&m->frame);
    for (int k = 0; k < 3; k++)
        mem_free(m->codes[k]);
    for (int k = 0; k < 2; k++)
        mem_free(m->half[k]);
    mem_free(m->per);
    mem_free(m->rgb);
    mem_free(m);
}

enum err first_minute_run(const struct bench_desc *desc, const char *folder, const char *finished, double least_s,
                          bool until_complete, struct first_minute_result *out, struct reason *why)
{
    struct first_minute *m = mem_alloc(1, sizeof(*m));

    *out = (struct first_minute_result){
        .first_s = -1.0,
        .good_s = -1.0,
        .better_s = -1.0,
        .equal_s = -1.0,
        .again_s = -1.0,
        .finished_error = -1.0,
    };
    if (!m)
        return err_say(why, ERR_NOMEM, "out of memory");
    m->desc = desc;
    m->out = out;
    enum err e = prepare(m, why);
    if (!e)
        e = begin(m, folder, false, why);
    if (!e && (e = make_truth(m)))
        err_say(why, e, "%s", m->why.text[0] ? m->why.text : err_text(e));
    end(m);
    if (!e)
        e = begin(m, folder, true, why);
    if (!e && (e = live(m, least_s, until_complete)))
        err_say(why, e, "%s", m->why.text[0] ? m->why.text : err_text(e));
    if (!e && finished && (out->complete || finished != folder))
        e = start_again(m, finished, why);
    release(m);
    return e;
}
