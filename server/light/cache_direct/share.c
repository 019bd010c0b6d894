/* A cache of direct light in several processes (light/cache/cache_share.h): its blocks are the units. */
#include "base/mem.h"
#include "light/cache/cache_share.h"
#include "light/cache/memory.h"
#include "light/cache_direct/internal.h"

#define NARROW_MOST 4 /* one process lights all narrow lobes if they are at most a part's packets / this */

bool transport_narrow_is_few(const struct transport *t, uint32_t count)
{
    return t->narrow.count * (uint64_t)NARROW_MOST * count <= t->gbuffer->packet_count;
}

bool transport_keeps(const struct transport *t, const struct cache_share *s, uint32_t packet)
{
    const struct transport_block *b = s && s->end > 0 ? transport_block_of(t, packet) : NULL;

    return !b || cache_share_needs(s, b->first) || (b->narrow && s->index == 0 && transport_narrow_is_few(t, s->count));
}

void transport_keep(struct transport *t, const struct cache_share *s)
{
    if (!s || s->end == 0)
        return;
    for (uint32_t k = 0; k < t->block_count; k++) {
        struct transport_block *b = &t->blocks[k];
        if (transport_keeps(t, s, b->first))
            continue;
        b->freed += (uint32_t)transport_block_bytes(b);
        for (uint32_t r = 0; t->bytes && r < TRANSPORT_ROWS; r++)
            b->pieces[r].bytes = NULL; /* they belong to t->bytes */
        transport_block_finish(b);
    }
    if (t->bytes)
        transport_gather_again(t);
    transport_count_kept(t, s);
}

static enum err pack(const struct transport *t, const struct cache_share *s, uint64_t rays, uint8_t **bytes,
                     size_t *size)
{
    static const struct digest none;
    struct cache_writer *w = cache_writer_create();

    if (!w)
        return ERR_NOMEM;
    transport_save_blocks(t, s->index, s->count, &rays, &none, w);
    const enum err e = cache_writer_bytes(w, bytes, size);
    cache_writer_destroy(w);
    return e;
}

static enum err unpack(struct transport *t, const struct cache_share *s, uint32_t from, const uint8_t *bytes,
                       size_t size, struct reason *why)
{
    static const struct digest none;
    struct cache_reader *r;
    enum err e = cache_reader_take("another rank", bytes, size, &r, why);

    if (!e)
        e = transport_load_blocks(r, &none, from, s->count, cache_share_takes_all(s) ? NULL : s, t, why);
    cache_reader_close(r);
    return e;
}

enum err transport_exchange(struct transport *t, const struct transport_desc *desc, struct reason *why)
{
    const struct cache_share *s = desc->share;
    const uint64_t rays = t->stats.rays; /* of this process */
    enum err e = ERR_OK;

    for (uint32_t from = 0; from < s->count; from++) { /* to the end even after an error, as the others do */
        uint8_t *bytes = NULL;
        size_t size = 0;
        enum err one = from == s->index ? pack(t, s, rays, &bytes, &size) : ERR_OK;
        if (one) /* nothing is passed, and all say so */
            err_say(why, one, "out of memory for the cache of direct light");
        const enum err passed = s->pass(s->context, from, &bytes, &size);
        one = one ? one : passed;
        if (!one && from != s->index && !e)
            one = unpack(t, s, from, bytes, size, why);
        mem_free(bytes);
        e = e ? e : one;
    }
    if (!e && !cache_share_takes_all(s))
        transport_keep(t, s);
    transport_count_kept(t, cache_share_takes_all(s) ? NULL : s);
    if (!e && s->end == 0 && !cache_memory_suffices(desc->max_bytes, t->stats.bytes))
        e = transport_say_too_large(t, t->stats.bytes, t->block_count, desc->max_bytes, why);
    return s->agree(s->context, e, why);
}
