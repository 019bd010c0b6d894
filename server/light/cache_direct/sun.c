/* Chooses the rays to the sun of a frame's sky. Few rays suffice for points that see all or none of it, which
 * includes most points near a shadow's border. */
#include "light/cache_direct/internal.h"

#include "base/mem.h"
#include "base/rng.h"
#include "sky/tables/cube.h"

#include <math.h>
#include <string.h>

static enum err reserve_sun(struct transport *t, uint32_t strata)
{
    const uint32_t count = strata * TRANSPORT_VARIANTS;

    if (count > t->sun_capacity) {
        mem_free(t->sun_values);
        t->sun_capacity = 0;
        t->sun_values = mem_alloc(count, 7 * sizeof(float));
        if (!t->sun_values)
            return ERR_NOMEM;
        t->sun_capacity = count;
    }
    float *at = t->sun_values;
    float **arrays[7] = { &t->sun.x, &t->sun.y, &t->sun.z,      &t->sun.r,
                          &t->sun.g, &t->sun.b, &t->sun.density };
    for (int k = 0; k < 7; k++, at += t->sun_capacity)
        *arrays[k] = at;
    return ERR_OK;
}

/* Marks the cells that contain texels of the sun. */
static void find_cells(struct transport_sun *b, const struct sky_split *s)
{
    const uint32_t n = s->n, edge = SKY_EDGE;

    memset(b->cells, 0, sizeof(b->cells));
    for (uint32_t k = 0; k < s->sun_count; k++) {
        const uint32_t face = s->sun[k] / (n * n), y = s->sun[k] / n % n, x = s->sun[k] % n;
        /* a texel may lie in several cells */
        for (uint32_t i = y * edge / n; i * n < (y + 1) * edge; i++)
            for (uint32_t j = x * edge / n; j * n < (x + 1) * edge; j++) {
                const uint32_t cell = sky_cell(face, i, j);
                b->cells[cell / 64] |= (uint64_t)1 << cell % 64;
            }
    }
}

#define CONE_COSINE 0.9f /* of the widest cone */
#define CONE_EDGE 64     /* texels along a face from which on one direction stands for a texel */
#define CONE_TEXELS 4096 /* at most, so that finding the cone takes no time */

static void texel_direction(const struct sky_split *s, uint32_t at, double w[3])
{
    const double n = s->n;

    cube_direction(at / (s->n * s->n), -1.0 + (2.0 * (at % s->n) + 1.0) / n,
                   -1.0 + (2.0 * (at / s->n % s->n) + 1.0) / n, w);
    const double length = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    for (int i = 0; i < 3; i++)
        w[i] /= length;
}

/* Finds the cone about the sun, and its light. */
static void find_cone(struct transport_sun *b, const struct sky_split *s, const struct environment *e)
{
    double flux[3][3] = { { 0.0 } }, axis[3], least = 1.0, length = 0.0;

    b->cosine = -2.0f;
    b->sine = 2.0f;
    if (s->n < CONE_EDGE || s->sun_count > CONE_TEXELS)
        return;
    for (uint32_t k = 0; k < s->sun_count; k++) {
        const struct texel *t = &e->texels[s->sun[k]];
        const float g = rgb_luminance(t->r, t->g, t->b);
        const double part = (1.0 - (double)sky_lower(s->level, g)) * e->solid_angle[s->sun[k] % (s->n * s->n)];
        double w[3];
        texel_direction(s, s->sun[k], w);
        for (int i = 0; i < 3; i++) {
            flux[0][i] += part * (double)t->r * w[i];
            flux[1][i] += part * (double)t->g * w[i];
            flux[2][i] += part * (double)t->b * w[i];
        }
    }
    for (int i = 0; i < 3; i++) {
        axis[i] = flux[0][i] + flux[1][i] + flux[2][i];
        length += axis[i] * axis[i];
    }
    for (uint32_t k = 0; k < s->sun_count; k++) {
        double w[3];
        texel_direction(s, s->sun[k], w);
        least = fmin(least, (axis[0] * w[0] + axis[1] * w[1] + axis[2] * w[2]) / sqrt(length));
    }
    const double radius = acos(fmax(least, -1.0)) + sqrt(2.0) / s->n + 1e-4; /* to the corners of a texel */
    if (!(cos(radius) > (double)CONE_COSINE))
        return;
    b->cosine = (float)cos(radius);
    b->sine = (float)sin(radius);
    for (int i = 0; i < 3; i++) {
        b->axis[i] = (float)(axis[i] / sqrt(length));
        for (int c = 0; c < 3; c++)
            b->flux[c][i] = (float)flux[c][i];
    }
}

/* Each variant is one point of a sequence, shifted from stratum to stratum in the second number. */
enum err transport_sun_draw(struct transport *t, const struct environment *e, const struct transport_frame *f)
{
    struct transport_sun *b = &t->sun;
    const uint64_t seed = rng_mix(rng_mix(f->seed, f->pass), 0x62726967);

    b->strata = 0;
    b->few = (f->samples + 31) / 32;
    b->seed = seed;
    if (t->sky.sun_count == 0)
        return ERR_OK;
    if (reserve_sun(t, TRANSPORT_MORE * b->few))
        return ERR_NOMEM;
    b->strata = TRANSPORT_MORE * b->few;
    find_cells(b, &t->sky);
    find_cone(b, &t->sky, e);
#pragma omp parallel for schedule(dynamic, 16)
    for (uint32_t v = 0; v < TRANSPORT_VARIANTS; v++) {
        double x[2];
        rng_sobol2(seed, v, x);
        for (uint32_t s = 0; s < b->strata; s++) {
            const double turned = x[1] + 0.6180339887498949 * s;
            const double own[2] = { (s + x[0]) / b->strata, turned - floor(turned) };
            const uint32_t at = s * TRANSPORT_VARIANTS + v;
            float w[3], rgb[3];
            sky_split_sample(&t->sky, e, own, w, rgb);
            b->x[at] = w[0];
            b->y[at] = w[1];
            b->z[at] = w[2];
            b->r[at] = rgb[0];
            b->g[at] = rgb[1];
            b->b[at] = rgb[2];
            b->density[at] = (float)b->few * sky_split_density(&t->sky, e, w);
        }
    }
    return ERR_OK;
}

/* The 16 points of a packet get 16 consecutive variants, which are well distributed. */
static void choose_variants(const struct transport_sun *b, uint32_t index, uint32_t variant[PACKET])
{
    const uint32_t base = (uint32_t)(rng_mix(b->seed, index) % (TRANSPORT_VARIANTS / PACKET)) * PACKET;

    for (uint32_t l = 0; l < PACKET; l++)
        variant[l] = base + l;
}

#define DAPPLED 4      /* points of a packet in penumbrae, from which on all its points count as such */
#define DAPPLED_PART 3 /* or one in so many of a block's points near a border, for the whole block */
#define CROWDED 14     /* points of a packet that need a round, from which on all get it */

/* Visibility of the sun from a block. */
enum side { SIDE_LIT, SIDE_DARK, SIDE_UNKNOWN };

/* If the cells of the sun are completely visible, or completely occluded, from all of a block's points, sixteen
 * rays to the sun itself must confirm it. */
static enum side side_of(const struct transport *t, const struct transport_block *b, uint64_t *rays)
{
    const struct transport_sun *s = &t->sun;
    struct transport_view view = { 0, 0 };
    uint64_t seen = 0, hidden = 0;
    uint32_t variant[PACKET];

    if (!t->rays)
        return SIDE_LIT;
    for (uint32_t k = 0; k < SKY_CELLS / 64; k++) {
        seen |= b->sight->seen[k] & s->cells[k];
        hidden |= b->sight->hidden[k] & s->cells[k];
    }
    if (seen && hidden)
        return SIDE_UNKNOWN;
    choose_variants(s, b->first, variant);
    *rays += t->kernels->sun->probe(t->rays, s, &t->gbuffer->packets[b->first], b->packets, variant, &view);
    if (seen && !view.dark)
        return SIDE_LIT;
    return !view.lit && !seen ? SIDE_DARK : SIDE_UNKNOWN;
}

/* A block while its rays are traced. */
struct shining {
    const struct transport *transport;
    const struct transport_block *block;
    const struct shade_packet *packets;
    uint64_t traced;
    uint32_t variant[TRANSPORT_PACKETS][PACKET];
    float sum[TRANSPORT_PACKETS][3][PACKET];
    uint32_t taken[TRANSPORT_PACKETS][PACKET]; /* number of samples */
    struct transport_view view[TRANSPORT_PACKETS];
};

static uint32_t samples_of(const struct transport_round *r)
{
    return (r->groups[1] - r->groups[0]) * (r->turns[1] - r->turns[0]);
}

/* Traces a round of samples for packet k. rays: NULL if it is known to see everything. */
static void shine(struct shining *s, const struct rays *rays, uint32_t k, const struct transport_round *r)
{
    const struct transport *t = s->transport;

    s->traced += t->kernels->sun->light(rays, &t->sun, &s->packets[k], s->block->narrow, s->variant[k], r,
                                           s->sum[k], &s->view[k]);
    for (uint32_t l = 0; l < PACKET; l++)
        s->taken[k][l] += samples_of(r);
}

/* A packet that sees everything: matte ones in closed form, others by a round of samples. */
static void shine_openly(struct shining *s, uint32_t k, const struct transport_round *r)
{
    const struct transport *t = s->transport;

    if (s->block->kind != LOBE_LAMBERT || !t->kernels->sun->open(&t->sun, &s->packets[k], s->sum[k])) {
        shine(s, NULL, k, r);
        return;
    }
    for (uint32_t l = 0; l < PACKET; l++)
        s->taken[k][l] = 1;
}

/* Points of several packets, collected in one. */
struct crowd {
    struct shade_packet points;
    uint32_t variant[PACKET], packet[PACKET], lane[PACKET];
};

static void shine_on_crowd(struct shining *s, struct crowd *c, const struct transport_round *r)
{
    const struct transport *t = s->transport;
    float sum[3][PACKET] = { { 0.0f } };
    struct transport_view view = { 0, 0 };

    if (c->points.count == 0)
        return;
    const uint32_t last = c->points.count - 1;
    for (uint32_t l = c->points.count; l < PACKET; l++) {
        shade_packet_put(&c->points, l, &s->packets[c->packet[last]], c->lane[last], 0);
        c->variant[l] = c->variant[last];
    }
    s->traced +=
        t->kernels->sun->light(t->rays, &t->sun, &c->points, s->block->narrow, c->variant, r, sum, &view);
    for (uint32_t i = 0; i < c->points.count; i++) {
        const uint32_t k = c->packet[i], l = c->lane[i];
        for (int q = 0; q < 3; q++)
            s->sum[k][q][l] += sum[q][i];
        s->taken[k][l] += samples_of(r);
        s->view[k].lit |= (view.lit >> i & 1u) << l;
        s->view[k].dark |= (view.dark >> i & 1u) << l;
    }
    c->points.count = 0;
}

/* The points that need all samples: those with both visible and occluded samples. At a plain shadow border the others
 * are on one side of it. If there are many in a packet, or among the block's points near a border, as under leaves, the
 * others are in penumbrae, too, and their few rays agreed by chance; omitting them would make dappled shade too
 * dark. */
static void find_needy(const struct shining *s, const uint32_t near[TRANSPORT_PACKETS],
                       uint32_t needy[TRANSPORT_PACKETS])
{
    uint32_t all = 0, some = 0;

    for (uint32_t k = 0; k < s->block->packets; k++) {
        needy[k] = s->view[k].lit & s->view[k].dark;
        some += (uint32_t)__builtin_popcount(needy[k]);
        all += (uint32_t)__builtin_popcount(near[k]);
    }
    for (uint32_t k = 0; k < s->block->packets; k++)
        if (__builtin_popcount(needy[k]) >= DAPPLED || some * DAPPLED_PART >= all)
            needy[k] = s->view[k].lit | s->view[k].dark;
}

/* Traces a round for some points of the block, sixteen at a time, across packets. If most points of a packet need the
 * round, the whole packet is traced: its other points get these samples, too, unless `had` marks points that got them
 * before. */
static void shine_on_some(struct shining *s, const uint32_t lanes[TRANSPORT_PACKETS],
                          const uint32_t had[TRANSPORT_PACKETS], const struct transport_round *r)
{
    struct crowd c = { .points = { .kind = s->packets[0].kind } };

    if (samples_of(r) == 0)
        return;
    for (uint32_t k = 0; k < s->block->packets; k++) {
        const bool most = !(had && had[k]) && __builtin_popcount(lanes[k]) >= CROWDED;
        if (most)
            shine(s, s->transport->rays, k, r);
        for (uint32_t left = most ? 0 : lanes[k]; left; left &= left - 1) {
            const uint32_t l = (uint32_t)__builtin_ctz(left), i = c.points.count++;
            shade_packet_put(&c.points, i, &s->packets[k], l, -1);
            c.variant[i] = s->variant[k][l];
            c.packet[i] = k;
            c.lane[i] = l;
            if (c.points.count == PACKET)
                shine_on_crowd(s, &c, r);
        }
    }
    shine_on_crowd(s, &c, r);
}

/* Traces the first half of the strata without those of the first round. */
static void shine_more(struct shining *s, const uint32_t lanes[TRANSPORT_PACKETS],
                       const uint32_t had[TRANSPORT_PACKETS], uint32_t half, uint32_t few)
{
    const struct transport_round second = { { half, few }, { 0, 1 } }, third = { { 0, few }, { 1, 2 } };

    shine_on_some(s, lanes, had, &second);
    shine_on_some(s, lanes, had, &third);
}

/* Traces half of the first rays. If the block's points differ, those near the edge of a shadow get half of the strata,
 * and those of them that need it get all strata. Packets without either that see the sun see all of it. Returns
 * the number of packets with points near an edge. */
static uint32_t find_shadows(struct shining *s, uint32_t few)
{
    const struct transport *t = s->transport;
    const uint32_t half = (few + 1) / 2, packets = s->block->packets;
    const struct transport_round first = { { 0, half }, { 0, 1 } }, second = { { half, few }, { 0, 1 } },
                                 rest = { { 0, few }, { 2, TRANSPORT_MORE } };
    struct transport_view all = { 0, 0 };
    uint32_t near[TRANSPORT_PACKETS] = { 0 }, needy[TRANSPORT_PACKETS] = { 0 }, late[TRANSPORT_PACKETS], mixed = 0;

    for (uint32_t k = 0; k < packets; k++) {
        shine(s, t->rays, k, &first);
        all.lit |= s->view[k].lit;
        all.dark |= s->view[k].dark;
    }
    if (all.lit && all.dark) {
        t->kernels->sun->edges(s->packets, packets, s->view, near);
        shine_more(s, near, NULL, half, few);
    }
    for (uint32_t k = 0; k < packets; k++)
        mixed += near[k] != 0;
    if (mixed > 0) {
        find_needy(s, near, needy);
        for (uint32_t k = 0; k < packets; k++)
            late[k] = needy[k] & ~near[k];
        shine_more(s, late, near, half, few);
        shine_on_some(s, needy, NULL, &rest);
    }
    for (uint32_t k = 0; k < packets; k++)
        if (!near[k] && !needy[k] && s->view[k].lit && !s->view[k].dark)
            shine_openly(s, k, &second);
    return mixed;
}

uint32_t transport_sun_add(const struct transport *t, const struct transport_block *b, float *lo, uint64_t *rays)
{
    const struct transport_round few = { { 0, t->sun.few }, { 0, 1 } };
    const enum side side = side_of(t, b, rays);
    struct shining s = { t, b, &t->gbuffer->packets[b->first], .traced = 0 };
    uint32_t mixed = 0;

    if (side == SIDE_DARK)
        return 0;
    for (uint32_t k = 0; k < b->packets; k++)
        choose_variants(&t->sun, b->first + k, s.variant[k]);
    for (uint32_t k = 0; side == SIDE_LIT && k < b->packets; k++)
        shine_openly(&s, k, &few);
    if (side == SIDE_UNKNOWN)
        mixed = find_shadows(&s, t->sun.few);
    for (uint32_t k = 0; k < b->packets; k++)
        for (int c = 0; c < 3; c++)
            for (uint32_t l = 0; l < PACKET; l++)
                lo[(k * 3 + (uint32_t)c) * PACKET + l] += s.sum[k][c][l] / (float)s.taken[k][l];
    *rays += s.traced;
    return mixed;
}
