/* The first minute of a live picture: how its error falls from the start of the process on, how it flickers, and how
 * long a second start takes, which finds the cache on disk. */
#include "bench/bench.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "cache/cache_folder.h"
#include "film/film.h"
#include "light/decide.h"
#include "source/source.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define INTERVAL_S (1.0 / 30.0) /* between pictures */
#define TRUTH_SAMPLES 32
#define TRUTH_EYE_PATHS 32
#define AFTER 4          /* pictures after the cache is complete, while its last blocks fade in */
#define PATIENCE_S 900.0 /* for the cache, on a busy machine */
#define AGAIN_S 30.0     /* at most, of the second start */
#define SECOND_DIFFERENCES (4 * 255 + 1)

static const double kept_s[] = { 0, 1, 1.5, 2, 3, 4, 5, 7, 10, 14, 20, 30, 45, 60, 90 };
enum { KEPT = sizeof(kept_s) / sizeof(kept_s[0]) + 1 }; /* and the last picture */

struct kept {
    double wall_s, processor_s;
    double share; /* of the cache */
    const char *by;
    int flicker; /* since the row before, 8-bit codes: 99 % of the second differences in time are at most that; below 0:
                  * there were fewer than three pictures */
    float *rgb;  /* NULL: there is none */
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
    double begun_s, begun_processor_s;
    uint64_t pictures, changes[SECOND_DIFFERENCES]; /* since the last row, of all values, by size */
    uint8_t *codes[3];                              /* the last pictures as shown, the newest first */
    double gain;
    char folder[64];   /* of caches */
    struct kept again; /* a picture by the finished cache after the second start */
    bool complete;     /* the cache became so */
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

/* What a process has: made again for the second start. */
static enum err begin(struct first_minute *m, struct reason *why)
{
    const struct bench_desc *d = m->desc;
    const struct set_desc set = { .scene = d->scene, .reading = d->reading, .width = d->width, .height = d->height };

    m->begun_s = clock_seconds();
    m->begun_processor_s = processor_seconds();
    const enum err e = set_create(&set, &m->set, why);
    if (e)
        return e;
    m->environment = environment_create(&(struct environment_desc){ .n = 0 });
    m->relighter = relighter_create(m->set, m->kernels);
    if (!m->environment || !m->relighter)
        return err_say(why, ERR_NOMEM, "out of memory");
    return environment_update(m->environment, &m->frame, why);
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
    for (int k = 0; k < 3; k++)
        m->codes[k] = mem_alloc(m->values, 1);
    if (!m->rgb || !m->codes[0] || !m->codes[1] || !m->codes[2])
        return err_say(why, ERR_NOMEM, "out of memory");
    strcpy(m->folder, "/tmp/relight-bench-XXXXXX");
    if (!mkdtemp(m->folder)) {
        m->folder[0] = '\0';
        return err_say(why, ERR_IO, "/tmp: no folder for the cache can be made");
    }
    m->light = (struct relight_desc){ .direct = { .method = METHOD_AUTO, .samples = 16, .why = &m->why },
                                      .classes = PATH_ALL,
                                      .cache_file = "",
                                      .cache_dir = m->folder,
                                      .renew = CAUSTIC_PARTS };
    return ERR_OK;
}

/* Adds to m->changes how the newest picture continues the two before. */
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
    for (size_t v = 0; v < m->values && m->pictures >= 3; v++)
        m->changes[abs(m->codes[0][v] - 2 * m->codes[1][v] + m->codes[2][v])]++;
}

/* Of m->changes, which it clears. */
static int flicker_of(struct first_minute *m)
{
    uint64_t all = 0, below = 0;
    int code = 0;

    for (int k = 0; k < SECOND_DIFFERENCES; k++)
        all += m->changes[k];
    while (all > 0 && below + m->changes[code] < 0.99 * (double)all)
        below += m->changes[code++];
    memset(m->changes, 0, sizeof(m->changes));
    return all > 0 ? code : -1;
}

static enum err copy(const struct first_minute *m, const struct decision *decision, const struct relight_stats *stats,
                     struct kept *out)
{
    *out = (struct kept){ clock_seconds() - m->begun_s,
                          processor_seconds() - m->begun_processor_s,
                          stats->cache_share,
                          decision->by == DECIDED_BY_CACHE ? "cache"
                          : decision->light.denoise        ? "denoised"
                                                           : "samples",
                          -1,
                          mem_alloc(m->values, sizeof(float)) };
    if (!out->rgb)
        return ERR_NOMEM;
    memcpy(out->rgb, m->rgb, m->values * sizeof(float));
    return ERR_OK;
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
    const enum err e = copy(m, decision, stats, k);
    k->flicker = flicker_of(m);
    return e;
}

/* What becomes of a picture. */
enum made { MADE_ROW, MADE_LAST, MADE_AGAIN };

static enum err make_picture(struct first_minute *m, enum made made)
{
    struct frame_request request = { .light = &m->light, .background = true, .allow_bias = INFINITY };
    struct decision decision;
    struct relight_stats stats;
    struct pilot_stats measured;

    m->light.turn = m->pictures++;
    request.target.seconds = decider_target_s(&m->decider, m->relighter, INTERVAL_S);
    decider_begin(&m->decider, m->relighter, &request);
    request.target.seconds = decider_target_s(&m->decider, m->relighter, INTERVAL_S);
    decide(&m->decider, &request, &decision);
    enum err e = decider_run(&m->decider, m->relighter, m->environment, &request, &decision, m->rgb, &stats, &measured);
    if (e)
        return e;
    if (made != MADE_AGAIN) {
        watch(m);
        e = keep(m, &decision, &stats, made == MADE_LAST);
    } else if (decision.by == DECIDED_BY_CACHE && stats.cache_share >= 1.0 && !m->again.rgb) {
        e = copy(m, &decision, &stats, &m->again);
    }
    if (!e)
        decider_learn(&m->decider, m->relighter, &request, &decision, &stats, &measured);
    return e;
}

/* Pictures until the cache is complete, or the time is over. */
static enum err live(struct first_minute *m)
{
    enum err e = ERR_OK;

    for (int after = 0; !e && after < AFTER && clock_seconds() - m->begun_s < PATIENCE_S;) {
        const double start = clock_seconds();
        e = make_picture(m, MADE_ROW);
        const double wait_s = start + fmax(decider_interval_s(&m->decider), INTERVAL_S) - clock_seconds();
        if (wait_s > 0.0)
            nanosleep(&(struct timespec){ (time_t)wait_s, (long)(1e9 * fmod(wait_s, 1.0)) }, NULL);
        m->complete = m->decider.cache.begun && !decider_is_computing(&m->decider, m->relighter);
        after += m->complete;
    }
    while (m->count > 0 && !m->kept[m->count - 1].rgb)
        m->count--;
    return e ? e : make_picture(m, MADE_LAST);
}

/* What is in memory is lost; the file is not. */
static enum err start_again(struct first_minute *m, struct reason *why)
{
    end(m);
    m->pictures = 0;
    enum err e = begin(m, why);
    while (!e && !m->again.rgb && clock_seconds() - m->begun_s < AGAIN_S)
        e = make_picture(m, MADE_AGAIN);
    return e;
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

static void print_row(const struct first_minute *m, const struct kept *k, FILE *to)
{
    char flicker[16] = "-";

    if (k->flicker >= 0)
        snprintf(flicker, sizeof(flicker), "%d", k->flicker);
    fprintf(to, "%10.2f %14.2f  %-8s %7.0f %% %10.2e %8s\n", k->wall_s, k->processor_s, k->by, 100.0 * k->share,
            error_of(m, k->rgb), flicker);
}

static void print(const struct first_minute *m, const char *name, FILE *to)
{
    fprintf(to,
            "the first minute of %s, %ux%u, %d threads, all light; relMSE over all pixels, against 2 x %d samples;\n"
            "flicker: 99 %% of the second differences in time are at most as many codes of 8 bits\n",
            name, m->desc->width, m->desc->height, omp_get_max_threads(), m->desc->rounds * TRUTH_SAMPLES);
    fprintf(to, "%10s %14s  %-8s %9s %10s %8s\n", "seconds", "processor s", "by", "computed", "relMSE", "flicker");
    for (size_t k = 0; k < m->count; k++)
        if (m->kept[k].rgb)
            print_row(m, &m->kept[k], to);
    if (m->again.rgb) {
        fputs("a second start, with the cache from disk\n", to);
        print_row(m, &m->again, to);
    } else {
        fputs("a second start was not measured: the cache was not complete in time\n", to);
    }
}

static void release(struct first_minute *m)
{
    struct reason why;

    end(m);
    frame_finish(&m->frame);
    for (size_t k = 0; k < KEPT; k++)
        mem_free(m->kept[k].rgb);
    mem_free(m->again.rgb);
    for (int k = 0; k < 3; k++)
        mem_free(m->codes[k]);
    for (int k = 0; k < 2; k++)
        mem_free(m->half[k]);
    mem_free(m->rgb);
    if (m->folder[0] && (cache_folder_trim(m->folder, NULL, 0, 0, &why) || rmdir(m->folder)))
        log_warning("%s could not be removed", m->folder);
    mem_free(m);
}

enum err bench_first_minute(const struct bench_desc *desc, FILE *to, struct reason *why)
{
    struct first_minute *m = mem_alloc(1, sizeof(*m));
    char name[sizeof(m->set->name)];

    if (!m)
        return err_say(why, ERR_NOMEM, "out of memory");
    m->desc = desc;
    enum err e = prepare(m, why);
    if (!e)
        e = begin(m, why);
    if (!e) {
        strcpy(name, m->set->name);
        if ((e = live(m)) || (e = make_truth(m)))
            err_say(why, e, "%s", m->why.text[0] ? m->why.text : err_text(e));
    }
    if (!e && m->complete)
        e = start_again(m, why);
    if (!e)
        print(m, name, to);
    release(m);
    return e;
}
