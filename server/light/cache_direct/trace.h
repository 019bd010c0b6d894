/* Traces the entries of the cache of direct light (light/cache_direct/internal.h). Included by its kernels only. */
#pragma once

#include "base/half.h"
#include "light/cache_direct/internal.h"
#include "light/estimators/packed.h"
#include "scene/geometry/lane_rays.h"
#include "scene/surface/lobes.h"

#include <math.h>

/* Share of the light of an even sky: by more than that a point differs from what its neighbours say (find_odd). */
#define ODD 0.06f

struct tracer {
    const struct transport_world *world;
    const struct shade_packet *points;
    struct shade_packet basis; /* the same points, with colours that separate the rows */
    struct lobes lobes;
    struct ray16 rays;
    struct lane_pixels pixels;
    uint32_t number; /* of the sample, which says where in their pixels its rays start */
    uint64_t traced;
};

static void start_tracer(struct tracer *t)
{
    lobes_rays(t->points, &t->rays);
    lanes_pixels(t->points, &t->pixels);
}

/* Sets colours such that the three channels of lobes_evaluate return, in this order: the part of the lobe that no
 * colour multiplies, the lobe for a specular colour of 1, and the first plus the matte part. */
static void set_up_tracer(struct tracer *t)
{
    static const float diffuse[3] = { 0.0f, 0.0f, 1.0f }, specular[3] = { 0.0f, 1.0f, 0.0f };
    const struct shade_packet *p = t->points;

    t->basis = *p;
    for (int c = 0; c < 3; c++)
        LANES(l)
        {
            t->basis.diffuse[c][l] = diffuse[c];
            t->basis.specular[c][l] = specular[c];
        }
    lobes_set_up(p, &t->lobes);
    LANES(l) t->lobes.diffuse_part.v[l] = 0.0f; /* the cells' directions suffice for the matte part */
    start_tracer(t);
}

/* Finds the lanes with d above their horizon, and their cosines. False: none. */
static bool face(const struct tracer *t, const struct lanes d[3], struct lanes *cosine, int32_t valid[PACKET])
{
    int32_t some = 0;

    if (!lobes_see(t->points, d, cosine))
        return false;
    LANES(l)
    {
        valid[l] = cosine->v[l] > 0.0f ? t->points->valid[l] : 0;
        some |= valid[l];
    }
    return some != 0;
}

/* Traces rays along d; tfar stays above 0 in the lanes that see the sky. */
static void ask(struct tracer *t, enum ray_spread spread, const struct lanes d[3], const int32_t valid[PACKET])
{
    uint32_t place[PACKET];
    int32_t count = 0;

    lanes_aim(d, &t->rays);
    LANES(l) place[l] = lanes_place(t->number);
    lanes_start(t->points, &t->pixels, place, &t->rays);
    LANES(l) count -= valid[l];
    if (t->world->rays) {
        rays_occluded16(t->world->rays, spread, valid, &t->rays);
        t->traced += (uint64_t)count;
    }
}

/* BRDF times cosine by rows along d, times the share of the sky there that each lane sees. False: no lane sees it. pdf:
 * of the specular lobe. shares: NULL: trace rays. */
static bool see_rows(struct tracer *t, enum ray_spread spread, const struct lanes d[3], const float *shares,
                     struct lanes row[TRANSPORT_ROWS], struct lanes *pdf)
{
    _Alignas(64) int32_t valid[PACKET];
    struct lanes cosine, brdf[3], share;
    int32_t seen = 0;

    if (!face(t, d, &cosine, valid))
        return false;
    if (!shares)
        ask(t, spread, d, valid);
    LANES(l)
    {
        share.v[l] = shares ? shares[l] : t->rays.tfar[l] > 0.0f ? 1.0f : 0.0f;
        valid[l] = share.v[l] != 0.0f ? valid[l] : 0;
        cosine.v[l] = valid[l] ? cosine.v[l] : 0.0f;
        seen |= valid[l];
    }
    if (!seen)
        return false;
    lobes_evaluate(&t->lobes, &t->basis, d, &cosine, brdf, pdf);
    LANES(l)
    {
        const float both = brdf[1].v[l] - brdf[0].v[l], matte = brdf[2].v[l] - brdf[0].v[l];
        row[0].v[l] = matte > 0.0f ? matte * share.v[l] : 0.0f;
        row[1].v[l] = both > 0.0f ? both * share.v[l] : 0.0f;
        row[2].v[l] = brdf[0].v[l] * share.v[l];
    }
    return true;
}

/* Balance heuristic weight / density of a cell's direction against the lobe's own samples; weight: 1 / density of the
 * former. */
static inline float balanced(float weight, float lobe_samples, float pdf)
{
    return weight / (1.0f + weight * lobe_samples * pdf);
}

static void set_direction(const struct transport_directions *dirs, uint32_t k, struct lanes d[3])
{
    const float x = dirs->x[k], y = dirs->y[k], z = dirs->z[k];

    LANES(l)
    {
        d[0].v[l] = x;
        d[1].v[l] = y;
        d[2].v[l] = z;
    }
}

/* What the lanes of a packet see of a direction: bits of those that face it, and of those of them that see it. */
struct glance {
    uint16_t faced, seen;
};

/* Of the first direction of each unit (transport_directions). */
struct outlook {
    struct glance first[SKY_CELLS];
    uint8_t sides[SKY_CELLS]; /* SEEN, HIDDEN: by some lanes */
};

enum { SEEN = 1, HIDDEN = 2 };

static uint8_t sides_of(struct glance g)
{
    return (uint8_t)((g.seen != 0 ? SEEN : 0) | (g.faced != g.seen ? HIDDEN : 0));
}

/* Traces direction k from the lanes that face it. */
static struct glance ask_direction(struct tracer *t, uint32_t k)
{
    _Alignas(64) int32_t valid[PACKET];
    struct lanes d[3], cosine;
    struct glance g = { 0, 0 };

    t->number = k;
    set_direction(t->world->directions, k, d);
    if (!face(t, d, &cosine, valid))
        return g;
    ask(t, RAYS_TOGETHER, d, valid);
    for (uint32_t l = 0; l < PACKET; l++) {
        g.faced |= (uint16_t)((valid[l] != 0) << l);
        g.seen |= (uint16_t)((valid[l] && t->rays.tfar[l] > 0.0f) << l);
    }
    return g;
}

/* What lanes see of unit u and of its eight neighbours. */
static uint8_t sides_around(const struct transport_directions *dirs, const uint8_t *sides, uint32_t u)
{
    uint8_t all = sides[u];

    for (int i = 0; i < 8; i++)
        all |= sides[dirs->around[u][i]];
    return all;
}

/* A block whose transport is traced. */
struct block_trace {
    const struct transport_world *world;
    const struct transport_neighbours *neighbours; /* NULL: all points trace all directions */
    uint32_t count;
    struct tracer points[TRANSPORT_PACKETS];
    struct shade_packet mixed[TRANSPORT_PACKETS];
    struct tracer turns[TRANSPORT_PACKETS]; /* of packets `mixed` */
    struct outlook together;                /* first directions, each from the turn's points */
    uint8_t known[SKY_CELLS];               /* by unit: SEEN, HIDDEN: by all points; else 0 */
    struct shade_packet lone[TRANSPORT_PACKETS];
    uint16_t from[TRANSPORT_PACKETS][PACKET]; /* the points that are lanes of packets `lone` */
    uint32_t lone_count;
    struct tracer alone[TRANSPORT_PACKETS];
    struct outlook outlooks[TRANSPORT_PACKETS]; /* of these */
    uint8_t sides;                              /* of all directions since the last reset */
};

static uint32_t turn_of(uint32_t unit, uint32_t k)
{
    return (unit + unit / 4 + k) % TRANSPORT_PACKETS;
}

/* Traces the first direction of each unit from a quarter of the points. If these and those of the eight units around
 * have the same visibility for all, all points' other directions are assumed to have it, too. */
static void look_together(struct block_trace *b, const struct shade_packet *packets)
{
    const struct transport_directions *dirs = b->world->directions;

    for (uint32_t k = 0; k < TRANSPORT_PACKETS; k++) {
        b->mixed[k] = packets[0];
        for (uint32_t l = 0; l < PACKET; l++) {
            const struct shade_packet *from = &packets[transport_turn_point(k, l) / PACKET];
            shade_packet_put(&b->mixed[k], l, from, l, from->valid[l]);
        }
        b->turns[k] = (struct tracer){ .world = b->world, .points = &b->mixed[k] };
        start_tracer(&b->turns[k]);
    }
    for (uint32_t u = 0; u < dirs->units; u++) {
        b->together.first[u] = ask_direction(&b->turns[turn_of(u, 0)], u * TRANSPORT_UNIT);
        b->together.sides[u] = sides_of(b->together.first[u]);
    }
    for (uint32_t u = 0; u < dirs->units; u++) {
        const uint8_t all = sides_around(dirs, b->together.sides, u);
        b->known[u] = all == SEEN || all == HIDDEN ? all : 0;
    }
}

static uint16_t used_lanes(const struct shade_packet *p)
{
    uint16_t bits = 0;

    for (uint32_t l = 0; l < PACKET; l++)
        bits |= (uint16_t)((p->valid[l] != 0) << l);
    return bits;
}

/* What the other points of its turn say about a lane. False: nothing. */
static bool ask_others(const struct transport_neighbours *n, uint32_t turn, struct glance g, uint16_t used,
                       uint32_t lane, float *out)
{
    const uint32_t p = transport_turn_point(turn, lane);
    float sum = 0.0f, seen = 0.0f;

    for (uint32_t l = 0; l < PACKET; l++) {
        const float w = g.faced == used ? n->others[p][l] : l == lane ? 0.0f : n->near[turn][l][p];
        sum += g.faced >> l & 1u ? w : 0.0f;
        seen += g.seen >> l & 1u ? w : 0.0f;
    }
    *out = seen / sum;
    return sum > 0.0f;
}

/* What a block's points see of an even sky by the first directions, and how much more than their neighbours say: in
 * all, and times x, y and z of the direction, so that too much on one side does not make up for too little on the
 * other. */
struct survey {
    float light[TRANSPORT_POINTS], off[4][TRANSPORT_POINTS];
    float squares[TRANSPORT_POINTS]; /* of all of these differences: what chance makes of `off` squared */
};

static void survey_unit(const struct block_trace *b, uint32_t u, struct survey *s)
{
    const struct glance g = b->together.first[u];
    const uint32_t turn = turn_of(u, 0), k = u * TRANSPORT_UNIT;
    const struct shade_packet *mixed = &b->mixed[turn];
    const uint16_t used = used_lanes(mixed);
    const struct transport_directions *dirs = b->world->directions;
    struct lanes d[3], cosine;

    set_direction(dirs, k, d);
    if (!g.faced || !lobes_see(mixed, d, &cosine))
        return;
    for (uint32_t l = 0; l < PACKET; l++) {
        const uint32_t p = transport_turn_point(turn, l);
        const float weight = dirs->weight[k] * cosine.v[l], seen = (float)(g.seen >> l & 1u);
        float told;
        s->light[p] += weight * seen;
        if (b->known[u] || !(g.faced >> l & 1u) || !ask_others(b->neighbours, turn, g, used, l, &told))
            continue;
        const float off = weight * (seen - told);
        s->off[0][p] += off;
        s->off[1][p] += off * dirs->x[k];
        s->off[2][p] += off * dirs->y[k];
        s->off[3][p] += off * dirs->z[k];
        s->squares[p] += 2.0f * off * off;
    }
}

/* The points about which their neighbours are wrong by more than ODD of their light, as beside edges and in grooves: by
 * the mean square of the points around, less what chance makes of it. */
static uint64_t find_odd(const struct block_trace *b)
{
    struct survey s = { .light = { 0.0f } };
    float square[TRANSPORT_POINTS];
    uint64_t odd = 0;

    for (uint32_t u = 0; u < b->world->directions->units; u++)
        survey_unit(b, u, &s);
    for (uint32_t p = 0; p < TRANSPORT_POINTS; p++) {
        square[p] = -s.squares[p];
        for (int k = 0; k < 4; k++)
            square[p] += s.off[k][p] * s.off[k][p];
    }
    for (uint32_t p = 0; p < TRANSPORT_POINTS; p++) {
        float whole = 0.0f, excess = 0.0f;
        for (uint32_t turn = 0; turn < TRANSPORT_PACKETS; turn++)
            for (uint32_t l = 0; l < PACKET; l++) {
                whole += b->neighbours->near[turn][l][p];
                excess += b->neighbours->near[turn][l][p] * square[transport_turn_point(turn, l)];
            }
        odd |= (uint64_t)(excess > ODD * ODD * s.light[p] * s.light[p] * whole) << p;
    }
    return odd;
}

/* Collects the points that trace all directions. */
static void set_alone(struct block_trace *b, const struct shade_packet *packets)
{
    const uint64_t alone = b->neighbours ? b->neighbours->alone | find_odd(b) : UINT64_MAX;
    const bool all = (uint32_t)__builtin_popcountll(alone) > (TRANSPORT_PACKETS - 1) * PACKET;
    uint32_t n = 0;

    for (uint32_t i = 0; i < b->count * PACKET; i++) {
        if (!all && !(alone >> i & 1u))
            continue;
        struct shade_packet *to = &b->lone[n / PACKET];
        if (n % PACKET == 0)
            *to = packets[i / PACKET];
        shade_packet_put(to, n % PACKET, &packets[i / PACKET], i % PACKET, packets[i / PACKET].valid[i % PACKET]);
        b->from[n / PACKET][n % PACKET] = (uint16_t)i;
        n++;
    }
    b->lone_count = (n + PACKET - 1) / PACKET;
    for (; n % PACKET != 0; n++)
        b->lone[n / PACKET].valid[n % PACKET] = 0;
    for (uint32_t k = 0; k < b->lone_count; k++) {
        struct tracer *t = &b->alone[k];
        struct outlook *o = &b->outlooks[k];
        *t = (struct tracer){ .world = b->world, .points = &b->lone[k] };
        start_tracer(t);
        for (uint32_t u = 0; u < b->world->directions->units; u++) {
            o->sides[u] = b->known[u];
            if (b->known[u])
                continue;
            o->first[u] = ask_direction(t, u * TRANSPORT_UNIT);
            o->sides[u] = sides_of(o->first[u]);
        }
    }
}

/* What a packet of points that trace all directions sees of direction k. If the first directions of its unit and of the
 * eight around it all have the same visibility for all lanes, it is assumed to have it, too. */
static struct glance glance_alone(struct tracer *t, const struct outlook *o, uint32_t k)
{
    const struct transport_directions *dirs = t->world->directions;
    const uint32_t u = k / TRANSPORT_UNIT;

    if (!dirs->units)
        return ask_direction(t, k);
    if (k % TRANSPORT_UNIT == 0)
        return o->first[u];
    const uint8_t sides = sides_around(dirs, o->sides, u);
    if (sides != SEEN && sides != HIDDEN)
        return ask_direction(t, k);
    return (struct glance){ UINT16_MAX, sides == SEEN ? UINT16_MAX : 0 };
}

/* The shares of direction k that points see, by what those of its turn see. */
static void share_glance(const struct transport_neighbours *n, uint32_t turn, struct glance g, uint16_t used,
                         float share[TRANSPORT_POINTS])
{
    const bool whole = g.faced == used;
    float sum[TRANSPORT_POINTS] = { 0.0f };

    memset(share, 0, TRANSPORT_POINTS * sizeof(*share));
    for (uint32_t l = 0; l < PACKET; l++) {
        const float *w = whole ? n->plane[turn][l] : n->near[turn][l];
        for (uint32_t p = 0; p < TRANSPORT_POINTS && g.seen >> l & 1u; p++)
            share[p] += w[p];
        for (uint32_t p = 0; p < TRANSPORT_POINTS && !whole && g.faced >> l & 1u; p++)
            sum[p] += w[p];
    }
    for (uint32_t p = 0; p < TRANSPORT_POINTS && !whole; p++)
        share[p] = sum[p] > 0.0f ? share[p] / sum[p] : 1.0f;
}

/* The share of direction k that each point sees. False: none sees it. */
static bool see(struct block_trace *b, uint32_t k, float share[TRANSPORT_POINTS])
{
    const struct transport_directions *dirs = b->world->directions;
    const uint32_t u = k / TRANSPORT_UNIT, turn = turn_of(u, k);
    uint8_t sides = 0;

    if (dirs->units && b->known[u]) {
        b->sides |= b->known[u];
        for (uint32_t p = 0; p < TRANSPORT_POINTS; p++)
            share[p] = 1.0f;
        return b->known[u] == SEEN;
    }
    if (b->neighbours && b->lone_count < TRANSPORT_PACKETS) {
        const struct glance g = k % TRANSPORT_UNIT == 0 ? b->together.first[u] : ask_direction(&b->turns[turn], k);
        share_glance(b->neighbours, turn, g, used_lanes(&b->mixed[turn]), share);
        sides = sides_of(g);
    }
    for (uint32_t i = 0; i < b->lone_count; i++) {
        const struct glance g = glance_alone(&b->alone[i], &b->outlooks[i], k);
        sides |= sides_of(g);
        for (uint32_t l = 0; l < PACKET; l++)
            if (b->lone[i].valid[l])
                share[b->from[i][l]] = (float)(g.seen >> l & 1u);
    }
    b->sides |= sides;
    return (sides & SEEN) != 0;
}

static void trace_cells(struct block_trace *b, uint32_t rows, struct transport_matrix *out,
                        struct transport_sight *sight)
{
    const struct transport_directions *dirs = b->world->directions;
    const float lobes = rows > 1 ? (float)b->world->lobe_samples : 0.0f, part = 1.0f / (float)dirs->group;

    for (uint32_t cell = 0, k = 0; cell < SKY_CELLS; cell += dirs->group) {
        struct lanes sum[TRANSPORT_PACKETS][TRANSPORT_ROWS];
        memset(sum, 0, sizeof(sum));
        b->sides = 0;
        for (const uint32_t end = k + dirs->per_group; k < end; k++) {
            const float weight = dirs->weight[k];
            float share[TRANSPORT_POINTS];
            struct lanes d[3];
            if (!see(b, k, share))
                continue;
            set_direction(dirs, k, d);
            for (uint32_t i = 0; i < b->count; i++) {
                struct lanes row[TRANSPORT_ROWS], pdf;
                if (!see_rows(&b->points[i], RAYS_TOGETHER, d, share + i * PACKET, row, &pdf))
                    continue;
                LANES(l)
                {
                    const float w = balanced(weight, lobes, pdf.v[l]);
                    sum[i][0].v[l] += weight * row[0].v[l];
                    sum[i][1].v[l] += w * row[1].v[l];
                    sum[i][2].v[l] += w * row[2].v[l];
                }
            }
        }
        for (uint32_t c = cell; c < cell + dirs->group; c++) {
            sight->seen[c / 64] |= (uint64_t)((b->sides & SEEN) != 0) << c % 64;
            sight->hidden[c / 64] |= (uint64_t)((b->sides & HIDDEN) != 0) << c % 64;
        }
        for (uint32_t i = 0; i < b->count; i++)
            for (uint32_t r = 0; r < rows; r++) {
                LANES(l) sum[i][r].v[l] *= part;
                for (uint32_t c = cell; c < cell + dirs->group; c++)
                    memcpy(&out[r].at[c][i * PACKET], sum[i][r].v, sizeof(sum[i][r]));
            }
    }
}

/* The lobe's own samples, with the same random numbers for all points, so that neighbours are similar and compress
 * well.
 */
static void trace_lobes(struct tracer *t, uint32_t rows, struct transport_matrix *out, uint32_t first)
{
    const struct transport_directions *dirs = t->world->directions;
    const float per_uv = (float)dirs->per_group / (float)dirs->group * (0.25f * SKY_EDGE * SKY_EDGE);
    const float half = 0.5f * SKY_EDGE, samples = (float)t->world->lobe_samples;

    for (uint32_t i = 0; i < t->world->lobe_samples; i++) {
        const float *x = t->world->lobe_numbers[i];
        struct lanes square[2], d[3], row[TRANSPORT_ROWS], pdf;
        LANES(l)
        {
            square[0].v[l] = x[0];
            square[1].v[l] = x[1];
        }
        lobes_sample(&t->lobes, t->points, square, d);
        t->number = i;
        if (!see_rows(t, RAYS_APART, d, NULL, row, &pdf))
            continue;
        for (uint32_t l = 0; l < PACKET; l++) {
            const float w[3] = { d[0].v[l], d[1].v[l], d[2].v[l] };
            float u, v;
            const uint32_t face = cube_locate(w, &u, &v), edge = SKY_EDGE - 1;
            const uint32_t q = (uint32_t)((v + 1.0f) * half), c = (uint32_t)((u + 1.0f) * half);
            const uint32_t cell = sky_cell(face, q < edge ? q : edge, c < edge ? c : edge);
            const float density = per_uv * cube_jacobian(u, v) + samples * pdf.v[l];
            for (uint32_t r = 1; r < rows; r++)
                out[r].at[cell][first + l] += row[r].v[l] / density;
        }
    }
}

static inline uint64_t trace(const struct transport_world *w, const struct shade_packet *packets, uint32_t count,
                             uint32_t rows, const struct transport_neighbours *neighbours, struct transport_matrix *out,
                             struct transport_sight *sight)
{
    struct block_trace b = { .world = w, .neighbours = neighbours, .count = count };
    uint64_t traced = 0;

    for (uint32_t i = 0; i < count; i++) {
        b.points[i] = (struct tracer){ .world = w, .points = &packets[i] };
        set_up_tracer(&b.points[i]);
    }
    if (neighbours)
        look_together(&b, packets);
    set_alone(&b, packets);
    trace_cells(&b, rows, out, sight);
    for (uint32_t i = 0; i < count && rows > 1; i++)
        trace_lobes(&b.points[i], rows, out, i * PACKET);
    for (uint32_t i = 0; i < TRANSPORT_PACKETS; i++)
        traced += b.points[i].traced + b.turns[i].traced + b.alone[i].traced;
    return traced;
}

static inline uint64_t aim(const struct transport_world *w, const struct shade_packet *p, struct transport_gaze *out)
{
    struct tracer t = { .world = w, .points = p };

    set_up_tracer(&t);
    memset(out, 0, TRANSPORT_GAZES * sizeof(*out));
    for (uint32_t i = 0; i < TRANSPORT_GAZES; i++, out++) {
        struct lanes square[2], d[3], row[TRANSPORT_ROWS], pdf;
        LANES(l)
        {
            square[0].v[l] = w->gaze_numbers[i][0];
            square[1].v[l] = w->gaze_numbers[i][1];
        }
        lobes_sample(&t.lobes, p, square, d);
        t.number = i;
        const bool some = see_rows(&t, RAYS_APART, d, NULL, row, &pdf);
        LANES(l)
        {
            const float density = some ? TRANSPORT_GAZES * pdf.v[l] : 0.0f;
            if (!(density > 0.0f))
                continue;
            out->to[l] = direction_pack((const float[]){ d[0].v[l], d[1].v[l], d[2].v[l] });
            out->by_specular[l] = half_round(fminf(row[1].v[l] / density, HALF_MAX));
            out->by_one[l] = half_round(fminf(row[2].v[l] / density, HALF_MAX));
            out->root_density[l] = half_round(fminf(sqrtf(density), HALF_MAX));
        }
    }
    return t.traced;
}
