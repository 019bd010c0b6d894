#include "light/relight_lamps.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/progress.h"
#include "base/threads.h"
#include "light/relight_builder.h"
#include "resolve/resolve.h"

#include <omp.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>

#define BATCH_MOST 4 /* samples per shading point between two images */
#define URGENT 4     /* samples for which the thread does not stand back: without lamps an image may be black */

struct relight_lamps {
    struct relight_lamps_desc desc;
    struct lamps *lamps;
    float *fresh; /* [height][width][3], being resolved */
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

enum err relight_lamps_create(const struct relight_lamps_desc *desc, struct relight_lamps **out, struct reason *why)
{
    const struct set *set = desc->set;
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
    l->lamps = lamps_create(&lamps);
    l->fresh = mem_alloc(values_of(l), sizeof(float));
    l->image = mem_alloc(values_of(l), sizeof(float));
    if (!l->lamps || !l->fresh || !l->image) {
        relight_lamps_destroy(l);
        return err_say(why, ERR_NOMEM, "no memory for the light of the lamps");
    }
    lamps_get_stats(l->lamps, &l->stats);
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
    lamps_destroy(l->lamps);
    mem_free(l->fresh);
    mem_free(l->image);
    mem_free(l);
}

/* Updates the image from the sums: the visible emission, and the mean of the samples. */
static void resolve(struct relight_lamps *l, uint64_t samples)
{
    const struct gbuffer *g = l->desc.set->gbuffer;
    const float share = 1.0f / (float)samples;
    const size_t count = values_of(l);

    resolve_pixels(g, lamps_sums(l->lamps), NULL, l->fresh);
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++)
        l->fresh[i] = g->glow[i] + share * l->fresh[i];
}

/* Runs one batch and updates the image. Batches grow, so that a first image is available soon. False: cancelled, or no
 * memory. */
static bool refine(struct relight_lamps *l)
{
    const double start = clock_seconds();
    const uint32_t done = (uint32_t)l->stats.samples, left = l->desc.samples - done;
    const uint32_t wanted = done < 1 ? 1 : done < BATCH_MOST ? done : BATCH_MOST;
    struct lamps_stats stats;

    if (!lamps_refine(l->lamps, wanted < left ? wanted : left, &l->cancelled))
        return false;
    lamps_get_stats(l->lamps, &stats);
    resolve(l, stats.samples);
    pthread_mutex_lock(&l->lock);
    float *old = l->image;
    l->image = l->fresh;
    l->fresh = old;
    l->stats = stats;
    l->seconds += clock_seconds() - start;
    pthread_mutex_unlock(&l->lock);
    return true;
}

enum err relight_lamps_complete(struct relight_lamps *l, bool progress, struct reason *why)
{
    struct progress line;
    bool good = true;

    progress_begin(&line, "lighting by the lamps", l->desc.samples, progress ? stderr : NULL);
    while (good && l->stats.samples < l->desc.samples) {
        const uint64_t before = l->stats.samples;
        good = refine(l);
        progress_step(&line, (uint32_t)(l->stats.samples - before));
    }
    progress_end(&line);
    return good ? ERR_OK : err_say(why, ERR_NOMEM, "no memory for the light of the lamps");
}

static void *refine_main(void *arg)
{
    struct relight_lamps *l = arg;
    bool good = true, urgent = true;

    omp_set_num_threads((int)l->threads);
    while (good && l->stats.samples < l->desc.samples) { /* this thread alone writes stats */
        if (urgent && l->stats.samples >= URGENT) {
            relight_stand_back(l->threads);
            urgent = false;
        }
        good = refine(l);
    }
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
    return samples;
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
