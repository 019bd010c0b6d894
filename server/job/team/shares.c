/* Who lights which packets of an image, and which packets a rank therefore keeps. */
#include "job/team/team_internal.h"

#include "light/frame/part.h"

#include <math.h>

#define SMOOTH 0.1           /* weight of an image in a rank's measured speed, */
#define SOON 0.4             /* and while shares are not settled */
#define WAITED 2e-3          /* seconds: longer than a poll */
#define REMEMBERED 0.9       /* per image, of the time that answers spent on their way */
#define LEAST 0.02           /* of the fastest rank's speed: with no share at all, it would never be measured again */
#define BLOCK_PACKETS 4      /* at most, of a block of the cache */
#define MARGIN (1.0 / 128.0) /* a rank keeps the packets of its share and this part of a mean share on either side, */
#define MARGIN_MIN 8         /* and some packets, since parts begin at blocks; */
#define MARGIN_FIRST 0.75    /* this part during the first images, in which the shares are measured */
#define HANDED 0.45 /* of a mean share, with two ranks: by how much memory may exceed the initial share; with more */
#define HANDED_MIN 0.02 /* it falls by the cube of the others, to this, since memory is to fall as 1/N */
#define RANGE 2.0       /* initial shares differ from the mean by 2^-RANGE .. 2^RANGE, */
#define MEASURED_S 0.5  /* unless every G-buffer took less processor time than this, which tells too little */

/* By how much a rank's memory may exceed its initial share, as a part of it. */
static double handed(const struct team *t)
{
    const double others = fmax(t->count - 1.0, 1.0);

    return fmax(HANDED_MIN, HANDED / (others * others * others));
}

/* Two ranks have the memory for cuts that follow another load than that of the first images. */
static uint32_t margin_of(const struct team *t, bool settled)
{
    const double margin = settled ? fmax(MARGIN, handed(t) / 3.0) : MARGIN_FIRST;

    return (uint32_t)(margin * packets_of(t) / t->count) + MARGIN_MIN;
}

/* ---- What a rank keeps ---- */

static void choose_kept(struct team *t)
{
    const struct prepared_scene *set = relighter_set(t->desc.relighter);
    const uint32_t packets = packets_of(t), margin = margin_of(t, t->settled);
    const uint32_t first = t->shares[t->own], end = t->shares[t->own + 1];

    t->share.first = first > margin ? first - margin : 0;
    t->share.end = end + margin < packets ? end + margin : packets;
    if (t->own == 0 && set->scene->ground.radius > 0.0f) /* whose images it lights alone */
        t->share.end = 0;
}

/* Releases the G-buffer of other ranks' packets and, except on rank 0, of the pixels, once no cache will need it. */
static void release_others(struct team *t)
{
    const struct transport *cache = relighter_cache(t->desc.relighter);
    struct gbuffer *g = relighter_set(t->desc.relighter)->gbuffer;

    if (t->released || !t->settled || t->share.end == 0 || !cache || !relighter_is_complete(t->desc.relighter))
        return;
    for (uint32_t first = 0, end; first < g->packet_count; first = end) {
        const bool kept = transport_keeps(cache, &t->share, first);
        for (end = first + 1; end < g->packet_count && transport_keeps(cache, &t->share, end) == kept; end++)
            ;
        if (!kept)
            gbuffer_release_packets(g, first, end);
    }
    if (t->own > 0)
        gbuffer_release_pixels(g);
    t->released = true;
}

enum err team_settle(struct team *t)
{
    t->settled = true;
    choose_kept(t);
    const enum err e = relighter_narrow(t->desc.relighter);
    if (!(t->own == 0 && t->desc.whole))
        release_others(t);
    return e;
}

/* ---- Shares ---- */

void team_share_out(struct team *t)
{
    const struct prepared_scene *set = relighter_set(t->desc.relighter);
    const uint32_t packets = set->gbuffer->packet_count;
    double mean = 0.0, whole = 0.0, at = 0.0;

    ranks_share_number(t->desc.ranks, 1.0 / fmax(set->gbuffer_cost_s, MEASURED_S), t->weight);
    for (uint32_t k = 0; k < t->count; k++)
        mean += t->weight[k] / t->count;
    for (uint32_t k = 0; k < t->count; k++) {
        t->weight[k] = exp2(fmin(fmax(round(log2(t->weight[k] / mean)), -RANGE), RANGE));
        whole += t->weight[k];
    }
    for (uint32_t k = 0; k < t->count; k++) {
        t->weight[k] /= whole;
        at += t->weight[k];
        t->shares[k + 1] = (uint32_t)(at * packets + 0.5);
    }
    t->shares[t->count] = packets;
    choose_kept(t);
}

/* The packet at which rank k's part would begin by measured speed; by the shares until all ranks are measured. */
static uint32_t place_of(const struct team *t, uint32_t rank)
{
    double whole = 0.0, at = 0.0;
    bool all = true;

    for (uint32_t k = 0; k < t->count; k++) {
        all = all && t->speed[k] > 0.0;
        at += k < rank ? t->speed[k] : 0.0;
        whole += t->speed[k];
    }
    return all ? (uint32_t)(at / whole * packets_of(t) + 0.5) : t->shares[rank];
}

void team_cut(const struct team *t, const struct transport *cache, uint32_t *cuts)
{
    const uint32_t packets = packets_of(t), margin = margin_of(t, t->settled);

    cuts[0] = 0;
    cuts[t->count] = packets;
    for (uint32_t k = 1; k < t->count; k++) {
        const uint32_t share = t->shares[k], least = share > margin ? share - margin + BLOCK_PACKETS : 0;
        uint32_t place = place_of(t, k);
        place = place < least ? least : place > share + margin ? share + margin : place;
        place = place < packets ? place : packets;
        place = cache ? transport_cut(cache, place) : place;
        cuts[k] = place > cuts[k - 1] ? place : cuts[k - 1];
    }
}

/* The first packet before which there are that many bytes, of `before`: [packets + 1]. */
static uint32_t find_bytes(const double *before, uint32_t packets, double bytes)
{
    uint32_t low = 0, high = packets;

    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (before[middle] < bytes)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

void team_limit_shares(const double *before, uint32_t packets, const double *most, uint32_t count, uint32_t *cuts)
{
    double left = 0.0; /* that the ranks from k on may keep */

    for (uint32_t k = 0; k < count; k++)
        left += most[k];
    for (uint32_t k = 1; k < count; k++) {
        left -= most[k - 1];
        const uint32_t least = find_bytes(before, packets, before[packets] - left);
        const uint32_t end = find_bytes(before, packets, before[cuts[k - 1]] + most[k - 1]);
        cuts[k] = cuts[k] < least ? least : cuts[k] > end ? end : cuts[k];
    }
}

enum err team_choose_shares(struct team *t, const struct transport *cache)
{
    const struct gbuffer *g = relighter_set(t->desc.relighter)->gbuffer;
    const uint32_t packets = g->packet_count, reach = margin_of(t, false) - margin_of(t, true);
    double *before = mem_alloc((size_t)packets + 1, sizeof(*before)), *most = mem_alloc(t->count, sizeof(*most));
    uint32_t *places = mem_alloc((size_t)t->count + 1, sizeof(*places));
    const enum err e = before && most && places ? ERR_OK : ERR_NOMEM;
    const double pixels = fmax(0.0, (double)g->bytes - (double)packets * sizeof(*g->packets)); /* rank 0's alone */

    for (uint32_t p = 0; p < packets && !e; p++)
        before[p + 1] = before[p] + sizeof(*g->packets) + transport_packet_bytes(cache, p);
    for (uint32_t k = 0; k < t->count && !e; k++) {
        most[k] = (1.0 + handed(t)) * t->weight[k] * (before[packets] + pixels) - (k == 0 ? pixels : 0.0);
        places[k] = place_of(t, k);
    }
    if (!e)
        team_limit_shares(before, packets, most, t->count, places);
    for (uint32_t k = 1; k < t->count && !e; k++) { /* among what ranks have */
        const uint32_t old = t->shares[k], low = old > reach ? old - reach + BLOCK_PACKETS : 0;
        const uint32_t place = places[k] < low ? low : places[k] > old + reach ? old + reach : places[k];
        t->shares[k] = transport_cut(cache, place < packets ? place : packets);
    }
    mem_free(before);
    mem_free(most);
    mem_free(places);
    return e;
}

void team_learn(struct team *t, uint32_t rank, uint32_t packets, double seconds)
{
    double most = 0.0;

    if (packets == 0 || !(seconds > 0.0))
        return;
    const double speed = packets / seconds;
    t->speed[rank] += (t->speed[rank] > 0.0 ? t->settled ? SMOOTH : SOON : 1.0) * (speed - t->speed[rank]);
    for (uint32_t k = 0; k < t->count; k++)
        most = t->speed[k] > most ? t->speed[k] : most;
    if (t->speed[rank] < LEAST * most)
        t->speed[rank] = LEAST * most;
}

void team_learn_answer(struct team *t, uint32_t rank, uint32_t packets, double lit_s, double taken_s)
{
    if (packets == 0)
        return;
    const double way_s = fmax(0.0, taken_s - lit_s) / packets, known_s = REMEMBERED * t->way_s[rank];

    t->way_s[rank] = t->waited[rank] > WAITED ? way_s : fmin(way_s, known_s);
    team_learn(t, rank, packets, lit_s + packets * t->way_s[rank]);
}
