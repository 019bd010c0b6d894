#include "light/frame/changes.h"

#include "base/mem.h"
#include "light/frame/relighter.h"

#include <string.h>

static enum err reserve(struct changes *c, size_t pixels)
{
    if (c->pixels == pixels)
        return ERR_OK;
    changes_finish(c);
    c->before = mem_alloc(pixels, 3 * sizeof(float));
    c->map = mem_alloc(pixels, 1);
    if (!c->before || !c->map) {
        changes_finish(c);
        return ERR_NOMEM;
    }
    c->pixels = (uint32_t)pixels;
    return ERR_OK;
}

/* What was computed for a packet. Only a cache of one process tells packets apart; eye paths and particles beside it do
 * not count. */
static uint8_t work_of(const uint8_t *work, uint32_t packet)
{
    if (!work)
        return CHANGE_SKY;
    return (uint8_t)((work[packet] & TRANSPORT_WORK_CELLS ? CHANGE_SKY : 0) |
                     (work[packet] & TRANSPORT_WORK_SUN ? CHANGE_SUN : 0));
}

static uint8_t pixel_of(const struct changes *c, const struct gbuffer *g, const uint8_t *work, const float *rgb,
                        size_t at)
{
    uint8_t bits = c->begun && memcmp(rgb + 3 * at, c->before + 3 * at, 3 * sizeof(float)) == 0 ? 0 : CHANGE_RADIANCE;

    for (uint32_t k = g->entry_first[at]; k < g->entry_first[at + 1]; k++)
        bits |= work_of(work, g->entries[k].point / PACKET);
    return bits;
}

static void widen(uint32_t box[4], uint32_t x, uint32_t y)
{
    const bool first = box[1] == 0;

    box[0] = first || x < box[0] ? x : box[0];
    box[1] = x + 1 > box[1] ? x + 1 : box[1];
    box[2] = first || y < box[2] ? y : box[2];
    box[3] = y + 1 > box[3] ? y + 1 : box[3];
}

static void count(struct changes *c, uint32_t width)
{
    c->changed = c->sky = c->sun = 0;
    memset(c->box, 0, sizeof(c->box));
    for (uint32_t at = 0; at < c->pixels; at++) {
        c->changed += c->map[at] & CHANGE_RADIANCE;
        c->sky += c->map[at] >> 1 & 1;
        c->sun += c->map[at] >> 2 & 1;
        if (c->map[at] & CHANGE_RADIANCE)
            widen(c->box, at % width, at / width);
    }
}

enum err changes_take(struct changes *c, const struct relighter *r, const struct relight_stats *stats, const float *rgb)
{
    const struct gbuffer *g = r->set->gbuffer;
    const size_t pixels = (size_t)g->width * g->height;
    const enum err e = reserve(c, pixels);
    const uint8_t *work = !r->team && stats->cache.packets > 0 && !stats->cache_refused && r->cache.transport
                              ? transport_work(r->cache.transport)
                              : NULL;

    if (e)
        return e;
#pragma omp parallel for schedule(static)
    for (size_t at = 0; at < pixels; at++)
        c->map[at] = pixel_of(c, g, work, rgb, at);
    memcpy(c->before, rgb, pixels * 3 * sizeof(float));
    c->begun = true;
    count(c, g->width);
    return ERR_OK;
}

void changes_finish(struct changes *c)
{
    mem_free(c->before);
    mem_free(c->map);
    *c = (struct changes){ .before = NULL };
}

void changes_paint(const struct changes *c, uint8_t *rgb)
{
    for (size_t at = 0; at < c->pixels; at++)
        for (int k = 0; k < 3; k++)
            rgb[3 * at + (size_t)k] = c->map[at] >> k & 1 ? 255 : 0;
}
