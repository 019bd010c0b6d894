#include "sky/tables/sky_split.h"

#include "base/mem.h"
#include "sky/tables/invert.h"
#include "sky/tables/sky_table.h"

#include <assert.h>
#include <math.h>

/* Share of the sky's energy. A fainter sun stays in the cells: a shadow that is wrong by a thousandth of the
 * light is invisible. */
#define FAINT 1e-3

static float texel_luminance(const struct environment *e, uint32_t at)
{
    const struct texel *x = &e->texels[at];
    return rgb_luminance(x->r, x->g, x->b);
}

double sky_cell_solid_angle(uint32_t place)
{
    const double step = 2.0 / SKY_EDGE; /* all faces are equal: only the position within one matters, 8 bits */
    uint32_t i = 0, j = 0;

    for (uint32_t b = 0; b < 4; b++) {
        j |= (place >> 2 * b & 1u) << b;
        i |= (place >> (2 * b + 1) & 1u) << b;
    }
    return cube_solid_angle(-1.0 + step * j, -1.0 + step * i, -1.0 + step * (j + 1), -1.0 + step * (i + 1));
}

/* Solid angle of the intersection of texel (row y, column x) and cell (row i, column j): the whole texel, unless the
 * cell's border crosses it, which happens if n is not a multiple of SKY_EDGE. */
static double overlap(const struct environment *e, uint32_t y, uint32_t x, uint32_t i, uint32_t j)
{
    const uint32_t n = e->n, edge = SKY_EDGE;

    if (y * edge >= i * n && (y + 1) * edge <= (i + 1) * n && x * edge >= j * n && (x + 1) * edge <= (j + 1) * n)
        return e->solid_angle[y * n + x];
    return cube_shared_solid_angle(n, y, x, edge, i, j);
}

/* Adds texels of a row that are entirely within the cell and not above the level. */
static void add_lower_texels(const struct texel *texels, const double *solid_angle, uint32_t count, double sum[3],
                             double *whole)
{
    double r = 0.0, g = 0.0, b = 0.0, weight = 0.0;

    for (uint32_t x = 0; x < count; x++) {
        r += solid_angle[x] * (double)texels[x].r;
        g += solid_angle[x] * (double)texels[x].g;
        b += solid_angle[x] * (double)texels[x].b;
        weight += solid_angle[x];
    }
    sum[0] += r;
    sum[1] += g;
    sum[2] += b;
    *whole += weight;
}

/* The mean of the lower part over a cell, weighted by solid angle. */
static void take_cell(struct sky_split *s, const struct environment *e, uint32_t face, uint32_t i, uint32_t j)
{
    const uint32_t n = e->n, edge = SKY_EDGE, place = sky_cell(face, i, j);
    const bool whole_texels = n % edge == 0;
    double sum[3] = { 0.0 }, whole = 0.0;

    for (uint32_t y = i * n / edge; y * edge < (i + 1) * n; y++) {
        if (whole_texels && !(s->row_max[face * n + y] > s->level)) {
            add_lower_texels(&e->texels[(face * n + y) * n + j * n / edge], &e->solid_angle[y * n + j * n / edge],
                             n / edge, sum, &whole);
            continue;
        }
        for (uint32_t x = j * n / edge; x * edge < (j + 1) * n; x++) {
            const struct texel *t = &e->texels[(face * n + y) * n + x];
            const float g = rgb_luminance(t->r, t->g, t->b);
            const double weight = whole_texels ? e->solid_angle[y * n + x] : overlap(e, y, x, i, j);
            const double kept = weight * (double)sky_lower(s->level, g);
            whole += weight;
            sum[0] += kept * (double)t->r;
            sum[1] += kept * (double)t->g;
            sum[2] += kept * (double)t->b;
        }
    }
    for (int c = 0; c < 3; c++)
        s->cells[place / SKY_CHUNK][c][place % SKY_CHUNK] = (float)(sum[c] / whole);
}

/* The sun's share of a texel's luminance. */
static double luminance_above(const struct sky_split *s, const struct environment *e, uint32_t at)
{
    const float g = texel_luminance(e, at);
    return (double)g * (1.0 - (double)sky_lower(s->level, g));
}

static enum err add_sun(struct sky_split *s, const struct environment *e, uint32_t at)
{
    if (s->sun_count == s->sun_capacity) {
        const uint32_t more = s->sun_capacity ? 2 * s->sun_capacity : 256;
        uint32_t *sun = mem_grow(s->sun, s->sun_count, more, sizeof(*sun));
        if (!sun)
            return ERR_NOMEM;
        s->sun = sun;
        double *cdf = mem_grow(s->sun_cdf, s->sun_count, more, sizeof(*cdf));
        if (!cdf)
            return ERR_NOMEM;
        s->sun_cdf = cdf;
        s->sun_capacity = more;
    }
    s->sun_energy += luminance_above(s, e, at) * e->solid_angle[at % (e->n * e->n)];
    s->sun[s->sun_count] = at;
    s->sun_cdf[s->sun_count++] = s->sun_energy;
    return ERR_OK;
}

static enum err find_sun(struct sky_split *s, const struct environment *e)
{
    enum err result = ERR_OK;

    s->sun_count = 0;
    s->sun_energy = 0.0;
    for (uint32_t row = 0; row < CUBE_FACES * e->n; row++)
        for (uint32_t at = row * e->n; s->row_max[row] > s->level && at < (row + 1) * e->n && !result; at++)
            if (texel_luminance(e, at) > s->level)
                result = add_sun(s, e, at);
    return result;
}

/* Rounds to half an octave, without a library's logarithm: the bits must be everyone's. */
static float round_level(float level)
{
    int exponent;
    const float part = frexpf(level, &exponent); /* 0.5..1 */
    const float rounded = part < 0.59460356f ? 0.5f : part < 0.84089642f ? 0.70710678f : 1.0f;

    return level > 0.0f && level < INFINITY ? ldexpf(rounded, exponent) : level;
}

enum err sky_split_begin(struct sky_split *s, const struct environment *e)
{
    assert(e->ready);
    if (CUBE_FACES * e->n > s->row_capacity) {
        mem_free(s->row_max);
        s->row_capacity = 0;
        s->row_max = mem_alloc(CUBE_FACES * e->n, sizeof(*s->row_max));
        if (!s->row_max)
            return ERR_NOMEM;
        s->row_capacity = CUBE_FACES * e->n;
    }
    s->n = e->n;
    s->level = s->unsplit ? INFINITY : round_level(sky_level(e, s->row_max));
    const enum err result = find_sun(s, e);
    if (s->sun_energy < FAINT * e->total_energy) {
        s->level = INFINITY;
        s->sun_count = 0;
        s->sun_energy = 0.0;
    }
    return result;
}

/* A row of cells of a face. */
void sky_split_part(struct sky_split *s, const struct environment *e, uint32_t part)
{
    for (uint32_t j = 0; j < SKY_EDGE; j++)
        take_cell(s, e, part / SKY_EDGE, part % SKY_EDGE, j);
}

enum err sky_split_take(struct sky_split *s, const struct environment *e)
{
    const enum err result = sky_split_begin(s, e);

    if (result)
        return result;
#pragma omp parallel for schedule(dynamic, 4)
    for (uint32_t k = 0; k < SKY_SPLIT_PARTS; k++)
        sky_split_part(s, e, k);
    return ERR_OK;
}

void sky_split_finish(struct sky_split *s)
{
    mem_free(s->sun);
    mem_free(s->sun_cdf);
    mem_free(s->row_max);
    *s = (struct sky_split){ .level = 0.0f };
}

void sky_split_sample(const struct sky_split *s, const struct environment *e, const double x[2], float w[3],
                      float rgb[3])
{
    const uint32_t n = s->n;
    const double place = invert(s->sun_cdf, s->sun_count, x[0]);
    const uint32_t k = (uint32_t)place, at = s->sun[k];
    const struct texel *t = &e->texels[at];
    const double above = luminance_above(s, e, at);
    float u, v;

    invert_direction(n, at / (n * n), at / n % n + (place - k), at % n + fmin(x[1], INVERT_LAST), w);
    cube_locate(w, &u, &v);
    /* p = above x solid angle / energy, uniform over the texel's square of (2 / n)^2; above / g of the radiance
     * belongs to the sun */
    const double density = above * e->solid_angle[at % (n * n)] / s->sun_energy * 0.25 * n * n;
    const double weight = above / (double)texel_luminance(e, at) / (density * (double)cube_jacobian(u, v));
    rgb[0] = (float)(weight * (double)t->r);
    rgb[1] = (float)(weight * (double)t->g);
    rgb[2] = (float)(weight * (double)t->b);
}

float sky_split_density(const struct sky_split *s, const struct environment *e, const float w[3])
{
    const uint32_t n = s->n;
    float u, v;
    const uint32_t at = cube_texel(n, w, &u, &v);
    const double above = luminance_above(s, e, at);

    if (!(above > 0.0) || s->sun_count == 0)
        return 0.0f;
    return (float)(above * e->solid_angle[at % (n * n)] / s->sun_energy * 0.25 * n * n * (double)cube_jacobian(u, v));
}
