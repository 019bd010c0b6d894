#include "sky/tables/sky_table.h"

#include "base/mem.h"
#include "base/vec.h"
#include "sky/tables/invert.h"

#include <assert.h>
#include <math.h>
#include <string.h>

/* The constants were determined on captured skies and sky models, resampled to faces of 256 x 256 texels.
 *
 * The level c is LEVEL times the mean of the sky clamped at c: a fixed point, which a sun of any strength moves by less
 * than its share of the sphere times LEVEL. A multiple of the plain mean would rise with the sun (the mean of a clear
 * sky with its sun is 2 to 7 times that without). Clear skies without the disc, overcast skies and twilight glow reach
 * 5 to 20 times their mean, a glowing sunrise cloud 50; the disc reaches 1e4 to 4e5 times. For LEVEL from 8 to 64, the
 * same skies are found to have a sun, and its share changes by less than 0.02.
 *
 * SUN_RADIUS: the disc's radius is 0.27 degrees, a texel up to 0.45; captured suns bloom. In any sky with a sun, all
 * but 0.01 of what is brighter than c is within 1.5 degrees, and all but 0.008 within 2.5 (a sunrise at the horizon). A
 * wider cap would only loosen the bound on the sun's cosine.
 *
 * SUN_SHARE: clear skies have 0.13 (hazy) to 0.85 in the sun. Lower are sources that are no sun: the brightest lamp of
 * a street at night (0.10), the middle of a studio's soft box (0.06), a veiled sun and dawns (0.01 to 0.02). With less
 * than a tenth of the light, a separate stratum gains little: its cell already gets samples by its energy. */
#define LEVEL 16.0
#define SUN_RADIUS 2.5 /* degrees */
#define SUN_SHARE 0.1

/* A histogram of solid angle over luminance, 16 bins per octave: the bits of a float >= 0 above the fourth bit of its
 * mantissa. Solid angles are integers, so that sums do not depend on the order of threads. */
#define BIN_SHIFT 19
#define BINS 4096
#define APART 4
#define PER_SR 0x1p40 /* 4 pi is 1.4e13, the smallest texel of 1024^2 is 8e5 */

static uint32_t bin_of(float luminance)
{
    uint32_t bits;

    memcpy(&bits, &luminance, sizeof(bits));
    return bits >> BIN_SHIFT;
}

/* The middle of a bin. */
static double bin_value(uint32_t bin)
{
    const uint32_t bits = (bin << BIN_SHIFT) + (1u << (BIN_SHIFT - 1));
    float value;

    memcpy(&value, &bits, sizeof(value));
    return value;
}

static float luminance_at(const struct sky_table *t, uint32_t at)
{
    const struct texel *x = &t->environment->texels[at];
    return rgb_luminance(x->r, x->g, x->b);
}

/* Neighbours mostly have the same bin, and consecutive sums in one place wait for each other: so there are APART
 * histograms, which take 0.7 of the time of one. */
static float measure_row(const struct environment *e, uint32_t row, uint64_t (*bins)[BINS])
{
    const double *solid_angle = e->solid_angle + (size_t)(row % e->n) * e->n;
    const struct texel *x = e->texels + (size_t)row * e->n;
    float brightest = 0.0f;

    for (uint32_t j = 0; j < e->n; j++) {
        const float g = rgb_luminance(x[j].r, x[j].g, x[j].b);
        bins[j % APART][bin_of(g)] += (uint64_t)(int64_t)(solid_angle[j] * PER_SR);
        brightest = g > brightest ? g : brightest;
    }
    return brightest;
}

/* The c > 0 with c = LEVEL m(c), where m(c) is the mean over the sphere of min(luminance, c). 0 if less than 1/LEVEL
 * of the sphere is lit: then there is none. Computed from the histogram, whose bins of 1/16 octave make m accurate to
 * about 3 %, which suffices. m is concave and m(0) = 0, so c is unique; with bin k the brightest that is not clamped, c
 * = LEVEL (below[k] + c above). */
static double find_level(const uint64_t *bins)
{
    double below[BINS] = { 0.0 }, above = 0.0;

    for (uint32_t k = 1; k < BINS; k++)
        below[k] = below[k - 1] + (bins[k] ? bin_value(k) * (double)bins[k] / (4.0 * PI * PER_SR) : 0.0);
    for (uint32_t k = BINS - 1; k > 0; k--) {
        if (bins[k] == 0)
            continue;
        const double c = LEVEL * below[k] / (1.0 - LEVEL * above);
        if (c >= bin_value(k))
            return c;
        above += (double)bins[k] / (4.0 * PI * PER_SR);
    }
    return 0.0;
}

float sky_level(const struct environment *e, float *row_max)
{
    uint64_t bins[BINS] = { 0 };
    const uint32_t rows = CUBE_FACES * e->n;

#pragma omp parallel
    {
        uint64_t own[APART][BINS] = { { 0 } };
#pragma omp for schedule(static) nowait
        for (uint32_t row = 0; row < rows; row++)
            row_max[row] = measure_row(e, row, own);
#pragma omp critical
        for (uint32_t k = 0; k < BINS; k++)
            bins[k] += (own[0][k] + own[1][k]) + (own[2][k] + own[3][k]);
    }
    return (float)find_level(bins);
}

static void measure(struct sky_table *t)
{
    t->level = sky_level(t->environment, t->row_max);
    t->mean = (float)(t->level / LEVEL);
}

static void texel_corner(const struct sky_table *t, uint32_t at, double row, double column, double out[3])
{
    const uint32_t n = t->n;

    cube_direction(at / (n * n), -1.0 + 2.0 * (at % n + column) / n, -1.0 + 2.0 * (at / n % n + row) / n, out);
    const double scale = 1.0 / sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]);
    for (int c = 0; c < 3; c++)
        out[c] *= scale;
}

/* The part of a sun's texel above the level, x solid angle. */
static double sun_part(const struct sky_table *t, uint32_t at)
{
    return ((double)luminance_at(t, at) - t->level) * t->environment->solid_angle[at % (t->n * t->n)];
}

static enum err add_sun_texel(struct sky_table *t, uint32_t at)
{
    if (t->sun_count == t->sun_capacity) {
        const uint32_t more = t->sun_capacity ? 2 * t->sun_capacity : 64;
        uint32_t *texels = mem_grow(t->sun_texels, t->sun_count, more, sizeof(*texels));
        if (!texels)
            return ERR_NOMEM;
        t->sun_texels = texels;
        double *cdf = mem_grow(t->sun_cdf, t->sun_count, more, sizeof(*cdf));
        if (!cdf)
            return ERR_NOMEM;
        t->sun_cdf = cdf;
        t->sun_capacity = more;
    }
    t->sun_energy += sun_part(t, at);
    t->sun_texels[t->sun_count] = at;
    t->sun_cdf[t->sun_count++] = t->sun_energy;
    return ERR_OK;
}

static uint32_t find_brightest(const struct sky_table *t)
{
    uint32_t row = 0, at;

    for (uint32_t k = 1; k < CUBE_FACES * t->n; k++)
        row = t->row_max[k] > t->row_max[row] ? k : row;
    for (at = row * t->n; luminance_at(t, at) != t->row_max[row];)
        at++;
    return at;
}

/* The mean direction of the sun's energy, and the angular extent of its texels around it. */
static void enclose_sun(struct sky_table *t)
{
    double axis[3] = { 0.0, 0.0, 0.0 }, w[3], least = 1.0;

    for (uint32_t k = 0; k < t->sun_count; k++) {
        texel_corner(t, t->sun_texels[k], 0.5, 0.5, w);
        for (int c = 0; c < 3; c++)
            axis[c] += sun_part(t, t->sun_texels[k]) / t->sun_energy * w[c];
    }
    const double length = sqrt(dot3(axis, axis));
    for (int c = 0; c < 3; c++)
        t->sun_axis[c] = (float)(axis[c] / length);
    for (int c = 0; c < 3; c++)
        axis[c] = t->sun_axis[c];
    for (uint32_t k = 0; k < 4 * t->sun_count; k++) {
        texel_corner(t, t->sun_texels[k / 4], k >> 1 & 1, k & 1, w);
        least = fmin(least, dot3(axis, w) / sqrt(dot3(axis, axis)));
    }
    t->sun_spread = (float)acos(least) * 1.0001f + 1e-6f; /* rounded up */
}

static enum err find_sun(struct sky_table *t)
{
    const uint32_t n = t->n;
    double centre[3], w[3];
    enum err e = ERR_OK;

    const uint32_t brightest = find_brightest(t);
    texel_corner(t, brightest, 0.5, 0.5, centre);
    const double reach = cos(SUN_RADIUS * PI / 180.0);
    for (uint32_t row = 0; row < CUBE_FACES * n; row++)
        for (uint32_t at = row * n; t->row_max[row] > t->level && at < (row + 1) * n && !e; at++) {
            if (!(luminance_at(t, at) > t->level))
                continue;
            texel_corner(t, at, 0.5, 0.5, w);
            if (at == brightest || dot3(w, centre) >= reach)
                e = add_sun_texel(t, at);
        }
    t->has_sun = !e && t->sun_count && t->sun_energy >= SUN_SHARE * t->environment->total_energy;
    if (t->has_sun) {
        enclose_sun(t);
    } else {
        t->sun_count = 0;
        t->sun_energy = 0.0;
    }
    return e;
}

bool sky_find_sun(const struct environment *e, struct sun_place *out)
{
    struct sky_table t = { .environment = e, .n = e->n };

    t.row_max = mem_alloc((size_t)CUBE_FACES * e->n, sizeof(*t.row_max));
    if (t.row_max)
        measure(&t);
    const bool found = t.level > 0.0f && find_sun(&t) == ERR_OK && t.has_sun;
    if (found) {
        const double azimuth = atan2(-(double)t.sun_axis[0], (double)t.sun_axis[2]) * 180.0 / PI;
        out->elevation = asin(fmin(fmax((double)t.sun_axis[1], -1.0), 1.0)) * 180.0 / PI;
        out->azimuth = azimuth < 0.0 ? azimuth + 360.0 : azimuth;
    }
    sky_table_finish(&t);
    return found;
}

/* The first of the sun's texels at or after `at`. */
static uint32_t find_sun_texel(const struct sky_table *t, uint32_t at)
{
    uint32_t low = 0, high = t->sun_count;

    while (low < high) {
        const uint32_t mid = (low + high) / 2;
        if (t->sun_texels[mid] < at)
            low = mid + 1;
        else
            high = mid;
    }
    return low;
}

/* One row of texels: shaped densities, and CDFs within each cell. */
static void shape_row(struct sky_table *t, uint32_t row)
{
    const uint32_t n = t->n, m = n / t->cells, first = row * n;
    const double *solid_angle = t->environment->solid_angle + (size_t)(row % n) * n;
    const struct texel *texels = t->environment->texels + first;
    const double less = t->compensated ? 0.5 * t->mean : 0.0, per_uv = 0.25 * n * n;
    double *cdf = t->row_cdf + first;
    float *density = t->density + first;

    for (uint32_t j = 0; j < n; j++) {
        const double kept = rgb_luminance(texels[j].r, texels[j].g, texels[j].b) - less;
        cdf[j] = (kept > 0.0 ? kept : 0.0) * solid_angle[j];
    }
    if (t->has_sun)
        for (uint32_t k = find_sun_texel(t, first); k < t->sun_count && t->sun_texels[k] < first + n; k++)
            cdf[t->sun_texels[k] - first] = (t->level - less) * solid_angle[t->sun_texels[k] - first];
    for (uint32_t j = 0; j < n; j++)
        density[j] = (float)(cdf[j] * per_uv);
    for (uint32_t j0 = 0; j0 < n; j0 += m)
        for (uint32_t j = j0 + 1; j < j0 + m; j++)
            cdf[j] += cdf[j - 1];
}

/* A column of cells of a face: the CDFs over their rows, and their energies. */
static void sum_cells(struct sky_table *t, uint32_t face, uint32_t column)
{
    const uint32_t n = t->n, m = n / t->cells;
    double *cdf = t->cell_cdf + ((size_t)face * t->cells + column) * n;
    double sum = 0.0;

    for (uint32_t i = 0; i < n; i++) {
        const double row = t->row_cdf[((size_t)face * n + i) * n + (column + 1) * m - 1];
        sum = i % m == 0 ? row : sum + row;
        cdf[i] = sum;
        if (i % m == m - 1)
            t->energy[(face * t->cells + i / m) * t->cells + column] = sum;
    }
}

static void find_corners(struct sky_table *t)
{
    const uint32_t cells = t->cells;

    for (uint32_t s = 0; s < t->strata; s++)
        for (uint32_t k = 0; k < 4; k++) {
            const uint32_t i = s / cells % cells + (k >> 1), j = s % cells + (k & 1);
            double w[3];
            cube_direction(s / (cells * cells), -1.0 + 2.0 * j / cells, -1.0 + 2.0 * i / cells, w);
            const double scale = 1.0 / sqrt(dot3(w, w));
            for (int c = 0; c < 3; c++)
                t->corner[s][k][c] = (float)(w[c] * scale);
        }
}

static enum err reserve(struct sky_table *t, uint32_t n, uint32_t cells)
{
    const size_t texels = (size_t)CUBE_FACES * n * n;

    if (t->n == n && t->cells == cells)
        return ERR_OK;
    sky_table_finish(t);
    t->energy = mem_alloc((size_t)CUBE_FACES * cells * cells, sizeof(*t->energy));
    t->corner = mem_alloc((size_t)CUBE_FACES * cells * cells, sizeof(*t->corner));
    t->density = mem_alloc(texels, sizeof(*t->density));
    t->row_cdf = mem_alloc(texels, sizeof(*t->row_cdf));
    t->cell_cdf = mem_alloc((size_t)CUBE_FACES * cells * n, sizeof(*t->cell_cdf));
    t->row_max = mem_alloc((size_t)CUBE_FACES * n, sizeof(*t->row_max));
    if (!t->energy || !t->corner || !t->density || !t->row_cdf || !t->cell_cdf || !t->row_max)
        return ERR_NOMEM;
    t->n = n;
    t->cells = cells;
    t->strata = CUBE_FACES * cells * cells;
    find_corners(t);
    return ERR_OK;
}

enum err sky_table_build(struct sky_table *t, const struct environment *e, const struct sky_table_desc *desc)
{
    const uint32_t n = e->n, cells = desc->cells;

    assert(e->ready);
    if (cells == 0 || cells > CELLS_MAX || (cells & (cells - 1)) || n % cells)
        return ERR_USAGE;
    enum err result = reserve(t, n, cells);
    if (result)
        return result;
    t->environment = e;
    t->desc = *desc;
    t->mean = t->level = 0.0f;
    t->has_sun = false;
    t->sun_count = 0;
    t->sun_energy = 0.0;
    if (desc->sun || desc->compensate)
        measure(t);
    if (desc->sun)
        result = find_sun(t);
    t->compensated = desc->compensate && t->mean > 0.0f;
#pragma omp parallel for schedule(static)
    for (uint32_t row = 0; row < CUBE_FACES * n; row++)
        shape_row(t, row);
#pragma omp parallel for schedule(static)
    for (uint32_t k = 0; k < CUBE_FACES * cells; k++)
        sum_cells(t, k / cells, k % cells);
    return result;
}

void sky_table_finish(struct sky_table *t)
{
    mem_free(t->energy);
    mem_free(t->corner);
    mem_free(t->density);
    mem_free(t->row_cdf);
    mem_free(t->cell_cdf);
    mem_free(t->row_max);
    mem_free(t->sun_texels);
    mem_free(t->sun_cdf);
    *t = (struct sky_table){ 0 };
}

static void invert_sun(const struct sky_table *t, const double x[2], float w[3])
{
    const uint32_t n = t->n;
    const double place = invert(t->sun_cdf, t->sun_count, x[0]);
    const uint32_t k = (uint32_t)place, at = t->sun_texels[k];

    invert_direction(n, at / (n * n), at / n % n + (place - k), at % n + fmin(x[1], INVERT_LAST), w);
}

void sky_table_invert(const struct sky_table *t, uint32_t stratum, const double x[2], float w[3])
{
    const uint32_t n = t->n, cells = t->cells, m = n / cells;

    if (stratum == t->strata) {
        invert_sun(t, x, w);
        return;
    }
    const uint32_t face = stratum / (cells * cells), i0 = stratum / cells % cells * m, j0 = stratum % cells * m;
    const double row = i0 + invert(t->cell_cdf + ((size_t)face * cells + stratum % cells) * n + i0, m, x[0]);
    const double column = j0 + invert(t->row_cdf + ((size_t)face * n + (uint32_t)row) * n + j0, m, x[1]);
    invert_direction(n, face, row, column, w);
}

float sky_table_sun(const struct sky_table *t, uint32_t texel, float jacobian)
{
    const uint32_t k = find_sun_texel(t, texel);

    if (k >= t->sun_count || t->sun_texels[k] != texel)
        return 0.0f;
    return (float)(sun_part(t, texel) * 0.25 * t->n * t->n * (double)jacobian / t->sun_energy);
}

uint32_t sky_table_evaluate(const struct sky_table *t, const float w[3], float rgb[3], float *pdf, float *sun_pdf)
{
    float u, v;
    const uint32_t n = t->n, cells = t->cells, m = n / cells, at = cube_texel(n, w, &u, &v);
    const struct texel *x = &t->environment->texels[at];
    const uint32_t stratum = (at / (n * n) * cells + at / n % n / m) * cells + at % n / m;
    const float jacobian = cube_jacobian(u, v);

    rgb[0] = x->r;
    rgb[1] = x->g;
    rgb[2] = x->b;
    *pdf = t->energy[stratum] > 0.0 ? (float)(t->density[at] * (double)jacobian / t->energy[stratum]) : 0.0f;
    *sun_pdf = t->has_sun && luminance_at(t, at) > t->level ? sky_table_sun(t, at, jacobian) : 0.0f;
    return stratum;
}
