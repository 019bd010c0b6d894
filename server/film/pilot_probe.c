#include "pilot_parts.h"

#include "facts.h"

#include <math.h>
#include <string.h>

#define SHARE_AT_FIRST 0.3 /* of a frame's time, for probes: while something is not known */
#define SHARE_LATER 0.05
#define SHARE_SETTLED 0.02 /* where all have had their readings */
#define READINGS_WANTED 2  /* of each way, before it may be chosen */
#define OTHER_WANTED 6     /* of eye paths and light tracer, before techniques have more than these */
#define FRAMES_AT_FIRST 4
#define HOPELESS 2.0        /* times the error of what is in use, in the same time: seldom looked at again, */
#define HOPELESS_DOUBTS 2.0 /* standard errors of it granted, */
#define SELDOM 8            /* every so many turns */
#define FIRST_LEAST 0.3     /* seconds that a first frame may take longer: there is no picture to be late after */
#define BANK_FRAMES 2.0     /* time that is saved up at most */
#define SKY_SHARE 0.04      /* of the light, come or gone on a face of the cube: another sky; */
#define SKY_RATIO 1.3       /* so is more or less in all */
#define PASS_OWN (UINT64_C(1) << 40) /* the pilot's own numbers: no picture has so high a pass */
#define SAMPLES_TIMED 8.0            /* at least, of direct light, once it is known what they begin with, */
#define SLOPE_TIMES 4.0              /* and the first time so many times as many beside few, or as few beside many */
#define CONTENDER 6                  /* readings that each gets that is not hopeless, before all have turns alike */
#define AGAIN_SETTLED 12             /* readings of what is in use, after which it is looked at half as often */
#define TURNS 3                      /* of all groups, to tell where they are hard under one sky */
#define DOUBTED 0.9                  /* of a time that could never be saved up: it may have been held up once */
#define LIGHT_LEAST 4.0              /* units, of a first look at the light tracer, */
#define LIGHT_MOST 64.0              /* and later */
#define FAIR 0.3                     /* of what a group holds in the mean */
#define HARD_MOST 30.0               /* a group's error over the mean, or the other way round */
#define ROUGH 1.0                    /* relMSE of a picture that is no good yardstick */

/* How much of a way makes as long a part as the one in use takes. */
static double equal_count(const struct pilot *p, uint32_t way)
{
    const enum pilot_part part = pilot_part_of(way);
    const uint32_t used = p->choice.way[part];
    const struct model *m = &p->model[way];

    if (used == WAY_NONE)
        return 1.0;
    if (!m->timed || !p->model[used].timed || !(m->unit_s > 0.0))
        return p->choice.n[part];
    const double n = (model_seconds(&p->model[used], p->choice.n[part]) - model_begin(m)) / m->unit_s;
    const double whole = pilot_halves(way) ? 2.0 * floor(0.5 * n + 0.5) : floor(n);
    return fmin(4.0 * p->choice.n[part], fmax(1.0, whole));
}

static bool in_use(const struct pilot *p, uint32_t way)
{
    return p->choice.way[pilot_part_of(way)] == way;
}

static bool hopeless(const struct pilot *p, uint32_t way)
{
    const enum pilot_part part = pilot_part_of(way);
    const uint32_t used = p->choice.way[part];

    const double limit = HOPELESS * (1.0 + HOPELESS_DOUBTS * p->model[way].doubt);

    if (used != WAY_NONE && model_is_rough(&p->model[way]) && !model_is_rough(&p->model[used]))
        return false;
    return part <= PILOT_GLOSSY && used != WAY_NONE && p->model[way].fresh && p->model[used].fresh &&
           model_error(&p->model[way], equal_count(p, way)) > limit * model_error(&p->model[used], p->choice.n[part]);
}

static bool known(const struct pilot *p)
{
    for (uint32_t way = 0; way < WAYS; way++)
        if (p->there[way] && p->model[way].fresh < READINGS_WANTED && !(p->model[way].fresh && hopeless(p, way)))
            return false;
    return true;
}

/* Enough is known of what is in use. */
static bool settled(const struct pilot *p)
{
    for (int part = 0; part <= PILOT_EYE; part++)
        if (p->choice.way[part] != WAY_NONE && p->model[p->choice.way[part]].chosen < AGAIN_SETTLED)
            return false;
    return true;
}

/* Whose readings are still to come to `wanted`; the hopeless have had theirs. */
static bool lacks(const struct pilot *p, uint32_t way, uint32_t wanted)
{
    const struct model *m = &p->model[way];

    return p->there[way] && !(in_use(p, way) && m->timed && m->fresh) && m->fresh < wanted &&
           !(m->fresh && hopeless(p, way));
}

double pilot_share(const struct pilot *p)
{
    if (!known(p))
        return SHARE_AT_FIRST;
    for (uint32_t way = 0; way < WAYS; way++)
        if (lacks(p, way, CONTENDER))
            return SHARE_LATER;
    return settled(p) ? SHARE_SETTLED : SHARE_LATER;
}

void pilot_look_at_sky(struct pilot *p)
{
    const struct environment *e = p->environment;
    double total = 0.0, apart = 0.0;

    for (int f = 0; f < CUBE_FACES; f++)
        total += p->energy[f];
    for (int f = 0; f < CUBE_FACES && total > 0.0 && e->total_energy > 0.0; f++)
        apart = fmax(apart, fabs(e->energy[f] / e->total_energy - p->energy[f] / total));
    const double ratio = total > 0.0 ? e->total_energy / total : INFINITY;
    if (apart <= SKY_SHARE && ratio <= SKY_RATIO && ratio >= 1.0 / SKY_RATIO)
        return;
    memcpy(p->energy, e->energy, sizeof(p->energy));
    p->peakedness = facts_peakedness(e);
    pilot_set_routes(p);
    for (uint32_t way = 0; way < WAYS; way++)
        model_age(&p->model[way]);
    for (int part = 0; part <= PILOT_EYE; part++) {
        allot_age(&p->allot[part]);
        p->allot_readings[part] = p->allot_turns[part] = 0;
    }
    memset(p->edge, 0, sizeof(p->edge));
    p->frames = 0;
}

/* The next one that holds a fair part of the kind; SURFACE_KINDS: of any. All have as many turns: what is read of them
 * is to stand for the picture. */
static const struct group *next_group(struct pilot *p, enum surface_kind kind)
{
    const struct groups *s = &p->groups;

    for (uint32_t k = 0; k < s->count; k++) {
        const struct group *g = &s->group[p->group_turn[kind]++ % s->count];
        if (kind == SURFACE_KINDS || g->weight[kind] * s->count >= FAIR * s->all.weight[kind])
            return g;
    }
    return &s->all;
}

uint64_t pilot_pass(struct pilot *p)
{
    return PASS_OWN + p->pass++;
}

/* Samples a point, in the mean of some packets. */
static double mean_of(const struct pilot *p, uint32_t way, double n, const struct packet_list *list)
{
    const struct allot_wish wish = pilot_deal(way, n);
    return allot_mean(&p->allot[pilot_part_of(way)], &wish, list);
}

/* Their share of the picture's. */
static double share_of(const struct pilot *p, uint32_t way, double n, const struct packet_list *list)
{
    const struct allot_wish wish = pilot_deal(way, n);
    return allot_work(&p->allot[pilot_part_of(way)], &wish, list);
}

static void pay(struct pilot *p, double seconds)
{
    p->bank_s -= seconds;
    if (p->desc.price)
        p->pilot_s += seconds;
}

/* How much of a group a part fills. */
static double filled(const struct group *g, enum pilot_part part)
{
    return part <= PILOT_GLOSSY ? g->weight[part] : g->pixel_count;
}

/* Of a group, what stands for the picture: by the pixels that the kind fills, since it may fill few in one group and
 * many in another. */
static double read_pair(struct pilot *p, uint32_t way, double n, const struct group *g, const struct pair *pair,
                        double hard)
{
    const enum pilot_part part = pilot_part_of(way);
    const double own = filled(g, part), all = filled(&p->groups.all, part);

    p->seen_on[way] = g;
    if (!(own > 0.0))
        return 0.0;
    const double scale = all / own / p->groups.all.pixel_count, error = scale * pair->error;
    model_read(&p->model[way], &(struct reading){ n, error, scale * pair->energy, hard, p->picture_noise >= ROUGH });
    return error;
}

static void note_edges(struct pilot *p, enum surface_kind kind, const struct pair *pair)
{
    struct pair *edge = &p->edge[kind];

    if (pilot_edges_are_jagged(p)) /* which do not say what they would be otherwise */
        return;
    /* A mean over some hundred groups. */
    const double keep = edge->pixels > 100 * p->groups.pixels / p->groups.count ? 0.9 : 1.0;

    edge->edge = keep * edge->edge + pair->edge;
    edge->pixels = (uint64_t)(keep * (double)edge->pixels) + pair->pixels;
}

/* Who gets what by all that has been read. */
static void deal(struct pilot *p, enum pilot_part part)
{
    const double times = allot_deal(&p->allot[part]);

    p->allot_readings[part] = 0;
    p->allot_turns[part]++;
    if (!(times < 1.0))
        return;
    for (uint32_t way = 0; way < WAYS; way++)
        if (pilot_part_of(way) == part)
            model_ease(&p->model[way], times);
}

void pilot_allot_all(struct pilot *p, const float *other)
{
    const struct group *all = &p->groups.all;

    for (int kind = 0; kind < SURFACE_KINDS; kind++) {
        const bool kinds[SURFACE_KINDS] = { kind == SURFACE_MATTE, kind == SURFACE_GLOSSY };
        if (all->list[kind].count == 0 || p->choice.way[kind] == WAY_NONE)
            continue;
        const struct allot_wish wish = pilot_deal(p->choice.way[kind], p->choice.n[kind]);
        pair_by_point(&p->groups, all, kinds, p->lo_direct, other, &p->yardstick, p->point_error);
        allot_read(&p->allot[kind], &all->list[kind], (const float(*)[PACKET])p->point_error, &wish, 0.0);
        deal(p, (enum pilot_part)kind);
    }
}

/* Where a group is hard, by a pair with numbers of its own, in lo_sum and lo_other. Once enough is known it stays. */
static void note_hard(struct pilot *p, uint32_t way, double n, const struct group *g, const struct yardstick *y)
{
    const enum pilot_part part = pilot_part_of(way);
    const bool kinds[SURFACE_KINDS] = { part != PILOT_GLOSSY, part != PILOT_MATTE };
    const struct allot_wish wish = pilot_deal(way, n);
    const double whole = model_error(&p->model[way], n) * p->groups.all.pixel_count;

    if (p->allot_turns[part] >= TURNS || !(whole > 0.0))
        return;
    pair_by_point(&p->groups, g, kinds, p->lo_sum, p->lo_other, y, p->point_error);
    allot_read(&p->allot[part], part == PILOT_EYE ? &g->both : &g->list[part], (const float(*)[PACKET])p->point_error,
               &wish, whole);
    if (++p->allot_readings[part] >= p->groups.count)
        deal(p, part);
}

/* A part that the picture has, once more on the group that others are to be tried on, with other numbers. */
static enum err again_direct(struct pilot *p, enum surface_kind kind)
{
    const struct group *g = p->here[kind].group;
    const uint32_t way = p->choice.way[kind];
    const bool kinds[SURFACE_KINDS] = { kind == SURFACE_MATTE, kind == SURFACE_GLOSSY };
    const double start = pilot_now(p), n = p->choice.n[kind];
    struct yardstick y = p->yardstick;
    struct direct_stats stats;
    struct pair pair;

    const enum err e =
        pilot_direct(p, p->tables[kind], way, n, pilot_pass(p), true, &g->list[kind], p->lo_other, &stats);
    if (e)
        return e;
    y.smooth = model_error(&p->model[way], n) > YARDSTICK_NOISY;
    pair_of_points(&p->groups, g, kinds, p->lo_direct, p->lo_other, &y, &pair);
    const double error = read_pair(p, way, n, g, &pair, 1.0), whole = model_error_told(&p->model[way], n);
    p->here[kind].read = true;
    p->here[kind].hard = whole > 0.0 ? fmin(HARD_MOST, fmax(1.0 / HARD_MOST, error / whole)) : 1.0;
    note_edges(p, kind, &pair);
    const double mean = mean_of(p, way, n, &g->list[kind]);
    pay(p, pilot_spent(p, start, &(struct pilot_work){ (enum pilot_part)kind, g->points[kind], stats.rays, mean }));
    return ERR_OK;
}

static enum err again_eye(struct pilot *p)
{
    const struct group *g = next_group(p, SURFACE_KINDS);
    static const bool both[SURFACE_KINDS] = { true, true };
    const uint32_t way = p->choice.way[PILOT_EYE];
    const double start = pilot_now(p), n = p->choice.n[PILOT_EYE];
    struct yardstick y = p->yardstick;
    struct eye_paths_stats stats, other;
    struct pair pair;

    enum err e = pilot_eye(p, way, n, pilot_pass(p), &g->both, p->lo_other, &stats);
    if (e)
        return e;
    y.smooth = model_error(&p->model[way], n) > YARDSTICK_NOISY;
    pair_of_points(&p->groups, g, both, p->lo_eye, p->lo_other, &y, &pair);
    (void)read_pair(p, way, n, g, &pair, 1.0);
    if (p->allot_turns[PILOT_EYE] < TURNS) { /* the picture's own numbers must not say who gets how many */
        e = pilot_eye(p, way, n, pilot_pass(p), &g->both, p->lo_sum, &other);
        if (e)
            return e;
        stats.rays += other.rays;
        y.place = PAIR_APART;
        note_hard(p, way, n, g, &y);
    }
    const double mean = mean_of(p, way, n, &g->both);
    pay(p, pilot_spent(p, start, &(struct pilot_work){ PILOT_EYE, g->points[0] + g->points[1], stats.rays, mean }));
    return ERR_OK;
}

static enum err again(struct pilot *p)
{
    enum err e = ERR_OK;

    for (int kind = 0; kind < SURFACE_KINDS && !e; kind++)
        if (p->choice.way[kind] != WAY_NONE && !p->here[kind].read)
            e = again_direct(p, (enum surface_kind)kind);
    if (!e && p->choice.way[PILOT_EYE] != WAY_NONE)
        e = again_eye(p);
    return e;
}

/* One timed run; n samples, on some of a group's packets. */
static enum err timed(struct pilot *p, uint32_t way, double n, bool keep, const struct packet_list *list, float *lo,
                      double *seconds)
{
    const enum surface_kind kind = (enum surface_kind)pilot_part_of(way);
    const double start = pilot_now(p);
    struct direct_stats stats;

    const enum err e = pilot_direct(p, p->probe, way, n, pilot_pass(p), keep, list, lo, &stats);
    uint64_t points = 0;
    for (uint32_t k = 0; k < list->count && p->desc.price; k++)
        points += p->gbuffer->packets[list->index[k]].count;
    *seconds = pilot_spent(p, start,
                           &(struct pilot_work){ (enum pilot_part)kind, points, stats.rays, mean_of(p, way, n, list) });
    pay(p, *seconds);
    return e;
}

/* What a run of n samples said of the time; the first time beside one of another count, and both of a single packet:
 * what that takes is no group's share of anything. */
static enum err read_time(struct pilot *p, uint32_t way, const struct group *g, double tables_s, double n,
                          double seconds)
{
    const enum surface_kind kind = (enum surface_kind)pilot_part_of(way);
    const double other = n > SAMPLES_TIMED ? 2.0 * ceil(0.5 * n / SLOPE_TIMES) : SLOPE_TIMES * n;
    const double count[2] = { fmin(n, other), fmax(n, other) };
    const struct packet_list one = { g->list[kind].index, 1 };
    struct model *m = &p->model[way];
    const double share[2] = { share_of(p, way, count[0], &g->list[kind]), share_of(p, way, count[1], &g->list[kind]) };
    double took[2], none[2];
    enum err e = ERR_OK;

    if (m->sloped) {
        if (n >= SAMPLES_TIMED)
            model_time(m, tables_s, n, p->unit_times[kind] * seconds / p->pace, share_of(p, way, n, &g->list[kind]));
        return ERR_OK;
    }
    for (int k = 0; k < 2 && !e; k++) {
        took[k] = seconds;
        if (count[k] != n)
            e = timed(p, way, count[k], true, &g->list[kind], p->lo_other, &took[k]);
        if (!e)
            e = timed(p, way, count[k], true, &one, p->lo_other, &none[k]);
        took[k] /= p->pace;
        none[k] /= p->pace;
    }
    if (e)
        return e;
    model_slope(m, tables_s, count, took, none, share);
    (void)model_whole(m, &p->base_times[kind], &p->unit_times[kind]);
    m->base_s *= p->base_times[kind];
    m->unit_s *= p->unit_times[kind];
    return ERR_OK;
}

/* Twice with n samples, the second time by the tables of the first: the difference in time is what these take. `keep`:
 * they are there already, and took *tables_s. lo_sum has served the picture already. */
static enum err probe_surfaces(struct pilot *p, uint32_t way, bool keep, double *tables_s)
{
    const enum surface_kind kind = (enum surface_kind)pilot_part_of(way);
    const bool kinds[SURFACE_KINDS] = { kind == SURFACE_MATTE, kind == SURFACE_GLOSSY };
    const double n = fmax(2.0, equal_count(p, way));
    struct yardstick y = p->yardstick;
    double first, second;
    struct pair pair;
    enum err e = ERR_OK;

    if (p->seen_on[way] == p->here[kind].group) {
        p->here[kind].group = next_group(p, kind);
        p->here[kind].read = false;
    }
    const struct group *g = p->here[kind].group;
    if (!p->here[kind].read && p->choice.way[kind] != WAY_NONE)
        e = again_direct(p, kind);
    if (!e)
        e = timed(p, way, n, keep, &g->list[kind], p->lo_sum, &first);
    if (!e)
        e = timed(p, way, n, true, &g->list[kind], p->lo_other, &second);
    if (e)
        return e;
    y.place = PAIR_APART;
    y.smooth = p->picture_noise > YARDSTICK_NOISY;
    pair_of_points(&p->groups, g, kinds, p->lo_sum, p->lo_other, &y, &pair);
    (void)read_pair(p, way, n, g, &pair, p->here[kind].read ? p->here[kind].hard : 1.0);
    note_hard(p, way, n, g, &y);
    if (!keep)
        *tables_s = fmax(0.0, first - second) / p->pace;
    return read_time(p, way, g, *tables_s, n, second);
}

/* A technique on the surfaces of one kind, and by the same tables on the others while little is known of those. */
static enum err probe_direct(struct pilot *p, uint32_t way)
{
    const uint32_t other = way < WAY_GLOSSY ? way + PILOT_TECHNIQUES : way - PILOT_TECHNIQUES;
    double tables_s = 0.0;
    enum err e = probe_surfaces(p, way, false, &tables_s);

    if (!e && p->there[other] && !in_use(p, other) && p->model[other].fresh < READINGS_WANTED && !hopeless(p, other))
        e = probe_surfaces(p, other, true, &tables_s);
    return e;
}

static enum err probe_eye(struct pilot *p, uint32_t way)
{
    static const bool both[SURFACE_KINDS] = { true, true };
    const struct group *g = next_group(p, SURFACE_KINDS);
    struct yardstick y = p->yardstick;
    const double n = equal_count(p, way), share = share_of(p, way, n, &g->both), mean = mean_of(p, way, n, &g->both);
    double least = INFINITY;
    struct pair pair;

    for (int k = 0; k < 2; k++) {
        const double start = pilot_now(p);
        struct eye_paths_stats stats;
        const enum err e = pilot_eye(p, way, n, pilot_pass(p), &g->both, k ? p->lo_other : p->lo_sum, &stats);
        if (e)
            return e;
        const struct pilot_work work = { PILOT_EYE, g->points[0] + g->points[1], stats.rays, mean };
        const double seconds = pilot_spent(p, start, &work);
        least = fmin(least, seconds);
        pay(p, seconds);
    }
    y.place = p->choice.way[PILOT_EYE] == WAY_NONE ? PAIR_NONE : PAIR_APART;
    y.smooth = p->picture_noise > YARDSTICK_NOISY;
    y.even = !(p->route[way].classes & (PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC));
    pair_of_points(&p->groups, g, both, p->lo_sum, p->lo_other, &y, &pair);
    (void)read_pair(p, way, n, g, &pair, 1.0);
    if (y.place == PAIR_APART)
        note_hard(p, way, n, g, &y);
    model_time(&p->model[way], 0.0, n, least / p->pace, share);
    return ERR_OK;
}

static enum err probe_light(struct pilot *p, uint32_t way)
{
    const struct model *m = &p->model[way];
    double n[2] = { LIGHT_LEAST, 4.0 * LIGHT_LEAST }, seconds[2];
    const int runs = m->timed ? 1 : 2;

    if (m->timed)
        n[0] = floor(fmin(LIGHT_MOST, fmax(LIGHT_LEAST, 0.5 * p->bank_s / (p->pace * m->unit_s))));
    for (int k = 0; k < runs; k++) {
        const double start = pilot_now(p);
        struct light_tracer_stats stats;
        const enum err e = pilot_light(p, way, n[k], pilot_pass(p), &stats);
        if (e)
            return e;
        seconds[k] =
            pilot_spent(p, start, &(struct pilot_work){ pilot_part_of(way), 0, stats.rays, n[k] * UNIT_PARTICLES });
        pay(p, seconds[k]);
        seconds[k] /= p->pace;
        pilot_read_light(p, way, n[k], p->yardstick.rgb);
    }
    if (runs == 2) {
        const double unit = fmax((seconds[1] - seconds[0]) / (n[1] - n[0]), 0.3 * seconds[1] / n[1]);
        model_time(&p->model[way], fmax(0.0, seconds[1] - unit * n[1]), n[1], unit * n[1], 1.0);
    }
    return ERR_OK;
}

/* Who is looked at next: whoever is least known; among equals first what `auto` stands for, then the estimators of the
 * rest, then other techniques. Where all are known, in turn. WAYS: nobody. */
static uint32_t next_way(struct pilot *p)
{
    const bool all = isfinite(p->bank_s) && (!p->begun || (known(p) && p->frames >= FRAMES_AT_FIRST));
    uint32_t best = WAYS, least = UINT32_MAX;

    for (uint32_t way = 0; way < WAYS; way++) {
        const bool other = way >= WAY_EYE_ALL, first = way % PILOT_TECHNIQUES == 0;
        /* What the other light would bring is told by few pixels, which one group has and another has not. */
        const uint32_t wanted = other ? OTHER_WANTED : all ? CONTENDER : READINGS_WANTED;
        const uint32_t rank = other ? p->model[way].fresh : 2 * p->model[way].fresh + !first;
        if (lacks(p, way, wanted) && rank < least) {
            least = rank;
            best = way;
        }
    }
    for (uint32_t k = 0; k < WAYS && best == WAYS; k++) {
        const uint32_t way = p->next_way++ % WAYS;
        if (p->there[way] && !in_use(p, way) && (!hopeless(p, way) || p->next_way / WAYS % SELDOM == 0))
            best = way;
    }
    return best;
}

/* What a probe of it will take, about; 0 where that is not known. */
static double cost_of(const struct pilot *p, uint32_t way)
{
    const struct model *m = &p->model[way];
    const double share = 1.0 / p->groups.count;

    if (!m->timed)
        return 0.0;
    if (way >= WAY_AIMED)
        return p->pace * model_seconds(m, LIGHT_LEAST);
    if (way >= WAY_EYE_ALL)
        return 2.0 * p->pace * m->unit_s * share * equal_count(p, way);
    /* Twice, and what is in use, which takes as long. */
    return p->pace * (2.0 * m->tables_s + 3.0 * m->run_s + 3.0 * share * (m->base_s + m->unit_s * equal_count(p, way)));
}

double pilot_first_s(const struct pilot_wish *wish)
{
    return wish->seconds > 0.0 ? fmax(FIRST_LEAST, 0.5 * wish->seconds) : INFINITY;
}

enum err pilot_probe(struct pilot *p, const struct pilot_wish *wish)
{
    const double frame = wish->seconds > 0.0 ? wish->seconds : p->frame_s;
    enum err e = ERR_OK;

    if (!p->groups.dealt && !groups_deal(&p->groups, &p->yardstick))
        return ERR_NOMEM;
    for (int kind = 0; kind < SURFACE_KINDS; kind++) {
        p->here[kind].group = next_group(p, (enum surface_kind)kind);
        p->here[kind].read = false;
    }

    if (!p->begun) {
        p->bank_s = pilot_first_s(wish);
    } else {
        p->bank_s = isinf(p->bank_s) ? 0.0 : fmax(-BANK_FRAMES * frame, p->bank_s);
        p->bank_s = fmin(BANK_FRAMES * frame, p->bank_s + pilot_share(p) * frame);
        /* What is in use is not to starve the rest: it goes first every other frame, or every fourth. */
        if (p->bank_s > 0.0 && p->runs % (known(p) && !settled(p) ? 2 : 4) == 0)
            e = again(p);
    }
    for (uint32_t probes = 0; probes < CONTENDER * WAYS && !e; probes++) {
        const uint32_t way = next_way(p);
        if (way < WAYS && p->begun && p->model[way].fresh < READINGS_WANTED && cost_of(p, way) > BANK_FRAMES * frame)
            model_scale(&p->model[way], DOUBTED);
        const bool must = !p->begun && way < WAY_EYE_ALL && way % PILOT_TECHNIQUES == 0 && !p->model[way].fresh;
        if (way == WAYS || (!must && p->bank_s <= cost_of(p, way)) ||
            (isinf(p->bank_s) && p->model[way].fresh >= (way < WAY_EYE_ALL ? READINGS_WANTED : OTHER_WANTED)))
            break;
        e = way < WAY_EYE_ALL ? probe_direct(p, way) : way < WAY_AIMED ? probe_eye(p, way) : probe_light(p, way);
    }
    return e;
}
