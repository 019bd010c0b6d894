#include "light/estimators/direct.h"

#include "base/cancel.h"
#include "base/denormals.h"
#include "base/mem.h"
#include "base/progress.h"
#include "base/rng.h"
#include "light/estimators/kernels.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#define PACKETS_FEW 1024 /* smaller chunks share small images out evenly */

struct direct {
    const struct kernels *kernels;
    struct light_samples *lights; /* [2][LIGHT_SETS_MAX]: of samples and of scouts */
    struct sky_table table;
    struct latlong latlong;
    struct irradiance known; /* of the last call's sky; knows: it is */
    bool knows;
    uint32_t *numbers; /* [number_capacity][2] */
    uint32_t number_capacity;
    bool tabled; /* in the last call, the strata were those of the table */
};

void direct_stats_add(struct direct_stats *to, const struct direct_stats *more)
{
    to->rays += more->rays;
    to->generated += more->generated;
    to->chosen += more->chosen;
    to->effective += more->effective;
    to->lobes += more->lobes;
}

struct direct *direct_create(const struct kernels *kernels)
{
    struct direct *d = mem_alloc(1, sizeof(*d));
    if (!d)
        return NULL;
    d->kernels = kernels;
    d->lights = mem_alloc(2 * LIGHT_SETS_MAX, sizeof(*d->lights));
    if (!d->lights) {
        direct_destroy(d);
        return NULL;
    }
    return d;
}

void direct_destroy(struct direct *d)
{
    if (!d)
        return;
    for (uint32_t k = 0; d->lights && k < 2 * LIGHT_SETS_MAX; k++)
        samples_finish(&d->lights[k]);
    mem_free(d->lights);
    sky_table_finish(&d->table);
    latlong_finish(&d->latlong);
    mem_free(d->numbers);
    mem_free(d);
}

const struct light_samples *direct_samples(const struct direct *d)
{
    return d->lights;
}

/* A sequence for the samples, and one for scouts. */
static enum err draw_numbers(struct direct *d, uint32_t count, uint32_t sets, uint64_t seed)
{
    if (sets * count > d->number_capacity) {
        mem_free(d->numbers);
        d->number_capacity = 0;
        d->numbers = mem_alloc(sets * count, 2 * sizeof(*d->numbers));
        if (!d->numbers)
            return ERR_NOMEM;
        d->number_capacity = sets * count;
    }
    for (uint32_t k = 0; k < sets * count; k++) {
        double x[2];
        rng_sobol2(seed + k / count, k % count, x);
        d->numbers[2 * k] = (uint32_t)(x[0] * 0x1p32);
        d->numbers[2 * k + 1] = (uint32_t)(x[1] * 0x1p32);
    }
    return ERR_OK;
}

/* The sampling strategy that the options amount to under a given sky. */
struct strategy {
    bool table;        /* the strata are those of d->table */
    bool systematic;   /* counts are drawn per packet */
    uint32_t light;    /* maximum samples per stratum */
    uint32_t sets;     /* number of sets of light samples */
    uint64_t set_seed; /* of the first set */
};

/* Builds the table, unless the faces' own densities suffice. */
static enum err build_table(struct direct *d, const struct environment *e, const struct direct_desc *desc,
                            const struct method_recipe *recipe, struct strategy *s)
{
    const bool both = recipe->brdf_part > 0.0f, apart = desc->sun || recipe->sun_apart;
    const bool gated = both && (desc->compensate == COMPENSATE_AUTO || recipe->sun_apart);
    struct sky_table_desc t = {
        .cells = desc->cells ? desc->cells : 1,
        .sun = apart || gated,
        .compensate = both && (desc->compensate != COMPENSATE_OFF || recipe->sun_apart),
    };

    if (desc->keep) {
        s->table = d->tabled;
        s->systematic = d->tabled && t.cells > 1;
        return ERR_OK;
    }
    d->tabled = false;
    if (recipe->strata != STRATA_FACES || recipe->light_part <= 0.0f || (t.cells == 1 && !t.sun && !t.compensate))
        return ERR_OK;
    enum err result = sky_table_build(&d->table, e, &t);
    if (!result && gated && d->table.has_sun && !apart) {
        t.compensate = t.sun = false;
        result = sky_table_build(&d->table, e, &t);
    }
    if (result == ERR_USAGE)
        err_say(desc->why, result,
                "%u x %u cells per cube map face of %u x %u texels: expected 1, 2, 4 or 8, "
                "dividing its size",
                t.cells, t.cells, e->n, e->n);
    d->tabled = s->table = t.cells > 1 || d->table.has_sun || d->table.compensated;
    s->systematic = t.cells > 1;
    return result;
}

/* The maximum count that any packet takes from each stratum of each set: the number to draw in a cell. */
static void count_most(const struct direct *d, const struct gbuffer *g, const struct packet_list *only,
                       const struct direct_frame *frame, uint32_t (*most)[STRATA_MAX])
{
    const uint32_t strata = d->lights[0].strata, packets = only ? only->count : g->packet_count;

#pragma omp parallel
    {
        const unsigned before = denormals_flush();
        uint32_t own[LIGHT_SETS_MAX][STRATA_MAX] = { { 0 } }, count[STRATA_MAX];
#pragma omp for schedule(static)
        for (uint32_t k = 0; k < packets; k++) {
            const uint32_t i = only ? only->index[k] : k;
            uint32_t *m = own[direct_lights(frame, i, false) - frame->lights];
            d->kernels->direct_counts(frame, &g->packets[i], i, count);
            for (uint32_t f = 0; f < strata; f++)
                m[f] = count[f] > m[f] ? count[f] : m[f];
        }
#pragma omp critical(count_most)
        for (uint32_t k = 0; k < LIGHT_SETS_MAX; k++)
            for (uint32_t f = 0; f < strata; f++)
                most[k][f] = own[k][f] > most[k][f] ? own[k][f] : most[k][f];
        denormals_restore(before);
    }
}

/* Draws set k of [2][LIGHT_SETS_MAX]. The first has the same seed as a single one. */
static enum err draw_set(struct direct *d, const struct environment *e, const struct method_recipe *recipe,
                         const struct strategy *s, uint32_t k, const uint32_t *most)
{
    const uint64_t seed = k == 0 ? s->set_seed : rng_mix(rng_mix(s->set_seed, UINT64_MAX), k);

    if (s->table)
        return samples_draw_table(&d->table, most, seed, &d->lights[k]);
    if (recipe->strata == STRATA_LATLONG || recipe->strata == STRATA_ROWS)
        return samples_draw_latlong(&d->latlong, recipe->strata, s->light, seed, &d->lights[k]);
    return samples_draw(e, recipe->strata, s->light, seed, &d->lights[k]);
}

static enum err draw_sets(struct direct *d, const struct gbuffer *g, const struct environment *e,
                          const struct method_recipe *recipe, const struct strategy *s, const struct packet_list *only,
                          const struct direct_frame *frame)
{
    uint32_t most[LIGHT_SETS_MAX][STRATA_MAX] = { { 0 } };
    const uint32_t all = (frame->known ? 2 : 1) * s->sets;
    int failed = 0;

    for (uint32_t k = 0; k < all && s->table; k++) {
        samples_shape(&d->table, &d->lights[k / s->sets * LIGHT_SETS_MAX + k % s->sets]);
        for (uint32_t f = 0; f < STRATA_MAX && !s->systematic; f++)
            most[k % s->sets][f] = s->light;
    }
    if (s->systematic)
        count_most(d, g, only, frame, most);
#pragma omp parallel for schedule(dynamic) reduction(+ : failed)
    for (uint32_t k = 0; k < all; k++)
        failed += draw_set(d, e, recipe, s, k / s->sets * LIGHT_SETS_MAX + k % s->sets, most[k % s->sets]) != ERR_OK;
    return failed ? ERR_NOMEM : ERR_OK;
}

static uint32_t lobe_count(uint32_t samples, float part)
{
    return (uint32_t)ceilf(part * (float)samples);
}

/* The index of the k-th packet to shade. */
static uint32_t packet_at(const struct packet_list *only, uint32_t k)
{
    return only ? only->index[k] : k;
}

static void shade_packets(const struct direct *d, const struct gbuffer *g, const struct direct_frame *frame,
                          const struct direct_desc *desc, float *lo, struct direct_stats *stats)
{
    const uint32_t packets = desc->only ? desc->only->count : g->packet_count;
    /* large enough to keep overhead low, small enough that no thread waits long at the end */
    const int chunk = packets < PACKETS_FEW ? 4 : 8;
    uint64_t rays = 0, chosen = 0, effective = 0, lobes = 0;

#pragma omp parallel reduction(+ : rays, chosen, effective, lobes)
    {
        const unsigned before = denormals_flush();
        struct direct_counts counts = { 0 };
#pragma omp for schedule(dynamic, chunk)
        for (uint32_t k = 0; k < packets; k++) {
            const uint32_t i = packet_at(desc->only, k), next = packet_at(desc->only, k + 1 < packets ? k + 1 : k);
            if (is_cancelled(desc->cancel))
                continue;
            for (size_t at = 0; at < sizeof(*g->packets);
                 at += 64) /* prefetch the next packet while this one is traced */
                __builtin_prefetch((const char *)&g->packets[next] + at);
            lobes += g->packets[i].count * lobe_count(desc->counts ? desc->counts[i] : desc->samples, frame->brdf_part);
            d->kernels->direct_packet(frame, &g->packets[i], i, lo + (size_t)i * 3 * PACKET, &counts);
            progress_part_step(desc->progress, desc->samples);
        }
        rays += counts.rays;
        chosen += counts.chosen;
        effective += counts.effective;
        denormals_restore(before);
    }
    stats->rays = rays;
    stats->chosen = chosen;
    stats->effective = effective;
    stats->lobes = lobes;
}

static void take_stats(const struct direct *d, const struct strategy *s, struct direct_stats *stats)
{
    for (uint32_t k = 0; k < s->sets; k++)
        stats->generated += d->lights[k].first[d->lights[k].strata];
    stats->strata = d->lights[0].strata;
    stats->sun = s->table && d->table.has_sun;
    stats->compensated = s->table && d->table.compensated;
}

static enum err reserve_notes(struct direct_log_sample **notes, uint32_t *room, uint32_t count)
{
    if (count > *room) {
        mem_free(*notes);
        *room = 0;
        *notes = mem_alloc(count, sizeof(**notes));
        if (!*notes)
            return ERR_NOMEM;
        *room = count;
    }
    if (count > 0)
        memset(*notes, 0, count * sizeof(**notes));
    return ERR_OK;
}

/* Forgets the last run's samples, of which a black sky has none, and keeps the point and the arrays' memory. */
static void reset_log(struct direct_log *log)
{
    *log = (struct direct_log){ .packet = log->packet,
                                .lane = log->lane,
                                .light = log->light,
                                .lobes = log->lobes,
                                .light_room = log->light_room,
                                .lobe_room = log->lobe_room };
}

/* The log before shading: all samples generated, none chosen. */
static enum err begin_log(struct direct_log *log, const struct direct_frame *f)
{
    const struct light_samples *lights = direct_lights(f, log->packet, false);

    log->samples = f->counts ? f->counts[log->packet] : f->samples;
    log->strata = f->light_part > 0.0f ? lights->strata : 0;
    log->cells = lights->cells ? lights->cells : 1;
    log->has_sun = log->strata > 0 && lights->has_sun;
    log->light_count = log->strata > 0 ? lights->first[lights->strata] : 0;
    log->lobe_count = lobe_count(log->samples, f->brdf_part);
    memcpy(log->first, lights->first, sizeof(log->first));
    memcpy(log->energy, lights->energy, sizeof(log->energy));
    if (reserve_notes(&log->light, &log->light_room, log->light_count) ||
        reserve_notes(&log->lobes, &log->lobe_room, log->lobe_count))
        return ERR_NOMEM;
    for (uint32_t k = 0; k < log->light_count; k++) {
        const float w[3] = { lights->x[k], lights->y[k], lights->z[k] };
        memcpy(log->light[k].w, w, sizeof(w));
    }
    return ERR_OK;
}

void direct_log_finish(struct direct_log *log)
{
    if (!log)
        return;
    mem_free(log->light);
    mem_free(log->lobes);
    *log = (struct direct_log){ 0 };
}

bool direct_is_corrected(const struct direct_desc *desc)
{
    return method_recipe(desc->method)->known && !desc->no_visibility && desc->samples >= DIRECT_CORRECTED;
}

enum err direct_shade(struct direct *d, const struct gbuffer *g, const struct rays *rays, const struct environment *e,
                      const struct direct_desc *desc, float *lo, struct direct_stats *stats)
{
    const struct method_recipe *recipe = method_recipe(desc->method);
    const uint64_t seed = rng_mix(desc->seed, desc->pass);
    struct strategy s = {
        .light = (uint32_t)ceilf(recipe->light_part * (float)desc->samples),
        .sets = recipe->light_part > 0.0f && desc->scatter ? LIGHT_SETS_MAX : 1,
        .set_seed = rng_mix(seed, 0),
    };
    struct direct_frame frame = {
        .environment = e,
        .lights = d->lights,
        .scatter = desc->scatter && recipe->light_part > 0.0f,
        .rays = desc->no_visibility ? NULL : rays,
        .share = recipe->share,
        .samples = desc->samples,
        .counts = desc->counts,
        .light_part = recipe->light_part,
        .brdf_part = recipe->brdf_part,
        .lobes = lobe_count(desc->samples, recipe->brdf_part),
        .seed = rng_mix(seed, 2),
    };

    environment_complete(e);
    assert(e->ready && desc->samples >= 1 && desc->method != METHOD_CACHED);
    *stats = (struct direct_stats){ 0 };
    if (desc->log)
        reset_log(desc->log);
    enum err result = ERR_OK;
    if (!desc->keep && (recipe->strata == STRATA_LATLONG || recipe->strata == STRATA_ROWS))
        result = latlong_build(&d->latlong, e, desc->why);
    if (result)
        return result;
    if (!(e->total_energy > 0.0)) { /* a black sky gives no light */
        for (uint32_t k = 0; k < (desc->only ? desc->only->count : g->packet_count); k++)
            memset(lo + (size_t)(desc->only ? desc->only->index[k] : k) * 3 * PACKET, 0, 3 * PACKET * sizeof(float));
        d->lights[0].strata = 0;
        return ERR_OK;
    }
    result = build_table(d, e, desc, recipe, &s);
    if (result)
        return result;
    frame.table = s.table ? &d->table : NULL;
    frame.systematic = s.systematic;
    if (direct_is_corrected(desc)) {
        if (!desc->keep || !d->knows)
            irradiance_build(&d->known, e, frame.table);
        frame.known = &d->known;
    }
    d->knows = frame.known;
    result = draw_sets(d, g, e, recipe, &s, desc->only, &frame);
    if (!result)
        result = draw_numbers(d, frame.lobes, frame.known ? 2 : 1, rng_mix(seed, 1));
    if (result)
        return result;
    frame.numbers = d->numbers;
    frame.log = desc->log;
    if (desc->log && begin_log(desc->log, &frame))
        return ERR_NOMEM;
    shade_packets(d, g, &frame, desc, lo, stats);
    take_stats(d, &s, stats);
    return ERR_OK;
}
