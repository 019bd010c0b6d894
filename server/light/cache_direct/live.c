#include "light/cache_direct/live.h"

#include "base/mem.h"
#include "light/cache_direct/internal.h"

#include <pthread.h>

struct transport_live {
    struct transport *cache; /* the frame's thread */
    struct transport *built; /* the builder; its pieces' bytes belong to the slots and to `cache` */
    struct transport_desc desc;
    struct transport_block *_Atomic *slots; /* [block_count]: finished and not collected yet, or NULL */
    uint32_t *block_bytes;                  /* [block_count]: of the newest version */
    uint64_t base;                          /* bytes apart from pieces */
    atomic_bool cancelled, complete;
    _Atomic uint64_t steps[TRANSPORT_STAGES]; /* packets built */
    _Atomic uint64_t held;                    /* bytes of all pieces, */
    _Atomic uint64_t newest;                  /* and of the newest versions, the only ones that frames will keep */

    pthread_mutex_t lock;
    pthread_cond_t freed;
    uint64_t waiting; /* {lock} finished blocks that have not replaced their previous version yet */
};

static void block_free(struct transport_live *live, struct transport_block *b)
{
    atomic_fetch_sub(&live->held, transport_block_bytes(b));
    transport_block_finish(b);
}

static void settle_count(struct transport_live *live, uint64_t count)
{
    if (count == 0)
        return;
    pthread_mutex_lock(&live->lock);
    live->waiting -= count;
    pthread_cond_broadcast(&live->freed);
    pthread_mutex_unlock(&live->lock);
}

enum err transport_live_create(const struct gbuffer *g, const struct rays *rays, const struct kernels *kernels,
                               const struct transport_desc *desc, struct transport_live **out, struct reason *why)
{
    struct transport_live *live = mem_alloc(1, sizeof(*live));

    *out = NULL;
    if (!live)
        return err_say(why, ERR_NOMEM, "out of memory for the cache of direct light");
    pthread_mutex_init(&live->lock, NULL);
    pthread_cond_init(&live->freed, NULL);
    live->desc = transport_resolve(desc);
    live->desc.progress = NULL;
    live->desc.cancel = &live->cancelled;
    live->cache = transport_begin(g, rays, kernels, desc);
    live->built = transport_begin(g, rays, kernels, desc);
    if (live->cache && live->built) {
        const uint32_t count = live->built->block_count;
        live->base = live->built->stats.bytes;
        live->slots = mem_alloc(count, sizeof(*live->slots));
        live->block_bytes = mem_alloc(count, sizeof(*live->block_bytes));
        live->cache->unbuilt_index = mem_alloc(g->packet_count, sizeof(*live->cache->unbuilt_index));
    }
    if (!live->slots || !live->block_bytes || !live->cache->unbuilt_index) {
        transport_live_destroy(live);
        return err_say(why, ERR_NOMEM, "out of memory for the cache of direct light");
    }
    *out = live;
    transport_live_advance(live);
    return ERR_OK;
}

void transport_live_destroy(struct transport_live *live)
{
    if (!live)
        return;
    for (uint32_t k = 0; live->slots && k < live->built->block_count; k++) {
        struct transport_block *b = atomic_load(&live->slots[k]);
        if (b)
            block_free(live, b);
        mem_free(b);
    }
    for (uint32_t k = 0; live->built && k < live->built->block_count; k++)
        live->built->blocks[k] = (struct transport_block){ .rows = 0 };
    transport_destroy(live->cache);
    transport_destroy(live->built);
    mem_free(live->slots);
    mem_free(live->block_bytes);
    pthread_mutex_destroy(&live->lock);
    pthread_cond_destroy(&live->freed);
    mem_free(live);
}

/* ---- The builder ---- */

/* While the limit is exceeded, waits for frames to free memory, if they will free enough. */
static void wait_for_room(struct transport_live *live)
{
    const uint64_t most = live->desc.max_bytes;

    pthread_mutex_lock(&live->lock);
    while (live->waiting > 0 && !live->cancelled &&
           transport_live_waits(most, live->base + live->held, live->base + live->newest))
        pthread_cond_wait(&live->freed, &live->lock);
    pthread_mutex_unlock(&live->lock);
}

/* Replaces a version in the slot that no frame has collected yet. */
enum err transport_live_publish(struct transport_live *live, uint32_t index, const struct transport_block *b, bool fine)
{
    struct transport_block *mine = mem_alloc_raw(1, sizeof(*mine));
    const uint64_t bytes = transport_block_bytes(b);

    if (!mine)
        return ERR_NOMEM;
    *mine = *b;
    mine->built = true;
    atomic_fetch_add(&live->held, bytes);
    atomic_fetch_add(&live->newest, bytes - live->block_bytes[index]);
    live->block_bytes[index] = (uint32_t)bytes;
    pthread_mutex_lock(&live->lock);
    live->waiting++;
    pthread_mutex_unlock(&live->lock);
    struct transport_block *unseen = atomic_exchange(&live->slots[index], mine);
    if (unseen) {
        block_free(live, unseen);
        mem_free(unseen);
        settle_count(live, 1);
    }
    atomic_fetch_add(&live->steps[fine ? TRANSPORT_FINE : TRANSPORT_COARSE], b->packets);
    wait_for_room(live);
    return ERR_OK;
}

uint64_t transport_live_bytes(struct transport_live *live)
{
    return live->base + live->newest;
}

enum err transport_live_build(struct transport_live *live, enum transport_stage stage, uint32_t threads,
                              struct reason *why)
{
    bool all;

    const enum err e = transport_build(live->built, &live->desc, stage == TRANSPORT_COARSE, threads, live, &all, why);
    if (!e && all && stage == TRANSPORT_FINE)
        atomic_store(&live->complete, true);
    return e;
}

const struct transport *transport_live_built(const struct transport_live *live)
{
    return atomic_load(&live->complete) ? live->built : NULL;
}

const struct transport *transport_live_layout(const struct transport_live *live)
{
    return live->built;
}

void transport_live_cancel(struct transport_live *live)
{
    atomic_store(&live->cancelled, true);
    pthread_mutex_lock(&live->lock);
    pthread_cond_broadcast(&live->freed);
    pthread_mutex_unlock(&live->lock);
}

double transport_live_share(const struct transport_live *live, enum transport_stage stage)
{
    const uint32_t all = live->built->stats.packets;
    return all > 0 ? (double)atomic_load(&live->steps[stage]) / all : 1.0;
}

/* ---- The frame's thread ---- */

struct transport *transport_live_cache(struct transport_live *live)
{
    return live->cache;
}

/* Lists the packets that other means must light. */
static void list_unbuilt(struct transport *t)
{
    t->unbuilt = (struct packet_list){ t->unbuilt_index, 0 };
    for (uint32_t k = 0; k < t->block_count; k++)
        for (uint32_t i = 0; i < t->blocks[k].packets && !t->blocks[k].built; i++)
            t->unbuilt_index[t->unbuilt.count++] = t->blocks[k].first + i;
}

void transport_live_advance(struct transport_live *live)
{
    struct transport *t = live->cache;
    const bool complete = atomic_load(&live->complete); /* then all remaining blocks are in the slots */
    uint32_t replaced = 0;

    if (!t->unbuilt_index)
        return;
    for (uint32_t k = 0; k < t->block_count; k++) {
        struct transport_block *next = atomic_exchange(&live->slots[k], NULL);
        if (!next)
            continue;
        block_free(live, &t->blocks[k]);
        t->blocks[k] = *next;
        transport_sun_forget(t, k);
        mem_free(next);
        replaced++;
    }
    settle_count(live, replaced);
    list_unbuilt(t);
    t->stats.bytes = live->base + atomic_load(&live->held);
    if (!complete)
        return;
    mem_free(t->unbuilt_index);
    t->unbuilt_index = NULL;
    t->stats = live->built->stats;
}
