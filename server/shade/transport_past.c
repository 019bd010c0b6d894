#include "transport_past.h"

#include "mem.h"

#include <math.h>
#include <string.h>

/* Gains are taken as exact only where all light is 0 or within these: far enough from where floats end that no product
 * or sum on the way gets there. */
#define LEAST 0x1p-40f
#define MOST 0x1p40f

static uint32_t bright_count(const struct transport_bright *b)
{
    return b->strata * TRANSPORT_VARIANTS;
}

void transport_past_begin(struct transport *t)
{
    struct transport_past *p = &t->past;
    float *const values = p->bright_values;
    const uint32_t capacity = p->bright_capacity;

    memcpy(p->cells, t->sky.cells, sizeof(p->cells));
    p->bright = t->bright;
    p->bright_values = t->bright_values; /* the next samples go where those before the last ones were */
    p->bright_capacity = t->bright_capacity;
    t->bright_values = values;
    t->bright_capacity = capacity;
}

void transport_past_finish(struct transport_past *p)
{
    mem_free(p->bright_values);
    mem_free(p->texels);
}

static bool in_range(float x)
{
    const float size = fabsf(x);

    return size == 0.0f || (size >= LEAST && size <= MOST);
}

/* Gain 1: bit by bit. */
static bool is_scaled(const float *now, const float *before, size_t n, float gain)
{
    if (gain == 1.0f)
        return memcmp(now, before, n * sizeof(*now)) == 0;
    for (size_t i = 0; i < n; i++)
        if (now[i] != gain * before[i] || !in_range(now[i]) || !in_range(before[i]))
            return false;
    return true;
}

static bool bright_is_scaled(const struct transport_bright *now, const struct transport_bright *before, float gain)
{
    const size_t n = bright_count(now);

    if (now->strata != before->strata)
        return false;
    return n == 0 || (now->few == before->few && now->seed == before->seed && is_scaled(now->x, before->x, n, 1.0f) &&
                      is_scaled(now->y, before->y, n, 1.0f) && is_scaled(now->z, before->z, n, 1.0f) &&
                      is_scaled(now->density, before->density, n, 1.0f) && is_scaled(now->r, before->r, n, gain) &&
                      is_scaled(now->g, before->g, n, gain) && is_scaled(now->b, before->b, n, gain));
}

/* The power of two by which the first cell with light has changed; 1 where it is none. */
static float find_gain(const float *now, const float *before, size_t n)
{
    size_t i = 0;
    int exponent;

    while (i < n && before[i] == 0.0f)
        i++;
    if (i == n || !in_range(now[i]) || !in_range(before[i]))
        return 1.0f;
    const float gain = now[i] / before[i];
    return frexpf(gain, &exponent) == 0.5f ? gain : 1.0f;
}

static void find_cells(struct transport *t, bool same_bright, struct transport_change *out)
{
    const size_t n = sizeof(t->sky.cells) / sizeof(float);
    const float *now = t->sky.cells[0][0], *before = t->past.cells[0][0];
    uint32_t changed = 0;

    for (uint32_t k = 0; k < TRANSPORT_CHUNKS; k++)
        if (memcmp(t->sky.cells[k], t->past.cells[k], sizeof(t->sky.cells[k])) != 0) {
            out->chunks[k / 64] |= (uint64_t)1 << k % 64;
            changed++;
        }
    if (same_bright && changed < TRANSPORT_CHUNKS) {
        out->what = changed ? TRANSPORT_SOME : TRANSPORT_EQUAL;
        if (!changed)
            return;
    }
    const float gain = find_gain(now, before, n);
    if (gain != 1.0f && is_scaled(now, before, n, gain) && bright_is_scaled(&t->bright, &t->past.bright, gain)) {
        out->what = TRANSPORT_GAIN;
        out->gain = gain;
    }
}

/* Texels are kept only once the rest of a frame was as the one before, so that skies that move cost nothing. */
static bool compare_texels(struct transport *t, const struct environment *e, float gain)
{
    struct transport_past *p = &t->past;
    const size_t row = (size_t)e->n;
    const bool known =
        p->texels_known && p->texel_edge == e->n && p->importance == e->importance && p->level * gain == t->sky.level;
    bool same = known;

    p->texels_known = false;
    if (p->texel_edge != e->n) {
        mem_free(p->texels);
        p->texels = mem_alloc_raw(CUBE_FACES * row * row, sizeof(*p->texels));
        p->texel_edge = p->texels ? e->n : 0;
        if (!p->texels)
            return false; /* no fault: they count as changed */
    }
    p->texels_known = true;
    p->level = t->sky.level;
    p->importance = e->importance;
#pragma omp parallel for schedule(static) reduction(&& : same)
    for (uint32_t k = 0; k < CUBE_FACES * e->n; k++) {
        const struct texel *now = &e->texels[k * row];
        struct texel *before = &p->texels[k * row];
        if (known && same)
            same = is_scaled(&now->r, &before->r, 4 * row, gain);
        memcpy(before, now, row * sizeof(*before));
    }
    return same;
}

/* What a guest's light is linear in is that of the last frame times the gain. Keeps it for the next one. */
static bool guest_is_scaled(struct transport_past *p, const struct transport_guest *guest, float gain)
{
    const uint32_t count = guest ? guest->count : 0;
    const bool same = count == p->guest_count && (count == 0 || is_scaled(guest->values, p->guest, count, gain));

    p->guest_count = count;
    if (count > 0)
        memcpy(p->guest, guest->values, count * sizeof(*p->guest));
    return same;
}

void transport_past_compare(struct transport *t, const struct environment *e, const struct transport_guest *guest,
                            bool valid, struct transport_change *out)
{
    *out = (struct transport_change){ .what = TRANSPORT_ALL, .gain = 1.0f };
    if (valid)
        find_cells(t, bright_is_scaled(&t->bright, &t->past.bright, 1.0f), out);
    if (!guest_is_scaled(&t->past, guest, out->gain))
        *out = (struct transport_change){ .what = TRANSPORT_ALL, .gain = 1.0f };
    if (t->stats.narrow > 0 && (out->what == TRANSPORT_EQUAL || out->what == TRANSPORT_GAIN))
        out->texels = compare_texels(t, e, out->gain);
    else
        t->past.texels_known = false;
}

bool transport_past_keeps(const struct transport_change *c, const struct transport_block *b)
{
    if (c->what == TRANSPORT_ALL || (b->narrow && !c->texels))
        return false;
    for (uint32_t r = 0; c->what == TRANSPORT_SOME && r < b->rows; r++)
        for (uint32_t i = 0; i < b->pieces[r].chunk_count; i++)
            if (c->chunks[b->pieces[r].chunks[i] / 64] >> b->pieces[r].chunks[i] % 64 & 1)
                return false;
    return true;
}
