#include "light/frame/pilot.h"

#include <math.h>

#define SHARE_AT_FIRST 0.3 /* of a frame's time, for measurements: while something is not known */
#define SHARE_LATER 0.05
#define SHARE_SETTLED 0.02 /* once each part has so many readings: */
#define SETTLED 12
#define BANK_FRAMES 2.0  /* the most time that is saved for measurements */
#define SKY_SHARE 0.04   /* a change of a cube face's share of the light that makes another sky; */
#define SKY_RATIO 1.3    /* likewise, of all light */
#define READINGS_MOST 24 /* in a frame */
#define TURNS 3          /* of all groups under one sky, after which the shares stay */

static bool all_have(const struct pilot *p, uint32_t more)
{
    for (int part = 0; part <= PILOT_EYE; part++)
        if (p->offered[part] && p->model[part].fresh < more)
            return false;
    return true;
}

double pilot_share(const struct pilot *p)
{
    return !all_have(p, 1) ? SHARE_AT_FIRST : !all_have(p, SETTLED) ? SHARE_LATER : SHARE_SETTLED;
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

/* Updates the shares of samples after all groups were read, or at once with `all`. */
static void read_hard(struct pilot *p, enum pilot_part part, const struct allot_count *count, const struct group *g,
                      bool all)
{
    allot_read(&p->allot[part], &g->list, (const float(*)[PACKET])p->point_error, count);
    if (++p->allot_readings[part] < p->groups.count && !all)
        return;
    p->model[part].variance *= allot_deal(&p->allot[part]);
    p->allot_readings[part] = 0;
    p->allot_turns[part]++;
}

/* One run of a part on a group's packets, into pair[k]. */
static enum err run(struct pilot *p, enum pilot_part part, double n, const struct group *g, int k)
{
    const struct allot_count count = pilot_count(part, n);
    struct pilot_work work = { part, g->points, 0, allot_mean(&p->allot[part], &count, &g->list) };
    struct direct_stats direct = { 0 };
    struct eye_paths_stats eye = { 0 };
    double by_clock;
    enum err e;

    if (part == PILOT_DIRECT) {
        struct direct_desc desc = pilot_direct(p, n, pilot_pass(p), &g->list);
        desc.keep = k > 0;
        e = passes_direct(p->passes, TABLES_PILOT, p->environment, &desc, p->pair[k], &direct, &by_clock);
    } else {
        const struct eye_paths_desc desc = pilot_eye(p, n, pilot_pass(p), &g->list);
        e = passes_eye(p->passes, p->environment, &desc, p->pair[k], &eye, &by_clock);
    }
    work.rays = direct.rays + eye.rays;
    const double seconds = pilot_seconds(p, &work, by_clock);
    p->bank_s -= seconds;
    p->pilot_s += seconds;
    return e;
}

static enum err probe_points(struct pilot *p, enum pilot_part part, double n, const struct group *g)
{
    const struct allot_count count = pilot_count(part, n);
    const bool by_point = p->allot_turns[part] < TURNS, whole = g == &p->groups.all;

    for (int k = 0; k < 2; k++) {
        const enum err e = run(p, part, n, g, k);
        if (e)
            return e;
    }
    const double error =
        pair_of_points(&p->groups, g, p->pair[0], p->pair[1], &p->yardstick, by_point ? p->point_error : NULL);
    if (whole) /* at a count nearer to that of the image than the readings before */
        model_age(&p->model[part]);
    model_read(&p->model[part], count.n, error);
    if (by_point)
        read_hard(p, part, &count, g, whole);
    return ERR_OK;
}

enum err pilot_probe_whole(struct pilot *p, enum pilot_part part, double n)
{
    return probe_points(p, part, n, &p->groups.all);
}

void pilot_read_light(struct pilot *p, enum pilot_part part, double n, float *const half[2])
{
    const struct gbuffer *g = p->set->gbuffer;
    struct yardstick y = p->yardstick;

    yardstick_spread(half[0], half[1], g->width, g->height, p->spread[0], p->spread[1]);
    y.more = p->spread[1];
    /* the mean of the halves has half of either's variance */
    model_read(&p->model[part], n, 0.5 * pair_of_images(&p->groups.all, half[0], half[1], &y));
}

/* Direct light and eye paths take turns on a group, then on the next. */
static enum err probe_next(struct pilot *p)
{
    const enum pilot_part part = (enum pilot_part)p->next_part;
    const struct group *g = &p->groups.group[p->next_group];

    p->next_part = p->next_part == PILOT_DIRECT ? PILOT_EYE : PILOT_DIRECT;
    if (p->next_part == PILOT_DIRECT)
        p->next_group = (p->next_group + 1) % p->groups.count;
    return p->offered[part] && g->list.count > 0 ? probe_points(p, part, p->n[part], g) : ERR_OK;
}

enum err pilot_probe(struct pilot *p, const struct budget_target *target)
{
    const double frame_s = target->seconds > 0.0 ? target->seconds : p->frame_s;
    enum err e = ERR_OK;

    p->bank_s = fmax(-BANK_FRAMES * frame_s, p->bank_s) + pilot_share(p) * frame_s;
    p->bank_s = fmin(BANK_FRAMES * frame_s, p->bank_s);
    for (uint32_t k = 0; k < READINGS_MOST && p->bank_s > 0.0 && !e; k++)
        e = probe_next(p);
    return e;
}
