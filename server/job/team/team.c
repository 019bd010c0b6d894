#include "job/team/team_internal.h"

#include "base/cancel.h"
#include "base/clock.h"
#include "base/half.h"
#include "base/log.h"
#include "job/team/team.h"
#include "light/frame/part.h"
#include "scene/geometry/scene_digest.h"

#include <inttypes.h>
#include <string.h>

#define FIRST 12 /* images with a cache in which shares are measured */

/* ---- Light in messages ---- */

static void unpack_light(const struct team *t, const uint8_t *in, float *lo, size_t values)
{
    if (!t->desc.half) {
        memcpy(lo, in, values * sizeof(float));
        return;
    }
    const uint16_t *from = (const uint16_t *)(const void *)in;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < values; i++)
        lo[i] = half_widen(from[i]);
}

/* Rank 0's own light, as others send theirs. */
static void round_light(const struct team *t, float *lo, size_t packets)
{
    if (t->desc.half)
        light_round(lo, packets * BLOCK);
}

/* ---- Caches ---- */

static enum err begin_caches(void *context, const void *request)
{
    struct team *t = context;
    struct order order;

    if (t->own > 0) /* it was told by rank 0 */
        return ERR_OK;
    t->together = true;
    memset(&order, 0, sizeof(order));
    order.kind = ORDER_PREPARE;
    order.work.cached = light_work_request(request);
    return ranks_broadcast(t->desc.ranks, &order, sizeof(order));
}

/* ---- Rank 0 ---- */

static int turn_of(const struct team *t, const struct dealt *d)
{
    return d == &t->dealt[1];
}

/* Begins to send what the other ranks need of an image. */
static enum err send_order(struct team *t, struct dealt *d, const struct transport *cache,
                           const struct transport_indirect *indirect)
{
    const size_t cuts = cuts_bytes(t), faces = d->order.faces, size = cuts + d->order.sky + faces;
    uint8_t *bytes = room_for(&d->out, size);

    if (!bytes)
        return ERR_NOMEM;
    memcpy(bytes, d->cuts, cuts);
    if (faces > 0) /* first: floats are aligned there */
        environment_get_faces(d->e, (float *)(void *)(bytes + cuts));
    if (cache)
        transport_pack_sky(cache, d->e, indirect, bytes + cuts + faces);
    t->stats.sent = sizeof(d->order) + size;
    const enum err e = ranks_begin_broadcast(t->desc.ranks, turn_of(t, d), &d->order, sizeof(d->order));
    return e ? e : ranks_begin_broadcast(t->desc.ranks, turn_of(t, d), bytes, size);
}

/* Memory for the answers, to be had before the order, after which all ranks answer. */
static enum err make_room(struct team *t, struct dealt *d)
{
    size_t size = 0;

    for (uint32_t k = 1; k < t->count; k++) {
        const size_t one = answer_bytes(t, d->cuts[k + 1] - d->cuts[k]);
        if (one > INT32_MAX)
            return ERR_RANGE;
        size += one;
    }
    t->stats.received = size;
    return room_for(&d->in, size + 1) ? ERR_OK : ERR_NOMEM;
}

static enum err expect_all(struct team *t, struct dealt *d)
{
    uint8_t *to = d->in.at;
    enum err e = ERR_OK;

    for (uint32_t k = 1; k < t->count && !e; k++) {
        const size_t one = answer_bytes(t, d->cuts[k + 1] - d->cuts[k]);
        e = ranks_expect(t->desc.ranks, turn_of(t, d), k, to, one);
        to += one;
    }
    return e;
}

/* Orders an image from the other ranks; a cache then has its sky. */
static enum err deal(struct team *t, struct dealt *d, const struct environment *e, const struct frame_plan *plan,
                     const struct relight_stats *stats)
{
    struct transport *cache = relighter_transport(t->desc.relighter, plan);
    const struct transport_indirect *indirect = relighter_indirect(t->desc.relighter, plan, &stats->plan);
    const bool faces = !cache || frame_plan_has(plan, PASS_EYE) || !transport_narrow_is_few(cache, t->count);
    enum err result = ERR_OK;

    d->e = e;
    memset(&d->order, 0, sizeof(d->order));
    light_work_pack(plan, stats, &d->order.work);
    if (cache) {
        transport_gather(cache);
        result = transport_take_sky(
            cache, e, &(struct transport_frame){ .unsplit = plan->pass[0].request->unsplit, .indirect = indirect });
    }
    d->order.narrow = faces;
    d->order.sky = cache ? transport_sky_bytes(cache, indirect) : 0;
    d->order.faces = faces ? 3 * sizeof(float) * CUBE_FACES * (uint64_t)e->n * e->n : 0;
    team_cut(t, cache, d->cuts);
    if (!result)
        result = make_room(t, d);
    if (!result)
        result = send_order(t, d, cache, indirect);
    d->open = !result;
    return result ? result : expect_all(t, d);
}

/* Copies the parts of other ranks to their places, except the packets that rank 0 has lit itself. since: the end of the
 * image before. */
static enum err take_all(struct team *t, const struct dealt *d, const struct packet_list *own, float *lo, double since,
                         struct relight_stats *stats)
{
    const double taken_s = clock_seconds() - since;
    float *kept = own->count ? mem_alloc_raw((size_t)own->count * BLOCK, sizeof(*kept)) : NULL;
    const uint8_t *at = d->in.at;
    enum err e = own->count && !kept ? ERR_NOMEM : ERR_OK;

    for (uint32_t i = 0; i < own->count && !e; i++)
        memcpy(kept + (size_t)i * BLOCK, lo + (size_t)own->index[i] * BLOCK, BLOCK * sizeof(float));
    if (kept)
        round_light(t, kept, own->count);
    for (uint32_t k = 1; k < t->count && !e; k++) {
        const uint32_t packets = d->cuts[k + 1] - d->cuts[k];
        struct answer a;
        memcpy(&a, at, sizeof(a));
        e = (enum err)a.error;
        if (!e)
            unpack_light(t, at + sizeof(a), lo + (size_t)d->cuts[k] * BLOCK, (size_t)packets * BLOCK);
        t->stats.memory_most = k == 1 || a.memory > t->stats.memory_most ? a.memory : t->stats.memory_most;
        stats->direct.rays += a.rays;
        team_learn_answer(t, k, packets, a.seconds, taken_s);
        at += answer_bytes(t, packets);
    }
    for (uint32_t i = 0; i < own->count && !e; i++)
        memcpy(lo + (size_t)own->index[i] * BLOCK, kept + (size_t)i * BLOCK, BLOCK * sizeof(float));
    mem_free(kept);
    return e;
}

/* With a cache that rank 0 has computed beside images. */
static enum err alone(struct team *t, struct relighter *r, const struct environment *e,
                      const struct frame_plan *plan, float *lo, struct relight_stats *stats)
{
    const struct light_part all = { 0, packets_of(t), TRANSPORT_NARROW_OWN, false };

    const enum err result = relighter_run_part(r, e, plan, &all, lo, stats);

    round_light(t, lo, all.end);
    return result;
}

/* After the first images with a cache: all ranks get new shares, between
 * this image and the next. */
static enum err settle_all(struct team *t, const struct transport *cache)
{
    const int turn = !t->turn;

    if (!cache || t->settled || !relighter_is_complete(t->desc.relighter) || ++t->first < FIRST)
        return ERR_OK;
    if (team_choose_shares(t, cache))
        return ERR_NOMEM;
    memset(&t->order, 0, sizeof(t->order));
    t->order.kind = ORDER_KEEP;
    enum err e = ranks_begin_broadcast(t->desc.ranks, turn, &t->order, sizeof(t->order));
    if (!e)
        e = ranks_begin_broadcast(t->desc.ranks, turn, t->shares, cuts_bytes(t));
    return e ? e : team_settle(t);
}

/* Orders the next image, if it is known. What fails here fails again when it is made, and is reported then. */
static void look_ahead(struct team *t)
{
    struct relighter *r = t->desc.relighter;
    const struct environment *e;
    const struct relight_desc *request;
    struct frame_plan plan;
    struct relight_stats stats;

    if (!t->next || !t->next(t->next_context, &e, &request) || relighter_describe(r, e, request, &plan, &stats))
        return;
    if (!relighter_can_deal(r, &plan) || (frame_plan_has(&plan, PASS_CACHED) && !t->together))
        return;
    const enum err failed = deal(t, &t->dealt[!t->turn], e, &plan, &stats);
    (void)failed;
}

static bool is_ordered(const struct dealt *d, const struct environment *e, const struct frame_plan *plan,
                       const struct relight_stats *stats)
{
    struct light_work work;

    memset(&work, 0, sizeof(work));
    light_work_pack(plan, stats, &work);
    return d->open && d->e == e && memcmp(&work, &d->order.work, sizeof(work)) == 0;
}

/* Receives the light of an image, or of one that is not made after all. */
static enum err receive(struct team *t, struct dealt *d)
{
    d->open = false;
    return ranks_receive(t->desc.ranks, turn_of(t, d), t->waited);
}

/* Rank 0's speed: of its part alone if the others wait for its other work, and of all it does between two images if
 * they have an order meanwhile. */
static void learn_own(struct team *t, bool early, uint32_t packets, double part_s, double busy_until)
{
    if (early != t->was_early)
        t->speed[0] = 0.0; /* the other measure */
    t->was_early = early;
    team_learn(t, 0, packets, early ? busy_until - t->end_s : part_s);
}

/* Lights the shade points of an image on all ranks. */
static enum err points(void *context, struct relighter *r, const struct environment *e,
                       const struct frame_plan *plan, float *lo, struct relight_stats *stats)
{
    static const struct packet_list nothing = { NULL, 0 };
    struct team *t = context;
    const struct transport *cache = relighter_transport(r, plan);
    struct dealt *d = &t->dealt[t->turn];
    enum err result = ERR_OK;

    if (cache && !t->together)
        return alone(t, r, e, plan, lo, stats);
    const bool early = is_ordered(d, e, plan, stats);
    if (!early)
        result = receive(t, d);
    if (!early && !result)
        result = deal(t, d, e, plan, stats);
    const bool narrow = cache && !d->order.narrow;
    const struct light_part own = { d->cuts[0], d->cuts[1], narrow ? TRANSPORT_NARROW_ALL : TRANSPORT_NARROW_OWN,
                                    cache != NULL };
    const double start = clock_seconds();
    if (!result)
        result = relighter_run_part(r, e, plan, &own, lo, stats);
    round_light(t, lo + (size_t)own.first * BLOCK, own.end - own.first);
    const double lit = clock_seconds();
    if (!result)
        result = settle_all(t, cache);
    if (!result)
        look_ahead(t);
    const double looked = clock_seconds();
    const enum err received = receive(t, d); /* after an error, too: MPI writes into d->in until then */
    t->turn = !t->turn;
    t->stats.part_s += lit - start;
    t->stats.wait_s += clock_seconds() - looked;
    t->stats.dealt++;
    t->stats.early += early;
    t->stats.memory = relighter_memory(r);
    if (!is_cancelled(plan->cancel))
        learn_own(t, early, own.end - own.first, lit - start, looked);
    result = result ? result : received;
    if (!result)
        result = take_all(t, d, narrow ? transport_narrow(cache) : &nothing, lo, early ? t->end_s : start, stats);
    t->end_s = clock_seconds();
    return result;
}

void team_look_ahead(struct team *t, team_next *next, void *context)
{
    t->next = next;
    t->next_context = context;
}

/* ---- Begin and end ---- */

/* Points that differ between hosts, because of another scene file or library version, would get the light of other
 * points. */
static enum err compare_sets(const struct team *t, struct reason *why)
{
    const struct prepared_scene *set = relighter_set(t->desc.relighter);
    struct digest own = { { 0 } }, first;

    digest_points(&own, set->gbuffer);
    digest_geometry(&own, set->scene);
    first = own;
    enum err e = ranks_broadcast(t->desc.ranks, &first, sizeof(first));
    if (!e && memcmp(&own, &first, sizeof(own)) != 0)
        e = err_say(why, ERR_USAGE,
                    "%s: this rank reads another scene than rank 0, or computes other points: give all hosts the same "
                    "files and programs",
                    set->name);
    return ranks_agree(t->desc.ranks, e, why);
}

enum err team_create(const struct team_desc *desc, struct team **out, struct reason *why)
{
    struct team *t = mem_alloc(1, sizeof(*t));

    *out = NULL;
    if (t) {
        t->desc = *desc;
        t->own = ranks_index(desc->ranks);
        t->count = ranks_count(desc->ranks);
        t->speed = mem_alloc(t->count, sizeof(*t->speed));
        t->weight = mem_alloc(t->count, sizeof(*t->weight));
        t->waited = mem_alloc(t->count, sizeof(*t->waited));
        t->way_s = mem_alloc(t->count, sizeof(*t->way_s));
        for (int turn = 0; turn < 2; turn++)
            t->dealt[turn].cuts = mem_alloc((size_t)t->count + 1, sizeof(*t->cuts));
        t->cuts = t->dealt[0].cuts;
        t->shares = mem_alloc((size_t)t->count + 1, sizeof(*t->shares));
        t->share = team_share(desc->ranks);
        t->share.begin = begin_caches;
        t->share.begin_context = t;
        struct environment_desc sky = *desc->environment;
        sky.lean = true;
        t->environment = t->own > 0 ? environment_create(&sky) : NULL;
    }
    const bool all = t && t->speed && t->weight && t->waited && t->way_s && t->cuts && t->dealt[1].cuts &&
                     t->shares && (t->environment || t->own == 0);
    enum err e = ranks_agree(desc->ranks, all ? ERR_OK : err_say(why, ERR_NOMEM, "out of memory"), why);
    if (!e)
        e = compare_sets(t, why);
    if (e) {
        if (t)
            t->desc.relighter = NULL; /* nobody serves */
        team_destroy(t);
        return e;
    }
    team_share_out(t);
    relighter_share(desc->relighter, &t->share);
    relighter_round(desc->relighter, desc->half);
    t->light = (struct light_team){ points, t };
    if (t->own == 0)
        relighter_join(desc->relighter, &t->light);
    *out = t;
    return ERR_OK;
}

/* On rank 0, before it waits for others: mpirun kills soon after a signal. */
static void report(const struct team *t)
{
    const struct team_stats *s = &t->stats;

    if (t->own > 0 || s->dealt == 0)
        return;
    log_info("%" PRIu64 " images by %u ranks, %" PRIu64 " of them ordered early: %.1f KB to each rank and %.2f MB from "
             "all of them per image; %.2f s for rank 0's parts, %.2f s of waiting for others; G-buffer and caches: "
             "%.1f MB on rank 0, at most %.1f MB on another",
             s->dealt, t->count, s->early, 1e-3 * (double)s->sent, 1e-6 * (double)s->received, s->part_s, s->wait_s,
             1e-6 * (double)s->memory, 1e-6 * (double)s->memory_most);
}

void team_destroy(struct team *t)
{
    struct order order;

    if (!t)
        return;
    report(t);
    memset(&order, 0, sizeof(order));
    order.kind = ORDER_LEAVE;
    if (t->desc.relighter)
        relighter_share(t->desc.relighter, NULL);
    if (t->desc.relighter && t->own == 0) {
        relighter_join(t->desc.relighter, NULL);
        const enum err lost = receive(t, &t->dealt[0]), too = receive(t, &t->dealt[1]);
        if (lost || too || ranks_broadcast(t->desc.ranks, &order, sizeof(order)))
            log_warning("a rank does not answer; it is left behind");
    }
    environment_destroy(t->environment);
    mem_free(t->speed);
    mem_free(t->weight);
    mem_free(t->waited);
    mem_free(t->way_s);
    mem_free(t->shares);
    mem_free(t->in.at);
    for (int turn = 0; turn < 2; turn++) {
        mem_free(t->dealt[turn].cuts);
        mem_free(t->dealt[turn].out.at);
        mem_free(t->dealt[turn].in.at);
        mem_free(t->out[turn].at);
    }
    mem_free(t);
}
