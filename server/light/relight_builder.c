#include "light/relight_builder.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/threads.h"

#include <math.h>
#include <omp.h>
#include <pthread.h>
#include <stdatomic.h>
#include <sys/resource.h>

/* Of the builder's threads: they take what the pictures' leave over, which are to leave something (relightd.c). With 10
 * each of a picture's parallel loops still waits for a thread that makes room too late. */
#define NICENESS 19

struct relight_builder {
    const struct set *set;
    const struct kernels *kernels;
    struct relight_desc light;
    struct transport_live *live;
    const struct transport *loaded;
    struct relight_keep keep;
    uint32_t threads;
    pthread_t thread;
    bool started;
    atomic_bool cancelled;
    atomic_bool done; /* then the next fields are set */
    enum err error;
    struct relight_bounce bounce;
    struct reason why;
};

/* On Linux a niceness is a thread's own. OpenMP gives a thread the same helpers again and again. */
void relight_stand_back(uint32_t threads)
{
#pragma omp parallel num_threads(threads)
    setpriority(PRIO_PROCESS, 0, NICENESS);
}

static void tell_end(const struct transport *t, double seconds)
{
    const struct transport_stats *s = transport_stats(t);

    log_info("light transport: computed in %.1f s beside the pictures, %.0f MB; %u of %u packets have lobes narrower "
             "than its cells",
             seconds, 1e-6 * (double)s->bytes, s->narrow, s->packets);
}

/* The result of direct light; NULL on failure. */
static const struct transport *build_direct(struct relight_builder *b)
{
    const double start = clock_seconds();

    b->error = transport_live_build(b->live, TRANSPORT_COARSE, b->threads, &b->why);
    if (!b->error && transport_live_share(b->live, TRANSPORT_COARSE) >= 1.0)
        log_info("light transport: there coarsely after %.1f s", clock_seconds() - start);
    if (!b->error)
        b->error = transport_live_build(b->live, TRANSPORT_FINE, b->threads, &b->why);
    const struct transport *t = transport_live_built(b->live);
    if (t)
        tell_end(t, clock_seconds() - start);
    return t;
}

static void build_bounce(struct relight_builder *b, const struct transport *direct)
{
    double ms = 0.0;

    if (relight_bounce_make(&b->bounce, direct, b->set, b->kernels, &b->light, &b->keep, false, &ms)) {
        log_warning("interreflection: no memory for it; eye paths are traced for it in every frame");
        b->bounce.refused = true;
    }
}

static void *build_main(void *arg)
{
    struct relight_builder *b = arg;

    omp_set_num_threads((int)b->threads);
    relight_stand_back(b->threads);
    const struct transport *t = b->loaded ? b->loaded : build_direct(b);
    if (t && !b->loaded)
        relight_keep_save(&b->keep, t, NULL, NULL);
    if (t)
        build_bounce(b, t);
    atomic_store(&b->done, true);
    return NULL;
}

enum err relight_builder_create(const struct relight_builder_desc *desc, struct relight_builder **out,
                                struct reason *why)
{
    struct relight_builder *b = mem_alloc(1, sizeof(*b));
    enum err e = ERR_OK;

    *out = NULL;
    if (!b)
        return err_say(why, ERR_NOMEM, "no memory for the cache of light transport");
    b->set = desc->set;
    b->kernels = desc->kernels;
    b->light = *desc->light;
    b->light.direct.cancel = &b->cancelled;
    b->light.direct.why = &b->why;
    b->keep = *desc->keep;
    b->loaded = desc->loaded;
    b->threads = (uint32_t)omp_get_max_threads();
    if (!b->loaded)
        e = transport_live_create(b->set->gbuffer, b->set->rays, b->kernels, desc->transport, &b->live, why);
    if (!e) /* its own and OpenMP's for it, without which OpenMP would end the program */
        b->started = threads_can_start(b->threads, why) && pthread_create(&b->thread, NULL, build_main, b) == 0;
    if (!b->started) {
        relight_builder_destroy(b);
        return e ? e : err_say(why, ERR_NOMEM, "a thread for the cache of light transport could not be started");
    }
    if (!b->loaded)
        log_info("%s: computing light transport for --method cached beside the pictures", b->set->name);
    *out = b;
    return ERR_OK;
}

void relight_builder_destroy(struct relight_builder *b)
{
    if (!b)
        return;
    atomic_store(&b->cancelled, true);
    if (b->live)
        transport_live_cancel(b->live);
    if (b->started)
        pthread_join(b->thread, NULL);
    relight_bounce_finish(&b->bounce);
    transport_live_destroy(b->live);
    mem_free(b);
}

struct transport_live *relight_builder_live(struct relight_builder *b)
{
    return b->live;
}

bool relight_builder_is_done(struct relight_builder *b, enum err *e, struct relight_bounce *bounce, struct reason *why)
{
    if (!atomic_load(&b->done))
        return false;
    *e = b->error;
    if (b->error)
        *why = b->why;
    *bounce = b->bounce;
    b->bounce = (struct relight_bounce){ .bounce = NULL };
    return true;
}

double relight_builder_share(const struct relight_builder *b)
{
    const double direct = !b->live ? 1.0
                                   : RELIGHT_COARSE * transport_live_share(b->live, TRANSPORT_COARSE) +
                                         (1.0 - RELIGHT_COARSE) * transport_live_share(b->live, TRANSPORT_FINE);

    return atomic_load(&b->done) ? 1.0 : fmin(direct, 0.99);
}
