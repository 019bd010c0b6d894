#include "light/radiance/components.h"

#include "base/mem.h"
#include "base/vec.h"
#include "sky/daylight/reinhart.h"
#include "sky/tables/cube.h"
#include "sky/tables/resample.h"

#include <math.h>
#include <string.h>

#define PATCHES_MOST 2306 /* of MF:4, the finest that --reinhart offers */

/* ---- Lat-long ---- */

/* A lat-long image in the world's azimuth. */
struct map {
    const struct environment *e;
    uint32_t width, height;
    bool bottom_first;
    double turn; /* azimuth of its left edge, in circles from north over east */
};

static const float *row_of(const struct map *m, uint32_t y)
{
    return m->e->image.rgb + 3 * (size_t)m->width * (m->bottom_first ? m->height - 1 - y : y);
}

static double altitude_of(const struct map *m, double y)
{
    return PI * (0.5 - y / m->height);
}

/* Adds a row of texels to the patches of a row, each with the part of its width that lies in the patch. weight: of the
 * height that lies in the row, per circle of azimuth. Patches begin half their width before their middle. */
static void add_row(const struct map *m, const float *texels, uint32_t count, double weight, double (*sum)[3])
{
    const double wide = (double)count / m->width, begin = (m->turn + 2.0) * count + 0.5;

    for (uint32_t x = 0; x < m->width; x++) {
        double from = begin + wide * x;
        const double to = begin + wide * (x + 1.0);
        while (from < to) {
            const double end = fmin(floor(from) + 1.0, to);
            double *patch = sum[(uint32_t)from % count];
            for (int c = 0; c < 3; c++)
                patch[c] += weight * (end - from) / count * (double)texels[3 * (size_t)x + (uint32_t)c];
            from = end;
        }
    }
}

/* The means of a row of patches. */
static void mean_row(const struct map *m, const struct reinhart_row *row, float (*radiance)[3])
{
    const double height = sin(row->top) - sin(row->bottom);
    const double first = (0.5 - row->top / PI) * m->height, last = (0.5 - row->bottom / PI) * m->height;
    double sum[120][3];

    memset(sum, 0, sizeof(sum));
    for (uint32_t y = (uint32_t)fmax(0.0, floor(first - 1e-9)); y < m->height && y < last; y++) {
        const double top = fmin(row->top, altitude_of(m, y)), bottom = fmax(row->bottom, altitude_of(m, y + 1.0));
        if (bottom < top)
            add_row(m, row_of(m, y), row->count, (sin(top) - sin(bottom)) / height, sum);
    }
    for (uint32_t k = 0; k < row->count; k++)
        for (int c = 0; c < 3; c++)
            radiance[row->first + k][c] = (float)(m->e->gain * sum[k][c] * row->count);
}

/* The mean of the lower hemisphere. rows: double[height][3], of its rows' sums. */
static void mean_ground(const struct map *m, double (*rows)[3], float radiance[3])
{
    double sum[3] = { 0 };

#pragma omp parallel for schedule(static)
    for (uint32_t y = m->height / 2; y < m->height; y++) {
        const float *t = row_of(m, y);
        const double weight = sin(fmin(0.0, altitude_of(m, y))) - sin(altitude_of(m, y + 1.0));
        double own[3] = { 0 };
        for (uint32_t x = 0; x < m->width; x++, t += 3)
            for (int c = 0; c < 3; c++)
                own[c] += (double)t[c];
        for (int c = 0; c < 3; c++)
            rows[y][c] = weight / m->width * own[c];
    }
    for (uint32_t y = m->height / 2; y < m->height; y++)
        for (int c = 0; c < 3; c++)
            sum[c] += rows[y][c];
    for (int c = 0; c < 3; c++)
        radiance[c] = (float)(m->e->gain * sum[c]);
}

static enum err from_latlong(const struct map *m, uint32_t mf, float (*radiance)[3])
{
    double(*rows)[3] = mem_alloc_raw(m->height, sizeof(*rows));

    if (!rows)
        return ERR_NOMEM;
    mean_ground(m, rows, radiance[0]);
#pragma omp parallel for schedule(dynamic)
    for (uint32_t k = 0; k <= 7 * mf; k++) {
        const struct reinhart_row row = reinhart_row(mf, k);
        mean_row(m, &row, radiance);
    }
    mem_free(rows);
    return ERR_OK;
}

/* ---- Other layouts, by way of the cube map ---- */

/* The patch of a world direction. */
static uint32_t find_patch(uint32_t mf, const double w[3])
{
    const double altitude = atan2(w[1], sqrt(w[0] * w[0] + w[2] * w[2]));

    if (altitude < 0.0)
        return 0;
    const double height = 0.5 * PI / (7 * mf + 0.5);
    const struct reinhart_row row = reinhart_row(mf, (uint32_t)fmin(altitude / height, 7.0 * mf));
    const double azimuth = atan2(-w[0], w[2]) / (2.0 * PI);
    return row.first + (uint32_t)((azimuth + 1.0) * row.count + 0.5) % row.count;
}

static void from_cube(const struct environment *e, uint32_t mf, float (*radiance)[3])
{
    static _Thread_local double sum[PATCHES_MOST][4]; /* the last one: solid angle */
    const uint32_t n = e->n, count = reinhart_count(mf);

    memset(sum, 0, sizeof(sum));
    for (size_t i = 0; i < (size_t)CUBE_FACES * n * n; i++) {
        const uint32_t column = (uint32_t)(i % n), row = (uint32_t)(i / n % n);
        const struct texel *t = &e->texels[i];
        double w[3];
        cube_direction((uint32_t)(i / n / n), (2.0 * column + 1.0) / n - 1.0, (2.0 * row + 1.0) / n - 1.0, w);
        double *patch = sum[find_patch(mf, w)];
        const double angle = e->solid_angle[(size_t)row * n + column];
        patch[0] += angle * (double)t->r;
        patch[1] += angle * (double)t->g;
        patch[2] += angle * (double)t->b;
        patch[3] += angle;
    }
    for (uint32_t k = 0; k < count; k++)
        for (int c = 0; c < 3; c++)
            radiance[k][c] = sum[k][3] > 0.0 ? (float)(sum[k][c] / sum[k][3]) : 0.0f;
}

enum err sky_patches(const struct environment *e, uint32_t mf, float (*radiance)[3])
{
    const struct resample_key *key = &e->resampler->table->key;
    const bool bottom_first = key->layout == LAYOUT_LATLONG_BOTTOM_FIRST;

    if (key->layout != LAYOUT_LATLONG && !bottom_first) {
        from_cube(e, mf, radiance);
        return ERR_OK;
    }
    const double turn = -0.5 - key->rotation / (2.0 * PI);
    const struct map map = { e, e->image.width, e->image.height, bottom_first, turn - floor(turn) };
    return from_latlong(&map, mf, radiance);
}
