/* Divides the source into blocks and reduces a frame to their means. */
#include "base/mem.h"
#include "sky/tables/resample.h"

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

uint32_t blocks_start(const struct blocks *b, int k, uint32_t index)
{
    return index / b->per_cell[k] * b->cell[k] + index % b->per_cell[k] * b->factor;
}

uint32_t blocks_end(const struct blocks *b, int k, uint32_t index)
{
    const uint32_t end = index % b->per_cell[k] * b->factor + b->factor;
    return index / b->per_cell[k] * b->cell[k] + (end < b->cell[k] ? end : b->cell[k]);
}

void blocks_bounds(const struct blocks *b, uint32_t column, uint32_t row, double low[2], double high[2])
{
    low[0] = blocks_start(b, 0, column);
    low[1] = blocks_start(b, 1, row);
    high[0] = blocks_end(b, 0, column);
    high[1] = blocks_end(b, 1, row);
}

/* Solid angles of single texels, for the reduction, stored without repetition: lat-long by row, cubes by position
 * within a face, the others by one quadrant. */
static size_t share_place(const struct resample_table *r, uint32_t x, uint32_t y)
{
    if (layout_faces(r->key.layout)) {
        const uint32_t size = layout_face_size(r->key.layout, r->key.width);
        return (size_t)(y % size) * size + x % size;
    }
    if (layout_is_disc(r->key.layout)) {
        const uint32_t a = x < r->key.width / 2 ? r->key.width - 1 - x : x,
                       b = y < r->key.height / 2 ? r->key.height - 1 - y : y;
        return (size_t)(b - r->key.height / 2) * (r->key.width - r->key.width / 2) + a - r->key.width / 2;
    }
    return y;
}

enum err resample_make_share(struct resample_table *r, const struct blocks *b)
{
    const int faces = layout_faces(r->key.layout) != NULL, disc = layout_is_disc(r->key.layout);
    const uint32_t x0 = disc ? r->key.width / 2 : 0, y0 = disc ? r->key.height / 2 : 0;
    const uint32_t x1 = faces ? b->cell[0] : disc ? r->key.width : 1, y1 = faces ? b->cell[1] : r->key.height;
    /* The top left cell of a cross is unused; the one below it is not. */
    const uint32_t down = faces && r->key.layout != LAYOUT_CUBE ? b->cell[1] : 0;

    r->share = mem_alloc((size_t)(x1 - x0) * (y1 - y0), sizeof(*r->share));
    if (!r->share)
        return ERR_NOMEM;
#pragma omp parallel for schedule(dynamic, 16)
    for (uint32_t y = y0; y < y1; y++)
        for (uint32_t x = x0; x < x1; x++) {
            const double low[2] = { x, y + down }, high[2] = { x + 1.0, y + down + 1.0 };
            r->share[share_place(r, x, y)] =
                (float)layout_solid_angle(r->key.layout, r->key.width, r->key.height, low, high);
        }
    return ERR_OK;
}

/* Adds part of a source row to its block: sum[3] of texels by solid angle, and `whole`, the sum of the solid angles. */
static void add_texels(const struct resample_table *t, const float *rgb, uint32_t x0, uint32_t x1, uint32_t y,
                       double sum[3], double *whole)
{
    const float *s = rgb + 3 * ((size_t)y * t->key.width + x0);
    const int by_row = !layout_faces(t->key.layout) && !layout_is_disc(t->key.layout);
    float row[3] = { 0.0f, 0.0f, 0.0f };

    if (by_row) { /* one solid angle for all, and few enough terms to sum in float */
        for (uint32_t x = x0; x < x1; x++, s += 3)
            for (int c = 0; c < 3; c++)
                row[c] += s[c];
        for (int c = 0; c < 3; c++)
            sum[c] += (double)t->share[y] * row[c];
        *whole += (double)t->share[y] * (x1 - x0);
        return;
    }
    for (uint32_t x = x0; x < x1; x++, s += 3) {
        const double share = t->share[share_place(t, x, y)];
        for (int c = 0; c < 3; c++)
            sum[c] += share * s[c];
        *whole += share;
    }
}

/* A row of blocks: each the mean of its texels, weighted by solid angle; masked texels have weight 0. */
void resample_reduce_row(const struct resample_table *t, const struct blocks *b, const float *rgb, uint32_t y,
                         float *out)
{
    const uint32_t y0 = blocks_start(b, 1, y), y1 = blocks_end(b, 1, y);

    for (uint32_t x = 0; x < b->columns; x++, out += 3) {
        const uint32_t x0 = blocks_start(b, 0, x), x1 = blocks_end(b, 0, x);
        double sum[3] = { 0.0, 0.0, 0.0 }, whole = 0.0;
        for (uint32_t row = y0; row < y1; row++)
            add_texels(t, rgb, x0, x1, row, sum, &whole);
        for (int c = 0; c < 3; c++)
            out[c] = whole > 0.0 ? (float)(sum[c] / whole) : 0.0f;
    }
}
