#include "light/cache_direct/sun_views.h"

#include "base/mem.h"

#include <stddef.h>
#include <string.h>

#define CHUNK 4096 /* units of two bytes */

enum { UNSEEN, LIT, DARK, STORED }; /* and places from STORED on */

struct sun_view sun_all_lit = { .whole = { UINT16_MAX, UINT16_MAX, UINT16_MAX, UINT16_MAX } }, sun_all_dark;

enum err sun_views_begin(struct sun_views *v, uint32_t blocks, _Atomic uint64_t *bytes)
{
    const uint32_t most = sizeof(struct sun_view) / 2;

    *v = (struct sun_views){ .blocks = blocks, .chunk_count = 2 * blocks / (CHUNK / most) + 1, .bytes = bytes };
    v->at = mem_alloc(blocks, sizeof(*v->at));
    v->chunks = mem_alloc(v->chunk_count, sizeof(*v->chunks));
    if (!v->at || !v->chunks) {
        mem_free(v->at);
        mem_free(v->chunks);
        v->at = NULL;
        return ERR_NOMEM;
    }
    atomic_fetch_add(bytes, blocks * sizeof(*v->at) + v->chunk_count * sizeof(*v->chunks));
    return ERR_OK;
}

static uint64_t bytes_of(const struct sun_views *v)
{
    uint64_t bytes = v->blocks * sizeof(*v->at) + v->chunk_count * sizeof(*v->chunks);

    for (uint32_t k = 0; k < v->chunk_count; k++)
        bytes += v->chunks[k] ? CHUNK * sizeof(uint16_t) : 0;
    return bytes;
}

void sun_views_count(struct sun_views *v, _Atomic uint64_t *bytes)
{
    const uint64_t own = bytes_of(v);

    atomic_fetch_sub(v->bytes, own);
    atomic_fetch_add(bytes, own);
    v->bytes = bytes;
}

void sun_views_finish(struct sun_views *v)
{
    if (!v || !v->at)
        return;
    atomic_fetch_sub(v->bytes, bytes_of(v));
    for (uint32_t k = 0; k < v->chunk_count; k++)
        mem_free(v->chunks[k]);
    mem_free(v->chunks);
    mem_free(v->at);
}

static struct sun_view *view_at(const struct sun_views *v, uint32_t place)
{
    return (struct sun_view *)(v->chunks[place / CHUNK] + place % CHUNK);
}

struct sun_view *sun_views_get(const struct sun_views *v, uint32_t block)
{
    const uint32_t at = v->at[block];

    return at >= STORED ? view_at(v, at - STORED) : at == LIT ? &sun_all_lit : at == DARK ? &sun_all_dark : NULL;
}

/* A place for so many units within one chunk; false: all chunks are used, by views that have been forgotten. */
static bool take_place(struct sun_views *v, uint32_t units, uint32_t *place)
{
    uint32_t used = atomic_load(&v->used);

    do {
        *place = used % CHUNK + units > CHUNK ? (used / CHUNK + 1) * CHUNK : used;
        if (*place / CHUNK >= v->chunk_count)
            return false;
    } while (!atomic_compare_exchange_weak(&v->used, &used, *place + units));
    return true;
}

/* Makes sure that the chunk is there. */
static bool have_chunk(struct sun_views *v, uint32_t chunk)
{
    uint16_t *none = NULL, *made;

    if (atomic_load(&v->chunks[chunk]))
        return true;
    made = mem_alloc(CHUNK, sizeof(*made));
    if (!made)
        return false;
    if (atomic_compare_exchange_strong(&v->chunks[chunk], &none, made))
        atomic_fetch_add(v->bytes, CHUNK * sizeof(*made));
    else
        mem_free(made);
    return true;
}

struct sun_view *sun_views_put(struct sun_views *v, uint32_t block, const struct sun_view *view, uint32_t packets,
                               uint32_t rows)
{
    const size_t used = packets * sizeof(*view->whole), bytes = offsetof(struct sun_view, bits[rows]);

    if (!memcmp(view->whole, sun_all_lit.whole, used)) {
        v->at[block] = LIT;
    } else if (!rows && !memcmp(view->whole, sun_all_dark.whole, used)) {
        v->at[block] = DARK;
    } else {
        uint32_t place;
        if (!take_place(v, (uint32_t)bytes / 2, &place) || !have_chunk(v, place / CHUNK))
            return NULL;
        memcpy(view_at(v, place), view, bytes);
        v->at[block] = STORED + place;
    }
    return sun_views_get(v, block);
}

void sun_views_forget(struct sun_views *v, uint32_t block)
{
    v->at[block] = UNSEEN;
}

/* ---- The file ---- */

/* The number of units, the places, and the units of all chunks. */

size_t sun_views_size(const struct sun_views *v)
{
    return sizeof(uint32_t) + v->blocks * sizeof(*v->at) + v->used * sizeof(uint16_t);
}

uint8_t *sun_views_save(const struct sun_views *v, uint8_t *to)
{
    const uint32_t used = v->used;

    memcpy(to, &used, sizeof(used));
    to += sizeof(used);
    memcpy(to, v->at, v->blocks * sizeof(*v->at));
    to += v->blocks * sizeof(*v->at);
    for (uint32_t from = 0; from < used; from += CHUNK) {
        const size_t bytes = (used - from < CHUNK ? used - from : CHUNK) * sizeof(uint16_t);
        if (v->chunks[from / CHUNK])
            memcpy(to, v->chunks[from / CHUNK], bytes);
        else /* there was no memory for it, and no view lies there */
            memset(to, 0, bytes);
        to += bytes;
    }
    return to;
}

/* Puts a view of the file's units anew, so that none shares memory with another, whatever the file says. */
static enum err put_again(struct sun_views *v, uint32_t block, uint32_t packets, uint32_t at, const uint16_t *units,
                          uint32_t used)
{
    const uint32_t head = offsetof(struct sun_view, bits) / 2, place = at - STORED;
    struct sun_view view = { .known = 0 };
    uint32_t rows = 0;

    if (at < STORED) {
        v->at[block] = at;
        return ERR_OK;
    }
    if (place > used || used - place < head)
        return ERR_FORMAT;
    memcpy(&view, units + place, head * sizeof(*units));
    for (uint32_t k = 0; k < packets; k++)
        rows += view.parts[k] != 0;
    if (used - place < head + rows * SUN_TILE)
        return ERR_FORMAT;
    memcpy(view.bits, units + place + head, rows * sizeof(view.bits[0]));
    return sun_views_put(v, block, &view, packets, rows) ? ERR_OK : ERR_NOMEM;
}

enum err sun_views_load(struct sun_views *v, const struct transport_block *blocks, struct cache_reader *r,
                        struct reason *why)
{
    uint32_t used = 0;
    enum err e = cache_reader_get(r, &used, sizeof(used), why);

    if (!e && used > v->chunk_count * CHUNK)
        return cache_reader_refuse(r, why);
    if (e)
        return e;
    uint32_t *at = mem_alloc_raw(v->blocks + 1, sizeof(*at));
    uint16_t *units = mem_alloc_raw(used + 1, sizeof(*units));
    e = at && units ? cache_reader_get(r, at, v->blocks * sizeof(*at), why)
                    : err_say(why, ERR_NOMEM, "no memory for what points see of the sun");
    e = e ? e : cache_reader_get(r, units, used * sizeof(*units), why);
    for (uint32_t k = 0; k < v->blocks && !e; k++) {
        e = put_again(v, k, blocks[k].packets, at[k], units, used);
        if (e == ERR_FORMAT)
            cache_reader_refuse(r, why);
        else if (e)
            err_say(why, e, "no memory for what points see of the sun");
    }
    mem_free(units);
    mem_free(at);
    return e;
}
