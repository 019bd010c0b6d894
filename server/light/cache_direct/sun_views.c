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

    *v = (struct sun_views){ .blocks = blocks, .chunk_count = blocks / (CHUNK / most) + 1, .bytes = bytes };
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

void sun_views_finish(struct sun_views *v)
{
    if (!v || !v->at)
        return;
    uint64_t bytes = v->blocks * sizeof(*v->at) + v->chunk_count * sizeof(*v->chunks);
    for (uint32_t k = 0; k < v->chunk_count; k++) {
        bytes += v->chunks[k] ? CHUNK * sizeof(uint16_t) : 0;
        mem_free(v->chunks[k]);
    }
    atomic_fetch_sub(v->bytes, bytes);
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

/* A place for so many units within one chunk. */
static uint32_t take_place(struct sun_views *v, uint32_t units)
{
    uint32_t used = atomic_load(&v->used), place;

    do
        place = used % CHUNK + units > CHUNK ? (used / CHUNK + 1) * CHUNK : used;
    while (!atomic_compare_exchange_weak(&v->used, &used, place + units));
    return place;
}

/* Makes sure that the chunk is there. */
static bool have_chunk(struct sun_views *v, uint32_t chunk)
{
    uint16_t *none = NULL, *made;

    if (chunk >= v->chunk_count)
        return false;
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
        const uint32_t place = take_place(v, (uint32_t)bytes / 2);
        if (!have_chunk(v, place / CHUNK))
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

/* The number of units, the places, and the chunks, the last one as far as it is used. */

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
        memcpy(to, v->chunks[from / CHUNK], bytes);
        to += bytes;
    }
    return to;
}

/* Whether the view lies within one chunk, with all its rows. */
static bool is_sound(const struct sun_views *v, uint32_t at, uint32_t packets)
{
    const uint32_t place = at - STORED, head = offsetof(struct sun_view, bits) / 2;
    uint32_t rows = 0;

    if (at < STORED)
        return true;
    if (place > v->used || v->used - place < head || place % CHUNK + head > CHUNK)
        return false;
    for (uint32_t k = 0; k < TRANSPORT_PACKETS; k++)
        rows += k < packets && view_at(v, place)->parts[k];
    return v->used - place >= head + rows * SUN_TILE && place % CHUNK + head + rows * SUN_TILE <= CHUNK;
}

enum err sun_views_load(struct sun_views *v, const struct transport_block *blocks, struct cache_reader *r,
                        struct reason *why)
{
    uint32_t used = 0;
    enum err e = cache_reader_get(r, &used, sizeof(used), why);

    if (!e && used > v->chunk_count * CHUNK)
        return cache_reader_refuse(r, why);
    e = e ? e : cache_reader_get(r, v->at, v->blocks * sizeof(*v->at), why);
    for (uint32_t from = 0; from < used && !e; from += CHUNK) {
        if (!have_chunk(v, from / CHUNK))
            return err_say(why, ERR_NOMEM, "no memory for what points see of the sun");
        e = cache_reader_get(r, v->chunks[from / CHUNK], (used - from < CHUNK ? used - from : CHUNK) * sizeof(uint16_t),
                             why);
    }
    v->used = used;
    for (uint32_t k = 0; k < v->blocks && !e; k++)
        if (!is_sound(v, v->at[k], blocks[k].packets))
            e = cache_reader_refuse(r, why);
    return e;
}
