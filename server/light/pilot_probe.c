#include "light/pilot_parts.h"

#include "light/facts.h"

#include <math.h>
#include <string.h>

#define SHARE_AT_FIRST 0.3 /* of a frame's time, for measurements: while something is not known */
#define SHARE_LATER 0.05
#define SHARE_SETTLED 0.02 /* once each way has so many readings: */
#define SETTLED 12
#define READINGS_WANTED 2 /* of each technique of direct light, before a way counts as known, */
#define OTHER_WANTED 6    /* and of the others: few pixels show their light, and not in all groups */
#define BANK_FRAMES 2.0   /* the most time that is saved for measurements */
#define SKY_SHARE 0.04    /* a change of a cube face's share of the light that makes another sky; */
#define SKY_RATIO 1.3     /* likewise, of all light */
#define TURNS 3           /* of all groups under one sky, after which the shares stay */
#define DOUBTED 0.9       /* factor on a time that could never be saved: it may have been an outlier */
#define LIGHT_LEAST 4.0   /* units of particles at first, */
#define LIGHT_MOST 64.0   /* and later */
#define TIMES_STEP 0.3    /* of a reading of group_times, */
#define TIMES_MOST 3.0    /* which is at most this, or as small */

static bool in_use(const struct pilot *p, uint32_t way)
{
    return p->choice.way[pilot_part_of(way)] == way;
}

/* The count at which a way takes as long as the one in use. */
static double equal_count(const struct pilot *p, uint32_t way)
{
    const enum pilot_part part = pilot_part_of(way);
    const uint32_t used = p->choice.way[part];
    const struct model *m = &p->model[way];

    if (used == WAY_NONE)
        return 1.0;
    const double n = p->choice.n[part];
    if (way == used || !m->timed || !p->model[used].timed || !(m->unit_s > 0.0))
        return n;
    return fmin(4.0 * n, fmax(1.0, (model_seconds(&p->model[used], n) - m->begin_s) / m->unit_s));
}

static bool all_have(const struct pilot *p, uint32_t more)
{
    for (uint32_t way = 0; way < WAYS; way++)
        if (p->offered[way] && p->model[way].fresh < (way < WAY_EYE_ALL ? READINGS_WANTED : OTHER_WANTED) + more)
            return false;
    return true;
}

double pilot_share(const struct pilot *p)
{
    return !all_have(p, 0) ? SHARE_AT_FIRST : !all_have(p, SETTLED) ? SHARE_LATER : SHARE_SETTLED;
}

bool pilot_same_sky(const double before[CUBE_FACES], const struct environment *e)
{
    double total = 0.0, apart = 0.0;

    for (int f = 0; f < CUBE_FACES; f++)
        total += before[f];
    for (int f = 0; f < CUBE_FACES && total > 0.0 && e->total_energy > 0.0; f++)
        apart = fmax(apart, fabs(e->energy[f] / e->total_energy - before[f] / total));
    const double ratio = total > 0.0 ? e->total_energy / total : INFINITY;
    return apart <= SKY_SHARE && ratio <= SKY_RATIO && ratio >= 1.0 / SKY_RATIO;
}

void pilot_look_at_sky(struct pilot *p)
{
    const struct environment *e = p->environment;

    if (pilot_same_sky(p->energy, e))
        return;
    memcpy(p->energy, e->energy, sizeof(p->energy));
    p->peakedness = facts_peakedness(e);
    pilot_offer_ways(p);
    for (uint32_t way = 0; way < WAYS; way++)
        model_age(&p->model[way]);
    for (int part = 0; part <= PILOT_EYE; part++) {
        allot_age(&p->allot[part]);
        p->allot_readings[part] = p->allot_turns[part] = 0;
    }
    p->frames = 0;
}

/* Charges the time of a measurement. */
static double pay(struct pilot *p, const struct pilot_work *work, double by_clock)
{
    const double seconds = pilot_seconds(p, work, by_clock);

    p->bank_s -= seconds;
    p->pilot_s += seconds;
    return seconds;
}

/* Updates the shares of samples after all groups were read, or at once with `all`. */
static void read_hard(struct pilot *p, uint32_t way, const struct allot_count *count, const struct group *g, bool all)
{
    const enum pilot_part part = pilot_part_of(way);

    allot_read(&p->allot[part], &g->list, (const float(*)[PACKET])p->point_error, count);
    if (++p->allot_readings[part] < p->groups.count && !all)
        return;
    const double factor = allot_deal(&p->allot[part]);
    p->allot_readings[part] = 0;
    p->allot_turns[part]++;
    for (uint32_t k = 0; k < WAYS; k++)
        if (pilot_part_of(k) == part)
            p->model[k].variance *= factor;
}

/* One run of a way on a group's packets, into pair[k]. */
static enum err run(struct pilot *p, uint32_t way, double n, const struct group *g, int k, double mean, double *seconds)
{
    const enum pilot_part part = pilot_part_of(way);
    struct pilot_work work = { part, g->points, 0, mean };
    struct direct_stats direct = { 0 };
    struct eye_paths_stats eye = { 0 };
    double by_clock;
    enum err e;

    if (part == PILOT_DIRECT) {
        struct direct_desc desc = pilot_direct(p, way, n, pilot_pass(p), &g->list);
        desc.keep = k > 0;
        e = passes_direct(p->passes, PASS_PROBE, p->environment, &desc, p->pair[k], &direct, &by_clock);
    } else {
        const struct eye_paths_desc desc = pilot_eye(p, way, n, pilot_pass(p), &g->list);
        e = passes_eye(p->passes, p->environment, &desc, p->pair[k], &eye, &by_clock);
    }
    work.rays = direct.rays + eye.rays;
    *seconds = pay(p, &work, by_clock);
    return e;
}

/* Runs twice with n samples or paths, the second time with the tables of the first: the time is the difference. */
static enum err probe_points(struct pilot *p, uint32_t way, double n, const struct group *g)
{
    const enum pilot_part part = pilot_part_of(way);
    const struct allot_count count = pilot_count(p, way, n);
    const double mean = allot_mean(&p->allot[part], &count, &g->list);
    const double share = mean * g->list.count / (count.n * p->groups.all.list.count);
    struct yardstick y = p->yardstick;
    struct model *m = &p->model[way];
    double seconds[2];

    for (int k = 0; k < 2; k++) {
        const enum err e = run(p, way, n, g, k, mean, &seconds[k]);
        if (e)
            return e;
    }
    y.lacks_part &= part == PILOT_EYE;
    const bool whole = g == &p->groups.all, by_point = !y.lacks_part && p->allot_turns[part] < TURNS;
    const struct pair pair =
        pair_of_points(&p->groups, g, p->pair[0], p->pair[1], &y, by_point ? p->point_error : NULL);
    if (!whole) /* ways are not compared at its count */
        model_read(m, &(struct reading){ count.n, pair.error, pair.energy });
    if (by_point)
        read_hard(p, way, &count, g, whole);
    /* Threads that share little work wait for each other: a way that whole pictures have timed shows how long. */
    const double least = fmin(seconds[0], seconds[1]), begin = part == PILOT_DIRECT ? seconds[0] - least : 0.0;
    if (m->ran && in_use(p, way)) {
        const double times = fmin(TIMES_MOST, fmax(1.0 / TIMES_MOST, m->unit_s * count.n * share / least));
        if (!whole)
            p->group_times = p->group_times > 0.0 ? p->group_times + TIMES_STEP * (times - p->group_times) : times;
    } else {
        model_time(m, begin, count.n, (p->group_times > 0.0 ? p->group_times : 1.0) * least, share);
    }
    return ERR_OK;
}

enum err pilot_probe_first(struct pilot *p, double n)
{
    return probe_points(p, WAY_DIRECT, n, &p->groups.all);
}

void pilot_read_light(struct pilot *p, uint32_t way, double n, float *const half[2])
{
    const struct gbuffer *g = p->set->gbuffer;
    struct yardstick y = p->yardstick;

    yardstick_spread(half[0], half[1], p->begun && in_use(p, way), g->width, g->height, p->spread[0], p->spread[1]);
    y.more = p->spread[1];
    const struct pair pair = pair_of_pictures(&p->groups.all, half[0], half[1], &y);
    /* the mean of the halves has half of either's variance */
    model_read(&p->model[way], &(struct reading){ n, 0.5 * pair.error, pair.energy });
}

/* Runs particles for measurement only; those of the picture are read when it is made. */
static enum err probe_light(struct pilot *p, uint32_t way)
{
    float *const *half = p->passes->half[pilot_part_of(way) - PILOT_AIMED];
    struct model *m = &p->model[way];
    const double afforded = m->timed ? 0.5 * p->bank_s / m->unit_s : 0.0;
    const double n = floor(fmin(LIGHT_MOST, fmax(LIGHT_LEAST, afforded)));
    struct light_tracer_stats stats;
    double by_clock;

    const struct light_tracer_desc desc = pilot_light(p, way, n, pilot_pass(p));
    const enum err e = passes_halves(p->passes, p->environment, &desc, half, &stats, &by_clock);
    if (e)
        return e;
    const struct pilot_work work = { pilot_part_of(way), 0, stats.rays, n * UNIT_PARTICLES };
    model_time(m, 0.0, n, pay(p, &work, by_clock), 1.0);
    pilot_read_light(p, way, n, half);
    return ERR_OK;
}

/* About the seconds of a measurement; 0: unknown. */
static double cost_of(const struct pilot *p, uint32_t way)
{
    const struct model *m = &p->model[way];
    const double n = way >= WAY_AIMED ? LIGHT_LEAST : 2.0 * equal_count(p, way) / p->groups.count;

    return m->timed ? 2.0 * m->begin_s + m->unit_s * n : 0.0;
}

/* All ways take turns on a group, then on the next. */
static enum err probe_next(struct pilot *p)
{
    const uint32_t way = p->next_way;
    const struct group *g = &p->groups.group[p->next_group];

    p->next_way = (p->next_way + 1) % WAYS;
    if (p->next_way == 0)
        p->next_group = (p->next_group + 1) % p->groups.count;
    if (!p->offered[way] || (way >= WAY_AIMED && p->begun && in_use(p, way)) || (way < WAY_AIMED && g->list.count == 0))
        return ERR_OK;
    return way < WAY_AIMED ? probe_points(p, way, fmax(2.0, equal_count(p, way)), g) : probe_light(p, way);
}

enum err pilot_probe(struct pilot *p, const struct pilot_target *target)
{
    const double frame_s = target->seconds > 0.0 ? target->seconds : p->frame_s;
    enum err e = ERR_OK;

    if (p->begun) {
        p->bank_s = fmax(-BANK_FRAMES * frame_s, p->bank_s) + pilot_share(p) * frame_s;
        p->bank_s = fmin(BANK_FRAMES * frame_s, p->bank_s);
    }
    for (uint32_t k = 0; k < OTHER_WANTED * WAYS && !e; k++) {
        if (!p->begun && k == WAYS) { /* each is known once: from here on by the counts of the choice */
            p->begun = true;
            pilot_choose(p, target);
            p->begun = false;
        }
        const bool must = !p->begun && p->offered[WAY_DIRECT] && !p->model[WAY_DIRECT].fresh;
        const double cost_s = cost_of(p, p->next_way);
        if (p->begun && cost_s > BANK_FRAMES * frame_s)
            p->model[p->next_way].unit_s *= DOUBTED;
        if (!must && (p->bank_s <= (p->begun ? cost_s : 0.0)))
            break;
        e = probe_next(p);
    }
    return e;
}
