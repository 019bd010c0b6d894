#include "light/frame/relight_cache.h"

#include "base/cancel.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/progress.h"
#include "base/process.h"
#include "base/rng.h"
#include "light/cache/memory.h"
#include "light/estimators/eye_paths.h"
#include "light/frame/beside.h"
#include "light/estimators/caustic_store.h"
#include "light/frame/frame_plan.h"

#include <math.h>
#include <omp.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>
#include <time.h>

enum { QUICK, WHOLE, STAGES }; /* of indirect light */

#define BEHIND_PATHS 16 /* eye paths per point behind mirrors and glass, in each of two halves that are filtered */

#define SEGMENTS 360     /* of a day, of four minutes: a degree of the sun's way */
#define PLACES 9         /* of the sun along a segment */
#define STEADY 8         /* frames of one day, before its way counts as known: not while the sky turns */
#define MORE_TILES 1.125 /* than in the file, which is then written again; so it is at the first day of a run */
#define TURN 512         /* packets that a turn asks for: a frame waits for some milliseconds at most */

/* Where the sun goes, by the frames' thread. */
struct aim {
    struct transport *transport; /* NULL: not known yet */
    struct sun_day day;
    float axis[3];   /* of the last frame's sun */
    uint64_t since;  /* number of the frame that began this day */
    uint32_t frames; /* that had this day one after another */
};

struct relight_builder {
    const struct prepared_scene *set;
    const struct kernels *kernels;
    struct relight_desc light;
    struct transport_live *live;
    const struct transport *loaded;
    struct relight_keep keep;
    const struct precedence *urgent;
    uint32_t threads;
    pthread_t thread;
    bool started;
    bool wanted; /* indirect light is */
    struct progress progress[STAGES];
    atomic_bool ended[STAGES];
    atomic_bool awaits_whole;            /* without a rough cache */
    struct indirect_cache *_Atomic next; /* not taken yet, or NULL */
    const struct indirect_cache *whole;  /* the frames' thread owns it */
    struct indirect_desc described;      /* of `whole` */
    struct eye_store *behind[2];
    atomic_bool behind_ready;
    struct caustic_store *_Atomic caustics; /* not taken yet, or NULL */
    struct caustic_store_desc caustics_made;
    atomic_bool cancelled;
    atomic_bool computes; /* files do not hold everything */
    pthread_mutex_t lock; /* of the next two */
    pthread_cond_t aimed;
    struct aim aim;
    atomic_bool done; /* then the next fields are set */
    enum err error;
    bool indirect_loaded, indirect_refused;
    struct reason why;
};

static struct indirect_desc describe_indirect(const struct relight_builder *b)
{
    /* The layout of blocks is known from the start. */
    struct indirect_desc d =
        relight_indirect_describe(b->set, &b->light, b->loaded ? b->loaded : transport_live_layout(b->live));

    d.urgent = b->urgent;
    return d;
}

static void publish(struct relight_builder *b, struct indirect_cache *made)
{
    if (made)
        indirect_destroy(atomic_exchange(&b->next, made));
}

static void refuse_indirect(struct relight_builder *b, const char *why)
{
    log_warning("%s: %s; eye paths are traced for it in every frame", b->set->name, why);
    b->indirect_refused = true;
}

/* A rough cache in some seconds. Without memory for it eye paths continue. */
static void build_quick_indirect(struct relight_builder *b)
{
    struct indirect_desc d = describe_indirect(b);
    const double start = clock_seconds();
    struct indirect_cache *made = NULL;
    struct reason why;

    d.quick = true;
    d.progress = &b->progress[QUICK];
    const enum err e = indirect_create(&d, b->kernels, &made, &why);
    atomic_store(&b->awaits_whole, !e && !made);
    if (made)
        log_info("indirect light: a rough version is ready after %.1f s", clock_seconds() - start);
    else if (!e && !is_cancelled(&b->cancelled))
        log_info("indirect light: no rough version, because little of what is in view sees the sky");
    publish(b, made);
    atomic_store(&b->ended[QUICK], true);
}

static void build_whole_indirect(struct relight_builder *b)
{
    const double start = clock_seconds();
    struct indirect_cache *made = NULL;
    struct reason why;

    b->described = describe_indirect(b);
    b->described.progress = &b->progress[WHOLE];
    const enum err e = indirect_create(&b->described, b->kernels, &made, &why);
    if (e)
        refuse_indirect(b, why.text);
    if (made)
        log_info("indirect light: computed in the background in %.1f s, %.0f MB", clock_seconds() - start,
                 1e-6 * (double)indirect_stats(made)->bytes);
    b->whole = made;
    if (made && !b->loaded)
        relight_keep_save(&b->keep, NULL, made, &b->described);
    publish(b, made);
    atomic_store(&b->ended[WHOLE], true);
}

/* True if a file contains indirect light: the one with direct light, or the one stored before direct light was
 * computed. */
static bool load_indirect(struct relight_builder *b)
{
    struct indirect_cache *made = NULL;
    struct reason why;

    b->described = describe_indirect(b);
    b->indirect_refused = relight_keep_load_indirect(&b->keep, b->kernels, &b->described, &made, &why) != ERR_OK;
    if (b->indirect_refused)
        refuse_indirect(b, why.text);
    b->indirect_loaded = made != NULL;
    if (made && !b->loaded) { /* the file of direct light will be another */
        log_info("indirect light: loaded from %s", b->keep.place.path);
        b->whole = made;
    }
    publish(b, made);
    atomic_store(&b->ended[QUICK], b->indirect_loaded);
    atomic_store(&b->ended[WHOLE], b->indirect_loaded);
    return b->indirect_loaded || b->indirect_refused;
}

static void build_coarsely(struct relight_builder *b)
{
    const double start = clock_seconds();

    b->error = transport_live_build(b->live, TRANSPORT_COARSE, b->threads, &b->why);
    if (!b->error && transport_live_share(b->live, TRANSPORT_COARSE) >= 1.0)
        log_info("light transport: a coarse version is ready after %.1f s", clock_seconds() - start);
}

/* The result of direct light; NULL on failure. */
static const struct transport *build_direct(struct relight_builder *b)
{
    const double start = clock_seconds();

    if (!b->error)
        b->error = transport_live_build(b->live, TRANSPORT_FINE, b->threads, &b->why);
    const struct transport *t = transport_live_built(b->live);
    if (t) {
        const struct transport_stats *s = transport_stats(t);

        log_info("light transport: computed in the background in %.1f s, %.0f MB", clock_seconds() - start,
                 1e-6 * (double)s->bytes);
    }
    return t;
}

static struct eye_store_desc describe_behind(const struct relight_builder *b, const struct plan *plan)
{
    return (struct eye_store_desc){
        .classes = relight_plan_behind(&b->light, plan),
        .paths = BEHIND_PATHS,
        .max_bytes = b->light.cache_bytes / 2,
        .cancel = &b->cancelled,
        .urgent = b->urgent,
    };
}

/* Publishes both halves, or neither. */
static void give_behind(struct relight_builder *b, const struct relight_paths *p)
{
    for (int k = 0; k < 2; k++)
        b->behind[k] = p->behind[k];
    atomic_store(&b->behind_ready, p->behind[0] && p->behind[1]);
}

/* Without memory for them live images trace such paths. */
static void build_behind(struct relight_builder *b, struct eye_store_desc d, struct relight_paths *p)
{
    const double start = clock_seconds();
    bool all = d.classes != 0;

    for (int k = 0; k < 2 && all; k++) {
        d.seed = rng_mix(b->light.direct.seed, 0x657965u + (uint64_t)k);
        all =
            eye_store_create(b->set->scene, b->set->rays, b->set->gbuffer, &d, &p->behind[k]) == ERR_OK && p->behind[k];
    }
    if (all)
        log_info("caustics behind mirrors and glass: stored in the background in %.1f s, %.1f MB",
                 clock_seconds() - start,
                 1e-6 * (double)(eye_store_stats(p->behind[0])->bytes + eye_store_stats(p->behind[1])->bytes));
    give_behind(b, p);
}

/* An empty store of such paths; NULL if there are none, or no memory: then live images make one themselves. */
static struct caustic_store *begin_caustics(struct relight_builder *b)
{
    struct caustic_store_desc d = b->caustics_made;
    struct caustic_store *made = NULL;
    struct reason why;

    d.urgent = b->urgent;
    if (!d.classes || caustic_store_create(b->set->scene, b->set->rays, &b->set->view, &d, &made, &why))
        return NULL;
    return made;
}

static void build_caustics(struct relight_builder *b, struct relight_paths *p)
{
    const double start = clock_seconds();

    if (!p->caustics)
        return;
    if (caustic_store_turn(p->caustics, 0, NULL, &b->cancelled) || !caustic_store_is_complete(p->caustics)) {
        caustic_store_destroy(p->caustics);
        p->caustics = NULL;
        return;
    }
    log_info("caustics: stored in the background in %.1f s, %.0f MB", clock_seconds() - start,
             1e-6 * (double)caustic_store_stats(p->caustics)->bytes);
}

/* Beyond geometry, materials and the caches' own numbers. */
static struct digest digest_of_paths(const struct eye_store_desc *behind, const struct caustic_store_desc *c)
{
    const uint64_t numbers[] = { behind->classes, behind->paths, behind->max_bytes, c->classes,   c->paths,
                                 c->parts,        c->start,      c->seed,           c->max_bytes, c->ground_apart };
    struct digest d = { { 0 } };

    digest_bytes(&d, numbers, sizeof(numbers));
    return d;
}

/* What live images have beside the caches (beside.h), from its file or traced. */
static void build_beside(struct relight_builder *b)
{
    struct relight_paths p = { .caustics = NULL };
    struct relight_keep keep;
    struct plan plan;

    if (!beside_wanted(b->set, &b->light) || is_cancelled(&b->cancelled))
        return;
    plan_make(&b->set->facts, &b->light, true, &plan);
    const struct eye_store_desc behind = describe_behind(b, &plan);
    b->caustics_made = relight_caustics_describe(b->set, &b->light, relight_plan_classes(&plan, PLAN_STORED));
    const struct digest key = digest_of_paths(&behind, &b->caustics_made);
    relight_keep_init_paths(&keep, &b->keep, b->set, &b->light, &key);
    p.caustics = begin_caustics(b);
    if (relight_keep_load_paths(&keep, b->set, behind.classes != 0, &p)) {
        give_behind(b, &p);
    } else {
        build_behind(b, behind, &p);
        build_caustics(b, &p);
        if (!is_cancelled(&b->cancelled) && !behind.classes == !p.behind[1] && !b->caustics_made.classes == !p.caustics)
            relight_keep_save_paths(&keep, &p);
    }
    atomic_store(&b->caustics, p.caustics);
}

/* Direct light reserves its share of the memory first, whichever is computed first. */
static void check_memory(struct relight_builder *b, const struct transport *t)
{
    const uint64_t rest = cache_memory_rest(b->light.cache_bytes, transport_stats(t)->bytes);

    if (b->whole && !cache_memory_suffices(rest, indirect_stats(b->whole)->bytes)) {
        b->whole = NULL;
        refuse_indirect(b, "--cache-memory leaves too little for the cache of indirect light");
    }
}

/* ---- The sun's way ---- */

static bool is_same_day(const struct sun_day *a, const struct sun_day *b)
{
    return a->day == b->day && a->latitude == b->latitude && a->solar == b->solar && a->ahead == b->ahead &&
           a->turn == b->turn;
}

static struct digest digest_of_day(const struct sun_day *d)
{
    const double numbers[] = { d->latitude, d->day, d->solar, d->ahead, d->turn };
    struct digest out = { { 0 } };

    digest_bytes(&out, numbers, sizeof(numbers));
    return out;
}

/* False: the builder ends. */
static bool await_day(struct relight_builder *b, const struct aim *last, struct aim *out)
{
    pthread_mutex_lock(&b->lock);
    while (!is_cancelled(&b->cancelled) &&
           (b->aim.frames < STEADY || (last->transport && is_same_day(&last->day, &b->aim.day))))
        pthread_cond_wait(&b->aimed, &b->lock);
    *out = b->aim;
    pthread_mutex_unlock(&b->lock);
    return !is_cancelled(&b->cancelled);
}

/* Follows the last frame's sun. False: the day is over. */
static bool follow_aim(struct relight_builder *b, struct aim *a)
{
    pthread_mutex_lock(&b->lock);
    const bool same = is_same_day(&a->day, &b->aim.day);
    memcpy(a->axis, b->aim.axis, sizeof(a->axis));
    pthread_mutex_unlock(&b->lock);
    return same && !is_cancelled(&b->cancelled);
}

/* The first one that is left from the sun's on. SEGMENTS: none. */
static uint32_t next_segment(const struct aim *a, const bool *over)
{
    double w[3], most = -2.0;
    uint32_t nearest = 0;

    for (uint32_t k = 0; k < SEGMENTS; k++) {
        sun_day_at(&a->day, 24.0 / SEGMENTS * (k + 0.5), w);
        const double c = w[0] * a->axis[0] + w[1] * a->axis[1] + w[2] * a->axis[2];
        nearest = c > most ? k : nearest;
        most = fmax(most, c);
    }
    for (uint32_t k = 0; k < SEGMENTS; k++)
        if (!over[(nearest + k) % SEGMENTS])
            return (nearest + k) % SEGMENTS;
    return SEGMENTS;
}

/* ERR_END: the day is over. Other errors: those of transport_look_at. */
static enum err look_along_segment(struct relight_builder *b, struct aim *a, uint32_t segment)
{
    const uint32_t turns = 1 + b->set->gbuffer->packet_count / TURN;
    double w[PLACES][3];
    enum err e = ERR_OK;

    for (uint32_t k = 0; k < PLACES; k++)
        sun_day_at(&a->day, 24.0 / SEGMENTS * (segment + (double)k / (PLACES - 1)), w[k]);
    for (uint32_t turn = 0; !e && turn < turns && w[PLACES / 2][1] > -SUN_RADIUS; turn++) {
        precedence_give_way(b->urgent);
        e = follow_aim(b, a) ? transport_look_at(a->transport, w, PLACES, turn, turns, a->since) : ERR_END;
    }
    return e;
}

/* Asks for what the sun meets on this day, from its next moments on. */
static enum err look_along_day(struct relight_builder *b, struct aim *a)
{
    bool over[SEGMENTS] = { false };
    enum err e = ERR_OK;

    for (uint32_t k; !e && (k = next_segment(a, over)) < SEGMENTS; over[k] = true)
        e = look_along_segment(b, a, k);
    return e;
}

static void follow_sun(struct relight_builder *b)
{
    struct digest d = { { 0 } };
    struct relight_keep keep;
    struct aim last = { .transport = NULL }, now;
    enum err said = ERR_END; /* each outcome is told when it changes, not every day */
    uint32_t kept = 0;

    digest_bytes(&d, "sun", sizeof("sun"));
    relight_keep_init_paths(&keep, &b->keep, b->set, &b->light, &d);
    while (await_day(b, &last, &now)) {
        const double start = clock_seconds();
        const struct digest day = digest_of_day(&now.day);
        bool whole = false;
        if (!last.transport && relight_keep_load_sun(&keep, now.transport, &day, &whole))
            kept = transport_sun_tiles(now.transport);
        const enum err e = whole ? ERR_OK : look_along_day(b, &now);
        if (!e && !whole && (!last.transport || transport_sun_tiles(now.transport) > MORE_TILES * kept)) {
            relight_keep_save_sun(&keep, now.transport, &day);
            kept = transport_sun_tiles(now.transport);
        }
        if (e != said && !e)
            log_info("sun: what points see of it on this day is known after %.1f s in the background",
                     clock_seconds() - start);
        else if (e != said && e == ERR_RANGE)
            log_info("sun: --cache-memory has no room for what points see of it on a day; images ask for the rest");
        said = e == ERR_END ? said : e;
        last = now;
    }
}

void relight_builder_aim(struct relight_builder *b, struct transport *t, const struct sun_day *day)
{
    const float *axis = transport_sun_axis(t);

    if (!axis)
        return;
    pthread_mutex_lock(&b->lock);
    if (!b->aim.transport || !is_same_day(&b->aim.day, day))
        b->aim = (struct aim){ t, *day, { 0.0f }, transport_frames(t), 0 };
    b->aim.frames++;
    memcpy(b->aim.axis, axis, sizeof(b->aim.axis));
    pthread_cond_signal(&b->aimed);
    pthread_mutex_unlock(&b->lock);
}

static void *build_main(void *arg)
{
    struct relight_builder *b = arg;
    const bool indirect = b->wanted && !load_indirect(b);

    atomic_store(&b->computes, indirect || !b->loaded);
    omp_set_num_threads((int)b->threads);
    if (indirect)
        build_quick_indirect(b);
    if (!b->loaded)
        build_coarsely(b);
    const bool whole_first = atomic_load(&b->awaits_whole); /* then images wait for nothing else */
    if (atomic_load(&b->computes) && !b->error && !whole_first)
        build_beside(b);
    if (indirect && !b->error && !is_cancelled(&b->cancelled))
        build_whole_indirect(b);
    if (whole_first && !b->error)
        build_beside(b);
    const struct transport *t = b->loaded ? b->loaded : build_direct(b);
    if (t)
        check_memory(b, t);
    if (t && (!b->loaded || b->whole))
        relight_keep_save(&b->keep, t, b->whole, b->whole ? &b->described : NULL);
    atomic_store(&b->done, true);
    if (!atomic_load(&b->computes)) /* images have both caches at once, and these paths later */
        build_beside(b);
    follow_sun(b);
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
    pthread_mutex_init(&b->lock, NULL);
    pthread_cond_init(&b->aimed, NULL);
    b->set = desc->set;
    b->kernels = desc->kernels;
    b->light = *desc->light;
    b->light.direct.cancel = &b->cancelled;
    b->light.direct.why = &b->why;
    b->keep = *desc->keep;
    b->loaded = desc->loaded;
    b->urgent = desc->transport->urgent;
    b->threads = (uint32_t)omp_get_max_threads();
    b->wanted = relight_indirect_wanted(b->set, &b->light);
    for (int k = 0; k < STAGES; k++)
        progress_begin(&b->progress[k], "indirect light", indirect_steps(b->set->gbuffer), NULL);
    if (!b->loaded)
        e = transport_live_create(b->set->gbuffer, b->set->rays, b->kernels, desc->transport, &b->live, why);
    if (!e) /* its own and OpenMP's for it, without which OpenMP would end the program */
        b->started = threads_can_start(b->threads, why) && pthread_create(&b->thread, NULL, build_main, b) == 0;
    if (!b->started) {
        relight_builder_destroy(b);
        return e ? e : err_say(why, ERR_NOMEM, "a thread for the cache of light transport could not be started");
    }
    if (!b->loaded)
        log_info("%s: computing light transport for --method cached in the background", b->set->name);
    *out = b;
    return ERR_OK;
}

void relight_builder_destroy(struct relight_builder *b)
{
    if (!b)
        return;
    pthread_mutex_lock(&b->lock);
    atomic_store(&b->cancelled, true);
    pthread_cond_signal(&b->aimed);
    pthread_mutex_unlock(&b->lock);
    if (b->live)
        transport_live_cancel(b->live);
    if (b->started)
        pthread_join(b->thread, NULL);
    indirect_destroy(atomic_load(&b->next));
    transport_live_destroy(b->live);
    caustic_store_destroy(atomic_load(&b->caustics));
    for (int k = 0; k < 2; k++)
        eye_store_destroy(b->behind[k]);
    pthread_cond_destroy(&b->aimed);
    pthread_mutex_destroy(&b->lock);
    mem_free(b);
}

void relight_builder_await_files(struct relight_builder *b)
{
    while (!atomic_load(&b->done) && !atomic_load(&b->computes))
        nanosleep(&(struct timespec){ .tv_nsec = 1000000 }, NULL);
}

struct transport_live *relight_builder_live(struct relight_builder *b)
{
    return b->live;
}

struct indirect_cache *relight_builder_take(struct relight_builder *b)
{
    return atomic_exchange(&b->next, NULL);
}

const struct eye_store *const *relight_builder_behind(const struct relight_builder *b)
{
    return atomic_load(&b->behind_ready) ? (const struct eye_store *const *)b->behind : NULL;
}

void relight_builder_take_caustics(struct relight_builder *b, struct relight_caustics *to)
{
    struct caustic_store *made = atomic_exchange(&b->caustics, NULL);

    if (made)
        relight_caustics_adopt(to, made, &b->caustics_made);
}

bool relight_builder_is_done(struct relight_builder *b, enum err *e, struct relight_indirect *indirect,
                             struct reason *why)
{
    if (!atomic_load(&b->done))
        return false;
    *e = b->error;
    if (b->error)
        *why = b->why;
    indirect->loaded = b->indirect_loaded;
    indirect->refused = b->indirect_refused;
    return true;
}

/* Of one of the stages of indirect light. */
static double share_of(const struct relight_builder *b, int stage)
{
    const struct progress *p = &b->progress[stage];

    return atomic_load(&b->ended[stage]) ? 1.0 : p->total ? 0.99 * (double)p->done / (double)p->total : 0.0;
}

double relight_share(const struct relight_stages *s)
{
    double share;

    if (!s->wanted)
        share = RELIGHT_COARSE * s->coarse + (1.0 - RELIGHT_COARSE) * s->fine;
    else if (!s->quick_ended)
        share = RELIGHT_COARSE * s->quick;
    else
        share = RELIGHT_COARSE + (RELIGHT_DIRECT - RELIGHT_COARSE) * s->coarse +
                (1.0 - RELIGHT_DIRECT) * (0.5 * s->whole + 0.5 * s->fine);
    return fmin(share, 0.99);
}

bool relight_builder_awaits_whole(const struct relight_builder *b)
{
    return atomic_load(&b->awaits_whole);
}

double relight_builder_share(const struct relight_builder *b)
{
    const struct relight_stages stages = {
        .wanted = b->wanted,
        .quick_ended = atomic_load(&b->ended[QUICK]),
        .quick = share_of(b, QUICK),
        .whole = share_of(b, WHOLE),
        .coarse = b->live ? transport_live_share(b->live, TRANSPORT_COARSE) : 1.0,
        .fine = b->live ? transport_live_share(b->live, TRANSPORT_FINE) : 1.0,
    };

    return atomic_load(&b->done) ? 1.0 : relight_share(&stages);
}
