#include "transport.h"

#include "denormals.h"
#include "mem.h"
#include "rng.h"
#include "transport_past.h"

#include <assert.h>
#include <math.h>
#include <string.h>

void transport_destroy(struct transport *t)
{
    if (!t)
        return;
    for (uint32_t k = 0; t->blocks && k < t->block_count; k++) {
        for (uint32_t r = 0; t->halves && r < TRANSPORT_ROWS; r++)
            t->blocks[k].pieces[r].halves = NULL; /* which are not its own */
        transport_block_finish(&t->blocks[k]);
    }
    mem_free(t->halves);
    mem_free(t->blocks);
    mem_free(t->fades);
    mem_free(t->unbuilt_index);
    mem_free(t->narrow_index);
    mem_free(t->bright_values);
    transport_past_finish(&t->past);
    transport_sky_finish(&t->sky);
    mem_free(t);
}

uint64_t transport_steps(const struct gbuffer *g)
{
    return g->packet_count;
}

/* Halves that a piece takes among others, in whole cache lines. */
static size_t place_of(const struct transport_piece *q, const struct transport_block *b)
{
    const size_t line = MEM_ALIGN / sizeof(uint16_t);
    const size_t halves = (size_t)transport_piece_bytes(q, b->packets * PACKET) / sizeof(uint16_t);

    return (halves + line - 1) / line * line;
}

/* Blocks are built in no order, by several threads. A frame that reads them one after the other takes two thirds of the
 * time. */
void transport_gather(struct transport *t)
{
    size_t count = 0;

    if (t->fades || t->halves)
        return;
    for (uint32_t k = 0; k < t->block_count; k++)
        for (uint32_t r = 0; r < t->blocks[k].rows; r++)
            count += place_of(&t->blocks[k].pieces[r], &t->blocks[k]);
    t->halves = mem_alloc_raw(count, sizeof(*t->halves));
    if (!t->halves)
        return;
    uint16_t *to = t->halves;
    for (uint32_t k = 0; k < t->block_count; k++)
        for (uint32_t r = 0; r < t->blocks[k].rows; r++) {
            struct transport_piece *q = &t->blocks[k].pieces[r];
            if (!q->halves)
                continue;
            memcpy(to, q->halves, (size_t)transport_piece_bytes(q, t->blocks[k].packets * PACKET));
            mem_free(q->halves);
            q->halves = to;
            to += place_of(q, &t->blocks[k]);
        }
}

const struct transport_stats *transport_stats(const struct transport *t)
{
    return &t->stats;
}

const struct packet_list *transport_unbuilt(const struct transport *t)
{
    return &t->unbuilt;
}

const char *transport_what_name(enum transport_what what)
{
    static const char *const names[] = { "all", "cells", "gain", "equal" };
    return names[what];
}

/* ---- A frame ---- */

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

/* The cells in which texels of the bright part lie. */
static void find_cells(struct transport_bright *b, const struct transport_sky *s)
{
    const uint32_t n = s->n, edge = TRANSPORT_EDGE;

    memset(b->cells, 0, sizeof(b->cells));
    for (uint32_t k = 0; k < s->bright_count; k++) {
        const uint32_t face = s->bright[k] / (n * n), y = s->bright[k] / n % n, x = s->bright[k] % n;
        /* a texel that cells' borders run through lies in each */
        for (uint32_t i = y * edge / n; i * n < (y + 1) * edge; i++)
            for (uint32_t j = x * edge / n; j * n < (x + 1) * edge; j++) {
                const uint32_t cell = transport_cell(face, i, j);
                b->cells[cell / 64] |= (uint64_t)1 << cell % 64;
            }
    }
}

/* The samples of the bright part. Variant by variant they are one sequence, moved along from stratum to stratum in the
 * second number. */
static enum err draw_bright(struct transport *t, const struct environment *e, const struct transport_frame *f)
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
#pragma omp parallel for schedule(static)
    for (uint32_t v = 0; v < TRANSPORT_VARIANTS; v++) {
        double x[2];
        rng_sobol2(seed, v, x);
        for (uint32_t s = 0; s < b->strata; s++) {
            const double turned = x[1] + 0.6180339887498949 * s;
            const double own[2] = { (s + x[0]) / b->strata, turned - floor(turned) };
            const uint32_t at = s * TRANSPORT_VARIANTS + v;
            float w[3], rgb[3];
            transport_sky_sample(&t->sky, e, own, w, rgb);
            b->x[at] = w[0];
            b->y[at] = w[1];
            b->z[at] = w[2];
            b->r[at] = rgb[0];
            b->g[at] = rgb[1];
            b->b[at] = rgb[2];
            b->density[at] = (float)b->few * transport_sky_density(&t->sky, e, w);
        }
    }
    return ERR_OK;
}

/* What a block is to the bright part. */
enum side { SIDE_LIT, SIDE_DARK, SIDE_UNKNOWN };

/* Where all of a block's points have seen the cells of the bright part by all of their directions, or by none, sixteen
 * rays to the part itself are to say the same. */
static enum side side_of(const struct transport *t, const struct transport_block *b, uint64_t *rays)
{
    const struct transport_bright *s = &t->bright;
    struct transport_view view = { false, false };
    uint64_t seen = 0, hidden = 0;

    if (!t->rays)
        return SIDE_LIT;
    for (uint32_t k = 0; k < TRANSPORT_CELLS / 64; k++) {
        seen |= b->sight.seen[k] & s->cells[k];
        hidden |= b->sight.hidden[k] & s->cells[k];
    }
    if (seen && hidden)
        return SIDE_UNKNOWN;
    *rays += t->kernels->probe(t->rays, s, &t->gbuffer->packets[b->first], b->packets, b->first, &view);
    if (seen && !view.dark)
        return SIDE_LIT;
    return !view.lit && !seen ? SIDE_DARK : SIDE_UNKNOWN;
}

/* The bright part. Where the points of a packet agree on whether they see it, few rays tell; where not, the rest of the
 * strata are traced too. Returns how many packets that were. */
static uint32_t add_bright(const struct transport *t, const struct transport_block *b, float *lo, uint64_t *rays)
{
    const struct transport_bright *s = &t->bright;
    const enum side side = side_of(t, b, rays);
    uint32_t penumbra = 0;

    for (uint32_t k = 0; side != SIDE_DARK && k < b->packets; k++) {
        const struct shade_packet *p = &t->gbuffer->packets[b->first + k];
        const struct rays *to_trace = side == SIDE_LIT ? NULL : t->rays;
        float sum[3][PACKET] = { { 0.0f } };
        struct transport_view view = { false, false };
        *rays += t->kernels->bright(to_trace, s, p, b->narrow, b->first + k, 0, sum, &view);
        const bool mixed = view.lit && view.dark;
        if (mixed)
            *rays += t->kernels->bright(to_trace, s, p, b->narrow, b->first + k, 1, sum, &view);
        const float scale = 1.0f / (float)(mixed ? s->strata : s->few);
        for (int c = 0; c < 3; c++)
            for (uint32_t l = 0; l < PACKET; l++)
                lo[(k * 3 + (uint32_t)c) * PACKET + l] += scale * sum[c][l];
        penumbra += mixed;
    }
    return penumbra;
}

/* What traces and looks, apart from the cells. Returns packets in a penumbra. */
static uint32_t add_rest(const struct transport *t, const struct transport_look *look, const struct transport_block *b,
                         float *lo, uint64_t *rays)
{
    for (uint32_t k = 0; b->narrow && k < b->packets; k++)
        t->kernels->gaze(look, &t->gbuffer->packets[b->first + k], b->gazes + (size_t)k * TRANSPORT_GAZES,
                         lo + (size_t)k * 3 * PACKET);
    return t->bright.strata ? add_bright(t, b, lo, rays) : 0;
}

static void clear_padding(const struct transport *t, const struct transport_block *b, float *lo)
{
    for (uint32_t k = 0; k < b->packets; k++)
        for (uint32_t l = t->gbuffer->packets[b->first + k].count; l < PACKET; l++)
            for (uint32_t c = 0; c < 3; c++)
                lo[(k * 3 + c) * PACKET + l] = 0.0f;
}

static void mix(const struct transport_block *b, const float *old, float weight, float *lo)
{
    for (size_t i = 0; i < (size_t)b->packets * 3 * PACKET; i++)
        lo[i] = old[i] + weight * (lo[i] - old[i]);
}

/* A block that takes over bit by bit, from its former self or from what stands in lo. */
static uint32_t shade_fading(const struct transport *t, const struct transport_look *look, uint32_t k, float *lo,
                             uint64_t *rays)
{
    const struct transport_block *b = &t->blocks[k];
    const struct transport_fade *f = &t->fades[k];
    const struct shade_packet *packets = &t->gbuffer->packets[b->first];
    const float weight = (float)f->weight / TRANSPORT_FADE;
    _Alignas(64) float old[TRANSPORT_PACKETS * 3 * PACKET];

    if (f->weight == 0)
        return 0;
    if (f->from_cells)
        t->kernels->cells(&f->old, packets, &t->sky, old);
    else
        memcpy(old, lo, (size_t)b->packets * 3 * PACKET * sizeof(float));
    t->kernels->cells(b, packets, &t->sky, lo);
    if (f->from_cells)
        mix(b, old, weight, lo);
    const uint32_t penumbra = add_rest(t, look, b, lo, rays);
    clear_padding(t, b, lo);
    if (!f->from_cells)
        mix(b, old, weight, lo);
    return penumbra;
}

static void scale_block(const struct transport_block *b, float gain, float *lo)
{
    for (size_t i = 0; i < (size_t)b->packets * 3 * PACKET; i++)
        lo[i] *= gain;
}

/* The frame's sky, and what has changed in it. */
static enum err take_sky(struct transport *t, const struct environment *e, const struct transport_frame *frame,
                         const float *lo, struct transport_change *change)
{
    const bool valid = t->past.lo == lo && frame->keep && !t->fades;

    assert(frame->samples >= 1);
    t->past.lo = NULL; /* until this one is there */
    transport_past_begin(t);
    t->sky.unsplit = frame->unsplit;
    enum err result = transport_sky_take(&t->sky, e);
    if (!result)
        result = draw_bright(t, e, frame);
    if (!result)
        transport_past_compare(t, e, valid, change);
    return result;
}

static bool is_cancelled(const struct transport_frame *frame)
{
    return frame->cancel && atomic_load_explicit(frame->cancel, memory_order_relaxed);
}

enum err transport_shade(struct transport *t, const struct environment *e, const struct transport_frame *frame,
                         float *lo, struct transport_frame_stats *stats)
{
    struct transport_change change;
    uint64_t rays = 0;
    uint32_t penumbra = 0, kept = 0;

    *stats = (struct transport_frame_stats){ 0 };
    const enum err result = take_sky(t, e, frame, lo, &change);
    if (result)
        return result;
    const struct transport_look look = {
        .environment = e,
        .level = t->sky.level,
        .per_energy = t->bright.strata ? 0.25 * t->bright.few * e->n * e->n / t->sky.bright_energy : 0.0,
    };
#pragma omp parallel reduction(+ : rays, penumbra, kept)
    {
        const unsigned before = denormals_flush();
#pragma omp for schedule(dynamic, 4)
        for (uint32_t k = 0; k < t->block_count; k++) {
            const struct transport_block *b = &t->blocks[k];
            float *out = lo + (size_t)b->first * 3 * PACKET;
            if (is_cancelled(frame))
                continue;
            if (transport_past_keeps(&change, b)) {
                if (change.what == TRANSPORT_GAIN)
                    scale_block(b, change.gain, out);
                kept++;
                continue;
            }
            if (t->fades && t->fades[k].weight < TRANSPORT_FADE) {
                penumbra += shade_fading(t, &look, k, out, &rays);
                continue;
            }
            t->kernels->cells(b, &t->gbuffer->packets[b->first], &t->sky, out);
            penumbra += add_rest(t, &look, b, out, &rays);
            clear_padding(t, b, out);
        }
        denormals_restore(before);
    }
    t->past.lo = t->fades || is_cancelled(frame) ? NULL : lo;
    stats->what = change.what;
    stats->kept = kept;
    stats->rays = rays;
    stats->penumbra = penumbra;
    stats->bright = t->sky.bright_count;
    stats->share = e->total_energy > 0.0 ? t->sky.bright_energy / e->total_energy : 0.0;
    return ERR_OK;
}
