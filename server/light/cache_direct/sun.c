/* Which part of the sun does each point see? Camera and geometry stand still, and the sun comes back to where it was,
 * or moves on by a part of its width: so each direction is asked once, and the answer kept as a bit.
 *
 * The sky's faces have a grid of directions, SUN_GRID along an edge, divided into tiles of SUN_EDGE x SUN_EDGE. The
 * texels of a frame's sun spread their energy over the directions of a few tiles, and a point's light from the sun is
 * the sum over the directions that it sees. As the sun moves, the weights of the directions change continuously, and
 * no bit does: shadows glide without noise. Each lane of a packet looks at another place of a direction's square, so
 * that penumbrae of neighbouring points do not have their steps in the same places.
 *
 * Most blocks see all or nothing of a tile, and have no bits. What an entry holds depends on nothing but the tile and
 * the block, not on the frames before: neither on their order nor on threads. */
#include "light/cache_direct/internal.h"
#include "light/cache_direct/sun_corner.h"
#include "light/cache_direct/sun_index.h"

#include "base/mem.h"
#include "base/rng.h"
#include "sky/tables/cube.h"
#include "sky/tables/invert.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#define SUN_GRID_LEAST SKY_EDGE /* of a sun that is as large as the sky */
#define SUN_AHEAD 8             /* frames in which the directions that a sun comes to next are traced */
#define SUN_MOST 1024           /* directions of a frame's sun, from which on the grid is coarser */

/* ---- Tiles ---- */

/* Which cell of a pixel direction k looks from: sixteen neighbours from sixteen cells, so that edges of shadows are
 * antialiased. The cell's column changes with the row and its row with the column, so that directions that see across
 * an edge one after another see it from all over the pixel; and in an order that is neither rising nor falling, since
 * penumbrae would be too wide or too narrow. */
static uint32_t cell_of(uint32_t k)
{
    static const uint8_t order[SUN_EDGE] = { 1, 3, 0, 2 };

    return pixel_cell(order[k / SUN_EDGE], order[k % SUN_EDGE]);
}

/* The cell and those around it: the few rays that a cell's answer rests on pass by what is narrow at a block's edge. */
static void mark_cells(struct sun_tile *t, uint32_t face, uint32_t row, uint32_t column)
{
    for (int k = 0; k < 9; k++) {
        const uint16_t cell = transport_unit_at(face, (int)row + k / 3 - 1, (int)column + k % 3 - 1, SKY_EDGE);
        t->cells[cell / 64] |= (uint64_t)1 << cell % 64;
    }
}

static void fill_tile(const struct sun_index *x, struct sun_tile *t, uint32_t grid, uint32_t face, uint32_t row,
                      uint32_t column)
{
    const uint32_t i0 = row * SUN_EDGE, j0 = column * SUN_EDGE;
    float least = 1.0f, w[3];

    invert_direction(grid, face, i0 + 0.5 * SUN_EDGE, j0 + 0.5 * SUN_EDGE, t->axis);
    for (uint32_t k = 0; k < SUN_TILE; k++) {
        const uint32_t i = i0 + k / SUN_EDGE, j = j0 + k % SUN_EDGE;
        mark_cells(t, face, i * SKY_EDGE / grid, j * SKY_EDGE / grid);
        invert_direction(grid, face, i + 0.5, j + 0.5, w);
        t->x[k] = w[0];
        t->y[k] = w[1];
        t->z[k] = w[2];
        for (uint32_t l = 0; l < PACKET; l++) {
            invert_direction(grid, face, i + x->place[k][l][1], j + x->place[k][l][0], w);
            for (int c = 0; c < 3; c++)
                t->looks[k].ray[c][l] = w[c];
            t->looks[k].place[l] = cell_of(k);
        }
        for (uint32_t corner = 0; corner < 4; corner++) {
            invert_direction(grid, face, i + INVERT_LAST * (corner >> 1), j + INVERT_LAST * (corner & 1), w);
            least = fminf(least, t->axis[0] * w[0] + t->axis[1] * w[1] + t->axis[2] * w[2]);
        }
    }
    t->sine = sqrtf(fmaxf(0.0f, 1.0f - least * least)) + 1e-5f;
}

static void drop_entry(struct transport *t, uint32_t at)
{
    struct sun_index *x = t->index;
    struct sun_entry *e = &x->entries[at];

    sun_views_finish(e->views);
    mem_free(e->views);
    mem_free(e->tile);
    *e = x->entries[--x->count];
    atomic_fetch_sub(&x->bytes, sizeof(*e->tile) + sizeof(*e->views));
}

void sun_index_make_room(struct transport *t, uint64_t most, uint64_t since)
{
    struct sun_index *x = t->index;

    while (x->count > 0 && x->bytes > most) {
        uint32_t oldest = 0;
        for (uint32_t k = 1; k < x->count; k++)
            if (x->entries[k].used < x->entries[oldest].used)
                oldest = k;
        if (x->entries[oldest].used >= since)
            return;
        drop_entry(t, oldest);
    }
}

uint64_t sun_index_bytes(const struct transport *t)
{
    return t->index->bytes + t->index->corners.bytes + t->index->later_corners.bytes;
}

bool sun_key_is_sound(uint32_t key)
{
    const uint32_t grid = key % (2 * SUN_GRID), edge = grid / SUN_EDGE;

    return grid >= SUN_GRID_LEAST && grid <= SUN_GRID && SUN_GRID % grid == 0 && key / (2 * SUN_GRID) < 6 * edge * edge;
}

int64_t sun_index_find(struct transport *t, uint32_t key)
{
    struct sun_index *x = t->index;
    const uint32_t grid = key % (2 * SUN_GRID), edge = grid / SUN_EDGE, at = key / (2 * SUN_GRID);

    for (uint32_t k = 0; k < x->count; k++)
        if (x->entries[k].key == key) {
            x->entries[k].used = x->frame;
            return k;
        }
    if (!mem_reserve(&x->entries, x->count, &x->capacity, sizeof(*x->entries)))
        return -1;
    struct sun_entry *e = &x->entries[x->count];
    *e = (struct sun_entry){ key, mem_alloc(1, sizeof(*e->tile)), mem_alloc(1, sizeof(*e->views)), x->frame };
    if (!e->tile || !e->views || sun_views_begin(e->views, t->block_count, &x->bytes)) {
        mem_free(e->tile);
        mem_free(e->views);
        return -1;
    }
    fill_tile(x, e->tile, grid, at / edge / edge, at / edge % edge, at % edge);
    atomic_fetch_add(&x->bytes, sizeof(*e->tile) + sizeof(*e->views));
    return x->count++;
}

/* ---- A frame's sun ---- */

/* The part of the tile that contains a square of the grid; it is added if there is none yet. NULL when out of memory.
 */
static struct sun_part *find_part(struct transport *t, struct sun_parts *s, uint32_t grid, uint32_t face, uint32_t y,
                                  uint32_t x)
{
    const uint32_t edge = grid / SUN_EDGE, row = y / SUN_EDGE, column = x / SUN_EDGE,
                   key = ((face * edge + row) * edge + column) * 2 * SUN_GRID + grid;
    struct sun_corners *corners = s == &t->sun.later ? &t->index->later_corners : &t->index->corners;

    for (uint32_t k = s->count; k-- > 0;) /* the last ones are the likeliest */
        if (s->at[k].key == key)
            return &s->at[k];
    if (!mem_reserve(&s->at, s->count, &s->capacity, sizeof(*s->at)))
        return NULL;
    const int64_t tile = sun_index_find(t, key);
    if (tile < 0)
        return NULL;
    memset(&s->at[s->count], 0, sizeof(*s->at));
    s->at[s->count].key = key;
    s->at[s->count].tile = (uint32_t)tile;
    for (uint32_t k = 0; k < 4; k++) {
        s->at[s->count].corners[k] = sun_corner_find(corners, t, grid, face, row + k / 2, column + k % 2);
        if (!s->at[s->count].corners[k])
            return NULL;
    }
    return &s->at[s->count++];
}

static uint32_t square_bit(uint32_t y, uint32_t x)
{
    return y % SUN_EDGE * SUN_EDGE + x % SUN_EDGE;
}

enum err sun_spread_texel(struct transport *t, struct sun_parts *to, uint32_t n, uint32_t grid, uint32_t at,
                          const float *rgb)
{
    const uint32_t face = at / (n * n), i = at / n % n, j = at % n;

    for (uint32_t y = i * grid / n; y * n < (i + 1) * grid; y++)
        for (uint32_t z = j * grid / n; z * n < (j + 1) * grid; z++) {
            struct sun_part *p = find_part(t, to, grid, face, y, z);
            if (!p)
                return ERR_NOMEM;
            const float solid = rgb ? (float)cube_shared_solid_angle(n, i, j, grid, y, z) : 0.0f;
            const uint32_t k = square_bit(y, z);
            p->asked |= 1u << k;
            p->weight[k] += rgb ? solid * rgb_luminance(rgb[0], rgb[1], rgb[2]) : 0.0f;
            for (int c = 0; rgb && c < 3; c++)
                p->colour[c] += solid * rgb[c];
        }
    return ERR_OK;
}

static enum err spread_sun(struct transport *t, const struct environment *e, uint32_t grid)
{
    enum err result = ERR_OK;

    for (uint32_t k = 0; k < t->sky.sun_count && !result; k++) {
        const struct texel *x = &e->texels[t->sky.sun[k]];
        const float above = 1.0f - sky_lower(t->sky.level, rgb_luminance(x->r, x->g, x->b)),
                    rgb[3] = { above * x->r, above * x->g, above * x->b };
        result = sun_spread_texel(t, &t->sun.parts, e->n, grid, t->sky.sun[k], rgb);
    }
    return result;
}

static void finish_part(const struct transport *t, const struct environment *e, struct sun_part *p)
{
    const struct sun_tile *q = t->index->entries[p->tile].tile;
    float sum = 0.0f;

    for (uint32_t k = 0; k < SUN_TILE; k++) {
        const float w[3] = { q->x[k], q->y[k], q->z[k] };
        sum += p->weight[k];
        for (int i = 0; i < 3; i++)
            p->flux[i] += p->weight[k] * w[i];
        if (p->asked >> k & 1u)
            p->density[k] = (float)SUN_SAMPLES * sky_split_density(&t->sky, e, w);
    }
    for (int c = 0; c < 3; c++)
        p->colour[c] = sum > 0.0f ? p->colour[c] / sum : 0.0f;
}

#define CONE_COSINE 0.9f /* of the widest cone */
#define SMALL_COSINE                                                                                                   \
    0.9994f /* of the widest sun, 4 degrees across, that lobes as wide as a cell see as one direction */

static void sum_parts(const struct transport *t, struct transport_sun *s)
{
    float least = 1.0f, sum = 0.0f;

    memset(s->flux, 0, sizeof(s->flux));
    memset(s->colour, 0, sizeof(s->colour));
    for (uint32_t k = 0; k < s->parts.count; k++) {
        float weight = 0.0f;
        for (uint32_t d = 0; d < SUN_TILE; d++)
            weight += s->parts.at[k].weight[d];
        sum += weight;
        for (int i = 0; i < 3; i++) {
            s->flux[i] += s->parts.at[k].flux[i];
            s->colour[i] += weight * s->parts.at[k].colour[i];
        }
    }
    const float length = sqrtf(s->flux[0] * s->flux[0] + s->flux[1] * s->flux[1] + s->flux[2] * s->flux[2]);
    for (int i = 0; i < 3; i++) {
        s->axis[i] = length > 0.0f ? s->flux[i] / length : 0.0f;
        s->colour[i] = sum > 0.0f ? s->colour[i] / sum : 0.0f;
    }
    for (uint32_t k = 0; k < s->parts.count; k++) {
        const struct sun_tile *q = t->index->entries[s->parts.at[k].tile].tile;
        const float c = s->axis[0] * q->axis[0] + s->axis[1] * q->axis[1] + s->axis[2] * q->axis[2];
        least = fminf(least, cosf(acosf(fminf(1.0f, c)) + asinf(fminf(1.0f, q->sine))));
    }
    s->cosine = least > CONE_COSINE ? least - 1e-6f : -2.0f;
    s->sine = least > SMALL_COSINE ? sqrtf(1.0f - least * least) + 1e-5f : 2.0f;
}

#define WIDEST 0.02f /* radius of a sun whose way is asked for ahead, radians */

/* From its middle to the furthest texel, which differs by half between frames as it crosses texels: the widest yet. */
static void measure_sun(struct transport *t, uint32_t n)
{
    struct transport_sun *s = &t->sun;
    float least = 1.0f, w[3];

    for (uint32_t k = 0; k < t->sky.sun_count; k++) {
        const uint32_t at = t->sky.sun[k];
        invert_direction(n, at / (n * n), at / n % n + 0.5, at % n + 0.5, w);
        least = fminf(least, s->axis[0] * w[0] + s->axis[1] * w[1] + s->axis[2] * w[2]);
    }
    if (t->sky.sun_count == 0 || acosf(least) > WIDEST)
        return;
    s->radius = s->edge == n ? fmaxf(s->radius, acosf(least)) : acosf(least);
    s->edge = n;
}

#define SUN_AHEAD_LEAST 0.995f /* cosine of the longest way in so many frames, 6 degrees: a sun that jumps */

/* A moving sun would ask for many new directions in one frame and for none in the next ones. So frames ask early for
 * what it will meet if it goes on, each for a part of the blocks. */
static enum err look_ahead(struct transport *t, uint32_t grid, const float before[3])
{
    const struct sun_parts *now = &t->sun.parts;
    const float *axis = t->sun.axis;
    float way[3];

    t->sun.ahead.count = 0;
    for (int i = 0; i < 3; i++)
        way[i] = SUN_AHEAD * (axis[i] - before[i]);
    const float square = way[0] * way[0] + way[1] * way[1] + way[2] * way[2];
    if (square < 1e-8f || square > 2.0f * (1.0f - SUN_AHEAD_LEAST) || !(t->sun.sine < 1.0f))
        return ERR_OK;
    for (uint32_t k = 0; k < now->count; k++) {
        const struct sun_tile *q = t->index->entries[now->at[k].tile].tile; /* stays where it is as entries are added */
        for (uint32_t left = now->at[k].asked; left; left &= left - 1) {
            const int d = __builtin_ctz(left);
            const float w[3] = { q->x[d] + way[0], q->y[d] + way[1], q->z[d] + way[2] };
            float u, v;
            const uint32_t at = cube_texel(grid, w, &u, &v), y = at / grid % grid, x = at % grid;
            struct sun_part *p = find_part(t, &t->sun.ahead, grid, at / (grid * grid), y, x);
            if (!p)
                return ERR_NOMEM;
            p->asked |= 1u << square_bit(y, x);
        }
    }
    return ERR_OK;
}

static struct sun_index *new_index(void)
{
    struct sun_index *x = mem_alloc(1, sizeof(*x));

    for (uint32_t k = 0; x && k < SUN_TILE; k++)
        for (uint32_t l = 0; l < PACKET; l++)
            rng_sobol2(k, l, x->place[k][l]);
    return x;
}

enum err transport_sun_take(struct transport *t, const struct environment *e)
{
    struct transport_sun *s = &t->sun;
    const float before[3] = { s->axis[0], s->axis[1], s->axis[2] };
    uint32_t grid = SUN_GRID;

    s->parts.count = 0;
    if (!t->index && !(t->index = new_index()))
        return ERR_NOMEM;
    t->index->frame++;
    sun_corners_frame(&t->index->corners, 2 * SUN_AHEAD);
    if (sun_index_bytes(t) > t->index_bytes)
        sun_index_make_room(t, t->index_bytes / 4 * 3, UINT64_MAX);
    while (grid > SUN_GRID_LEAST && (uint64_t)t->sky.sun_count * grid * grid > (uint64_t)SUN_MOST * e->n * e->n)
        grid /= 2;
    enum err result = spread_sun(t, e, grid);
    for (uint32_t k = 0; k < s->parts.count && !result; k++)
        finish_part(t, e, &s->parts.at[k]);
    sum_parts(t, s);
    measure_sun(t, e->n);
    if (!result)
        result = look_ahead(t, grid, before);
    if (result)
        s->parts.count = s->ahead.count = 0;
    return result;
}

void transport_sun_forget(struct transport *t, uint32_t block)
{
    for (uint32_t k = 0; t->index && k < t->index->count; k++)
        sun_views_forget(t->index->entries[k].views, block);
    if (t->index)
        sun_corners_forget(&t->index->corners, t->blocks[block].first, t->blocks[block].packets);
}

void transport_sun_finish(struct transport *t)
{
    while (t->index && t->index->count > 0)
        drop_entry(t, 0);
    if (t->index) {
        mem_free(t->index->entries);
        sun_corners_finish(&t->index->corners);
        sun_corners_finish(&t->index->later_corners);
    }
    mem_free(t->index);
    mem_free(t->sun.parts.at);
    mem_free(t->sun.ahead.at);
    mem_free(t->sun.later.at);
    t->index = NULL;
    t->sun.parts = t->sun.ahead = t->sun.later = (struct sun_parts){ .count = 0 };
}

/* ---- Blocks ---- */

/* True: from all of the block's points the cells about the tile are completely visible, or completely occluded. False:
 * packets must be asked. */
static bool judge_block(const struct transport *t, const struct transport_block *b, const struct sun_tile *q,
                        struct sun_view *out)
{
    uint64_t seen = 0, hidden = 0;

    for (uint32_t k = 0; t->rays && k < SKY_CELLS / 64; k++) {
        seen |= b->sight->seen[k] & q->cells[k];
        hidden |= b->sight->hidden[k] & q->cells[k];
    }
    *out = seen || !t->rays ? sun_all_lit : sun_all_dark;
    return !seen || !hidden;
}

#define DAPPLED 3 /* lanes of a packet that see a part, from which on the others' corners may agree by chance */

/* A point sees all or nothing of a tile if its four corners say so. Under leaves that would make dappled shade too
 * dark. Returns the number of rows of bits. */
static uint32_t judge_packets(const struct transport *t, const struct transport_block *b, const struct sun_part *p,
                              struct sun_view *v, uint64_t *rays)
{
    uint32_t rows = 0;

    memset(v, 0, sizeof(*v));
    for (uint32_t k = 0; k < b->packets; k++) {
        struct transport_view view = { 0, 0 };
        for (uint32_t c = 0; c < 4; c++)
            sun_corner_look(t, p->corners[c], b->first + k, &view, rays);
        const uint32_t both = view.lit & view.dark, parts = __builtin_popcount(both) < DAPPLED ? both : UINT16_MAX;
        v->parts[k] = (uint16_t)parts;
        v->whole[k] = (uint16_t)(view.lit && !view.dark ? UINT16_MAX : view.lit & ~parts);
        for (uint32_t d = 0; parts && d < SUN_TILE; d++)
            v->bits[rows][d] = v->whole[k];
        rows += parts != 0;
    }
    return rows;
}

static void trace_missing(const struct transport *t, const struct transport_block *b, const struct sun_tile *q,
                          uint32_t asked, struct sun_view *v, uint64_t *rays)
{
    const uint32_t missing = asked & ~(uint32_t)v->known;
    struct transport_view view = { 0, 0 };
    uint32_t row = 0;

    for (uint32_t k = 0; k < b->packets && missing; k++)
        if (v->parts[k])
            *rays += t->kernels->sun->trace(t->rays, q->looks, &t->gbuffer->packets[b->first + k], missing, v->parts[k],
                                            v->bits[row++], &view);
    v->known = (uint16_t)(v->known | missing);
}

const struct sun_view *sun_look(const struct transport *t, uint32_t block, const struct sun_part *p,
                                struct sun_view *own, uint64_t *rays)
{
    struct sun_views *views = t->index->entries[p->tile].views;
    const struct sun_tile *q = t->index->entries[p->tile].tile;
    const struct transport_block *b = &t->blocks[block];
    struct sun_view *v = sun_views_get(views, block);

    if (!v) {
        uint32_t rows = 0;
        if (!judge_block(t, b, q, own))
            rows = judge_packets(t, b, p, own, rays);
        v = sun_views_put(views, block, own, b->packets, rows);
        v = v ? v : own;
    }
    if (v != &sun_all_lit && v != &sun_all_dark)
        trace_missing(t, b, q, p->asked, v, rays);
    return v;
}

/* Adds the light of some packets, part by part; at once, so that it has the same bits to whatever it is added. */
static void add_parts(const struct transport *t, uint32_t block, uint32_t packets, float *lo, uint64_t *rays)
{
    const struct transport_block *b = &t->blocks[block];
    float sum[TRANSPORT_PACKETS * 3 * PACKET] = { 0.0f };

    for (uint32_t i = 0; i < t->sun.parts.count; i++) {
        const struct sun_part *p = &t->sun.parts.at[i];
        struct sun_view own;
        const struct sun_view *v = sun_look(t, block, p, &own, rays);
        const uint16_t(*row)[SUN_TILE] = v->bits;
        for (uint32_t k = 0; k < b->packets; k++) {
            const uint16_t *bits = v->parts[k] ? *row++ : NULL;
            if (packets >> k & 1u && (v->whole[k] || bits))
                t->kernels->sun->light(p, t->index->entries[p->tile].tile, &t->gbuffer->packets[b->first + k],
                                       b->narrow, v->whole[k], bits, sum + (size_t)k * 3 * PACKET);
        }
    }
    for (uint32_t left = packets; left; left &= left - 1) {
        const size_t at = (size_t)__builtin_ctz(left) * 3 * PACKET;
        for (size_t i = at; i < at + 3 * PACKET; i++)
            lo[i] += sum[i];
    }
}

uint32_t transport_sun_add(struct transport *t, uint32_t block, float *lo, uint64_t *rays)
{
    const struct transport_block *b = &t->blocks[block];
    uint16_t lanes[TRANSPORT_PACKETS];
    uint32_t some = 0, differ = 0, parts = 0; /* packets: lit; by other tiles otherwise; with lanes that see a part */

    for (uint32_t i = 0; i < t->sun.parts.count; i++) {
        struct sun_view own;
        const struct sun_view *v = sun_look(t, block, &t->sun.parts.at[i], &own, rays);
        for (uint32_t k = 0; k < b->packets; k++) {
            lanes[k] = i ? lanes[k] : v->whole[k];
            some |= (uint32_t)((v->whole[k] | v->parts[k]) != 0) << k;
            differ |= (uint32_t)(v->whole[k] != lanes[k]) << k;
            parts |= (uint32_t)(v->parts[k] != 0) << k;
        }
    }
    for (uint32_t left = b->narrow ? 0 : some & ~differ & ~parts; left; left &= left - 1) {
        const uint32_t k = (uint32_t)__builtin_ctz(left);
        if (t->kernels->sun->whole(&t->sun, &t->gbuffer->packets[b->first + k], lanes[k], lo + (size_t)k * 3 * PACKET))
            some &= ~(1u << k);
    }
    if (some)
        add_parts(t, block, some, lo, rays);
    for (uint32_t i = 0; block % SUN_AHEAD == t->index->frame % SUN_AHEAD && i < t->sun.ahead.count; i++) {
        struct sun_view own;
        sun_look(t, block, &t->sun.ahead.at[i], &own, rays);
    }
    return (uint32_t)__builtin_popcount(parts);
}
