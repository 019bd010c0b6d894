/* The first minute of a live picture: how its error falls from the start of the process on. */
#include "bench/bench.h"

#include "base/clock.h"
#include "base/mem.h"
#include "light/decide.h"
#include "source/source.h"

#include <math.h>
#include <omp.h>
#include <string.h>
#include <time.h>

#define INTERVAL_S (1.0 / 30.0) /* between pictures */
#define HURRY_SHARE 0.3
#define PICTURE_SHARE 0.75
#define TRUTH_SAMPLES 32
#define TRUTH_EYE_PATHS 32
#define AFTER 4 /* pictures after the cache is complete, while its last blocks fade in */

static const double kept_s[] = { 0, 1, 1.5, 2, 3, 4, 5, 7, 10, 14, 20, 30, 45, 60, 90 };
enum { KEPT = sizeof(kept_s) / sizeof(kept_s[0]) + 1 }; /* and the last picture */

struct kept {
    double wall_s, processor_s;
    double share; /* of the cache */
    const char *by;
    float *rgb; /* NULL: there is none */
};

struct first_minute {
    const struct bench_desc *desc;
    const struct kernels *kernels;
    struct frame frame;
    struct set *set;
    struct environment *environment;
    struct relighter *relighter;
    struct decider decider;
    struct relight_desc light;
    struct reason why;
    double begun_s;
    struct kept kept[KEPT];
    size_t count;   /* of kept */
    size_t values;  /* of a picture */
    float *rgb;     /* the newest one */
    float *half[2]; /* of the reference: independent */
};

static double processor_seconds(void)
{
    struct timespec t;

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static enum err begin(struct first_minute *m, struct reason *why)
{
    const struct bench_desc *d = m->desc;
    const struct set_desc set = { .scene = d->scene, .reading = d->reading, .width = d->width, .height = d->height };
    const struct source_desc source = { .spec = d->source };
    enum err e = kernels_select(d->cpu, &m->kernels, why);

    if (d->threads)
        omp_set_num_threads(d->threads);
    if (!e)
        e = set_create(&set, &m->set, why);
    if (!e)
        e = source_first(&source, &m->frame, why);
    if (e)
        return e;
    m->values = 3 * (size_t)d->width * d->height;
    m->environment = environment_create(&(struct environment_desc){ .n = 0 });
    m->relighter = relighter_create(m->set, m->kernels);
    m->rgb = mem_alloc(m->values, sizeof(*m->rgb));
    if (!m->environment || !m->relighter || !m->rgb)
        return err_say(why, ERR_NOMEM, "out of memory");
    m->light = (struct relight_desc){ .direct = { .method = METHOD_AUTO, .samples = 16, .why = &m->why },
                                      .classes = PATH_ALL };
    return environment_update(m->environment, &m->frame, why);
}

/* Keeps the newest picture if it is the first after one of the times, or the last. */
static enum err keep(struct first_minute *m, const struct decision *decision, const struct relight_stats *stats,
                     bool last)
{
    const double wall_s = clock_seconds() - m->begun_s;

    if (!last && (m->count + 1 >= KEPT || wall_s < kept_s[m->count]))
        return ERR_OK;
    struct kept *k = &m->kept[m->count++];
    while (m->count + 1 < KEPT && kept_s[m->count] <= wall_s)
        m->count++; /* times without a picture of their own */
    *k = (struct kept){ wall_s, processor_seconds(), stats->cache_share,
                        decision->by == DECIDED_BY_CACHE ? "cache"
                        : decision->light.denoise        ? "denoised"
                                                         : "samples",
                        mem_alloc(m->values, sizeof(float)) };
    if (!k->rgb)
        return ERR_NOMEM;
    memcpy(k->rgb, m->rgb, m->values * sizeof(float));
    return ERR_OK;
}

static enum err make_picture(struct first_minute *m, bool last)
{
    struct frame_request request = {
        .light = &m->light, .target.seconds = PICTURE_SHARE * INTERVAL_S, .background = true, .allow_bias = INFINITY
    };
    struct decision decision;
    struct relight_stats stats;
    struct pilot_stats measured;

    decider_begin(&m->decider, m->relighter, &request);
    if (decider_interval_s(&m->decider) > 0.0)
        request.target.seconds = HURRY_SHARE * decider_interval_s(&m->decider);
    decide(&m->decider, &request, &decision);
    enum err e = decider_run(&m->decider, m->relighter, m->environment, &request, &decision, m->rgb, &stats, &measured);
    if (!e)
        e = keep(m, &decision, &stats, last);
    if (!e)
        decider_learn(&m->decider, m->relighter, &request, &decision, &stats, &measured);
    return e;
}

/* Pictures until the cache is complete, or the time is over. */
static enum err live(struct first_minute *m)
{
    const double most_s = kept_s[KEPT - 2];
    enum err e = ERR_OK;

    for (int after = 0; !e && after < AFTER && clock_seconds() - m->begun_s < most_s;) {
        const double start = clock_seconds();
        e = make_picture(m, false);
        const double wait_s = start + fmax(decider_interval_s(&m->decider), INTERVAL_S) - clock_seconds();
        if (wait_s > 0.0)
            nanosleep(&(struct timespec){ (time_t)wait_s, (long)(1e9 * fmod(wait_s, 1.0)) }, NULL);
        after += m->decider.cache.begun && !decider_is_computing(&m->decider, m->relighter);
    }
    while (m->count > 0 && !m->kept[m->count - 1].rgb)
        m->count--;
    return e ? e : make_picture(m, true);
}

/* Two halves of unbiased passes of all light. */
static enum err make_truth(struct first_minute *m)
{
    struct relight_desc light = m->light;
    struct relight_stats stats;
    enum err e = ERR_OK;

    light.direct.method = METHOD_MIS;
    light.direct.samples = TRUTH_SAMPLES;
    light.eye_paths = TRUTH_EYE_PATHS;
    for (int k = 0; k < 2; k++)
        if (!(m->half[k] = mem_alloc(m->values, sizeof(float))))
            return ERR_NOMEM;
    for (int i = 0; i < 2 * m->desc->rounds && !e; i++) {
        light.direct.pass = (uint64_t)i;
        light.direct.seed = 77;
        e = relighter_run(m->relighter, m->environment, &light, m->rgb, &stats);
        for (size_t v = 0; v < m->values; v++)
            m->half[i % 2][v] += m->rgb[v] / (float)m->desc->rounds;
    }
    return e;
}

/* relMSE without the noise of the reference: the product of the differences from its two halves. The weights are those
 * of the last picture, which has no noise. */
static double error_of(const struct first_minute *m, const float *x)
{
    const float *last = m->kept[m->count - 1].rgb;
    double mean = 0.0, sum = 0.0;

    for (size_t v = 0; v < m->values; v++)
        mean += (double)last[v] / (double)m->values;
    for (size_t v = 0; v < m->values; v++)
        sum += (double)(x[v] - m->half[0][v]) * (double)(x[v] - m->half[1][v]) /
               ((double)last[v] * (double)last[v] + 1e-2 * mean * mean);
    return sum / (double)m->values;
}

static void print(const struct first_minute *m, FILE *to)
{
    fprintf(to,
            "the first minute of %s, %ux%u, %d threads, all light; relMSE over all pixels, against 2 x %d samples\n",
            m->set->name, m->desc->width, m->desc->height, omp_get_max_threads(), m->desc->rounds * TRUTH_SAMPLES);
    fprintf(to, "%10s %14s  %-8s %9s %10s\n", "seconds", "processor s", "by", "computed", "relMSE");
    for (size_t k = 0; k < m->count; k++)
        if (m->kept[k].rgb)
            fprintf(to, "%10.2f %14.2f  %-8s %7.0f %% %10.2e\n", m->kept[k].wall_s, m->kept[k].processor_s,
                    m->kept[k].by, 100.0 * m->kept[k].share, error_of(m, m->kept[k].rgb));
}

enum err bench_first_minute(const struct bench_desc *desc, FILE *to, struct reason *why)
{
    struct first_minute *m = mem_alloc(1, sizeof(*m));
    enum err e = ERR_OK;

    if (!m)
        return err_say(why, ERR_NOMEM, "out of memory");
    m->desc = desc;
    m->begun_s = clock_seconds();
    e = begin(m, why);
    if (!e && ((e = live(m)) || (e = make_truth(m))))
        err_say(why, e, "%s", m->why.text[0] ? m->why.text : err_text(e));
    if (!e)
        print(m, to);
    decider_finish(&m->decider);
    relighter_destroy(m->relighter);
    environment_destroy(m->environment);
    set_destroy(m->set);
    frame_finish(&m->frame);
    for (size_t k = 0; k < KEPT; k++)
        mem_free(m->kept[k].rgb);
    for (int k = 0; k < 2; k++)
        mem_free(m->half[k]);
    mem_free(m->rgb);
    mem_free(m);
    return e;
}
