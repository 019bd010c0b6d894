#include "light/frame/part.h"

#include "base/half.h"
#include "base/mem.h"
#include "light/frame/relighter.h"

struct packet_list light_part_list(const struct packet_list *all, const struct light_part *part)
{
    uint32_t first = 0, end = all->count;

    while (first < end && all->index[first] < part->first)
        first++;
    while (end > first && all->index[end - 1] >= part->end)
        end--;
    return (struct packet_list){ all->index + first, end - first };
}

void light_round(float *lo, size_t count)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++)
        lo[i] = half_widen(half_round(lo[i] < 65504.0f ? lo[i] : 65504.0f));
}

bool light_deals(enum method method)
{
    return !method_is_reference(method) && method != METHOD_LATLONG && method != METHOD_LATLONG_ROWS;
}

void relighter_join(struct relighter *r, const struct light_team *team)
{
    r->team = team;
}

void relighter_share(struct relighter *r, const struct cache_share *share)
{
    r->cache.share = share;
}

enum err relighter_narrow(struct relighter *r)
{
    return r->cache.transport && r->cache.keep.share ? relight_cache_narrow(&r->cache) : ERR_OK;
}

void relighter_round(struct relighter *r, bool half)
{
    r->half = half;
}

/* A cache under construction changes from image to image, and only in this process. */
struct transport *relighter_transport(const struct relighter *r, const struct frame_plan *plan)
{
    const bool cached = frame_plan_has(plan, PASS_CACHED) && !r->cache.refused;

    return cached && relight_cache_is_settled(&r->cache) ? r->cache.transport : NULL;
}

const struct transport_indirect *relighter_indirect(const struct relighter *r, const struct frame_plan *plan,
                                                    const struct plan *choice)
{
    return frame_plan_has(plan, PASS_CACHED) && choice->indirect == PLAN_CACHE && r->cache.indirect.indirect
               ? indirect_of_frame(r->cache.indirect.indirect)
               : NULL;
}

const struct packet_list *relighter_left(const struct relighter *r)
{
    return r->cache.indirect.indirect ? indirect_left(r->cache.indirect.indirect) : NULL;
}

const struct prepared_scene *relighter_set(const struct relighter *r)
{
    return r->set;
}

const float *relighter_points(const struct relighter *r)
{
    return r->passes.lo;
}

const struct transport *relighter_cache(const struct relighter *r)
{
    return r->cache.transport;
}

bool relighter_is_complete(const struct relighter *r)
{
    return r->cache.transport && r->cache.indirect.indirect && !r->cache.building;
}

uint64_t relighter_memory(const struct relighter *r)
{
    const struct relight_cache *c = &r->cache;

    return r->set->gbuffer->bytes + (c->transport ? transport_stats(c->transport)->bytes : 0) +
           (c->indirect.indirect ? indirect_stats(c->indirect.indirect)->bytes : 0);
}

static bool can_deal(const struct relighter *r, const struct frame_plan *plan, const struct pass *s)
{
    const struct direct_desc *d = &s->direct;

    switch (s->kind) {
    case PASS_CACHED: return relighter_transport(r, plan) != NULL;
    case PASS_EYE: return !s->eye.counts && (!s->eye.only || s->eye.only == relighter_left(r));
    case PASS_DIRECT: return !d->only && !d->keep && !d->counts && !d->log && d->cells <= 1 && light_deals(d->method);
    case PASS_GLIDE:
    case PASS_FILTER:
    case PASS_ACCUMULATE:
    case PASS_LEAVE: return false;
    default: return true; /* the first process's */
    }
}

bool relighter_can_deal(const struct relighter *r, const struct frame_plan *plan)
{
    for (uint32_t k = 0; k < plan->count; k++)
        if (!can_deal(r, plan, &plan->pass[k]))
            return false;
    return !r->passes.backplate;
}

bool relighter_number_packets(struct relighter *r)
{
    const uint32_t count = r->set->gbuffer->packet_count;

    if (r->packets)
        return true;
    r->packets = mem_alloc_raw(count, sizeof(*r->packets));
    for (uint32_t k = 0; r->packets && k < count; k++)
        r->packets[k] = k;
    return r->packets != NULL;
}
