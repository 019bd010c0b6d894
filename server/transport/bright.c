/* Chooses the rays to the bright part of a frame's sky. Few rays suffice for points that see all of it or nothing, and
 * most points do, even near the border of a shadow. */
#include "transport/parts.h"

#include "base/mem.h"
#include "base/rng.h"

#include <math.h>
#include <string.h>

static enum err reserve_bright(struct transport *t, uint32_t strata)
{
    const uint32_t count = strata * TRANSPORT_VARIANTS;

    if (count > t->bright_capacity) {
        mem_free(t->bright_values);
        t->bright_capacity = 0;
        t->bright_values = mem_alloc(count, 7 * sizeof(float));
        if (!t->bright_values)
            return ERR_NOMEM;
        t->bright_capacity = count;
    }
    float *at = t->bright_values;
    float **arrays[7] = { &t->bright.x, &t->bright.y, &t->bright.z,      &t->bright.r,
                          &t->bright.g, &t->bright.b, &t->bright.density };
    for (int k = 0; k < 7; k++, at += t->bright_capacity)
        *arrays[k] = at;
    return ERR_OK;
}

/* Marks the cells that contain texels of the bright part. */
static void find_cells(struct transport_bright *b, const struct sky_split *s)
{
    const uint32_t n = s->n, edge = SKY_EDGE;

    memset(b->cells, 0, sizeof(b->cells));
    for (uint32_t k = 0; k < s->bright_count; k++) {
        const uint32_t face = s->bright[k] / (n * n), y = s->bright[k] / n % n, x = s->bright[k] % n;
        /* a texel may lie in several cells */
        for (uint32_t i = y * edge / n; i * n < (y + 1) * edge; i++)
            for (uint32_t j = x * edge / n; j * n < (x + 1) * edge; j++) {
                const uint32_t cell = sky_cell(face, i, j);
                b->cells[cell / 64] |= (uint64_t)1 << cell % 64;
            }
    }
}

/* Each variant is one point of a sequence, shifted from stratum to stratum in the second number. */
enum err transport_bright_draw(struct transport *t, const struct environment *e, const struct transport_frame *f)
{
    struct transport_bright *b = &t->bright;
    const uint64_t seed = rng_mix(rng_mix(f->seed, f->pass), 0x62726967);

    b->strata = 0;
    b->few = (f->samples + 31) / 32;
    b->seed = seed;
    if (t->sky.bright_count == 0)
        return ERR_OK;
    if (reserve_bright(t, TRANSPORT_MORE * b->few))
        return ERR_NOMEM;
    b->strata = TRANSPORT_MORE * b->few;
    find_cells(b, &t->sky);
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
static void choose_variants(const struct transport_bright *b, uint32_t index, uint32_t variant[PACKET])
{
    const uint32_t base = (uint32_t)(rng_mix(b->seed, index) % (TRANSPORT_VARIANTS / PACKET)) * PACKET;

    for (uint32_t l = 0; l < PACKET; l++)
        variant[l] = base + l;
}

#define DAPPLED 4 /* points of a packet in penumbrae, from which on all its points count as such */

/* Visibility of the bright part from a block. */
enum side { SIDE_LIT, SIDE_DARK, SIDE_UNKNOWN };

/* If the cells of the bright part are completely visible, or completely occluded, from all of a block's points, sixteen
 * rays to the bright part itself must confirm it. */
static enum side side_of(const struct transport *t, const struct transport_block *b, uint64_t *rays)
{
    const struct transport_bright *s = &t->bright;
    struct transport_view view = { 0, 0 };
    uint64_t seen = 0, hidden = 0;
    uint32_t variant[PACKET];

    if (!t->rays)
        return SIDE_LIT;
    for (uint32_t k = 0; k < SKY_CELLS / 64; k++) {
        seen |= b->sight.seen[k] & s->cells[k];
        hidden |= b->sight.hidden[k] & s->cells[k];
    }
    if (seen && hidden)
        return SIDE_UNKNOWN;
    choose_variants(s, b->first, variant);
    *rays += t->kernels->bright->probe(t->rays, s, &t->gbuffer->packets[b->first], b->packets, variant, &view);
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

    s->traced += t->kernels->bright->light(rays, &t->bright, &s->packets[k], s->block->narrow, s->variant[k], r,
                                           s->sum[k], &s->view[k]);
    for (uint32_t l = 0; l < PACKET; l++)
        s->taken[k][l] += samples_of(r);
}

static bool is_mixed(const struct transport_view *v)
{
    return v->lit && v->dark;
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
        t->kernels->bright->light(t->rays, &t->bright, &c->points, s->block->narrow, c->variant, r, sum, &view);
    for (uint32_t i = 0; i < c->points.count; i++) {
        const uint32_t k = c->packet[i], l = c->lane[i];
        for (int q = 0; q < 3; q++)
            s->sum[k][q][l] += sum[q][i];
        s->taken[k][l] += samples_of(r);
    }
    c->points.count = 0;
}

/* The points of a packet that need all samples: those with both visible and occluded samples. At a plain shadow border
 * the others are on one side of it. If there are many, as under leaves, the others are penumbrae too, whose few rays
 * agreed by chance; leaving them out would make dappled shade too dark. */
static uint32_t needy(const struct shining *s, uint32_t k)
{
    const uint32_t both = s->view[k].lit & s->view[k].dark;

    return __builtin_popcount(both) < DAPPLED ? both : s->view[k].lit | s->view[k].dark;
}

/* Traces a round for those points, sixteen at a time, across packets. */
static void shine_on_mixed(struct shining *s, const struct transport_round *r)
{
    struct crowd c = { .points = { .kind = s->packets[0].kind } };

    for (uint32_t k = 0; k < s->block->packets; k++)
        for (uint32_t both = needy(s, k), l = 0; both >> l; l++) {
            if (!(both >> l & 1u))
                continue;
            const uint32_t i = c.points.count++;
            shade_packet_put(&c.points, i, &s->packets[k], l, -1);
            c.variant[i] = s->variant[k][l];
            c.packet[i] = k;
            c.lane[i] = l;
            if (c.points.count == PACKET)
                shine_on_crowd(s, &c, r);
        }
    shine_on_crowd(s, &c, r);
}

/* Traces half of the first rays; if the block's points differ, the other half; if a packet's points differ, as many
 * again; then the rest of the strata for each point whose own samples differ, or for all if there are many of these.
 * Returns the number of packets whose points differ. */
static uint32_t find_shadows(struct shining *s, uint32_t few)
{
    const struct rays *rays = s->transport->rays;
    const uint32_t half = (few + 1) / 2, packets = s->block->packets;
    const struct transport_round first = { { 0, half }, { 0, 1 } }, second = { { half, few }, { 0, 1 } },
                                 third = { { 0, few }, { 1, 2 } }, rest = { { 0, few }, { 2, TRANSPORT_MORE } };
    struct transport_view all = { 0, 0 };
    uint32_t mixed = 0;

    for (uint32_t k = 0; k < packets; k++) {
        shine(s, rays, k, &first);
        all.lit |= s->view[k].lit;
        all.dark |= s->view[k].dark;
    }
    for (uint32_t k = 0; k < packets; k++) {
        if (half < few && all.lit)
            shine(s, all.dark ? rays : NULL, k, &second);
        if (!is_mixed(&s->view[k]))
            continue;
        shine(s, rays, k, &third);
        mixed++;
    }
    if (mixed > 0)
        shine_on_mixed(s, &rest);
    return mixed;
}

uint32_t transport_bright_add(const struct transport *t, const struct transport_block *b, float *lo, uint64_t *rays)
{
    const struct transport_round few = { { 0, t->bright.few }, { 0, 1 } };
    const enum side side = side_of(t, b, rays);
    struct shining s = { t, b, &t->gbuffer->packets[b->first], .traced = 0 };
    uint32_t mixed = 0;

    if (side == SIDE_DARK)
        return 0;
    for (uint32_t k = 0; k < b->packets; k++)
        choose_variants(&t->bright, b->first + k, s.variant[k]);
    for (uint32_t k = 0; side == SIDE_LIT && k < b->packets; k++)
        shine(&s, NULL, k, &few);
    if (side == SIDE_UNKNOWN)
        mixed = find_shadows(&s, t->bright.few);
    for (uint32_t k = 0; k < b->packets; k++)
        for (int c = 0; c < 3; c++)
            for (uint32_t l = 0; l < PACKET; l++)
                lo[(k * 3 + (uint32_t)c) * PACKET + l] += s.sum[k][c][l] / (float)s.taken[k][l];
    *rays += s.traced;
    return mixed;
}
