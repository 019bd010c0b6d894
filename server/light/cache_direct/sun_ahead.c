/* The sun's way ahead of frames: what points see along it is asked for in the background, and kept in a file. */
#include "light/cache_direct/internal.h"
#include "light/cache_direct/sun_index.h"

#include "base/mem.h"
#include "base/vec.h"
#include "sky/tables/cube.h"

#include <math.h>
#include <string.h>

#define RIM 32 /* places of the disc's rim that are looked up, besides the middle: on its way none passes a texel by */

static enum err ask_for_disc(struct transport *t, const double w[3])
{
    const double flat = sqrt(w[0] * w[0] + w[2] * w[2]), across[3] = { w[2] / flat, 0.0, -w[0] / flat },
                 up[3] = { -w[1] * w[0] / flat, flat, -w[1] * w[2] / flat };
    enum err e = ERR_OK;

    for (int k = 0; k <= RIM && !e; k++) {
        const double r = k < RIM ? t->sun.radius : 0.0, turn = 2.0 * PI / RIM * k, c = r * cos(turn), s = r * sin(turn);
        float at[3], u, v;
        for (int i = 0; i < 3; i++)
            at[i] = (float)(w[i] + c * across[i] + s * up[i]);
        e = sun_spread_texel(t, &t->sun.later, t->sun.edge, SUN_GRID, cube_texel(t->sun.edge, at, &u, &v), NULL);
    }
    return e;
}

static void look_at_parts(const struct transport *t, uint32_t turn, uint32_t turns)
{
    const struct sun_parts *s = &t->sun.later;

#pragma omp parallel for schedule(dynamic, 2)
    for (uint32_t block = turn; block < t->block_count; block += turns) {
        struct sun_view own;
        uint64_t rays = 0;
        for (uint32_t k = 0; k < s->count; k++)
            sun_look(t, block, &s->at[k], &own, &rays);
    }
}

/* Between frames; one that awaits its turn goes first. */
static void lock_index(struct transport *t)
{
    pthread_mutex_lock(&t->lock);
    while (atomic_load(&t->awaits))
        pthread_cond_wait(&t->shaded, &t->lock);
}

/* How much is filled ahead; frames may take the rest. */
static uint64_t most_bytes(const struct transport *t)
{
    return t->index_bytes / 8 * 7;
}

enum err transport_look_at(struct transport *t, const double (*w)[3], uint32_t count, uint32_t turn, uint32_t turns,
                           uint64_t since)
{
    enum err e = ERR_OK;

    lock_index(t);
    if (!t->index || !(t->sun.radius > 0.0f))
        e = ERR_UNSUPPORTED;
    else
        sun_corners_frame(&t->index->later_corners, turns);
    if (!e && sun_index_bytes(t) > most_bytes(t))
        sun_index_make_room(t, most_bytes(t) / 8 * 7, since);
    t->sun.later.count = 0;
    for (uint32_t k = 0; k < count && !e; k++)
        e = ask_for_disc(t, w[k]);
    if (!e && sun_index_bytes(t) > most_bytes(t))
        e = ERR_RANGE;
    if (!e)
        look_at_parts(t, turn, turns);
    pthread_mutex_unlock(&t->lock);
    return e;
}

uint64_t transport_frames(const struct transport *t)
{
    return t->index ? t->index->frame : 0;
}

const float *transport_sun_axis(const struct transport *t)
{
    return t->sun.radius > 0.0f && t->sun.parts.count > 0 ? t->sun.axis : NULL;
}

/* ---- The file ---- */

static const char section[] = "sun"; /* the number of tiles; of each its key and its views (sun_views_save) */

uint32_t transport_sun_tiles(struct transport *t)
{
    lock_index(t);
    const uint32_t count = t->index ? t->index->count : 0;
    pthread_mutex_unlock(&t->lock);
    return count;
}

static size_t copy_size(const struct sun_index *x)
{
    size_t size = sizeof(x->count);

    for (uint32_t k = 0; k < x->count; k++)
        size += sizeof(x->entries[k].key) + sun_views_size(x->entries[k].views);
    return size;
}

static void copy_index(const struct sun_index *x, uint8_t *to)
{
    memcpy(to, &x->count, sizeof(x->count));
    to += sizeof(x->count);
    for (uint32_t k = 0; k < x->count; k++) {
        memcpy(to, &x->entries[k].key, sizeof(x->entries[k].key));
        to = sun_views_save(x->entries[k].views, to + sizeof(x->entries[k].key));
    }
}

/* Frames go on writing, so the file is written from a copy. A frame that comes meanwhile waits while memory is copied.
 */
enum err transport_copy_sun(struct transport *t, struct transport_sun_copy *out)
{
    size_t wanted = 1;

    *out = (struct transport_sun_copy){ .size = 0 };
    while (out->size < wanted) { /* frames may have added to it */
        mem_free(out->bytes);
        *out = (struct transport_sun_copy){ mem_alloc_large_raw(wanted, 1), wanted };
        if (!out->bytes)
            return ERR_NOMEM;
        lock_index(t);
        wanted = t->index ? copy_size(t->index) : 0;
        if (wanted > 0 && wanted <= out->size)
            copy_index(t->index, out->bytes);
        pthread_mutex_unlock(&t->lock);
    }
    out->size = wanted;
    return wanted > 0 ? ERR_OK : ERR_END;
}

void transport_save_sun(const struct transport_sun_copy *c, const struct digest *key, struct cache_writer *w)
{
    cache_writer_section(w, section, key);
    cache_writer_put(w, c->bytes, c->size);
}

#define TILES (6u * SUN_GRID / SUN_EDGE * (SUN_GRID / SUN_EDGE)) /* no file has more */

/* Tiles from a file, before the last byte is checked. */
struct loaded {
    struct sun_entry *entries;
    uint32_t count, read;
    _Atomic uint64_t bytes;
};

static enum err read_entry(struct cache_reader *r, struct transport *t, struct loaded *l, struct reason *why)
{
    struct sun_entry *e = &l->entries[l->read++];
    enum err result = cache_reader_get(r, &e->key, sizeof(e->key), why);

    if (!result && !sun_key_is_sound(e->key))
        result = cache_reader_refuse(r, why);
    if (!result &&
        (!(e->views = mem_alloc(1, sizeof(*e->views))) || sun_views_begin(e->views, t->block_count, &l->bytes)))
        result = err_say(why, ERR_NOMEM, "no memory for what points see of the sun");
    result = result ? result : sun_views_load(e->views, t->blocks, r, why);
    if (!result && l->bytes > most_bytes(t))
        result = err_say(why, ERR_RANGE, "what it knows of the sun needs more than --cache-memory has for it");
    return result;
}

/* Takes over the views of a tile that frames have not asked for yet; it goes before all that they ask for. */
static void adopt(struct transport *t, struct sun_entry *e)
{
    const uint32_t before = t->index->count;
    const int64_t at = sun_index_find(t, e->key);

    if (at < before) /* frames have it, or there is no memory */
        return;
    struct sun_views *empty = t->index->entries[at].views;
    t->index->entries[at].views = e->views;
    t->index->entries[at].used = 0;
    sun_views_count(e->views, &t->index->bytes);
    e->views = empty;
}

static enum err read_all(struct transport *t, struct cache_reader *r, const struct digest *key, struct loaded *l,
                         struct reason *why)
{
    enum err e = cache_reader_find(r, section, key, why);

    e = e ? e : cache_reader_get(r, &l->count, sizeof(l->count), why);
    if (!e && l->count > TILES)
        e = cache_reader_refuse(r, why);
    if (!e && !(l->entries = mem_alloc(l->count + 1, sizeof(*l->entries))))
        e = err_say(why, ERR_NOMEM, "no memory for what points see of the sun");
    while (!e && l->read < l->count)
        e = read_entry(r, t, l, why);
    return e ? e : cache_reader_end(r, why);
}

enum err transport_load_sun(struct transport *t, struct cache_reader *r, const struct digest *key, struct reason *why)
{
    struct loaded l = { .entries = NULL };
    const enum err e = read_all(t, r, key, &l, why);

    lock_index(t);
    for (uint32_t k = 0; k < l.read; k++) {
        if (!e && sun_index_bytes(t) < most_bytes(t))
            adopt(t, &l.entries[k]);
        sun_views_finish(l.entries[k].views);
        mem_free(l.entries[k].views);
    }
    pthread_mutex_unlock(&t->lock);
    mem_free(l.entries);
    return e;
}
