#include "light/cache_direct/transport.h"

#include "base/mem.h"
#include "light/cache/cache_share.h"
#include "light/cache/memory.h"
#include "light/cache_direct/internal.h"
#include "light/estimators/packed.h"
#include "scene/geometry/scene_digest.h"

#include <math.h>
#include <string.h>

/* Increase it when the transport of the same scene (directions, weights, rows, blocks) or the file format changes. */
#define FORMAT 8

/* One section: the number of rays, then block by block the pieces, each behind its shape, the gazes and the sight. */
static const char section[] = "transport";

_Static_assert(sizeof(struct transport_shape) == 108, "no padding");

struct digest transport_key(const struct gbuffer *g, const struct scene *scene, const struct transport_desc *desc)
{
    const struct transport_desc d = transport_resolve(desc);
    const float numbers[] = { d.tolerance, d.tolerance_glossy, TRANSPORT_EXPONENT, TRANSPORT_ALPHA };
    struct digest key = { { 0 } };

    digest_u64(&key, FORMAT);
    digest_u64(&key, SKY_EDGE);
    digest_u64(&key, TRANSPORT_POINTS);
    digest_u64(&key, (uint64_t)d.per_cell << 32 | d.lobe_samples);
    digest_u64(&key, d.seed);
    digest_u64(&key, d.no_visibility);
    digest_bytes(&key, numbers, sizeof(numbers));
    digest_points(&key, g);
    digest_geometry(&key, scene);
    return key;
}

void transport_save(const struct transport *t, const struct digest *key, struct cache_writer *w)
{
    transport_save_blocks(t, 0, 1, &t->stats.rays, key, w);
}

void transport_save_blocks(const struct transport *t, uint32_t first, uint32_t step, const uint64_t *rays,
                           const struct digest *key, struct cache_writer *w)
{
    cache_writer_section(w, section, key);
    cache_writer_put(w, rays, sizeof(*rays));
    for (uint32_t k = first; k < t->block_count; k += step) {
        const struct transport_block *b = &t->blocks[k];
        for (uint32_t r = 0; r < b->rows; r++) {
            const struct transport_piece *q = &b->pieces[r];
            cache_writer_put(w, &q->shape, sizeof(q->shape));
            cache_writer_put(w, q->bytes, (size_t)transport_piece_bytes(q, b->packets * PACKET));
        }
        cache_writer_put(w, b->gazes, (size_t)transport_gaze_bytes(b));
        cache_writer_put(w, b->sight, sizeof(*b->sight));
    }
}

/* ---- Loading ---- */

static enum err no_memory(struct reason *why)
{
    return err_say(why, ERR_NOMEM, "out of memory for the cache of direct light");
}

/* Checks a shape, so that the loops that read the piece stay within its bytes and the sky's cells. */
static bool is_sound(const struct transport_shape *s, uint32_t points)
{
    int exponent;

    if (s->form > TRANSPORT_BYTES || s->chunk_count > SKY_CHUNKS || s->rank > points)
        return false;
    if (s->form == TRANSPORT_RAW && s->rank != 0 && s->rank != points)
        return false;
    if (s->rank > 0 && s->chunk_count == 0)
        return false;
    if (!(s->scale > 0.0f) || !isfinite(s->scale) || frexpf(s->scale, &exponent) != 0.5f)
        return false;
    for (uint32_t k = 0; k < s->chunk_count; k++)
        if (s->chunks[k] >= SKY_CHUNKS || (k > 0 && s->chunks[k] <= s->chunks[k - 1]))
            return false;
    return true;
}

/* Half floats that are finite and, of gazes, not negative. */
static bool are_sound_halves(const uint16_t *halves, size_t count, bool of_gazes)
{
    const uint16_t mask = of_gazes ? 0xffffu : 0x7fffu;
    unsigned bad = 0;

    for (size_t i = 0; i < count; i++)
        bad |= (halves[i] & mask) >= 0x7c00u;
    return bad == 0;
}

bool transport_is_sound(const struct transport_piece *q, size_t bytes)
{
    const uint32_t gains = transport_gains(&q->shape);
    const size_t before = q->shape.form == TRANSPORT_BYTES ? transport_head(&q->shape) : 0;

    for (uint32_t k = 0; k < gains; k++) {
        float gain;
        memcpy(&gain, q->bytes + k * sizeof(gain), sizeof(gain));
        if (!(gain >= 0.0f && gain < 1e6f))
            return false;
    }
    return are_sound_halves((const uint16_t *)(const void *)(q->bytes + before), (bytes - before) / sizeof(uint16_t),
                            false);
}

static enum err read_piece(struct cache_reader *r, uint32_t points, struct transport_piece *q, struct reason *why)
{
    enum err e = cache_reader_get(r, &q->shape, sizeof(q->shape), why);

    if (!e && !is_sound(&q->shape, points))
        e = cache_reader_refuse(r, why);
    const size_t bytes = e ? 0 : (size_t)transport_piece_bytes(q, points);
    if (bytes == 0)
        return e;
    q->bytes = mem_alloc_raw(bytes, 1);
    if (!q->bytes)
        return no_memory(why);
    e = cache_reader_get(r, q->bytes, bytes, why);
    return e || transport_is_sound(q, bytes) ? e : cache_reader_refuse(r, why);
}

static bool is_sound_gaze(const struct transport_gaze *q)
{
    bool sound = are_sound_halves(q->by_specular, PACKET, true) && are_sound_halves(q->by_one, PACKET, true) &&
                 are_sound_halves(q->root_density, PACKET, true);

    for (uint32_t l = 0; l < PACKET; l++)
        sound = sound && direction_is_packed(q->to[l]);
    return sound;
}

static enum err read_block(struct cache_reader *r, struct transport_block *b, struct reason *why)
{
    const size_t gazes = b->narrow ? (size_t)b->packets * TRANSPORT_GAZES : 0;
    enum err e = ERR_OK;

    for (uint32_t row = 0; row < b->rows && !e; row++)
        e = read_piece(r, b->packets * PACKET, &b->pieces[row], why);
    if (!e && gazes > 0) {
        b->gazes = mem_alloc_raw(gazes, sizeof(*b->gazes));
        e = b->gazes ? cache_reader_get(r, b->gazes, gazes * sizeof(*b->gazes), why) : no_memory(why);
    }
    for (size_t i = 0; i < gazes && !e; i++)
        if (!is_sound_gaze(&b->gazes[i]))
            e = cache_reader_refuse(r, why);
    if (!e) {
        b->sight = mem_alloc_raw(1, sizeof(*b->sight)); /* any bits are valid */
        e = b->sight ? cache_reader_get(r, b->sight, sizeof(*b->sight), why) : no_memory(why);
    }
    return e;
}

enum err transport_load_blocks(struct cache_reader *r, const struct digest *key, uint32_t first, uint32_t step,
                               const struct cache_share *s, struct transport *t, struct reason *why)
{
    uint64_t rays = 0;
    enum err e = cache_reader_find(r, section, key, why);

    if (!e)
        e = cache_reader_get(r, &rays, sizeof(rays), why);
    t->stats.rays += rays;
    for (uint32_t k = first; !e && k < t->block_count; k += step) {
        e = read_block(r, &t->blocks[k], why);
        if (!transport_keeps(t, s, t->blocks[k].first))
            transport_block_finish(&t->blocks[k]);
    }
    return e ? e : cache_reader_end(r, why);
}

enum err transport_load(struct cache_reader *r, const struct digest *key, const struct gbuffer *g,
                        const struct rays *rays, const struct kernels *kernels, const struct transport_desc *desc,
                        struct transport **out, struct reason *why)
{
    const uint64_t max_bytes = transport_resolve(desc).max_bytes;
    struct transport *t = transport_begin(g, rays, kernels, desc);
    enum err e = t ? cache_reader_find(r, section, key, why) : no_memory(why);

    *out = NULL;
    if (!e)
        e = cache_reader_get(r, &t->stats.rays, sizeof(t->stats.rays), why);
    for (uint32_t k = 0; !e && k < t->block_count; k++) {
        e = read_block(r, &t->blocks[k], why);
        if (!e && !cache_share_takes_all(desc->share) && !transport_keeps(t, desc->share, t->blocks[k].first)) {
            transport_block_finish(&t->blocks[k]);
            continue;
        }
        if (e)
            break;
        transport_count_block(t, &t->blocks[k]);
        if (!cache_memory_suffices(max_bytes, t->stats.bytes))
            e = transport_say_too_large(t, t->stats.bytes, k + 1, max_bytes, why);
    }
    if (!e)
        e = cache_reader_end(r, why);
    if (e) {
        transport_destroy(t);
        return e;
    }
    transport_close_stats(t);
    *out = t;
    return ERR_OK;
}
