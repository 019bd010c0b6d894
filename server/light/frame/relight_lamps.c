#include "light/frame/relight_lamps.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/process.h"
#include "base/progress.h"
#include "base/rng.h"
#include "light/denoise/denoise.h"
#include "light/resolve/resolve.h"

#include <omp.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/resource.h>

#define BATCH_MOST 4 /* samples per shading point between two images, of either half */
#define NICENESS 19  /* then: images come first */
#define URGENT 4     /* samples for which the thread does not stand back: without lamps an image may be black */

struct relight_lamps {
    struct relight_lamps_desc desc;
    struct lamps *half[2];   /* [1] is NULL without a filter, as the next two are */
    struct filter *filter;   /* until the part is complete */
    float *filtered;         /* [packet_count][3][16] */
    struct lamps_stats done; /* of the halves together */
    float *fresh;            /* [height][width][3], being resolved */
    uint32_t threads;
    pthread_t thread;
    bool started;
    atomic_bool cancelled, failed;

    pthread_mutex_t lock;
    float *image;             /* {lock} [height][width][3] */
    struct lamps_stats stats; /* {lock} of the image */
    double seconds;           /* {lock} spent on it */
};

static size_t values_of(const struct relight_lamps *l)
{
    return 3 * (size_t)l->desc.set->gbuffer->width * l->desc.set->gbuffer->height;
}

/* What only a filtered part has. */
static bool create_filter(struct relight_lamps *l, const struct lamps_desc *first)
{
    const struct prepared_scene *set = l->desc.set;
    struct lamps_desc second = *first;

    second.seed = rng_mix(first->seed, 0x68616c66); /* "half" */
    l->half[1] = lamps_create(&second);
    l->filter = filter_create(set->gbuffer, &set->view, l->desc.kernels ? l->desc.kernels->level : NULL);
    l->filtered = mem_alloc((size_t)set->gbuffer->packet_count + 1, 3 * PACKET * sizeof(float));
    return l->half[1] && l->filter && l->filtered;
}

enum err relight_lamps_create(const struct relight_lamps_desc *desc, struct relight_lamps **out, struct reason *why)
{
    const struct prepared_scene *set = desc->set;
    const struct lamps_desc lamps = {
        .scene = set->scene, .rays = set->rays, .gbuffer = set->gbuffer, .seed = desc->seed
    };

    *out = NULL;
    if (!scene_has_lamps(set->scene))
        return ERR_OK;
    struct relight_lamps *l = mem_alloc(1, sizeof(*l));
    if (!l)
        return err_say(why, ERR_NOMEM, "no memory for the light of the lamps");
    l->desc = *desc;
    pthread_mutex_init(&l->lock, NULL);
    l->half[0] = lamps_create(&lamps);
    l->fresh = mem_alloc(values_of(l), sizeof(float));
    l->image = mem_alloc(values_of(l), sizeof(float));
    if (!l->half[0] || !l->fresh || !l->image || (desc->denoise && !create_filter(l, &lamps))) {
        relight_lamps_destroy(l);
        return err_say(why, ERR_NOMEM, "no memory for the light of the lamps");
    }
    lamps_get_stats(l->half[0], &l->done);
    l->stats = l->done;
    *out = l;
    return ERR_OK;
}

void relight_lamps_destroy(struct relight_lamps *l)
{
    if (!l)
        return;
    atomic_store(&l->cancelled, true);
    if (l->started)
        pthread_join(l->thread, NULL);
    pthread_mutex_destroy(&l->lock);
    for (int k = 0; k < 2; k++)
        lamps_destroy(l->half[k]);
    filter_destroy(l->filter);
    mem_free(l->filtered);
    mem_free(l->fresh);
    mem_free(l->image);
    mem_free(l);
}

/* Sums over all samples of a half: filtered, or of the only one. */
static const float *sums_of(struct relight_lamps *l)
{
    if (!l->filter)
        return lamps_sums(l->half[0]);
    const float *const half[2] = { lamps_sums(l->half[0]), lamps_sums(l->half[1]) };
    filter_run(l->filter, half, l->filtered);
    return l->filtered;
}

/* Updates the image: the visible emission, and the mean of the samples. */
static void publish(struct relight_lamps *l, double seconds)
{
    const double start = clock_seconds();
    const struct gbuffer *g = l->desc.set->gbuffer;
    const float share = 1.0f / (float)(l->half[1] ? l->done.samples / 2 : l->done.samples);
    const size_t count = values_of(l);

    resolve_pixels(g, sums_of(l), NULL, l->fresh);
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++)
        l->fresh[i] = g->glow[i] + share * l->fresh[i];
    pthread_mutex_lock(&l->lock);
    float *old = l->image;
    l->image = l->fresh;
    l->fresh = old;
    l->stats = l->done;
    l->seconds += seconds + clock_seconds() - start;
    pthread_mutex_unlock(&l->lock);
}

/* Runs one batch in each half. Batches grow, so that a first image is available soon. False: cancelled, or no
 * memory. */
static bool refine(struct relight_lamps *l)
{
    const uint32_t halves = l->half[1] ? 2 : 1, done = (uint32_t)l->done.samples / halves;
    const uint32_t left = (l->desc.samples + halves - 1) / halves - done;
    const uint32_t wanted = done < 1 ? 1 : done < BATCH_MOST ? done : BATCH_MOST;
    uint64_t rays = 0;

    for (uint32_t k = 0; k < halves; k++) {
        struct lamps_stats one;
        if (!lamps_refine(l->half[k], wanted < left ? wanted : left, &l->cancelled))
            return false;
        lamps_get_stats(l->half[k], &one);
        l->done.samples = one.samples * halves;
        rays += one.rays;
    }
    l->done.rays = rays;
    return true;
}

enum err relight_lamps_complete(struct relight_lamps *l, bool progress, struct reason *why)
{
    const double start = clock_seconds();
    struct progress line;
    bool good = true;

    progress_begin(&line, "lighting by the lamps", l->desc.samples, progress ? stderr : NULL);
    while (good && l->done.samples < l->desc.samples) {
        const uint64_t before = l->done.samples;
        good = refine(l);
        progress_step(&line, (uint32_t)(l->done.samples - before));
    }
    progress_end(&line);
    if (!good)
        return err_say(why, ERR_NOMEM, "no memory for the light of the lamps");
    publish(l, clock_seconds() - start);
    return ERR_OK;
}

/* On Linux, niceness is per thread. OpenMP gives a thread the same helpers again and again. */
static void stand_back(uint32_t threads)
{
#pragma omp parallel num_threads(threads)
    setpriority(PRIO_PROCESS, 0, NICENESS);
}

static void *refine_main(void *arg)
{
    struct relight_lamps *l = arg;
    bool good = true, urgent = true;

    omp_set_num_threads((int)l->threads);
    while (good && l->done.samples < l->desc.samples) {
        const double start = clock_seconds();
        if (urgent && l->done.samples >= URGENT) {
            stand_back(l->threads);
            urgent = false;
        }
        good = refine(l);
        if (good)
            publish(l, clock_seconds() - start);
    }
    filter_destroy(l->filter); /* its memory is not needed any more */
    l->filter = NULL;
    if (good)
        log_info("%s: light of the lamps: %u samples per shading point in %.1f s", l->desc.set->name, l->desc.samples,
                 l->seconds);
    else if (!atomic_load(&l->cancelled)) {
        log_warning("no memory to refine the light of the lamps");
        atomic_store(&l->failed, true);
    }
    return NULL;
}

enum err relight_lamps_start(struct relight_lamps *l, struct reason *why)
{
    l->threads = (uint32_t)omp_get_max_threads();
    /* its own and OpenMP's for it, without which OpenMP would end the program */
    l->started = threads_can_start(l->threads, why) && pthread_create(&l->thread, NULL, refine_main, l) == 0;
    return l->started ? ERR_OK : err_say(why, ERR_NOMEM, "a thread for the light of the lamps could not be started");
}

uint32_t relight_lamps_samples(struct relight_lamps *l)
{
    pthread_mutex_lock(&l->lock);
    const uint32_t samples = (uint32_t)l->stats.samples;
    pthread_mutex_unlock(&l->lock);
    return samples < l->desc.samples ? samples : l->desc.samples; /* halves may have one more */
}

bool relight_lamps_is_complete(struct relight_lamps *l)
{
    return relight_lamps_samples(l) >= l->desc.samples;
}

bool relight_lamps_has_failed(struct relight_lamps *l)
{
    return atomic_load(&l->failed);
}

void relight_lamps_add(struct relight_lamps *l, double scale, float *rgb)
{
    const float s = (float)scale;

    if (!l || !(s > 0.0f))
        return;
    const size_t count = values_of(l);
    pthread_mutex_lock(&l->lock);
    const float *image = l->image;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++)
        rgb[i] += s * image[i];
    pthread_mutex_unlock(&l->lock);
}

void relight_lamps_pixel(struct relight_lamps *l, uint32_t x, uint32_t y, float rgb[3])
{
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    if (!l)
        return;
    pthread_mutex_lock(&l->lock);
    memcpy(rgb, l->image + 3 * ((size_t)y * l->desc.set->gbuffer->width + x), 3 * sizeof(*rgb));
    pthread_mutex_unlock(&l->lock);
}

void relight_lamps_get_stats(struct relight_lamps *l, struct lamps_stats *out, double *seconds)
{
    pthread_mutex_lock(&l->lock);
    *out = l->stats;
    *seconds = l->seconds;
    pthread_mutex_unlock(&l->lock);
}
