/* Keeps the inputs of the last frame and its light in two parts, so that a frame computes only the light that depends
 * on changed parts of the sky. A part is reused only if all of its inputs have the same bits, so that the frame has
 * those of one computed whole. */
#include "light/cache_direct/internal.h"

#include "base/mem.h"

#include <string.h>

#define WORDS ((SKY_CHUNKS + 63) / 64)

enum state {               /* of a block */
             HELD = 1,     /* lit is its light */
             CHANGING = 2, /* its cells changed in the last frame */
             SHINES = 4,   /* shone is not all 0 */
};

struct transport_last {
    bool known;              /* lit, where it is held, and shone are the light under the sky below */
    bool lit_all, shone_all; /* this frame computes that part everywhere, */
    bool moved;              /* because all of the sky counts as changed */
    uint64_t changed[WORDS]; /* chunks of the sky that differ from the last frame's */
    _Alignas(64) float cells[SKY_CHUNKS][3][SKY_CHUNK];
    struct sun_parts sun;
    const void *indirect; /* whose; NULL: none */
    float *coefficients;
    uint32_t coefficient_count;
    uint64_t (*sees)[WORDS]; /* [block_count]: chunks of the sky that reach the block */
    uint8_t *states;         /* [block_count]: bits of enum state */
    float *lit, *shone;      /* [packet_count][3][PACKET]: by cells and gazes; by the sun. NULL until needed */
};

void transport_last_destroy(struct transport_last *l)
{
    if (!l)
        return;
    mem_free(l->sun.at);
    mem_free(l->coefficients);
    mem_free(l->sees);
    mem_free(l->states);
    mem_free(l->lit);
    mem_free(l->shone);
    mem_free(l);
}

/* ---- What has changed ---- */

static bool same_sun(const struct sun_parts *a, const struct sun_parts *b)
{
    return a->count == b->count && (a->count == 0 || memcmp(a->at, b->at, a->count * sizeof(*a->at)) == 0);
}

static bool same_indirect(const struct transport_last *l, const struct transport_indirect *i)
{
    if (!i || !l->indirect)
        return !i && !l->indirect;
    return l->indirect == i->self && l->coefficient_count == i->sky_count &&
           memcmp(l->coefficients, i->sky, i->sky_count * sizeof(float)) == 0;
}

/* Returns the number of chunks that differ. */
static uint32_t compare_cells(struct transport_last *l, const struct sky_split *sky)
{
    uint32_t count = 0;

    memset(l->changed, 0, sizeof(l->changed));
    for (uint32_t k = 0; k < SKY_CHUNKS; k++) {
        const bool differs = memcmp(l->cells[k], sky->cells[k], sizeof(l->cells[k])) != 0;
        l->changed[k / 64] |= (uint64_t)differs << k % 64;
        count += differs;
    }
    return count;
}

/* ---- This frame's inputs, for the next one ---- */

static bool keep_sun(struct transport_last *l, const struct sun_parts *b)
{
    if (b->count > l->sun.capacity) {
        mem_free(l->sun.at);
        l->sun = (struct sun_parts){ .at = mem_alloc(b->count, sizeof(*b->at)) };
        if (!l->sun.at)
            return false;
        l->sun.capacity = b->count;
    }
    l->sun.count = b->count;
    if (b->count)
        memcpy(l->sun.at, b->at, b->count * sizeof(*b->at));
    return true;
}

static bool keep_indirect(struct transport_last *l, const struct transport_indirect *i)
{
    l->indirect = NULL;
    if (!i)
        return true;
    if (i->sky_count != l->coefficient_count) {
        mem_free(l->coefficients);
        l->coefficient_count = 0;
        l->coefficients = mem_alloc(i->sky_count, sizeof(float));
        if (!l->coefficients)
            return false;
        l->coefficient_count = i->sky_count;
    }
    memcpy(l->coefficients, i->sky, i->sky_count * sizeof(float));
    l->indirect = i->self;
    return true;
}

static bool find_chunks(struct transport_last *l, const struct transport *t)
{
    l->sees = mem_alloc(t->block_count, sizeof(*l->sees));
    for (uint32_t k = 0; l->sees && k < t->block_count; k++)
        for (uint32_t r = 0; r < t->blocks[k].rows; r++) {
            const struct transport_shape *s = &t->blocks[k].pieces[r].shape;
            for (uint32_t i = 0; i < s->chunk_count; i++)
                l->sees[k][s->chunks[i] / 64] |= (uint64_t)1 << s->chunks[i] % 64;
        }
    return l->sees != NULL;
}

static bool reserve_light(struct transport_last *l, const struct transport *t)
{
    const size_t floats = (size_t)t->gbuffer->packet_count * 3 * PACKET;

    if (!l->sees && !find_chunks(l, t))
        return false;
    if (!l->states)
        l->states = mem_alloc(t->block_count, sizeof(*l->states));
    if (!l->lit)
        l->lit = mem_alloc_raw(floats, sizeof(float));
    if (!l->shone)
        l->shone = mem_alloc_raw(floats, sizeof(float));
    return l->states && l->lit && l->shone;
}

/* ---- A frame ---- */

/* Light is kept from the second of two frames on that have much in common, so that others cost nothing. */
bool transport_last_begin(struct transport *t, const struct transport_indirect *indirect)
{
    struct transport_last *l = t->last;

    if (!l && !(l = t->last = mem_alloc(1, sizeof(*l))))
        return false;
    const uint32_t changed = compare_cells(l, &t->sky);
    const bool as_sunny = same_sun(&t->sun.parts, &l->sun), same_rest = same_indirect(l, indirect);
    const bool alike = (same_rest && 2 * changed < SKY_CHUNKS) || (as_sunny && t->sun.parts.count > 0);

    l->moved = !same_rest;
    l->lit_all = !l->known || !same_rest;
    l->shone_all = !l->known || !as_sunny;
    l->known = false;
    memcpy(l->cells, t->sky.cells, sizeof(l->cells));
    return keep_sun(l, &t->sun.parts) && keep_indirect(l, indirect) && alike && reserve_light(l, t);
}

void transport_last_end(struct transport *t, bool complete)
{
    t->last->known = complete;
}

/* What changes in frame after frame is computed in each of them and not kept, which saves 1 to 3 % of such a
 * frame. What then stays the same for once is computed again and kept. */
unsigned transport_last_work(const struct transport *t, uint32_t block)
{
    const struct transport_last *l = t->last;
    const unsigned sun = l->shone_all ? TRANSPORT_WORK_SUN : 0;
    uint8_t *state = &l->states[block];
    uint64_t reached = 0;

    for (uint32_t k = 0; k < WORDS; k++)
        reached |= l->sees[block][k] & l->changed[k];
    /* gazes read single texels, which the cells do not tell apart */
    const bool changed = l->moved || reached || t->blocks[block].narrow, again = changed && *state & CHANGING;
    const bool computed = changed || l->lit_all || !(*state & HELD);
    *state = (uint8_t)((*state & SHINES) | (changed ? CHANGING : 0) | (again ? 0 : HELD));
    return sun | (computed ? TRANSPORT_WORK_CELLS : 0) | (again ? TRANSPORT_LAST_PASSING : 0);
}

float *transport_last_lit(const struct transport *t, uint32_t packet)
{
    return t->last->lit + (size_t)packet * 3 * PACKET;
}

float *transport_last_shone(const struct transport *t, uint32_t packet)
{
    return t->last->shone + (size_t)packet * 3 * PACKET;
}

void transport_last_look(const struct transport *t, uint32_t block)
{
    const struct transport_block *b = &t->blocks[block];
    const float *shone = transport_last_shone(t, b->first);
    uint8_t *state = &t->last->states[block];
    bool any = false;

    for (size_t i = 0; i < (size_t)b->packets * 3 * PACKET; i++)
        any |= shone[i] != 0.0f;
    *state = (uint8_t)(any ? *state | SHINES : *state & ~SHINES);
}

bool transport_last_is_dark(const struct transport *t, uint32_t block)
{
    return !(t->last->states[block] & SHINES);
}
