/* Ranks other than 0. */
#include "job/team/team_internal.h"

#include "base/clock.h"
#include "base/half.h"
#include "base/log.h"
#include "light/frame/part.h"

#include <string.h>

static void pack_light(const struct team *t, const float *lo, size_t values, uint8_t *out)
{
    if (!t->desc.half) {
        memcpy(out, lo, values * sizeof(float));
        return;
    }
    uint16_t *to = (uint16_t *)(void *)out;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < values; i++)
        to[i] = half_round(lo[i] < HALF_MAX ? lo[i] : HALF_MAX);
}

static enum err take_sky(struct team *t, const struct order *order, const struct frame_plan *plan,
                         const struct plan *choice)
{
    const size_t cuts = cuts_bytes(t);
    struct transport *cache = relighter_transport(t->desc.relighter, plan);
    enum err e = ERR_OK;

    if (order->sky) {
        transport_gather(cache);
        t->environment->ready = true;
        e = transport_unpack_sky(cache, t->in.at + cuts + order->faces, order->sky,
                                 relighter_indirect(t->desc.relighter, plan, choice), t->environment);
    }
    if (!e && order->faces) /* last: the unpacking clears the texels that were bright in the image before */
        environment_set_faces(t->environment, (const float *)(const void *)(t->in.at + cuts));
    return e;
}

/* Loads or computes the caches of a request together with the other ranks. An error is rank 0's, too. */
static void prepare(struct team *t, const struct order *order)
{
    struct relight_desc request = order->work.cached;
    struct reason why = { "" };
    double ms;

    request.cache_file = t->desc.cache_file;
    request.cache_dir = t->desc.cache_dir;
    request.direct.cancel = t->desc.cancel;
    request.direct.why = &why;
    if (relighter_prepare(t->desc.relighter, &request, false, &ms) && why.text[0])
        log_error("%s", why.text);
}

/* Lights this rank's part and sends it, or in its stead *failed, by which rank 0 ends the image. */
static enum err serve_one(struct team *t, const struct order *order, float *lo, enum err *failed)
{
    struct frame_plan plan;
    struct relight_stats stats = { 0 };

    memcpy(t->cuts, t->in.at, cuts_bytes(t));
    const struct light_part part = { t->cuts[t->own], t->cuts[t->own + 1],
                                     order->narrow ? TRANSPORT_NARROW_OWN : TRANSPORT_NARROW_NONE, order->sky > 0 };
    const uint32_t packets = part.end - part.first;
    const double start = clock_seconds();
    enum err e = light_work_unpack(t->desc.relighter, &order->work, &plan, &stats);
    if (!e)
        e = take_sky(t, order, &plan, &stats.plan);
    if (!e)
        e = relighter_run_part(t->desc.relighter, t->environment, &plan, &part, lo, &stats);
    const size_t size = answer_bytes(t, packets);
    uint8_t *out = room_for(&t->out[t->turn], size); /* the answer before may still be on its way */
    t->turn = !t->turn;
    const double seconds = clock_seconds() - start;
    t->stats.part_s += seconds;
    e = e || out ? e : ERR_NOMEM;
    const struct answer a = { e, seconds, stats.direct.rays, relighter_memory(t->desc.relighter) };
    *failed = e;
    t->failure = a;
    if (e)
        return ranks_send(t->desc.ranks, &t->failure, sizeof(a));
    memcpy(out, &a, sizeof(a));
    pack_light(t, lo + (size_t)part.first * BLOCK, (size_t)packets * BLOCK, out + sizeof(a));
    return ranks_send(t->desc.ranks, out, size);
}

enum err team_serve(struct team *t, struct reason *why)
{
    float *lo = mem_alloc(packets_of(t), BLOCK * sizeof(*lo));
    struct order order;
    enum err e = ERR_OK, failed = ERR_OK;

    if (!lo)
        ranks_abort(t->desc.ranks, "out of memory for this rank's part of an image");
    while (!e) {
        e = ranks_broadcast(t->desc.ranks, &order, sizeof(order));
        if (e || order.kind == ORDER_LEAVE)
            break;
        if (order.kind == ORDER_PREPARE) {
            prepare(t, &order);
            continue;
        }
        if (order.kind == ORDER_KEEP) {
            e = ranks_broadcast(t->desc.ranks, t->shares, cuts_bytes(t));
            if (!e && team_settle(t))
                ranks_abort(t->desc.ranks, "out of memory for this rank's part of the cache");
            continue;
        }
        const size_t size = cuts_bytes(t) + order.sky + order.faces;
        if (!room_for(&t->in, size))
            ranks_abort(t->desc.ranks, "out of memory for the sky of an image");
        e = ranks_broadcast(t->desc.ranks, t->in.at, size);
        if (!e)
            e = serve_one(t, &order, lo, &failed);
    }
    const enum err sent = e ? e : ranks_sent(t->desc.ranks);
    mem_free(lo);
    e = e ? e : sent;
    if (e)
        return err_say(why, e, "rank 0 no longer answers");
    return failed ? err_say(why, failed, "this rank's part of an image: %s", err_text(failed)) : ERR_OK;
}
