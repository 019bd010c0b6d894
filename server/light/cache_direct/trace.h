/* Traces the entries of the cache of direct light (light/cache_direct/internal.h). Included by its kernels only. */
#pragma once

#include "light/cache_direct/internal.h"
#include "scene/geometry/lane_rays.h"
#include "scene/surface/lobes.h"

#include <math.h>

struct tracer {
    const struct transport_world *world;
    const struct shade_packet *points;
    const uint8_t *known;      /* enum transport_outlook by unit, of the block */
    struct shade_packet basis; /* the same points, with colours that separate the rows */
    struct lobes lobes;
    struct ray16 rays;
    struct lane_pixels pixels;
    uint32_t number; /* of the sample, which says where in their pixels its rays start */
    uint32_t rows;
    uint64_t traced;
    bool seen, hidden; /* by some lane for which a direction was above the horizon, since the last reset */
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

/* BRDF times cosine by rows in the lanes that see the sky along d; 0 in the others. False: no lane sees it. pdf: of the
 * specular lobe. known: bits of the lanes that see it, if no rays are needed; NULL: trace rays. */
static bool see_rows(struct tracer *t, enum ray_spread spread, const struct lanes d[3], const uint32_t *known,
                     struct lanes row[TRANSPORT_ROWS], struct lanes *pdf)
{
    _Alignas(64) int32_t valid[PACKET], faced[PACKET];
    struct lanes cosine, brdf[3];
    int32_t seen = 0, hidden = 0;

    if (!face(t, d, &cosine, valid))
        return false;
    if (known) {
        LANES(l) t->rays.tfar[l] = *known >> l & 1u ? INFINITY : -INFINITY;
    } else {
        ask(t, spread, d, valid);
    }
    memcpy(faced, valid, sizeof(faced));
    LANES(l)
    {
        valid[l] = t->rays.tfar[l] > 0.0f ? valid[l] : 0;
        cosine.v[l] = valid[l] ? cosine.v[l] : 0.0f;
        seen |= valid[l];
        hidden |= faced[l] & ~valid[l];
    }
    t->seen |= seen != 0;
    t->hidden |= hidden != 0;
    if (!seen)
        return false;
    lobes_evaluate(&t->lobes, &t->basis, d, &cosine, brdf, pdf);
    LANES(l)
    {
        const float both = brdf[1].v[l] - brdf[0].v[l], matte = brdf[2].v[l] - brdf[0].v[l];
        row[0].v[l] = matte > 0.0f ? matte : 0.0f;
        row[1].v[l] = both > 0.0f ? both : 0.0f;
        row[2].v[l] = brdf[0].v[l];
    }
    return true;
}

/* Balance heuristic weight / density of a cell's direction against the lobe's own samples; weight: 1 / density of the
 * former. */
static inline float balanced(float weight, float lobe_samples, float pdf)
{
    return weight / (1.0f + weight * lobe_samples * pdf);
}

static void set_direction(struct tracer *t, uint32_t k, struct lanes d[3])
{
    const struct transport_directions *dirs = t->world->directions;
    const float x = dirs->x[k], y = dirs->y[k], z = dirs->z[k];

    LANES(l)
    {
        d[0].v[l] = x;
        d[1].v[l] = y;
        d[2].v[l] = z;
    }
    t->number = k;
}

/* Visibility of the first direction of each unit (transport_directions). */
struct outlook {
    uint32_t first[SKY_CELLS]; /* bits of the lanes that see it */
    uint8_t sides[SKY_CELLS];  /* of the lanes for which it is above the horizon, bit 0: some see it, bit 1: some do
                                  not */
};

/* Traces the first direction of unit u from the lanes that face it: bits of those that see it. sides: as in struct
 * outlook. */
static uint32_t ask_unit(struct tracer *t, uint32_t u, uint8_t *sides)
{
    _Alignas(64) int32_t valid[PACKET];
    struct lanes d[3], cosine;
    uint32_t seen = 0, faced = 0;

    *sides = 0;
    set_direction(t, u * TRANSPORT_UNIT, d);
    if (!face(t, d, &cosine, valid))
        return 0;
    ask(t, RAYS_TOGETHER, d, valid);
    for (uint32_t l = 0; l < PACKET; l++) {
        faced |= (uint32_t)(valid[l] != 0) << l;
        seen |= (uint32_t)(valid[l] && t->rays.tfar[l] > 0.0f) << l;
    }
    *sides = (uint8_t)((seen != 0) | (faced != seen) << 1);
    return seen;
}

/* What lanes see of unit u and of its eight neighbours. */
static uint8_t sides_around(const struct transport_directions *dirs, const uint8_t *sides, uint32_t u)
{
    uint8_t all = sides[u];

    for (int i = 0; i < 8; i++)
        all |= sides[dirs->around[u][i]];
    return all;
}

/* The packet asked for unit u has one of four lanes of each of the block's packets, other ones for the units beside it.
 */
static inline uint64_t look(const struct transport_world *w, const struct shade_packet *packets, uint32_t count,
                            uint8_t out[SKY_CELLS])
{
    const struct transport_directions *dirs = w->directions;
    struct shade_packet mixed[TRANSPORT_PACKETS];
    struct tracer t[TRANSPORT_PACKETS];
    uint8_t sides[SKY_CELLS];
    uint64_t traced = 0;

    memset(out, TRANSPORT_UNKNOWN, SKY_CELLS);
    if (count < TRANSPORT_PACKETS)
        return 0; /* asking each packet costs no more */
    for (uint32_t k = 0; k < TRANSPORT_PACKETS && dirs->units; k++) {
        mixed[k] = packets[0];
        for (uint32_t l = 0; l < PACKET; l++) {
            const struct shade_packet *from = &packets[(l + l / 4 + k) % TRANSPORT_PACKETS];
            shade_packet_put(&mixed[k], l, from, l, from->valid[l]);
        }
        t[k] = (struct tracer){ .world = w, .points = &mixed[k] };
        start_tracer(&t[k]);
    }
    for (uint32_t u = 0; u < dirs->units; u++)
        ask_unit(&t[(u + u / 4) % TRANSPORT_PACKETS], u, &sides[u]);
    for (uint32_t u = 0; u < dirs->units; u++) {
        const uint8_t all = sides_around(dirs, sides, u);
        out[u] = all == 1 ? TRANSPORT_LIT : all == 2 ? TRANSPORT_DARK : TRANSPORT_UNKNOWN;
    }
    for (uint32_t k = 0; k < TRANSPORT_PACKETS && dirs->units; k++)
        traced += t[k].traced;
    return traced;
}

/* Traces one direction of each unit that is not known. */
static void look_out(struct tracer *t, struct outlook *o)
{
    for (uint32_t u = 0; u < t->world->directions->units; u++) {
        o->sides[u] = t->known[u] == TRANSPORT_LIT ? 1 : 2;
        if (t->known[u] == TRANSPORT_UNKNOWN)
            o->first[u] = ask_unit(t, u, &o->sides[u]);
    }
}

/* If the first directions of a unit and of its eight neighbours all have the same visibility for all lanes, the unit's
 * other directions are assumed to have it, too. */
static const uint32_t *known_of(const struct tracer *t, const struct outlook *o, uint32_t k)
{
    static const uint32_t all = UINT32_MAX, none = 0;
    const uint32_t u = k / TRANSPORT_UNIT;

    if (!t->world->directions->units)
        return NULL;
    if (t->known[u] != TRANSPORT_UNKNOWN)
        return t->known[u] == TRANSPORT_LIT ? &all : &none;
    if (k % TRANSPORT_UNIT == 0)
        return &o->first[u];
    const uint8_t sides = sides_around(t->world->directions, o->sides, u);
    return sides == 1 ? &all : sides == 2 ? &none : NULL;
}

static void trace_cells(struct tracer *t, struct transport_matrix *out, uint32_t first, struct transport_sight *sight)
{
    const struct transport_directions *dirs = t->world->directions;
    const float lobes = t->rows > 1 ? (float)t->world->lobe_samples : 0.0f;
    const float part = 1.0f / (float)dirs->group;
    struct outlook outlook;

    look_out(t, &outlook);
    for (uint32_t cell = 0, k = 0; cell < SKY_CELLS; cell += dirs->group) {
        struct lanes sum[TRANSPORT_ROWS] = { { { 0 } } };
        t->seen = t->hidden = false;
        for (const uint32_t end = k + dirs->per_group; k < end; k++) {
            const float weight = dirs->weight[k];
            struct lanes d[3], row[TRANSPORT_ROWS], pdf;
            set_direction(t, k, d);
            if (!see_rows(t, RAYS_TOGETHER, d, known_of(t, &outlook, k), row, &pdf))
                continue;
            LANES(l)
            {
                const float w = balanced(weight, lobes, pdf.v[l]);
                sum[0].v[l] += weight * row[0].v[l];
                sum[1].v[l] += w * row[1].v[l];
                sum[2].v[l] += w * row[2].v[l];
            }
        }
        for (uint32_t c = cell; c < cell + dirs->group; c++) {
            sight->seen[c / 64] |= (uint64_t)t->seen << c % 64;
            sight->hidden[c / 64] |= (uint64_t)t->hidden << c % 64;
        }
        for (uint32_t r = 0; r < t->rows; r++) {
            LANES(l) sum[r].v[l] *= part;
            for (uint32_t c = cell; c < cell + dirs->group; c++)
                memcpy(&out[r].at[c][first], sum[r].v, sizeof(sum[r]));
        }
    }
}

/* The lobe's own samples, with the same random numbers for all points, so that neighbours are similar and compress
 * well.
 */
static void trace_lobes(struct tracer *t, struct transport_matrix *out, uint32_t first)
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
            for (uint32_t r = 1; r < t->rows; r++)
                out[r].at[cell][first + l] += row[r].v[l] / density;
        }
    }
}

static inline uint64_t trace(const struct transport_world *w, const struct shade_packet *p, uint32_t rows,
                             const uint8_t known[SKY_CELLS], struct transport_matrix *out, uint32_t first,
                             struct transport_sight *sight)
{
    struct tracer t = { .world = w, .points = p, .rows = rows, .known = known };

    set_up_tracer(&t);
    trace_cells(&t, out, first, sight);
    if (rows > 1)
        trace_lobes(&t, out, first);
    return t.traced;
}

static inline uint64_t aim(const struct transport_world *w, const struct shade_packet *p, struct transport_gaze *out)
{
    struct tracer t = { .world = w, .points = p, .rows = TRANSPORT_ROWS };

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
            const float scale = density > 0.0f ? 1.0f / density : 0.0f;
            out->x[l] = d[0].v[l];
            out->y[l] = d[1].v[l];
            out->z[l] = d[2].v[l];
            out->by_specular[l] = scale > 0.0f ? scale * row[1].v[l] : 0.0f;
            out->by_one[l] = scale > 0.0f ? scale * row[2].v[l] : 0.0f;
            out->density[l] = density;
        }
    }
    return t.traced;
}
