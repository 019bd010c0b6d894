#include "light/cache_direct/transport.h"

#include "base/cancel.h"
#include "base/denormals.h"
#include "base/mem.h"
#include "light/cache_direct/internal.h"

#include <string.h>

void transport_destroy(struct transport *t)
{
    if (!t)
        return;
    for (uint32_t k = 0; t->blocks && k < t->block_count; k++) {
        for (uint32_t r = 0; t->bytes && r < TRANSPORT_ROWS; r++)
            t->blocks[k].pieces[r].bytes = NULL; /* they belong to t->bytes */
        transport_block_finish(&t->blocks[k]);
    }
    mem_free(t->bytes);
    mem_free(t->blocks);
    mem_free(t->unbuilt_index);
    mem_free(t->narrow_index);
    transport_sun_finish(t);
    mem_free(t->work);
    transport_last_destroy(t->last);
    sky_split_finish(&t->sky);
    pthread_cond_destroy(&t->shaded);
    pthread_mutex_destroy(&t->lock);
    mem_free(t);
}

uint64_t transport_steps(const struct gbuffer *g)
{
    return g->packet_count;
}

/* Bytes of a piece in t->bytes: whole cache lines. */
static size_t place_of(const struct transport_piece *q, const struct transport_block *b)
{
    const size_t bytes = (size_t)transport_piece_bytes(q, b->packets * PACKET);

    return (bytes + MEM_ALIGN - 1) / MEM_ALIGN * MEM_ALIGN;
}

/* Several threads build blocks in no particular order. With the blocks in order, a frame takes two thirds of the
 * time. */
void transport_gather(struct transport *t)
{
    if (!t->unbuilt_index && !t->bytes)
        transport_gather_again(t);
}

void transport_gather_again(struct transport *t)
{
    uint8_t *const before = t->bytes;
    size_t count = 0;

    for (uint32_t k = 0; k < t->block_count; k++)
        for (uint32_t r = 0; r < t->blocks[k].rows; r++)
            count += place_of(&t->blocks[k].pieces[r], &t->blocks[k]);
    uint8_t *to = mem_alloc_large(count, 1);
    if (!to)
        return;
    t->bytes = to;
    for (uint32_t k = 0; k < t->block_count; k++)
        for (uint32_t r = 0; r < t->blocks[k].rows; r++) {
            struct transport_piece *q = &t->blocks[k].pieces[r];
            if (!q->bytes)
                continue;
            memcpy(to, q->bytes, (size_t)transport_piece_bytes(q, t->blocks[k].packets * PACKET));
            if (!before)
                mem_free(q->bytes);
            q->bytes = to;
            to += place_of(q, &t->blocks[k]);
        }
    mem_free(before);
}

const struct transport_stats *transport_stats(const struct transport *t)
{
    return &t->stats;
}

const struct packet_list *transport_narrow(const struct transport *t)
{
    return &t->narrow;
}

const struct packet_list *transport_unbuilt(const struct transport *t)
{
    return &t->unbuilt;
}

const uint8_t *transport_work(const struct transport *t)
{
    return t->work;
}

bool transport_is_settled(const struct transport *t)
{
    return !t->unbuilt_index;
}

/* ---- A frame ---- */

/* Adds the light that gazes see. */
static void add_gazes(const struct transport *t, const struct transport_look *look, const struct transport_block *b,
                      float *lo)
{
    for (uint32_t k = 0; b->narrow && k < b->packets; k++)
        t->kernels->gaze(look, &t->gbuffer->packets[b->first + k], b->gazes + (size_t)k * TRANSPORT_GAZES,
                         lo + (size_t)k * 3 * PACKET);
}

/* Returns the number of packets in penumbrae. */
static uint32_t add_sun(struct transport *t, uint32_t k, float *lo, uint64_t *rays)
{
    return t->sun.parts.count ? transport_sun_add(t, k, lo, rays) : 0;
}

static void clear_padding(const struct transport *t, const struct transport_block *b, float *lo)
{
    for (uint32_t k = 0; k < b->packets; k++)
        for (uint32_t l = t->gbuffer->packets[b->first + k].count; l < PACKET; l++)
            for (uint32_t c = 0; c < 3; c++)
                lo[(k * 3 + c) * PACKET + l] = 0.0f;
}

/* Computes the cells' means and the data of indirect light at the same time: waking the threads twice would cost a
 * measurable part of the frame. */
static enum err take_cells(struct sky_split *s, const struct environment *e, const struct transport_indirect *indirect)
{
    const enum err result = sky_split_begin(s, e);
    const uint32_t parts = indirect ? indirect->take_parts : 0;

    if (result)
        return result;
    if (indirect)
        environment_complete_pyramid(e);
#pragma omp parallel
    {
#pragma omp for schedule(dynamic, 1) nowait
        for (uint32_t k = 0; k < parts; k++)
            indirect->take(indirect->self, e, k);
#pragma omp for schedule(dynamic, 4)
        for (uint32_t k = 0; k < SKY_SPLIT_PARTS; k++)
            sky_split_part(s, e, k);
    }
    if (indirect)
        indirect->taken(indirect->self);
    return ERR_OK;
}

enum err transport_take_sky(struct transport *t, const struct environment *e, const struct transport_frame *frame)
{
    t->sky.unsplit = frame->unsplit;
    return take_cells(&t->sky, e, frame->indirect);
}

/* Splits the frame's sky and its sun. */
static enum err take_sky(struct transport *t, const struct environment *e, const struct transport_frame *frame)
{
    const enum err result = frame->sky_taken ? ERR_OK : transport_take_sky(t, e, frame);
    return result ? result : transport_sun_take(t, e);
}

static bool is_asked_for(const struct transport_frame *f, const struct transport_block *b)
{
    if (b->narrow && f->narrow != TRANSPORT_NARROW_OWN)
        return f->narrow == TRANSPORT_NARROW_ALL;
    return f->end == 0 || (b->first >= f->first && b->first < f->end);
}

const struct transport_block *transport_block_of(const struct transport *t, uint32_t packet)
{
    uint32_t low = 0, high = t->block_count;

    while (high - low > 1) { /* blocks[low] begins at packet or before, blocks[high] behind */
        const uint32_t middle = low + (high - low) / 2;
        if (t->blocks[middle].first <= packet)
            low = middle;
        else
            high = middle;
    }
    return &t->blocks[low];
}

uint32_t transport_cut(const struct transport *t, uint32_t packet)
{
    return packet < t->gbuffer->packet_count && t->block_count > 0 ? transport_block_of(t, packet)->first
                                                                   : t->gbuffer->packet_count;
}

/* A part of a frame, for functions that query its blocks. */
struct wanted {
    const struct transport *transport;
    const struct transport_frame *frame;
};

static bool is_listed(const struct packet_list *list, uint32_t packet)
{
    uint32_t low = 0, high = list->count;

    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (list->index[middle] < packet)
            low = middle + 1;
        else
            high = middle;
    }
    return low < list->count && list->index[low] == packet;
}

/* Whether is_asked_for holds for the packet's block, without a search for that; it may also hold for a few more. */
static bool wants(const void *context, uint32_t packet)
{
    const struct wanted *w = context;
    const struct transport_frame *f = w->frame;

    return (packet < f->end && packet + TRANSPORT_PACKETS > f->first) ||
           (f->narrow == TRANSPORT_NARROW_ALL && is_listed(&w->transport->narrow, packet));
}

/* Adds it to lo, where other techniques have lit a block that is not built. */
static void add_indirect(const struct transport *t, const struct transport_frame *frame,
                         const struct transport_block *b, float *lo)
{
    _Alignas(64) float indirect[TRANSPORT_PACKETS * 3 * PACKET];
    struct transport_rows rows;

    if (!frame->indirect)
        return;
    frame->indirect->rows(frame->indirect->self, b->first, &rows);
    t->kernels->cells(b, &t->gbuffer->packets[b->first], &t->sky, &rows, indirect);
    clear_padding(t, b, indirect);
    for (size_t i = 0; i < (size_t)b->packets * 3 * PACKET; i++)
        lo[i] += indirect[i];
}

/* A block's light from cells and gazes. */
static void light_cells(const struct transport *t, const struct transport_look *look,
                        const struct transport_frame *frame, const struct transport_block *b, float *lo)
{
    struct transport_rows more;

    if (frame->indirect)
        frame->indirect->rows(frame->indirect->self, b->first, &more);
    t->kernels->cells(b, &t->gbuffer->packets[b->first], &t->sky, frame->indirect ? &more : NULL, lo);
    add_gazes(t, look, b, lo);
}

/* Computes what has changed, and adds up the parts. Packets, far apart in memory, are not read for the rest. */
static uint32_t shade_changes(struct transport *t, const struct transport_look *look,
                              const struct transport_frame *frame, uint32_t k, unsigned work, float *lo, uint64_t *rays)
{
    const struct transport_block *b = &t->blocks[k];
    float *lit = work & TRANSPORT_LAST_PASSING ? lo : transport_last_lit(t, b->first);
    float *shone = transport_last_shone(t, b->first);
    const size_t floats = (size_t)b->packets * 3 * PACKET;
    uint32_t penumbra = 0;

    if (work & TRANSPORT_WORK_CELLS) {
        light_cells(t, look, frame, b, lit);
        clear_padding(t, b, lit);
    }
    if (work & TRANSPORT_WORK_SUN) {
        memset(shone, 0, floats * sizeof(*shone));
        penumbra = add_sun(t, k, shone, rays);
        clear_padding(t, b, shone);
        transport_last_look(t, k);
    }
    if (lit != lo)
        memcpy(lo, lit, floats * sizeof(*lo));
    const size_t lighter = transport_last_is_dark(t, k) ? 0 : floats;
    for (size_t i = 0; i < lighter; i++)
        lo[i] += shone[i];
    return penumbra;
}

/* A frame while its blocks are lit. */
struct shading {
    struct transport *transport;
    const struct transport_frame *frame;
    struct transport_look look;
    bool keeps; /* by way of the last frame's light */
};

static uint32_t shade_block(const struct shading *s, uint32_t k, float *lo, uint64_t *rays)
{
    struct transport *t = s->transport;
    const struct transport_block *b = &t->blocks[k];
    const unsigned all = TRANSPORT_WORK_CELLS | (t->sun.parts.count ? TRANSPORT_WORK_SUN : 0),
                   work = s->keeps ? transport_last_work(t, k) : all;

    memset(t->work + b->first, (int)(work & all), b->packets);
    if (t->unbuilt_index && !b->built) {
        add_indirect(t, s->frame, b, lo);
        return 0;
    }
    if (s->keeps)
        return shade_changes(t, &s->look, s->frame, k, work, lo, rays);
    light_cells(t, &s->look, s->frame, b, lo);
    const uint32_t penumbra = add_sun(t, k, lo, rays);
    clear_padding(t, b, lo);
    return penumbra;
}

/* Whether a frame can take over parts of the last one: all of the image, by a cache that is built. */
static bool is_kept(const struct transport *t, const struct transport_frame *f)
{
    return !t->unbuilt_index && f->end == 0 && f->narrow == TRANSPORT_NARROW_OWN;
}

static void count_work(const struct transport *t, struct transport_frame_stats *stats)
{
    for (uint32_t k = 0; k < t->gbuffer->packet_count; k++) {
        stats->lit += t->work[k] & TRANSPORT_WORK_CELLS ? 1 : 0;
        stats->shone += t->work[k] & TRANSPORT_WORK_SUN ? 1 : 0;
    }
}

/* Takes the sky, and decides what the last frame spares. */
static enum err begin_frame(struct transport *t, const struct environment *e, const struct transport_frame *frame,
                            struct shading *out)
{
    if (!t->work && !(t->work = mem_alloc(t->gbuffer->packet_count + 1, sizeof(*t->work))))
        return ERR_NOMEM;
    const enum err result = take_sky(t, e, frame);
    if (result)
        return result;
    if (t->stats.narrow > 0 && frame->narrow != TRANSPORT_NARROW_NONE)
        environment_complete_pyramid(e);
    *out = (struct shading){
        t,
        frame,
        { .environment = e,
          .level = t->sky.level,
          .sun = &t->sun,
          .per_energy = t->sun.parts.count ? 0.25 * SUN_SAMPLES * e->n * e->n / t->sky.sun_energy : 0.0 },
        is_kept(t, frame) && transport_last_begin(t, frame->indirect),
    };
    memset(t->work, 0, t->gbuffer->packet_count);
    return ERR_OK;
}

static enum err shade(struct transport *t, const struct environment *e, const struct transport_frame *frame, float *lo,
                      struct transport_frame_stats *stats)
{
    struct shading s;
    uint64_t rays = 0;
    uint32_t penumbra = 0;

    *stats = (struct transport_frame_stats){ 0 };
    const enum err result = begin_frame(t, e, frame, &s);
    if (result)
        return result;
    const uint32_t parts = frame->indirect ? frame->indirect->parts : 0;
    const struct wanted part = { t, frame };
#pragma omp parallel reduction(+ : rays, penumbra)
    {
        const unsigned before = denormals_flush();
#pragma omp for schedule(dynamic, 4)
        for (uint32_t k = 0; k < parts; k++)
            frame->indirect->prepare(frame->indirect->self, k, frame->end ? wants : NULL, &part);
#pragma omp for schedule(dynamic, 4)
        for (uint32_t k = 0; k < t->block_count; k++)
            if (!is_cancelled(frame->cancel) && is_asked_for(frame, &t->blocks[k]))
                penumbra += shade_block(&s, k, lo + (size_t)t->blocks[k].first * 3 * PACKET, &rays);
        denormals_restore(before);
    }
    if (s.keeps)
        transport_last_end(t, !is_cancelled(frame->cancel));
    stats->rays = rays;
    stats->penumbra = penumbra;
    count_work(t, stats);
    stats->sun = t->sky.sun_count;
    stats->share = e->total_energy > 0.0 ? t->sky.sun_energy / e->total_energy : 0.0;
    return ERR_OK;
}

enum err transport_shade(struct transport *t, const struct environment *e, const struct transport_frame *frame,
                         float *lo, struct transport_frame_stats *stats)
{
    atomic_store(&t->awaits, true);
    pthread_mutex_lock(&t->lock);
    atomic_store(&t->awaits, false);
    const enum err result = shade(t, e, frame, lo, stats);
    pthread_cond_signal(&t->shaded);
    pthread_mutex_unlock(&t->lock);
    return result;
}
