#include "light/estimators/baselines/path.h"

#include "base/cancel.h"
#include "base/luminance.h"
#include "base/mem.h"
#include "base/rng.h"

#include <assert.h>
#include <math.h>
#include <omp.h>
#include <string.h>

#define LARGE_STEPS 0.3         /* their probability; chosen, not measured */
#define STEP_MIN (1.0 / 1024.0) /* range of small step sizes [Kelemen et al. 2002] */
#define STEP_MAX (1.0 / 64.0)
#define CHAIN_LENGTH 512 /* mutations; chains are many and short (path.h) */
#define PILOT 4096       /* samples; chosen, not measured */
#define BOOTSTRAP_MIN (UINT64_C(1) << 14)
#define BOOTSTRAP_MAX (UINT64_C(1) << 22)
#define BRIGHTEST_CHANNEL (1.0 / 0.0722) /* a channel exceeds the luminance at most by this factor: pure blue */

/* The random numbers of one sample, drawn on first use. Numbers that `before` did not use are uniformly distributed and
 * may be drawn afresh. */
struct tape {
    struct numbers numbers;
    struct rng *rng;
    const struct tape *before; /* the state that small steps mutate; NULL: a large step */
    uint32_t count;
    uint16_t used[PATH_PLACES]; /* the numbers used */
    bool known[PATH_PLACES];
    double value[PATH_PLACES];
};

struct state {
    struct tape tape;
    double xy[2], rgb[3], luminance;
};

struct session {
    const struct path_world *world;
    const struct path_desc *desc;
    uint64_t seed;
    struct state *states; /* two per thread */
    double *bootstrap;    /* luminances */
    uint64_t bootstrap_count;
    double pilot, mean;  /* mean luminance of the image, by the pilot and by the bootstrap */
    uint32_t *start;     /* [chains]: bootstrap sample at which each chain starts */
    uint64_t chains;     /* of CHAIN_LENGTH mutations each */
    int64_t *sum;        /* [height][width][3], in multiples of `unit` */
    double unit;         /* radiance */
    uint64_t rays, done; /* samples */
};

enum stream { /* streams of random numbers */
              STREAM_PILOT,
              STREAM_BOOTSTRAP,
              STREAM_START,
              STREAM_CHAIN,
};

/* Step size distributed exponentially between the two, in either direction, with wrap-around [Kelemen et al. 2002]. */
static double small_step(double x, struct rng *rng)
{
    const double u = rng_next(rng);
    const double step = STEP_MAX * exp(-log(STEP_MAX / STEP_MIN) * (u < 0.5 ? 2.0 * u : 2.0 * u - 1.0));
    const double y = u < 0.5 ? x + step : x - step;

    return y >= 1.0 ? y - 1.0 : y < 0.0 ? fmin(y + 1.0, 1.0 - 0x1p-53) : y;
}

static double tape_at(struct numbers *n, uint32_t place)
{
    struct tape *t = (struct tape *)n; /* the first member */

    assert(place < PATH_PLACES);
    if (!t->known[place]) {
        t->value[place] =
            t->before && t->before->known[place] ? small_step(t->before->value[place], t->rng) : rng_next(t->rng);
        t->known[place] = true;
        t->used[t->count++] = (uint16_t)place;
    }
    return t->value[place];
}

/* Creates a sample in s: all numbers afresh, or by a small step from `before`. */
static void propose(const struct session *m, struct state *s, const struct state *before, struct rng *rng,
                    uint64_t *rays)
{
    struct tape *t = &s->tape;

    for (uint32_t i = 0; i < t->count; i++)
        t->known[t->used[i]] = false;
    t->count = 0;
    t->numbers.at = tape_at;
    t->rng = rng;
    t->before = before ? &before->tape : NULL;
    s->xy[0] = tape_at(&t->numbers, 0) * m->world->view->width;
    s->xy[1] = tape_at(&t->numbers, 1) * m->world->view->height;
    path_sample(m->world, m->desc->classes, s->xy, &t->numbers, s->rgb, rays);
    s->luminance = luminance_of(LUMINANCE_REC709, s->rgb);
}

static struct rng stream(const struct session *m, enum stream which, uint64_t index)
{
    return (struct rng){ rng_mix(rng_mix(m->seed, which), index) };
}

/* Mean luminance of independent samples; writes each to `each` unless NULL. */
static double sample_evenly(struct session *m, enum stream which, uint64_t count, double *each)
{
    uint64_t rays = 0, done = 0;
    double sum = 0.0;

#pragma omp parallel for schedule(dynamic, 64) reduction(+ : rays, done)
    for (uint64_t i = 0; i < count; i++) {
        struct state *s = &m->states[2 * omp_get_thread_num()];
        struct rng rng = stream(m, which, i);
        if (is_cancelled(m->desc->cancel))
            continue;
        propose(m, s, NULL, &rng, &rays);
        each[i] = s->luminance;
        done++;
    }
    for (uint64_t i = 0; i < count; i++)
        sum += each[i]; /* in order: the sum does not depend on the number of threads */
    m->rays += rays;
    m->done += done;
    return sum / (double)count;
}

/* Selects the chains' start states in proportion to luminance, by systematic resampling with one random number. */
static void choose_starts(struct session *m)
{
    struct rng rng = stream(m, STREAM_START, 0);
    const double step = m->mean * (double)m->bootstrap_count / (double)m->chains, first = rng_next(&rng) * step;
    double sum = m->bootstrap[0];
    uint64_t i = 0, last = 0;

    for (uint64_t c = 0; c < m->chains; c++) {
        while (sum <= first + (double)c * step && i + 1 < m->bootstrap_count)
            sum += m->bootstrap[++i];
        last = m->bootstrap[i] > 0.0 ? i : last; /* rounding may move the last chain onto a dark sample */
        m->start[c] = (uint32_t)last;
    }
}

static void splat(const struct session *m, const struct state *s, double weight)
{
    const struct view *v = m->world->view;
    const uint32_t x = (uint32_t)fmin(s->xy[0], v->width - 1.0), y = (uint32_t)fmin(s->xy[1], v->height - 1.0);
    int64_t *to = m->sum + 3 * ((size_t)y * v->width + x);

    for (int k = 0; k < 3; k++) {
        const int64_t units = llrint(s->rgb[k] * weight / m->unit);
#pragma omp atomic
        to[k] += units;
    }
}

/* Runs one chain. With b the pilot's mean, p the probability of large steps and W the bootstrap's mean, a state of
 * luminance I contributes W f/I times its balance weight (I/b) / (I/b + p), and a large step f/p times p / (I/b + p):
 * both are multiples of f / (I/b + p) [Kelemen et al. 2002, where W = b]. */
static void run_chain(const struct session *m, uint64_t chain, struct state *states, uint64_t *rays)
{
    struct state *now = &states[0], *next = &states[1];
    struct rng rng = stream(m, STREAM_BOOTSTRAP, m->start[chain]);
    const double held_share = m->mean / m->pilot;
    double held = 0.0; /* weight of the current state that has not been splatted yet */

    propose(m, now, NULL, &rng, rays);
    rng = stream(m, STREAM_CHAIN, chain);
    for (uint32_t i = 0; i < CHAIN_LENGTH; i++) {
        const bool large = rng_next(&rng) < LARGE_STEPS;
        propose(m, next, large ? NULL : now, &rng, rays);
        const double accept = now->luminance > 0.0 ? fmin(1.0, next->luminance / now->luminance) : 1.0;
        const double here = now->luminance / m->pilot + LARGE_STEPS, there = next->luminance / m->pilot + LARGE_STEPS;
        double arriving = (accept * held_share + (large ? 1.0 : 0.0)) / there;
        held += (1.0 - accept) * held_share / here;
        if (rng_next(&rng) < accept) {
            struct state *old = now;
            splat(m, now, held);
            held = arriving;
            arriving = 0.0;
            now = next;
            next = old;
        }
        if (arriving > 0.0)
            splat(m, next, arriving);
    }
    splat(m, now, held);
}

static void run_chains(struct session *m)
{
    uint64_t rays = 0, done = 0;

#pragma omp parallel for schedule(dynamic, 1) reduction(+ : rays, done)
    for (uint64_t c = 0; c < m->chains; c++) {
        if (is_cancelled(m->desc->cancel))
            continue;
        run_chain(m, c, &m->states[2 * omp_get_thread_num()], &rays);
        done += CHAIN_LENGTH;
    }
    m->rays += rays;
    m->done += done;
}

/* Integer sums do not depend on their order. The unit is as small as their range allows: a state accumulates at most 1
 * per mutation times BRIGHTEST_CHANNEL times the two means. */
static void run(struct session *m, float *rgb)
{
    const size_t pixels = (size_t)m->world->view->width * m->world->view->height;
    const double mutations = (double)m->chains * CHAIN_LENGTH;

    m->pilot = sample_evenly(m, STREAM_PILOT, PILOT, m->bootstrap);
    m->mean = sample_evenly(m, STREAM_BOOTSTRAP, m->bootstrap_count, m->bootstrap);
    if (!(m->mean > 0.0) || is_cancelled(m->desc->cancel))
        return;
    if (!(m->pilot > 0.0))
        m->pilot = m->mean;
    m->unit = 2.0 * (mutations + 1.0) * BRIGHTEST_CHANNEL * (m->mean + m->pilot) * 0x1p-62;
    choose_starts(m);
    run_chains(m);
    if (is_cancelled(m->desc->cancel))
        return;
    for (size_t i = 0; i < 3 * pixels; i++)
        rgb[i] = (float)((double)m->sum[i] * m->unit * (double)pixels / mutations);
}

enum err mlt_render(const struct path_world *world, const struct path_desc *desc, float *rgb, struct path_stats *stats)
{
    const uint64_t pixels = (uint64_t)world->view->width * world->view->height;
    const uint64_t mutations = pixels * desc->samples;
    struct session m = {
        .world = world,
        .desc = desc,
        .seed = rng_mix(desc->seed, desc->pass),
        .chains = (mutations + CHAIN_LENGTH - 1) / CHAIN_LENGTH,
    };
    enum err e = ERR_NOMEM;

    assert(world->environment->ready && desc->samples >= 1);
    memset(rgb, 0, pixels * 3 * sizeof(*rgb));
    *stats = (struct path_stats){ 0 };
    if (!(world->environment->total_energy > 0.0)) /* a black sky gives no light */
        return ERR_OK;
    m.bootstrap_count = mutations / 4;
    if (m.bootstrap_count < BOOTSTRAP_MIN)
        m.bootstrap_count = BOOTSTRAP_MIN;
    if (m.bootstrap_count > BOOTSTRAP_MAX)
        m.bootstrap_count = BOOTSTRAP_MAX;
    m.states = mem_alloc(2 * (size_t)omp_get_max_threads(), sizeof(*m.states));
    m.bootstrap = mem_alloc(m.bootstrap_count, sizeof(*m.bootstrap));
    m.start = mem_alloc(m.chains, sizeof(*m.start));
    m.sum = mem_alloc(pixels * 3, sizeof(*m.sum));
    if (!m.states || !m.bootstrap || !m.start || !m.sum)
        goto done;
    run(&m, rgb);
    stats->rays = m.rays;
    stats->samples = m.done;
    e = ERR_OK;
done:
    mem_free(m.sum);
    mem_free(m.start);
    mem_free(m.bootstrap);
    mem_free(m.states);
    return e;
}
