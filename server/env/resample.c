#include "resample.h"

#include "mem.h"
#include "resample_build.h"
#include "vec.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MANY 64                      /* terms that are still added in float */
#define BLOCKS_MAX ((size_t)1 << 23) /* a table of about 100 MB, and some 500 MB while it is made */
#define BLOCKS_PER_TEXEL 8           /* of the cube map: finer than that is not seen */
#define BLOCKS_FEW ((size_t)1 << 20) /* not worth reducing, however coarse the cube map */
#define FIT_ROUNDS 400
#define FIT_TOLERANCE 8e-6
#define FIT_HASTE 1.7 /* over-relaxation: halves the rounds */

void blocks_init(struct blocks *b, enum layout layout, uint32_t width, uint32_t height, uint32_t factor)
{
    const uint32_t size = layout_faces(layout) ? layout_face_size(layout, width) : 0;

    *b = (struct blocks){ .layout = layout, .width = width, .height = height, .factor = factor };
    b->cell[0] = size ? size : width;
    b->cell[1] = size ? size : height;
    for (int k = 0; k < 2; k++)
        b->per_cell[k] = (b->cell[k] + factor - 1) / factor;
    b->columns = width / b->cell[0] * b->per_cell[0];
    b->rows = height / b->cell[1] * b->per_cell[1];
}

/* Where along one coordinate a block begins, in texels. */
static uint32_t block_start(const struct blocks *b, int k, uint32_t index)
{
    return index / b->per_cell[k] * b->cell[k] + index % b->per_cell[k] * b->factor;
}

static uint32_t block_end(const struct blocks *b, int k, uint32_t index)
{
    const uint32_t end = index % b->per_cell[k] * b->factor + b->factor;
    return index / b->per_cell[k] * b->cell[k] + (end < b->cell[k] ? end : b->cell[k]);
}

void blocks_bounds(const struct blocks *b, uint32_t column, uint32_t row, double low[2], double high[2])
{
    low[0] = block_start(b, 0, column);
    low[1] = block_start(b, 1, row);
    high[0] = block_end(b, 0, column);
    high[1] = block_end(b, 1, row);
}

enum err overlaps_add(struct overlaps *o, uint32_t texel, uint32_t block, double solid_angle)
{
    if (o->count == o->capacity) {
        const size_t more = o->capacity ? o->capacity + o->capacity / 2 : 1024;
        struct overlap *grown = mem_grow(o->items, o->count, more, sizeof(*grown));
        if (!grown)
            return ERR_NOMEM;
        o->items = grown;
        o->capacity = more;
    }
    o->items[o->count++] = (struct overlap){ texel, block, solid_angle };
    return ERR_OK;
}

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

/* All overlaps, in lists[count]: by rows of the cube map for lat-long, by rows of blocks for the others. */
static enum err find_overlaps(const struct blocks *b, const struct cube_side *side, struct overlaps *lists,
                              uint32_t count)
{
    const int latlong = !layout_faces(b->layout) && !layout_is_disc(b->layout);
    double *edge_cos = mem_alloc((size_t)b->rows + 1, sizeof(*edge_cos));
    enum err e = edge_cos ? ERR_OK : ERR_NOMEM;

    for (uint32_t r = 0; !e && r <= b->rows; r++) {
        const uint32_t y = b->layout == LAYOUT_LATLONG_BOTTOM_FIRST
                               ? (r == b->rows ? b->height : b->height - block_end(b, 1, b->rows - 1 - r))
                               : (r == b->rows ? b->height : block_start(b, 1, r));
        edge_cos[r] = y == 0 ? 1.0 : y == b->height ? -1.0 : cos(PI * y / b->height);
    }
#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t i = 0; i < count; i++) {
        lists[i].e = e;
        if (!e && latlong)
            resample_latlong_row(b, side, edge_cos, i, &lists[i]);
        else if (!e)
            resample_polygon_row(b, side, i, &lists[i]);
    }
    mem_free(edge_cos);
    return e;
}

static int by_block(const void *a, const void *b)
{
    const struct overlap *x = a, *y = b;
    return (x->block > y->block) - (x->block < y->block);
}

/* The lists as one table, ordered by cube texel and within it by block. The lists are emptied on the way. */
static enum err gather(struct resampler *r, struct overlaps *lists, uint32_t count, struct overlap **table)
{
    const size_t texels = (size_t)CUBE_FACES * r->n * r->n;
    size_t total = 0;

    for (uint32_t i = 0; i < count; i++) {
        if (lists[i].e)
            return lists[i].e;
        total += lists[i].count;
    }
    assert(total < UINT32_MAX);
    r->first = mem_alloc(texels + 2, sizeof(*r->first));
    *table = mem_alloc(total, sizeof(**table));
    if (!r->first || !*table)
        return ERR_NOMEM;
    for (uint32_t i = 0; i < count; i++) /* first[t + 2]: how many t has; then first[t + 1]: where its next one goes */
        for (size_t k = 0; k < lists[i].count; k++)
            r->first[lists[i].items[k].texel + 2]++;
    for (size_t t = 2; t < texels + 2; t++)
        r->first[t] += r->first[t - 1];
    for (uint32_t i = 0; i < count; i++) {
        for (size_t k = 0; k < lists[i].count; k++)
            (*table)[r->first[lists[i].items[k].texel + 1]++] = lists[i].items[k];
        mem_free(lists[i].items);
        lists[i].items = NULL;
    }
#pragma omp parallel for schedule(dynamic, 1024)
    for (size_t t = 0; t < texels; t++)
        qsort(*table + r->first[t], r->first[t + 1] - r->first[t], sizeof(**table), by_block);
    return ERR_OK;
}

/* What the layout shows of each texel of the cube map: the row sums of the table. */
static double *shown_of_texels(const struct resampler *r)
{
    const double step = 2.0 / r->n;
    double *shown = mem_alloc((size_t)CUBE_FACES * r->n * r->n, sizeof(*shown));

    for (uint32_t row = 0; shown && row < CUBE_FACES * r->n; row++) {
        const double v = -1.0 + step * (row % r->n);
        for (uint32_t j = 0; j < r->n; j++) {
            const double u = -1.0 + step * j;
            shown[(size_t)row * r->n + j] = layout_shown_of_face(r->layout, row / r->n, u, v, u + step, v + step);
        }
    }
    return shown;
}

/* What each block covers: the column sums. */
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

/* Borders of a ball's and a fisheye's texels are curved, so their overlaps are slightly off. Rows and columns are
 * scaled in turn until both have their exact sums (iterative proportional fitting). */
static enum err fit(const struct resampler *r, struct overlap *table, const double *row_sum, const double *column_sum)
{
    const size_t texels = (size_t)CUBE_FACES * r->n * r->n, blocks = (size_t)r->columns * r->rows;
    double *sum = mem_alloc(blocks, sizeof(*sum));
    double worst = 1.0;

    for (int round = 0; sum && round < FIT_ROUNDS && worst > FIT_TOLERANCE; round++) {
        memset(sum, 0, blocks * sizeof(*sum));
        for (size_t t = 0; t < texels; t++) {
            double row = 0.0;
            for (size_t k = r->first[t]; k < r->first[t + 1]; k++)
                row += table[k].solid_angle;
            const double scale = row > 0.0 ? row_sum[t] / row : 0.0;
            for (size_t k = r->first[t]; k < r->first[t + 1]; k++)
                sum[table[k].block] += table[k].solid_angle *= scale;
        }
        worst = 0.0;
        for (size_t b = 0; b < blocks; b++) {
            if (sum[b] > 0.0)
                worst = fmax(worst, fabs(sum[b] / column_sum[b] - 1.0));
            const double scale = sum[b] > 0.0 ? column_sum[b] / sum[b] : 0.0;
            sum[b] = fabs(scale - 1.0) < 0.1 ? 1.0 + FIT_HASTE * (scale - 1.0) : scale;
        }
        if (worst > FIT_TOLERANCE)
            for (size_t k = 0; k < r->first[texels]; k++)
                table[k].solid_angle *= sum[table[k].block];
    }
    mem_free(sum);
    return sum ? ERR_OK : ERR_NOMEM;
}

/* Weights are shares of what was found, so that a constant stays constant to the last bit of float. What is shown of a
 * texel is a share of it too: the rest is the mean's. */
static enum err weigh(struct resampler *r, const struct overlap *table, const double *row_sum)
{
    const size_t texels = (size_t)CUBE_FACES * r->n * r->n, total = r->first[texels];
    const double step = 2.0 / r->n;

    r->index = mem_alloc(total, sizeof(*r->index));
    r->weight = mem_alloc(total, sizeof(*r->weight));
    if (layout_shown(r->layout) < 4.0 * PI)
        r->unseen = mem_alloc(texels, sizeof(*r->unseen));
    if (!r->index || !r->weight || (layout_shown(r->layout) < 4.0 * PI && !r->unseen))
        return ERR_NOMEM;
#pragma omp parallel for schedule(static)
    for (size_t t = 0; t < texels; t++) {
        double sum = 0.0, seen = 1.0;
        for (size_t k = r->first[t]; k < r->first[t + 1]; k++)
            sum += table[k].solid_angle;
        if (r->unseen) {
            const double u = -1.0 + step * (double)(t % r->n), v = -1.0 + step * (double)(t / r->n % r->n);
            seen = sum > 0.0 ? row_sum[t] / cube_solid_angle(u, v, u + step, v + step) : 0.0;
            r->unseen[t] = (float)(1.0 - seen);
        }
        for (size_t k = r->first[t]; k < r->first[t + 1]; k++) {
            r->index[k] = table[k].block;
            r->weight[k] = (float)(seen * table[k].solid_angle / sum);
        }
    }
    return ERR_OK;
}

/* Solid angles of single texels, for the reduction. They repeat: lat-long, by row; cubes, by place within the face;
 * the others are symmetric about both middles. */
static size_t share_place(const struct resampler *r, uint32_t x, uint32_t y)
{
    if (layout_faces(r->layout)) {
        const uint32_t size = layout_face_size(r->layout, r->width);
        return (size_t)(y % size) * size + x % size;
    }
    if (layout_is_disc(r->layout)) {
        const uint32_t a = x < r->width / 2 ? r->width - 1 - x : x, b = y < r->height / 2 ? r->height - 1 - y : y;
        return (size_t)(b - r->height / 2) * (r->width - r->width / 2) + a - r->width / 2;
    }
    return y;
}

static enum err make_share(struct resampler *r, const struct blocks *b)
{
    const int faces = layout_faces(r->layout) != NULL, disc = layout_is_disc(r->layout);
    const uint32_t x0 = disc ? r->width / 2 : 0, y0 = disc ? r->height / 2 : 0;
    const uint32_t x1 = faces ? b->cell[0] : disc ? r->width : 1, y1 = faces ? b->cell[1] : r->height;
    /* The top left cell of a cross is not read; the one below it is. */
    const uint32_t down = faces && r->layout != LAYOUT_CUBE ? b->cell[1] : 0;

    r->share = mem_alloc((size_t)(x1 - x0) * (y1 - y0), sizeof(*r->share));
    r->reduced = mem_alloc(3 * (size_t)r->columns * r->rows, sizeof(*r->reduced));
    if (!r->share || !r->reduced)
        return ERR_NOMEM;
#pragma omp parallel for schedule(dynamic, 16)
    for (uint32_t y = y0; y < y1; y++)
        for (uint32_t x = x0; x < x1; x++) {
            const double low[2] = { x, y + down }, high[2] = { x + 1.0, y + down + 1.0 };
            r->share[share_place(r, x, y)] = (float)layout_solid_angle(r->layout, r->width, r->height, low, high);
        }
    return ERR_OK;
}

static enum err make_table(struct resampler *r, const struct blocks *b, struct overlaps *lists, uint32_t count)
{
    const size_t blocks = (size_t)r->columns * r->rows;
    double *row_sum = shown_of_texels(r), *column_sum = NULL;
    struct overlap *table = NULL;
    enum err e = row_sum ? ERR_OK : ERR_NOMEM;

    if (!e) { /* the solid angles of face +Y, which every layout shows whole, are those of each */
        const struct cube_side side = { r->n, r->rotation, row_sum + 2 * (size_t)r->n * r->n };
        e = find_overlaps(b, &side, lists, count);
    }
    if (!e)
        e = gather(r, lists, count, &table);
    if (!e && layout_is_disc(r->layout)) {
        column_sum = shown_of_blocks(b);
        e = column_sum ? fit(r, table, row_sum, column_sum) : ERR_NOMEM;
    }
    if (!e)
        e = weigh(r, table, row_sum);
    if (!e && r->unseen) {
        r->block_sum = mem_alloc(blocks, sizeof(*r->block_sum));
        e = r->block_sum ? ERR_OK : ERR_NOMEM;
        for (size_t k = 0; !e && k < blocks; k++)
            r->block_sum[k] = (float)(column_sum[k] / layout_shown(r->layout));
    }
    mem_free(row_sum);
    mem_free(column_sum);
    mem_free(table);
    return e;
}

enum err resampler_create(enum layout layout, uint32_t width, uint32_t height, uint32_t n, double rotation,
                          struct resampler **out)
{
    struct blocks b;

    *out = NULL;
    enum err e = layout == LAYOUT_AUTO ? ERR_UNSUPPORTED : layout_fits(layout, width, height, "", NULL);
    if (e)
        return e;
    blocks_init(&b, layout, width, height, choose_factor(layout, width, height, n));
    const uint32_t count = layout_faces(layout) || layout_is_disc(layout) ? b.rows : CUBE_FACES * n;
    struct resampler *r = mem_alloc(1, sizeof(*r));
    struct overlaps *lists = mem_alloc(count, sizeof(*lists));
    e = r && lists ? ERR_OK : ERR_NOMEM;
    if (!e) {
        *r = (struct resampler){ .layout = layout, .width = width, .height = height, .n = n, .rotation = rotation };
        r->factor = b.factor;
        r->columns = b.columns;
        r->rows = b.rows;
        if (b.factor > 1)
            e = make_share(r, &b);
    }
    if (!e)
        e = make_table(r, &b, lists, count);
    for (uint32_t i = 0; lists && i < count; i++)
        mem_free(lists[i].items);
    mem_free(lists);
    if (e)
        resampler_destroy(r);
    else
        *out = r;
    return e;
}

void resampler_destroy(struct resampler *r)
{
    if (!r)
        return;
    mem_free(r->first);
    mem_free(r->index);
    mem_free(r->weight);
    mem_free(r->unseen);
    mem_free(r->block_sum);
    mem_free(r->share);
    mem_free(r->reduced);
    mem_free(r);
}

/* Part of a row of the source into its block: sum[3] of texels by solid angle, and whole, the solid angles'. */
static void add_texels(const struct resampler *r, const float *rgb, uint32_t x0, uint32_t x1, uint32_t y, double sum[3],
                       double *whole)
{
    const float *s = rgb + 3 * ((size_t)y * r->width + x0);
    const int by_row = !layout_faces(r->layout) && !layout_is_disc(r->layout);
    float row[3] = { 0.0f, 0.0f, 0.0f };

    if (by_row) { /* one solid angle for all, and few enough for a sum in float */
        for (uint32_t x = x0; x < x1; x++, s += 3)
            for (int c = 0; c < 3; c++)
                row[c] += s[c];
        for (int c = 0; c < 3; c++)
            sum[c] += (double)r->share[y] * row[c];
        *whole += (double)r->share[y] * (x1 - x0);
        return;
    }
    for (uint32_t x = x0; x < x1; x++, s += 3) {
        const double share = r->share[share_place(r, x, y)];
        for (int c = 0; c < 3; c++)
            sum[c] += share * s[c];
        *whole += share;
    }
}

/* A row of blocks: each the mean of its texels, weighted by solid angle. What is masked weighs nothing. */
static void reduce_row(const struct resampler *r, const struct blocks *b, const float *rgb, uint32_t y, float *out)
{
    const uint32_t y0 = block_start(b, 1, y), y1 = block_end(b, 1, y);

    for (uint32_t x = 0; x < b->columns; x++, out += 3) {
        const uint32_t x0 = block_start(b, 0, x), x1 = block_end(b, 0, x);
        double sum[3] = { 0.0, 0.0, 0.0 }, whole = 0.0;
        for (uint32_t row = y0; row < y1; row++)
            add_texels(r, rgb, x0, x1, row, sum, &whole);
        for (int c = 0; c < 3; c++)
            out[c] = whole > 0.0 ? (float)(sum[c] / whole) : 0.0f;
    }
}

void resampler_load(struct resampler *r, const float *rgb)
{
    double mean[3] = { 0.0, 0.0, 0.0 };

    r->source = rgb;
    if (r->factor > 1) {
        struct blocks b;
        blocks_init(&b, r->layout, r->width, r->height, r->factor);
#pragma omp parallel for schedule(static)
        for (uint32_t y = 0; y < r->rows; y++)
            reduce_row(r, &b, rgb, y, r->reduced + 3 * (size_t)y * r->columns);
        r->source = r->reduced;
    }
    for (size_t k = 0; r->unseen && k < (size_t)r->columns * r->rows; k++)
        for (int c = 0; c < 3; c++)
            mean[c] += (double)r->block_sum[k] * r->source[3 * k + (size_t)c];
    for (int c = 0; c < 3; c++)
        r->mean[c] = (float)mean[c];
}

/* Where a coarse cube map meets a fine source, thousands of terms add up: in double, so that the sum stays exact. */
static void sum_many(const struct resampler *r, uint64_t first, uint64_t last, float out[3])
{
    double sum[3] = { 0.0, 0.0, 0.0 };

    for (uint64_t k = first; k < last; k++)
        for (int c = 0; c < 3; c++)
            sum[c] += (double)r->weight[k] * r->source[3 * (size_t)r->index[k] + (size_t)c];
    for (int c = 0; c < 3; c++)
        out[c] = (float)sum[c];
}

/* Four floats a texel instead of three, which is one operation of a vector; what the fourth reads is the next texel's
 * red, and is dropped. */
static void sum_few(const struct resampler *r, uint32_t first, uint32_t last, float out[4])
{
    const float *restrict source = r->source;
    float sum[4] = { 0.0f, 0.0f, 0.0f, 0.0f };

    for (uint32_t k = first; k < last; k++) {
        float s[4];
        memcpy(s, source + 3 * (size_t)r->index[k], sizeof(s));
        for (int c = 0; c < 4; c++)
            sum[c] += r->weight[k] * s[c];
    }
    memcpy(out, sum, sizeof(sum));
}

void resampler_row(const struct resampler *r, float gain, uint32_t row, float *texels)
{
    const uint32_t *first = r->first + (size_t)row * r->n, end = r->columns * r->rows - 1;

    assert(row < CUBE_FACES * r->n && r->source);
    for (uint32_t j = 0; j < r->n; j++) {
        float sum[4] = { 0.0f, 0.0f, 0.0f, 0.0f };
        const uint32_t count = first[j + 1] - first[j];
        /* After the very last source texel there is no next one. */
        if (count > MANY || (count && r->index[first[j + 1] - 1] == end))
            sum_many(r, first[j], first[j + 1], sum);
        else
            sum_few(r, first[j], first[j + 1], sum);
        const float unseen = r->unseen ? r->unseen[(size_t)row * r->n + j] : 0.0f;
        for (int c = 0; c < 3; c++)
            texels[4 * j + (uint32_t)c] = gain * (sum[c] + unseen * r->mean[c]);
    }
}
