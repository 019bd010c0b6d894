/* The sun's way ahead of frames: what points see along it is asked for in the background, and kept in a file. */
#include "light/cache_direct/internal.h"
#include "light/cache_direct/sun_index.h"

#include "base/mem.h"
#include "base/vec.h"
#include "sky/tables/cube.h"

#include <math.h>
#include <string.h>

#define WIDEST 0.02f /* radius of a sun whose way is asked for, radians */
#define RIM 16       /* places of the disc's rim that are looked up, besides the middle */

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

bool transport_look_at(struct transport *t, const double (*w)[3], uint32_t count, uint32_t turn, uint32_t turns,
                       uint64_t since)
{
    enum err e = ERR_OK;

    lock_index(t);
    if (!t->index || !(t->sun.radius > 0.0f && t->sun.radius < WIDEST))
        e = ERR_UNSUPPORTED;
    if (!e)
        sun_index_make_room(t, most_bytes(t), since);
    t->sun.later.count = 0;
    for (uint32_t k = 0; k < count && !e; k++)
        e = ask_for_disc(t, w[k]);
    if (!e && t->index->bytes > most_bytes(t))
        e = ERR_RANGE;
    if (!e)
        look_at_parts(t, turn, turns);
    pthread_mutex_unlock(&t->lock);
    return !e;
}

uint64_t transport_frames(const struct transport *t)
{
    return t->index ? t->index->frame : 0;
}

const float *transport_sun_axis(const struct transport *t)
{
    return t->sun.axis;
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

/* A copy, since frames go on writing. Frames that come meanwhile wait for some hundredths of a second. */
static enum err copy_index(struct transport *t, struct transport_sun_copy *out)
{
    const struct sun_index *x = t->index;
    size_t size = sizeof(x->count);

    for (uint32_t k = 0; k < x->count; k++)
        size += sizeof(x->entries[k].key) + sun_views_size(x->entries[k].views);
    uint8_t *to = mem_alloc_large(size, 1);
    *out = (struct transport_sun_copy){ to, size };
    if (!to)
        return ERR_NOMEM;
    memcpy(to, &x->count, sizeof(x->count));
    to += sizeof(x->count);
    for (uint32_t k = 0; k < x->count; k++) {
        memcpy(to, &x->entries[k].key, sizeof(x->entries[k].key));
        to = sun_views_save(x->entries[k].views, to + sizeof(x->entries[k].key));
    }
    return ERR_OK;
}

enum err transport_copy_sun(struct transport *t, struct transport_sun_copy *out)
{
    lock_index(t);
    const enum err e = t->index ? copy_index(t, out) : ERR_END;
    pthread_mutex_unlock(&t->lock);
    return e;
}

void transport_save_sun(const struct transport_sun_copy *c, const struct digest *key, struct cache_writer *w)
{
    cache_writer_section(w, section, key);
    cache_writer_put(w, c->bytes, c->size);
}

static enum err read_entry(struct cache_reader *r, struct transport *t, struct sun_entry *e, struct reason *why)
{
    enum err result = cache_reader_get(r, &e->key, sizeof(e->key), why);

    if (!result && !sun_key_is_sound(e->key))
        result = cache_reader_refuse(r, why);
    if (!result &&
        (!(e->views = mem_alloc(1, sizeof(*e->views))) || sun_views_begin(e->views, t->block_count, &t->index->bytes)))
        result = err_say(why, ERR_NOMEM, "no memory for what points see of the sun");
    return result ? result : sun_views_load(e->views, t->blocks, r, why);
}

/* Takes over the views of a tile that frames have not asked for yet. */
static void adopt(struct transport *t, struct sun_entry *e)
{
    const int64_t at = sun_index_find(t, e->key);

    if (at < 0)
        return;
    struct sun_views *mine = t->index->entries[at].views;
    if (mine->used == 0) {
        t->index->entries[at].views = e->views;
        e->views = mine;
    }
}

enum err transport_load_sun(struct transport *t, struct cache_reader *r, const struct digest *key, struct reason *why)
{
    uint32_t count = 0, read = 0;
    enum err e = cache_reader_find(r, section, key, why);

    e = e ? e : cache_reader_get(r, &count, sizeof(count), why);
    struct sun_entry *entries = e ? NULL : mem_alloc(count, sizeof(*entries));
    if (!e && !entries)
        e = err_say(why, ERR_NOMEM, "no memory for what points see of the sun");
    while (!e && read < count)
        e = read_entry(r, t, &entries[read++], why);
    e = e ? e : cache_reader_end(r, why);
    lock_index(t);
    for (uint32_t k = 0; k < read; k++) {
        if (!e && t->index->bytes < most_bytes(t))
            adopt(t, &entries[k]);
        sun_views_finish(entries[k].views);
        mem_free(entries[k].views);
    }
    pthread_mutex_unlock(&t->lock);
    mem_free(entries);
    return e;
}
