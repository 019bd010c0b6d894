/* The sky's means over tents, each of which falls from 1 at a cell's centre to 0 at its neighbours' centres, also
 * across the edges of faces. The weights sum to 1 everywhere. Where three faces meet there is no fourth cell, and its
 * share is distributed to the three. */
#include "light/cache_indirect/internal.h"
#include "sky/tables/pyramid.h"

#include <math.h>
#include <string.h>

#define EDGE SKY_EDGE
#define FINE 64u    /* minimum number of texels along an edge; larger texels are divided */
#define COARSE 128u /* maximum number, from the pyramid: eight texels per slope of a tent */
#define PARTS INDIRECT_SKY_FACE_PARTS

/* Rows and columns -1 and 16 are the neighbouring face's. */
static uint32_t neighbour(uint32_t face, int i, int j)
{
    face = cube_step_over(face, EDGE, &i, &j);
    return sky_cell(face, (uint32_t)i, (uint32_t)j);
}

static int clamped(int k)
{
    return k < 0 ? 0 : k >= EDGE ? EDGE - 1 : k;
}

/* The cell at (i, j), which may lie beyond one border, or the three cells at a corner. Returns their number. */
static uint32_t cells_of(uint32_t face, int i, int j, uint32_t out[3])
{
    const int ci = clamped(i), cj = clamped(j);

    if (ci == i || cj == j) {
        out[0] = neighbour(face, i, j);
        return 1;
    }
    out[0] = sky_cell(face, (uint32_t)ci, (uint32_t)cj);
    out[1] = neighbour(face, i, cj);
    out[2] = neighbour(face, ci, j);
    return 3;
}

/* The last cell, -1 or more, whose centre is not beyond u in -1..1; *on: the position from its centre to the next. */
static int cell_before(double u, float *on)
{
    const double x = (u + 1.0) * (0.5 * EDGE) - 0.5, whole = floor(x);

    *on = (float)(x - whole);
    return (int)whole;
}

struct four {
    float v __attribute__((vector_size(16))); /* red, green, blue, weight */
};

/* The texels of a level of the sky's pyramid, each divided into fine x fine. */
struct grid {
    const struct pyramid_level *level;
    uint32_t n, fine;
};

static struct grid grid_of(const struct environment *e)
{
    const struct pyramid_level *level = e->pyramid->level;

    while (level->n > COARSE)
        level++;
    return (struct grid){ level, level->n, level->n < FINE ? (FINE + level->n - 1) / level->n : 1 };
}

/* Adds the texels of a row, from column `first` on, that lie between the same two cell centres to these cells. Returns
 * the column after them. */
static uint32_t take_run(const struct grid *g, const float *texels, const float *solid_angle, uint32_t first,
                         float (*out)[4])
{
    const struct four colours = { { 1.0f, 1.0f, 1.0f, 0.0f } }, rest = { { 0.0f, 0.0f, 0.0f, 1.0f } };
    const uint32_t columns = g->n * g->fine;
    struct four whole = { { 0.0f } }, behind = { { 0.0f } };
    float on;
    const int cell = cell_before(-1.0 + 2.0 * (first + 0.5) / columns, &on);
    const float step = (float)EDGE / (float)columns;
    uint32_t j = first, at = first / g->fine, part = first % g->fine;

    for (; j < columns && on < 1.0f; j++, on += step) {
        struct four x;
        memcpy(&x, texels + 4 * (size_t)at, sizeof(x));
        x.v = solid_angle[at] * (x.v * colours.v + rest.v);
        whole.v += x.v;
        behind.v += on * x.v;
        part++;
        at += part == g->fine;
        part = part == g->fine ? 0 : part;
    }
    for (int c = 0; c < 4; c++) {
        out[cell + 1][c] += whole.v[c] - behind.v[c];
        out[cell + 2][c] += behind.v[c];
    }
    return j;
}

/* Sums a part of a face's rows. */
static void take_part(const struct grid *g, uint32_t face, uint32_t part, struct indirect_tent_sums *out)
{
    const uint32_t rows = g->n * g->fine;
    float one[INDIRECT_WIDE][4];

    memset(out, 0, sizeof(*out));
    for (uint32_t y = part * rows / PARTS; y < (part + 1) * rows / PARTS; y++) {
        float on;
        const int i = cell_before(-1.0 + 2.0 * (y + 0.5) / rows, &on) + 1;
        const size_t row = y / g->fine;
        const float *texels = g->level->texels + ((size_t)face * g->n + row) * g->n * 4;
        memset(one, 0, sizeof(one));
        for (uint32_t j = 0; j < rows;)
            j = take_run(g, texels, g->level->solid_angle + row * g->n, j, one);
        for (uint32_t j = 0; j < INDIRECT_WIDE; j++)
            for (int c = 0; c < 4; c++) {
                out->at[i][j][c] += (1.0f - on) * one[j][c];
                out->at[i + 1][j][c] += on * one[j][c];
            }
    }
}

/* Adds the parts' sums at (i, j) to one cell, or to the three of a corner. */
static void deal(const struct indirect_tent_sums parts[PARTS], uint32_t face, int i, int j, float out[3][SKY_CELLS],
                 float *omega)
{
    float sum[4] = { 0.0f };
    uint32_t cells[3];

    for (uint32_t k = 0; k < PARTS; k++)
        for (int c = 0; c < 4; c++)
            sum[c] += parts[k].at[i + 1][j + 1][c];
    const uint32_t count = sum[3] > 0.0f ? cells_of(face, i, j, cells) : 0;
    for (uint32_t q = 0; q < count; q++) {
        for (int c = 0; c < 3; c++)
            out[c][cells[q]] += sum[c] / (float)count;
        omega[cells[q]] += sum[3] / (float)count;
    }
}

void indirect_sky_part(const struct environment *e, uint32_t part, struct indirect_tents *t)
{
    const struct grid g = grid_of(e);

    take_part(&g, part / PARTS, part % PARTS, &t->parts[part / PARTS][part % PARTS]);
}

void indirect_sky_deal(const struct indirect_tents *t, float out[3][SKY_CELLS])
{
    float omega[SKY_CELLS] = { 0.0f };

    memset(out, 0, 3 * sizeof(*out));
    for (uint32_t face = 0; face < CUBE_FACES; face++)
        for (int i = -1; i <= EDGE; i++)
            for (int j = -1; j <= EDGE; j++)
                deal(t->parts[face], face, i, j, out, omega);
    for (uint32_t cell = 0; cell < SKY_CELLS; cell++)
        for (int c = 0; c < 3; c++)
            out[c][cell] /= omega[cell];
}

uint32_t indirect_cell(struct vec3 w, double x)
{
    const float direction[3] = { w.x, w.y, w.z };
    float u, v, right, down;
    uint32_t cells[3];

    const uint32_t face = cube_locate(direction, &u, &v);
    int j = cell_before((double)u, &right), i = cell_before((double)v, &down);
    /* x selects the column, its remainder the row, and what remains then one of a corner's cells */
    if (x < (double)right) {
        j++;
        x /= (double)right;
    } else {
        x = (x - (double)right) / (1.0 - (double)right);
    }
    if (x < (double)down) {
        i++;
        x /= (double)down;
    } else {
        x = (x - (double)down) / (1.0 - (double)down);
    }
    const uint32_t count = cells_of(face, i, j, cells), k = (uint32_t)(x * count);
    return cells[k < count ? k : count - 1];
}
