#include "sky/tables/resample.h"

#include "base/mem.h"
#include "base/vec.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define BLOCKS_MAX ((size_t)1 << 23) /* a table of about 100 MB, and some 500 MB while it is built */
#define BLOCKS_PER_TEXEL 8           /* per cube map texel; a finer source makes no visible difference */
#define BLOCKS_FEW ((size_t)1 << 20) /* not worth reducing, however coarse the cube map is */
#define TEXEL_BYTES (3 * sizeof(float))
#define LINE_WORDS (((size_t)UINT16_MAX * TEXEL_BYTES / LINE_BYTES + 2) / 64 + 1)
#define FIT_ROUNDS 400     /* a limit; the tolerance ends it earlier */
#define FIT_TOLERANCE 8e-6 /* relative, of a block's energy */
#define FIT_HASTE 1.7      /* over-relaxation: halves the number of iterations */

static uint32_t choose_factor(enum layout layout, uint32_t width, uint32_t height, uint32_t n)
{
    const size_t useful = (size_t)BLOCKS_PER_TEXEL * CUBE_FACES * n * n;
    const size_t cap = useful > BLOCKS_MAX ? BLOCKS_MAX : useful < BLOCKS_FEW ? BLOCKS_FEW : useful;
    struct blocks b;
    uint32_t factor = 1;

    for (blocks_init(&b, layout, width, height, 1); (size_t)b.columns * b.rows > cap;)
        blocks_init(&b, layout, width, height, ++factor);
    return factor;
}

static enum err find_row_edges(const struct blocks *b, struct row_edges *out)
{
    out->height = mem_alloc((size_t)b->rows + 1, sizeof(*out->height));
    out->sine = mem_alloc((size_t)b->rows + 1, sizeof(*out->sine));
    if (!out->height || !out->sine)
        return ERR_NOMEM;
    for (uint32_t r = 0; r <= b->rows; r++) {
        const uint32_t y = r == b->rows                               ? b->height
                           : b->layout == LAYOUT_LATLONG_BOTTOM_FIRST ? b->height - blocks_end(b, 1, b->rows - 1 - r)
                                                                      : blocks_start(b, 1, r);
        const double h = y == 0 ? 1.0 : y == b->height ? -1.0 : cos(PI * y / b->height);
        out->height[r] = h;
        out->sine[r] = sqrt(fmax(1e-300, 1.0 - h * h));
    }
    return ERR_OK;
}

/* Finds all overlaps, in lists[count]: per part of the cube map for lat-long, per row of blocks for the others. */
static enum err find_overlaps(const struct blocks *b, const struct cube_side *side, struct overlaps *lists,
                              uint32_t count)
{
    const bool latlong = !layout_faces(b->layout) && !layout_is_disc(b->layout);
    struct row_edges edges = { NULL, NULL };
    const enum err e = latlong ? find_row_edges(b, &edges) : ERR_OK;

#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t i = 0; i < count; i++) {
        lists[i].e = e;
        if (!e && latlong)
            resample_latlong_part(b, side, &edges, i, &lists[i]);
        else if (!e)
            resample_polygon_row(b, side, i, &lists[i]);
    }
    mem_free(edges.height);
    mem_free(edges.sine);
    return e;
}

/* The covered solid angle of each cube map texel: the row sums of the matrix. A layout that covers all faces alike and
 * completely has those of one face. */
static double *shown_of_texels(const struct resample_table *r)
{
    const uint32_t n = r->key.n, faces = layout_is_disc(r->key.layout) ? CUBE_FACES : 1;
    const size_t face_texels = (size_t)n * n;
    const double step = 2.0 / n;
    double *shown = mem_alloc_raw(faces * face_texels, sizeof(*shown));

    if (!shown)
        return NULL;
    cube_solid_angles(n, shown);
    for (uint32_t face = 0; face < faces; face++) {
        if (face > 0 && r->key.layout != LAYOUT_FISHEYE)
            memcpy(shown + face * face_texels, shown, face_texels * sizeof(*shown));
        for (size_t k = 0; k < face_texels && r->key.layout == LAYOUT_FISHEYE; k++) {
            const double u = -1.0 + step * (double)(k % n), v = -1.0 + step * (double)(k / n);
            shown[face * face_texels + k] = layout_shown_of_face(r->key.layout, face, u, v, u + step, v + step);
        }
    }
    return shown;
}

/* The solid angle of each block: the column sums. */
static double *shown_of_blocks(const struct blocks *b)
{
    double *shown = mem_alloc((size_t)b->columns * b->rows, sizeof(*shown));

    if (!shown)
        return NULL;
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < b->rows; y++)
        for (uint32_t x = 0; x < b->columns; x++) {
            double low[2], high[2];
            blocks_bounds(b, x, y, low, high);
            shown[(size_t)y * b->columns + x] = layout_solid_angle(b->layout, b->width, b->height, low, high);
        }
    return shown;
}

/* The texels of a ball and a fisheye have curved borders, so their overlaps are slightly off. Rows and columns are
 * scaled alternately until both have their exact sums (iterative proportional fitting). */
static enum err fit(const struct resample_table *r, struct resample_sorted *s, const double *row_sum,
                    const double *column_sum)
{
    const size_t texels = (size_t)CUBE_FACES * r->key.n * r->key.n, blocks = (size_t)r->columns * r->rows;
    double *sum = mem_alloc(blocks, sizeof(*sum));
    double worst = 1.0;

    for (int round = 0; sum && round < FIT_ROUNDS && worst > FIT_TOLERANCE; round++) {
        memset(sum, 0, blocks * sizeof(*sum));
        for (size_t t = 0; t < texels; t++) {
            double row = 0.0;
            for (size_t k = s->first[t]; k < s->first[t + 1]; k++)
                row += s->items[k].solid_angle;
            const double scale = row > 0.0 ? row_sum[t] / row : 0.0;
            for (size_t k = s->first[t]; k < s->first[t + 1]; k++)
                sum[s->items[k].block] += s->items[k].solid_angle *= scale;
        }
        worst = 0.0;
        for (size_t b = 0; b < blocks; b++) {
            if (sum[b] > 0.0)
                worst = fmax(worst, fabs(sum[b] / column_sum[b] - 1.0));
            const double scale = sum[b] > 0.0 ? column_sum[b] / sum[b] : 0.0;
            sum[b] = fabs(scale - 1.0) < 0.1 ? 1.0 + FIT_HASTE * (scale - 1.0) : scale;
        }
        if (worst > FIT_TOLERANCE)
            for (size_t k = 0; k < s->first[texels]; k++)
                s->items[k].solid_angle *= sum[s->items[k].block];
    }
    mem_free(sum);
    return sum ? ERR_OK : ERR_NOMEM;
}

/* Converts solid angles to weights that sum to 1, so that a constant stays constant to the last bit of float. Returns
 * the uncovered share of the texel, which the mean fills. */
static double weigh(const struct resample_table *t, struct resample_sorted *s, size_t texel, const double *row_sum)
{
    const uint32_t n = t->key.n;
    const double step = 2.0 / n;
    double sum = 0.0, seen = 1.0;

    for (size_t k = s->first[texel]; k < s->first[texel + 1]; k++)
        sum += s->items[k].solid_angle;
    if (t->unseen) {
        const double u = -1.0 + step * (double)(texel % n), v = -1.0 + step * (double)(texel / n % n);
        seen = sum > 0.0 ? row_sum[texel] / cube_solid_angle(u, v, u + step, v + step) : 0.0;
    }
    for (size_t k = s->first[texel]; k < s->first[texel + 1]; k++)
        s->items[k].solid_angle = seen * s->items[k].solid_angle / sum;
    return seen;
}

/* Texel `in_tile` of a tile in `sorted`; false beyond the edge of the face. */
static bool find_texel(const struct resample_table *t, uint32_t tile, uint32_t in_tile, size_t *texel)
{
    const uint32_t n = t->key.n, across = t->across, face = tile / (across * across);
    const uint32_t row = tile / across % across * TILE + in_tile / TILE, column = tile % across * TILE + in_tile % TILE;

    *texel = ((size_t)face * n + row) * n + column;
    return row < n && column < n;
}

/* The texels of a tile by their numbers of terms, most first; those with equal numbers in their own order. */
static void sort_by_terms(const uint32_t terms[TILE * TILE], uint8_t order[TILE * TILE])
{
    uint8_t place[RESAMPLE_MANY + 2] = { 0 }; /* of the next texel with as many terms; the last: with more than that */
    uint32_t start = 0;

    for (uint32_t k = 0; k < TILE * TILE; k++)
        place[terms[k] > RESAMPLE_MANY ? RESAMPLE_MANY + 1 : terms[k]]++;
    for (uint32_t c = RESAMPLE_MANY + 2; c-- > 0;) {
        const uint8_t count = place[c];
        place[c] = (uint8_t)start;
        start += count;
    }
    const uint32_t many = place[RESAMPLE_MANY];
    for (uint32_t k = 0; k < TILE * TILE; k++)
        order[place[terms[k] > RESAMPLE_MANY ? RESAMPLE_MANY + 1 : terms[k]]++] = (uint8_t)k;
    for (uint32_t i = 1; i < many; i++) { /* few tiles have any of these */
        const uint8_t texel = order[i];
        uint32_t k = i;
        for (; k > 0 && terms[order[k - 1]] < terms[texel]; k--)
            order[k] = order[k - 1];
        order[k] = texel;
    }
}

/* Assigns texels to octets, and sets each octet's steps (temporarily in `first`) and the base of its block numbers.
 * Returns the largest distance from the base. */
static uint32_t lay_out_tile(const struct resample_table *t, const struct resample_sorted *s, uint32_t tile)
{
    struct octet *octets = t->octets + (size_t)OCTETS * tile;
    uint32_t terms[TILE * TILE], low = UINT32_MAX, highest = 0, many = 0, end = 0;
    uint8_t order[TILE * TILE];

    for (uint32_t k = 0; k < TILE * TILE; k++) {
        size_t texel;
        terms[k] = 0;
        if (!find_texel(t, tile, k, &texel) || s->first[texel] == s->first[texel + 1])
            continue;
        const uint32_t first = s->items[s->first[texel]].block, last = s->items[s->first[texel + 1] - 1].block;
        terms[k] = s->first[texel + 1] - s->first[texel];
        low = first < low ? first : low;
        highest = last > highest ? last : highest;
    }
    end = highest == t->columns * t->rows - 1;
    sort_by_terms(terms, order);
    for (uint32_t k = 0; k < OCTETS; k++) {
        octets[k].first = terms[order[8 * k]];
        many = octets[k].first > RESAMPLE_MANY;
        octets[k].base = low & INT32_MAX;
        octets[k].careful = (many || end) & 1;
        memcpy(octets[k].texel, order + 8 * k, sizeof(octets[k].texel));
    }
    return highest > low ? highest - low : 0;
}

/* Writes a texel's terms to its lane; padding repeats the last block with weight 0. */
static void fill_lane(struct resample_table *t, const struct resample_sorted *s, size_t texel, const struct octet *e,
                      uint32_t lane)
{
    const uint32_t terms = texel == SIZE_MAX ? 0 : s->first[texel + 1] - s->first[texel];
    const struct overlap *items = terms ? s->items + s->first[texel] : NULL;

    for (uint32_t k = 0; k < e[1].first - e->first; k++) {
        const size_t at = (size_t)8 * (e->first + k) + lane;
        const uint32_t block = terms ? items[k < terms ? k : terms - 1].block - e->base : 0;
        t->weight[at] = k < terms ? (float)items[k].solid_angle : 0.0f;
        if (t->near)
            t->near[at] = (uint16_t)block;
        else
            t->far[at] = block;
    }
}

static void fill_tile(struct resample_table *t, struct resample_sorted *s, uint32_t tile, const double *row_sum)
{
    for (size_t k = 0; k < 8 * OCTETS; k++) {
        const struct octet *e = &t->octets[(size_t)OCTETS * tile + k / 8];
        size_t texel;
        if (find_texel(t, tile, e->texel[k % 8], &texel)) {
            const double seen = weigh(t, s, texel, row_sum);
            if (t->unseen)
                t->unseen[(size_t)8 * OCTETS * tile + k] = (float)(1.0 - seen);
        } else {
            texel = SIZE_MAX;
        }
        fill_lane(t, s, texel, e, k % 8);
    }
}

/* Lists the cache lines of a tile's blocks, ascending and relative to the line of its base. Returns their number.
 * Assumes that the source starts at a cache line, as mem_alloc guarantees; otherwise the list is off by one. */
static uint32_t find_lines(const struct resample_table *t, uint32_t tile, uint16_t *out)
{
    const struct octet *e = &t->octets[(size_t)OCTETS * tile];
    const size_t start = e->base * TEXEL_BYTES / LINE_BYTES;
    uint64_t lines[LINE_WORDS]; /* a bit set, of which so many words are in use */
    size_t used = 0;
    uint32_t count = 0;

    for (size_t k = 8 * (size_t)e[0].first; k < 8 * (size_t)e[OCTETS].first; k++) {
        const size_t from = (e->base + (size_t)t->near[k]) * TEXEL_BYTES;
        for (size_t at = from / LINE_BYTES - start; at <= (from + TEXEL_BYTES - 1) / LINE_BYTES - start; at++) {
            while (used <= at / 64)
                lines[used++] = 0;
            lines[at / 64] |= UINT64_C(1) << at % 64;
        }
    }
    for (size_t at = 0; at < used; at++)
        for (uint64_t left = lines[at]; left; left &= left - 1)
            out[count++] = (uint16_t)(64 * at + (uint32_t)__builtin_ctzll(left));
    return count;
}

/* A row of tiles, whose lists start where its terms would. Each has at most two lines. */
static size_t row_lines(const struct resample_table *t, uint32_t row)
{
    return (size_t)2 * 8 * t->octets[(size_t)OCTETS * t->across * row].first;
}

static enum err list_lines(struct resample_table *t)
{
    const uint32_t rows = CUBE_FACES * t->across, tiles = rows * t->across;
    uint16_t *found = mem_alloc_raw(row_lines(t, rows), sizeof(*found));

    t->line_first = mem_alloc_raw((size_t)tiles + 1, sizeof(*t->line_first));
    if (!found || !t->line_first) {
        mem_free(found);
        return ERR_NOMEM;
    }
    t->line_first[0] = 0;
#pragma omp parallel for schedule(static)
    for (uint32_t row = 0; row < rows; row++) {
        uint16_t *out = found + row_lines(t, row);
        for (uint32_t k = row * t->across; k < (row + 1) * t->across; k++)
            out += t->line_first[k + 1] = find_lines(t, k, out);
    }
    for (uint32_t k = 0; k < tiles; k++)
        t->line_first[k + 1] += t->line_first[k];
    t->line = mem_alloc_raw(t->line_first[tiles], sizeof(*t->line));
    for (uint32_t row = 0; t->line && row < rows; row++) {
        const uint32_t from = t->line_first[row * t->across], to = t->line_first[(row + 1) * t->across];
        memcpy(t->line + from, found + row_lines(t, row), (to - from) * sizeof(*t->line));
    }
    mem_free(found);
    return t->line ? ERR_OK : ERR_NOMEM;
}

static enum err pack(struct resample_table *t, struct resample_sorted *s, const double *row_sum)
{
    const uint32_t tiles = CUBE_FACES * t->across * t->across;
    const bool whole = layout_shown(t->key.layout) >= 4.0 * PI;
    uint32_t farthest = 0, steps = 0;

    t->octets = mem_alloc((size_t)OCTETS * tiles + 1, sizeof(*t->octets));
    if (!whole)
        t->unseen = mem_alloc((size_t)8 * OCTETS * tiles, sizeof(*t->unseen));
    if (!t->octets || (!whole && !t->unseen))
        return ERR_NOMEM;
#pragma omp parallel for schedule(static) reduction(max : farthest)
    for (uint32_t k = 0; k < tiles; k++) {
        const uint32_t far = lay_out_tile(t, s, k);
        farthest = far > farthest ? far : farthest;
    }
    for (size_t k = 0; k <= (size_t)OCTETS * tiles; k++) {
        const uint32_t own = t->octets[k].first;
        t->octets[k].first = steps;
        steps += own;
    }
    t->weight = mem_alloc_large_raw(steps, 8 * sizeof(*t->weight));
    if (farthest <= UINT16_MAX)
        t->near = mem_alloc_large_raw(steps, 8 * sizeof(*t->near));
    else
        t->far = mem_alloc_large_raw(steps, 8 * sizeof(*t->far));
    if (!t->weight || (!t->near && !t->far))
        return ERR_NOMEM;
#pragma omp parallel for schedule(static)
    for (uint32_t k = 0; k < tiles; k++)
        fill_tile(t, s, k, row_sum);
    return t->near ? list_lines(t) : ERR_OK;
}

static enum err make_table(struct resample_table *t, const struct blocks *b, struct overlaps *lists, uint32_t count)
{
    const uint32_t n = t->key.n;
    const size_t blocks = (size_t)t->columns * t->rows;
    double *row_sum = shown_of_texels(t), *column_sum = NULL;
    struct resample_sorted s = { 0 };
    enum err e = row_sum ? ERR_OK : ERR_NOMEM;

    if (!e) { /* every layout covers face +Y completely, so its solid angles serve for all faces */
        const size_t up = layout_is_disc(t->key.layout) ? 2 : 0;
        const struct cube_side side = { n, t->key.rotation, row_sum + up * n * n };
        e = find_overlaps(b, &side, lists, count);
    }
    if (!e)
        e = resample_gather(b, n, lists, count, &s);
    if (!e && layout_is_disc(t->key.layout)) {
        column_sum = shown_of_blocks(b);
        e = column_sum ? fit(t, &s, row_sum, column_sum) : ERR_NOMEM;
    }
    if (!e)
        e = pack(t, &s, row_sum);
    if (!e && t->unseen) {
        t->block_sum = mem_alloc(blocks, sizeof(*t->block_sum));
        e = t->block_sum ? ERR_OK : ERR_NOMEM;
        for (size_t k = 0; !e && k < blocks; k++)
            t->block_sum[k] = (float)(column_sum[k] / layout_shown(t->key.layout));
    }
    mem_free(row_sum);
    mem_free(column_sum);
    mem_free(s.first);
    mem_free(s.items);
    return e;
}

enum err resample_table_create(const struct resample_key *key, struct resample_table **out)
{
    const enum layout layout = key->layout;
    struct blocks b;

    *out = NULL;
    enum err e = layout == LAYOUT_AUTO ? ERR_UNSUPPORTED : layout_fits(layout, key->width, key->height, "", NULL);
    if (e)
        return e;
    blocks_init(&b, layout, key->width, key->height, choose_factor(layout, key->width, key->height, key->n));
    const uint32_t count = layout_faces(layout) || layout_is_disc(layout) ? b.rows : RESAMPLE_LATLONG_PARTS * key->n;
    struct resample_table *t = mem_alloc(1, sizeof(*t));
    struct overlaps *lists = mem_alloc(count, sizeof(*lists));
    e = t && lists ? ERR_OK : ERR_NOMEM;
    if (!e) {
        *t = (struct resample_table){ .key = *key, .factor = b.factor, .columns = b.columns, .rows = b.rows };
        t->across = (key->n + TILE - 1) / TILE;
        if (b.factor > 1)
            e = resample_make_share(t, &b);
    }
    if (!e)
        e = make_table(t, &b, lists, count);
    for (uint32_t i = 0; lists && i < count; i++)
        mem_free(lists[i].items);
    mem_free(lists);
    if (e)
        resample_table_destroy(t);
    else
        *out = t;
    return e;
}

void resample_table_destroy(struct resample_table *t)
{
    if (!t)
        return;
    mem_free(t->octets);
    mem_free(t->weight);
    mem_free(t->near);
    mem_free(t->far);
    mem_free(t->line_first);
    mem_free(t->line);
    mem_free(t->unseen);
    mem_free(t->block_sum);
    mem_free(t->share);
    mem_free(t);
}
