#include "transport/file.h"

#include "base/mem.h"
#include "cache/memory.h"
#include "scene/scene_digest.h"
#include "transport/parts.h"

#include <math.h>
#include <string.h>

/* To be counted up whenever the same scene would get another transport: other directions, weights, rows, blocks. */
#define FORMAT 6

static const char index_name[] = "transport.index", pieces_name[] = "transport.pieces",
                  gazes_name[] = "transport.gazes", sights_name[] = "transport.sights";

/* The index: a head, and the pieces of all blocks in their order; their bytes stand behind each other in the same. */
struct head {
    uint32_t blocks, pieces;
    uint64_t rays;
};

struct record {
    uint32_t rank;
    float scale;
    uint8_t form, chunk_count;
    uint8_t chunks[SKY_CHUNKS];
    uint8_t zero[2];
};

_Static_assert(sizeof(struct head) == 16 && sizeof(struct record) == 108, "a section's layout has no padding");

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

/* ---- Saving ---- */

void transport_save(const struct transport *t, const struct digest *key, struct cache_writer *w)
{
    const size_t size = sizeof(struct head) + t->stats.pieces * sizeof(struct record);
    uint8_t *index = mem_alloc(size, 1), *at = index + sizeof(struct head);
    const struct head head = { t->block_count, t->stats.pieces, t->stats.rays };

    cache_writer_section(w, index_name, key);
    if (index) {
        memcpy(index, &head, sizeof(head));
        for (uint32_t k = 0; k < t->block_count; k++)
            for (uint32_t r = 0; r < t->blocks[k].rows; r++, at += sizeof(struct record)) {
                const struct transport_piece *q = &t->blocks[k].pieces[r];
                struct record record = { q->bytes ? q->rank : 0, q->scale, (uint8_t)q->form,
                                         q->chunk_count,         { 0 },    { 0 } };
                memcpy(record.chunks, q->chunks, q->chunk_count);
                memcpy(at, &record, sizeof(record));
            }
    }
    cache_writer_give(w, index, size);
    cache_writer_section(w, pieces_name, key);
    for (uint32_t k = 0; k < t->block_count; k++)
        for (uint32_t r = 0; r < t->blocks[k].rows; r++) {
            const struct transport_piece *q = &t->blocks[k].pieces[r];
            cache_writer_put(w, q->bytes, (size_t)transport_piece_bytes(q, t->blocks[k].packets * PACKET));
        }
    cache_writer_section(w, gazes_name, key);
    for (uint32_t k = 0; k < t->block_count; k++)
        cache_writer_put(w, t->blocks[k].gazes, (size_t)transport_gaze_bytes(&t->blocks[k]));
    cache_writer_section(w, sights_name, key);
    for (uint32_t k = 0; k < t->block_count; k++)
        cache_writer_put(w, &t->blocks[k].sight, sizeof(t->blocks[k].sight));
}

/* ---- Loading ---- */

static enum err refuse(const struct cache_reader *r, struct reason *why, const char *what)
{
    return err_say(why, ERR_FORMAT, "%.200s: %s", cache_reader_path(r), what);
}

/* Whatever stands in a record, the loops that read the piece stay within its bytes and the sky's cells. */
static bool is_sound(const struct record *record, uint32_t points)
{
    int exponent;

    if (record->form > TRANSPORT_BYTES || record->chunk_count > SKY_CHUNKS || record->rank > points)
        return false;
    if (record->form == TRANSPORT_RAW && record->rank != 0 && record->rank != points)
        return false;
    if (record->rank > 0 && record->chunk_count == 0)
        return false;
    if (!(record->scale > 0.0f) || !isfinite(record->scale) || frexpf(record->scale, &exponent) != 0.5f)
        return false;
    for (uint32_t k = 0; k < record->chunk_count; k++)
        if (record->chunks[k] >= SKY_CHUNKS || (k > 0 && record->chunks[k] <= record->chunks[k - 1]))
            return false;
    return true;
}

static uint64_t bytes_of(const struct record *record, uint32_t points)
{
    const uint64_t u = record->form == TRANSPORT_RAW ? 0 : sizeof(uint16_t) * (uint64_t)record->rank * points;
    return transport_head((enum transport_form)record->form, record->rank, record->chunk_count) + u;
}

static uint32_t count_pieces(const struct transport *t)
{
    uint32_t count = 0;

    for (uint32_t k = 0; k < t->block_count; k++)
        count += t->blocks[k].rows;
    return count;
}

/* All of the index into `records`, and how many bytes of pieces it promises. */
static enum err read_index(struct cache_reader *r, const struct digest *key, struct transport *t,
                           struct record *records, uint64_t *bytes, struct reason *why)
{
    const uint32_t pieces = count_pieces(t);
    struct head head;

    enum err e = cache_reader_find(r, index_name, key, why);
    if (!e)
        e = cache_reader_get(r, &head, sizeof(head), why);
    if (!e && (head.blocks != t->block_count || head.pieces != pieces))
        e = refuse(r, why, "has other blocks than this picture");
    if (!e)
        e = cache_reader_get(r, records, pieces * sizeof(*records), why);
    if (!e)
        e = cache_reader_end(r, why);
    if (e)
        return e;
    t->stats.rays = head.rays;
    *bytes = 0;
    for (uint32_t k = 0; k < t->block_count; k++)
        for (uint32_t row = 0; row < t->blocks[k].rows; row++, records++) {
            if (!is_sound(records, t->blocks[k].packets * PACKET))
                return refuse(r, why, "holds numbers that cannot be");
            *bytes += bytes_of(records, t->blocks[k].packets * PACKET);
        }
    return ERR_OK;
}

static bool all_finite(const uint16_t *halves, size_t count)
{
    unsigned bad = 0;

    for (size_t i = 0; i < count; i++)
        bad |= (halves[i] & 0x7c00u) == 0x7c00u;
    return bad == 0;
}

/* Any bytes will do for V; halves and gains are finite. */
static bool has_sound_numbers(const struct transport_piece *q, size_t bytes)
{
    const uint32_t gains = transport_gains(q->form, q->rank);
    const size_t before = q->form == TRANSPORT_BYTES ? transport_head(q->form, q->rank, q->chunk_count) : 0;

    for (uint32_t k = 0; k < gains; k++) {
        float gain;
        memcpy(&gain, q->bytes + k * sizeof(gain), sizeof(gain));
        if (!(gain >= 0.0f && gain < 1e6f))
            return false;
    }
    return all_finite((const uint16_t *)(const void *)(q->bytes + before), (bytes - before) / sizeof(uint16_t));
}

static enum err read_piece(struct cache_reader *r, const struct record *record, uint32_t points,
                           struct transport_piece *q, struct reason *why)
{
    const size_t bytes = (size_t)bytes_of(record, points);

    *q = (struct transport_piece){ .rank = record->rank,
                                   .scale = record->scale,
                                   .form = (enum transport_form)record->form,
                                   .chunk_count = record->chunk_count };
    memcpy(q->chunks, record->chunks, record->chunk_count);
    if (bytes == 0)
        return ERR_OK;
    q->bytes = mem_alloc_raw(bytes, 1);
    if (!q->bytes)
        return err_say(why, ERR_NOMEM, "no memory for the cache of light transport");
    const enum err e = cache_reader_get(r, q->bytes, bytes, why);
    if (e)
        return e;
    return has_sound_numbers(q, bytes) ? ERR_OK : refuse(r, why, "holds numbers that cannot be");
}

static enum err read_pieces(struct cache_reader *r, const struct digest *key, struct transport *t,
                            const struct record *records, uint64_t bytes, uint64_t max_bytes, struct reason *why)
{
    enum err e = cache_reader_find(r, pieces_name, key, why);

    if (!e && cache_reader_left(r) != bytes)
        e = refuse(r, why, "holds more or less than it says");
    if (!e && !cache_memory_suffices(max_bytes, t->stats.bytes + bytes)) {
        t->stats.bytes += bytes;
        return transport_say_too_large(t, t->stats.bytes, t->block_count, max_bytes, why);
    }
    for (uint32_t k = 0; k < t->block_count && !e; k++) {
        struct transport_block *b = &t->blocks[k];
        for (uint32_t row = 0; row < b->rows && !e; row++)
            e = read_piece(r, records++, b->packets * PACKET, &b->pieces[row], why);
    }
    return e ? e : cache_reader_end(r, why);
}

/* Directions of any length but zero are looked up as they are; light is neither less than none nor without bound. */
static bool is_sound_gaze(const struct transport_gaze *q)
{
    for (uint32_t l = 0; l < PACKET; l++) {
        const float length2 = q->x[l] * q->x[l] + q->y[l] * q->y[l] + q->z[l] * q->z[l];
        const float least = fminf(q->density[l], fminf(q->by_specular[l], q->by_one[l]));
        const float most = fmaxf(q->density[l], fmaxf(q->by_specular[l], q->by_one[l]));
        const float sum = q->density[l] + q->by_specular[l] + q->by_one[l]; /* NaN, if one is */
        if (!(length2 > 0.5f && length2 < 2.0f && least >= 0.0f && most < 1e30f && sum >= 0.0f))
            return false;
    }
    return true;
}

static enum err read_gazes(struct cache_reader *r, const struct digest *key, struct transport *t, struct reason *why)
{
    enum err e = cache_reader_find(r, gazes_name, key, why);

    for (uint32_t k = 0; k < t->block_count && !e; k++) {
        struct transport_block *b = &t->blocks[k];
        const size_t count = b->narrow ? (size_t)b->packets * TRANSPORT_GAZES : 0;
        if (count == 0)
            continue;
        b->gazes = mem_alloc_raw(count, sizeof(*b->gazes));
        if (!b->gazes)
            return err_say(why, ERR_NOMEM, "no memory for the cache of light transport");
        e = cache_reader_get(r, b->gazes, count * sizeof(*b->gazes), why);
        for (size_t i = 0; i < count && !e; i++)
            if (!is_sound_gaze(&b->gazes[i]))
                e = refuse(r, why, "holds numbers that cannot be");
    }
    return e ? e : cache_reader_end(r, why);
}

/* Any bits will do. */
static enum err read_sights(struct cache_reader *r, const struct digest *key, struct transport *t, struct reason *why)
{
    enum err e = cache_reader_find(r, sights_name, key, why);

    for (uint32_t k = 0; k < t->block_count && !e; k++)
        e = cache_reader_get(r, &t->blocks[k].sight, sizeof(t->blocks[k].sight), why);
    return e ? e : cache_reader_end(r, why);
}

enum err transport_load(struct cache_reader *r, const struct digest *key, const struct gbuffer *g,
                        const struct rays *rays, const struct kernels *kernels, const struct transport_desc *desc,
                        struct transport **out, struct reason *why)
{
    struct transport *t = transport_begin(g, rays, kernels, desc);
    struct record *records = t ? mem_alloc(count_pieces(t), sizeof(*records)) : NULL;
    uint64_t bytes = 0;
    enum err e = ERR_OK;

    *out = NULL;
    if (!t || !records)
        e = err_say(why, ERR_NOMEM, "no memory for the cache of light transport");
    if (!e)
        e = read_index(r, key, t, records, &bytes, why);
    if (!e)
        e = read_pieces(r, key, t, records, bytes, transport_resolve(desc).max_bytes, why);
    if (!e)
        e = read_gazes(r, key, t, why);
    if (!e)
        e = read_sights(r, key, t, why);
    if (!e) {
        for (uint32_t k = 0; k < t->block_count; k++)
            transport_count_block(t, &t->blocks[k]);
        transport_close_stats(t);
        *out = t;
        t = NULL;
    }
    mem_free(records);
    transport_destroy(t);
    return e;
}
