/* A cache of indirect light in several processes (light/cache/cache_share.h): its groups are the units. */
#include "base/mem.h"
#include "light/cache/cache_share.h"
#include "light/cache_indirect/internal.h"

#include <string.h>

static const char section[] = "groups";

bool indirect_keeps(const struct indirect_cache *b, const struct transport *direct, const struct cache_share *s,
                  const struct indirect_group *g)
{
    for (uint32_t i = g->first; i < g->first + g->count; i++)
        if (transport_keeps(direct, s, b->blocks[i].first))
            return true;
    return false;
}

void indirect_drop_group(struct indirect_cache *b, struct indirect_group *g)
{
    for (uint32_t r = 0; r < TRANSPORT_ROWS; r++) {
        mem_free(g->pieces[r].bytes);
        g->pieces[r] = (struct indirect_piece){ .bytes = NULL };
    }
    for (uint32_t i = g->first; i < g->first + g->count; i++)
        memset(b->blocks[i].rank, 0, sizeof(b->blocks[i].rank));
}

/* Removes blocks that are not needed from the stream, in which blocks are in the order of their packets. */
static enum err shorten(struct indirect_cache *b, const struct transport *direct, const struct cache_share *s)
{
    const uint32_t packets = b->gbuffer->packet_count;
    size_t to = 0, end;

    for (uint32_t p = 0, next; p < packets; p = next) {
        for (next = p + 1; next < packets && b->places[next].packets == 0; next++)
            ;
        if (b->places[p].packets == 0)
            continue;
        const size_t at = (size_t)b->places[p].at * 8;
        end = next < packets ? (size_t)b->places[next].at * 8 : b->stream_size;
        if (!transport_keeps(direct, s, p)) {
            b->places[p] = (struct indirect_place){ .packets = 0 };
            continue;
        }
        memmove(b->stream + to, b->stream + at, end - at);
        b->places[p].at = (uint32_t)(to / 8);
        to += end - at;
    }
    uint8_t *stream = mem_alloc_raw(to + 1, 1);
    if (!stream)
        return ERR_NOMEM;
    memcpy(stream, b->stream, to);
    mem_free(b->stream);
    b->stream = stream;
    b->stats.bytes -= b->stream_size - to;
    b->stream_size = to;
    return ERR_OK;
}

enum err indirect_keep(struct indirect_cache *b, const struct transport *direct, const struct cache_share *s)
{
    if (!s || s->end == 0)
        return ERR_OK;
    for (uint32_t k = 0; k < b->group_count; k++) {
        struct indirect_group *g = &b->groups[k];
        if (indirect_keeps(b, direct, s, g))
            continue;
        for (uint32_t r = 0; r < g->rows; r++) {
            b->stats.bytes -= g->pieces[r].bytes ? (size_t)g->pieces[r].rank * 3 * g->pieces[r].basis : 0;
            mem_free(g->pieces[r].bytes);
            g->pieces[r].bytes = NULL;
        }
    }
    return shorten(b, direct, s);
}

/* The light of two records is a unit. Packs that of process `from`, or unpacks it. */
static void move_light(struct indirect_build *b, uint32_t from, uint8_t *bytes, bool packs)
{
    const size_t size = 2 * SKY_CELLS * sizeof(*b->light);

    for (uint32_t r = 2 * from; r < b->records.count; r += 2 * b->desc->share->count, bytes += size) {
        uint16_t *light = b->light + (size_t)r * SKY_CELLS;
        memcpy(packs ? (void *)bytes : light, packs ? (const void *)light : bytes, size);
    }
}

enum err indirect_exchange_light(struct indirect_build *b)
{
    const struct cache_share *s = b->desc->share;
    enum err e = ERR_OK;

    for (uint32_t from = 0; from < s->count; from++) {
        const uint32_t pairs = (b->records.count + 1) / 2, units = (pairs + s->count - 1 - from) / s->count;
        const size_t all = units * 2 * SKY_CELLS * sizeof(*b->light);
        uint8_t *bytes = from == s->index ? mem_alloc_raw(all + 1, 1) : NULL;
        size_t size = bytes ? all : 0;
        if (bytes)
            move_light(b, from, bytes, true);
        enum err one = from == s->index && !bytes ? ERR_NOMEM : ERR_OK;
        const enum err passed = s->pass(s->context, from, &bytes, &size);
        one = one ? one : passed ? passed : size == all ? ERR_OK : ERR_FORMAT;
        if (!one && from != s->index)
            move_light(b, from, bytes, false);
        mem_free(bytes);
        e = e ? e : one;
    }
    return e;
}

static enum err pack(const struct indirect_build *b, uint8_t **bytes, size_t *size)
{
    static const struct digest none;
    const struct cache_share *s = b->desc->share;
    struct cache_writer *w = cache_writer_create();

    if (!w)
        return ERR_NOMEM;
    cache_writer_section(w, section, &none);
    cache_writer_put(w, &b->own_rays, sizeof(b->own_rays));
    for (uint32_t k = s->index; k < b->b->group_count; k += s->count)
        indirect_save_group(b->b, &b->b->groups[k], w);
    const enum err e = cache_writer_bytes(w, bytes, size);
    cache_writer_destroy(w);
    return e;
}

static enum err unpack(struct indirect_build *b, uint32_t from, const uint8_t *bytes, size_t size, uint64_t *held,
                       struct reason *why)
{
    static const struct digest none;
    const struct cache_share *s = b->desc->share;
    struct cache_reader *r;
    uint64_t rays = 0;
    enum err e = cache_reader_take("another rank", bytes, size, &r, why);

    if (!e)
        e = cache_reader_find(r, section, &none, why);
    if (!e)
        e = cache_reader_get(r, &rays, sizeof(rays), why);
    b->b->stats.rays += rays;
    for (uint32_t k = from; k < b->b->group_count && !e; k += s->count) {
        struct indirect_group *g = &b->b->groups[k];
        const uint64_t before = *held;
        e = indirect_load_group(r, b->b, g, held, b->desc->max_bytes, why);
        if (!cache_share_takes_all(s) && !indirect_keeps(b->b, b->desc->direct, s, g)) {
            indirect_drop_group(b->b, g);
            *held = before;
        }
    }
    if (!e)
        e = cache_reader_end(r, why);
    cache_reader_close(r);
    return e;
}

enum err indirect_exchange(struct indirect_build *b, struct reason *why)
{
    const struct cache_share *s = b->desc->share;
    uint64_t held = b->b->stats.bytes;
    enum err e = ERR_OK;

    for (uint32_t k = s->index; k < b->b->group_count; k += s->count)
        for (uint32_t r = 0; r < b->b->groups[k].rows && s->end == 0; r++)
            held += indirect_piece_bytes(&b->b->groups[k], b->b->blocks + b->b->groups[k].first, r);

    for (uint32_t from = 0; from < s->count; from++) { /* to the end even after an error, as the others do */
        uint8_t *bytes = NULL;
        size_t size = 0;
        enum err one = from == s->index ? pack(b, &bytes, &size) : ERR_OK;
        if (one)
            err_say(why, one, "out of memory for the cache of indirect light");
        const enum err passed = s->pass(s->context, from, &bytes, &size);
        one = one ? one : passed;
        if (!one && from != s->index && !e)
            one = unpack(b, from, bytes, size, &held, why);
        mem_free(bytes);
        e = e ? e : one;
    }
    for (uint32_t k = s->index; k < b->b->group_count && !cache_share_takes_all(s); k += s->count)
        if (!indirect_keeps(b->b, b->desc->direct, s, &b->b->groups[k]))
            indirect_drop_group(b->b, &b->b->groups[k]);
    return s->agree(s->context, e, why);
}
