#include "light/cache_direct/sun_corner.h"

#include "base/mem.h"
#include "base/rng.h"
#include "sky/tables/invert.h"

#include <math.h>
#include <string.h>

struct sun_corner {
    uint32_t key; /* grid, face, row and column */
    uint64_t used, bytes;
    struct sun_look look;
    struct {
        uint16_t lit, dark; /* both 0: not looked at yet, or below the horizon */
    } views[];              /* [packet_count] */
};

/* Lanes look at places around a corner, from opposite corners of their pixels to opposite corners of a tile. */
static void fill(struct sun_look *o, uint32_t grid, uint32_t face, uint32_t row, uint32_t column)
{
    const double last = grid - 1 + INVERT_LAST;

    for (uint32_t l = 0; l < PACKET; l++) {
        double place[2];
        float w[3];
        rng_sobol2(0, l, place);
        invert_direction(grid, face, fmin(last, fmax(0.0, row * SUN_EDGE + place[1] - 0.5)),
                         fmin(last, fmax(0.0, column * SUN_EDGE + place[0] - 0.5)), w);
        for (int c = 0; c < 3; c++)
            o->ray[c][l] = w[c];
        const uint32_t right = row % 2, down = (row + column + l / 2) % 2 ? right : 1 - right;
        o->place[l] = pixel_cell(right * 3, down * 3);
    }
}

struct sun_corner *sun_corner_find(struct sun_corners *x, const struct transport *t, uint32_t grid, uint32_t face,
                                   uint32_t row, uint32_t column)
{
    const uint32_t edge = grid / SUN_EDGE + 1, key = (((face * edge + row) * edge + column) << 10) + grid;
    struct sun_corner *c;

    for (size_t k = 0; k < x->count; k++)
        if (x->at[k]->key == key) {
            x->at[k]->used = x->frame;
            return x->at[k];
        }
    const size_t bytes = sizeof(*c) + t->gbuffer->packet_count * sizeof(c->views[0]);
    if (!mem_reserve(&x->at, x->count, &x->capacity, sizeof(*x->at)) || !(c = mem_alloc(1, bytes)))
        return NULL;
    c->key = key;
    c->used = x->frame;
    c->bytes = bytes;
    fill(&c->look, grid, face, row, column);
    x->at[x->count++] = c;
    x->bytes += bytes;
    return c;
}

void sun_corner_look(const struct transport *t, struct sun_corner *c, uint32_t packet, struct transport_view *view,
                     uint64_t *rays)
{
    struct transport_view own = { c->views[packet].lit, c->views[packet].dark };
    uint16_t bits = 0;

    if (!own.lit && !own.dark) {
        *rays += t->kernels->sun->trace(t->rays, &c->look, &t->gbuffer->packets[packet], 1, UINT16_MAX, &bits, &own);
        c->views[packet].lit = (uint16_t)own.lit;
        c->views[packet].dark = (uint16_t)own.dark;
    }
    view->lit |= own.lit;
    view->dark |= own.dark;
}

void sun_corners_frame(struct sun_corners *x, uint64_t kept)
{
    x->frame++;
    for (size_t k = x->count; k-- > 0;) {
        if (x->at[k]->used + kept >= x->frame)
            continue;
        x->bytes -= x->at[k]->bytes;
        mem_free(x->at[k]);
        x->at[k] = x->at[--x->count];
    }
}

void sun_corners_forget(struct sun_corners *x, uint32_t first, uint32_t packets)
{
    for (size_t k = 0; k < x->count; k++)
        memset(&x->at[k]->views[first], 0, packets * sizeof(x->at[k]->views[0]));
}

void sun_corners_finish(struct sun_corners *x)
{
    for (size_t k = 0; k < x->count; k++)
        mem_free(x->at[k]);
    mem_free(x->at);
}
