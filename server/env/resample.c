#include "resample.h"

#include "cube.h"
#include "mem.h"
#include "vec.h"

#include <assert.h>
#include <string.h>

#define MANY 64 /* terms that are still added in float */

/* What one row of cube texels overlaps, while the table grows. */
struct overlap_row {
    uint32_t *count; /* [n]: entries of each texel */
    uint32_t *index;
    double *solid_angle;
    size_t used, capacity;
    enum err e;
};

/* One source column while a cube texel is integrated over it: solid angle per source row. */
struct column {
    double *row_solid_angle; /* [height], zero outside lowest..highest */
    uint32_t lowest, highest;
};

struct source_grid {
    uint32_t width, height;
    double rotation;
    const double *edge_cos; /* [height + 1]: cos(pi r / height), descending */
    int bottom_first;
};

static enum err append(struct overlap_row *o, uint32_t index, double solid_angle)
{
    if (o->used == o->capacity) {
        const size_t more = o->capacity ? 2 * o->capacity : 1024;
        uint32_t *grown = mem_grow(o->index, o->used, more, sizeof(*o->index));
        if (!grown)
            return ERR_NOMEM;
        o->index = grown;
        double *grown_angle = mem_grow(o->solid_angle, o->used, more, sizeof(*o->solid_angle));
        if (!grown_angle)
            return ERR_NOMEM;
        o->solid_angle = grown_angle;
        o->capacity = more;
    }
    o->index[o->used] = index;
    o->solid_angle[o->used++] = solid_angle;
    return ERR_OK;
}

/* A straight border of a cube texel, seen from the centre: a horizontal line at height y over a foot at distance d in
 * the direction `azimuth`. Along it the height of the unit vector is, with k = y / d and psi counted from that azimuth,
 *     h(psi) = k cos(psi) / sqrt(1 + k^2 cos(psi)^2),     integral of h = asin(k sin(psi) / sqrt(1 + k^2)).
 * Or, where the texel reaches the pole, that pole: h is constant. */
struct border {
    double k, azimuth;
    double constant; /* 1 or -1: the pole, else 0 */
};

static double wrap_angle(double a)
{
    while (a > PI)
        a -= 2.0 * PI;
    while (a <= -PI)
        a += 2.0 * PI;
    return a;
}

static double border_height(const struct border *b, double psi)
{
    const double c = b->k * cos(psi);
    return b->constant != 0.0 ? b->constant : c / sqrt(1.0 + c * c);
}

static double height_integral(const struct border *b, double psi0, double psi1)
{
    const double scale = b->k / sqrt(1.0 + b->k * b->k);
    return asin(scale * sin(psi1)) - asin(scale * sin(psi0));
}

/* Integral of min(h(psi), cap) from psi0 to psi1. |h| falls as psi leaves 0, so it crosses the cap at -psi* and psi*,
 * where cos(psi*) = cap / (k sqrt(1 - cap^2)). */
static double capped_integral(const struct border *b, double cap, double psi0, double psi1)
{
    if (b->constant != 0.0)
        return fmin(b->constant, cap) * (psi1 - psi0);
    if (b->k * cap <= 0.0) /* the border lies wholly on one side of the cap */
        return b->k > 0.0 || (b->k == 0.0 && cap < 0.0) ? cap * (psi1 - psi0) : height_integral(b, psi0, psi1);
    const double ratio = cap / (b->k * sqrt(fmax(1e-300, 1.0 - cap * cap)));
    const double crossing = ratio < 1.0 ? acos(ratio) : 0.0;
    const double in0 = fmin(psi1, fmax(psi0, -crossing)), in1 = fmin(psi1, fmax(psi0, crossing));
    if (b->k > 0.0) /* above the cap between the crossings */
        return cap * (in1 - in0) + height_integral(b, psi0, in0) + height_integral(b, in1, psi1);
    return height_integral(b, in0, in1) + cap * ((psi1 - psi0) - (in1 - in0));
}

static enum err flush_column(const struct source_grid *g, struct column *col, uint32_t x, struct overlap_row *o,
                             uint32_t *count)
{
    for (uint32_t r = col->lowest; r <= col->highest && r < g->height; r++) {
        const uint32_t y = g->bottom_first ? g->height - 1 - r : r;
        if (col->row_solid_angle[r] > 0.0) {
            const enum err e = append(o, y * g->width + x, col->row_solid_angle[r]);
            if (e)
                return e;
            ++*count;
        }
        col->row_solid_angle[r] = 0.0;
    }
    col->lowest = g->height;
    col->highest = 0;
    return ERR_OK;
}

/* The azimuths at which the texel begins, ends and has corners, ascending. Returns how many. */
static int texel_azimuths(uint32_t face, const double u[2], const double v[2], double out[6])
{
    const int pole_inside = face >> 1 == 1 && u[0] < 0 && u[1] > 0 && v[0] < 0 && v[1] > 0;
    double centre[3], w[3];
    int count = 0;

    if (pole_inside) {
        out[0] = -PI;
        out[1] = PI;
        count = 2;
    }
    cube_direction(face, 0.5 * (u[0] + u[1]), 0.5 * (v[0] + v[1]), centre);
    const double phi_centre = pole_inside ? 0.0 : atan2(centre[0], centre[2]);
    for (int k = 0; k < 4; k++) {
        cube_direction(face, u[k & 1], v[k >> 1], w);
        if (fabs(w[0]) < 1e-12 && fabs(w[2]) < 1e-12)
            continue; /* the pole itself has no azimuth */
        out[count++] = phi_centre + wrap_angle(atan2(w[0], w[2]) - phi_centre);
    }
    for (int i = 1; i < count; i++) /* insertion sort of at most six */
        for (int k = i; k > 0 && out[k - 1] > out[k]; k--) {
            const double swap = out[k];
            out[k] = out[k - 1];
            out[k - 1] = swap;
        }
    return count;
}

/* The borders by which the meridian at phi enters and leaves the texel, lower in height first. */
static void find_borders(uint32_t face, const double u[2], const double v[2], double phi, struct border out[2])
{
    static const double normal_azimuth[4] = { 0.5 * PI, -0.5 * PI, 0.0, PI }; /* +x, -x, +z, -z */

    if (face >> 1 != 1) { /* a side: bottom and top edge, at distance 1 */
        const double *y = face >> 1 == 0 ? u : v, azimuth = normal_azimuth[face < 2 ? face : face - 2];
        for (int k = 0; k < 2; k++)
            out[k] = (struct border){ y[k], azimuth, 0.0 };
        return;
    }
    /* A pole: u runs along z, v along x. The meridian is a ray from the plane's origin, clipped against both slabs. */
    const double pole = face & 1 ? -1.0 : 1.0;
    const double along[2] = { cos(phi), sin(phi) }, low[2] = { u[0], v[0] }, high[2] = { u[1], v[1] };
    struct border enter = { 0.0, 0.0, pole }, leave = { 0.0, 0.0, pole };
    double near = 0.0, far = 1e30;
    for (int k = 0; k < 2; k++) {
        if (fabs(along[k]) < 1e-15)
            continue;
        const double first = along[k] > 0.0 ? low[k] : high[k], last = along[k] > 0.0 ? high[k] : low[k];
        const double toward = normal_azimuth[(k == 0 ? 2 : 0) + (along[k] < 0.0)];
        if (first / along[k] > near + 1e-15) {
            near = first / along[k];
            enter = (struct border){ pole / fabs(first), toward, 0.0 };
        }
        if (last / along[k] < far) {
            far = last / along[k];
            leave = (struct border){ pole / fabs(last), toward, 0.0 };
        }
    }
    out[0] = pole > 0.0 ? leave : enter;
    out[1] = pole > 0.0 ? enter : leave;
}

/* The texel between two azimuths, exactly: what lies between its lower and upper border, row by row of the source. */
static void integrate_interval(const struct source_grid *g, uint32_t face, const double u[2], const double v[2],
                               double phi0, double phi1, struct column *col)
{
    struct border border[2];
    double psi[2][2], height[2], above[2];

    find_borders(face, u, v, 0.5 * (phi0 + phi1), border);
    for (int k = 0; k < 2; k++) {
        psi[k][0] = wrap_angle(0.5 * (phi0 + phi1) - border[k].azimuth) - 0.5 * (phi1 - phi0);
        psi[k][1] = psi[k][0] + (phi1 - phi0);
        const double h0 = border_height(&border[k], psi[k][0]), h1 = border_height(&border[k], psi[k][1]);
        height[k] = k == 0 ? fmin(h0, h1) : fmax(h0, h1);
        if (psi[k][0] < 0.0 && psi[k][1] > 0.0) {
            const double middle = border_height(&border[k], 0.0);
            height[k] = k == 0 ? fmin(height[k], middle) : fmax(height[k], middle);
        }
    }
    uint32_t r = (uint32_t)(acos(fmin(1.0, fmax(-1.0, height[1]))) / PI * g->height);
    r = r < g->height ? r : g->height - 1;
    while (r > 0 && height[1] > g->edge_cos[r]) /* rounding at a boundary */
        r--;
    for (int k = 0; k < 2; k++)
        above[k] = capped_integral(&border[k], g->edge_cos[r], psi[k][0], psi[k][1]);
    for (; r < g->height; r++) {
        double below[2];
        for (int k = 0; k < 2; k++)
            below[k] = capped_integral(&border[k], g->edge_cos[r + 1], psi[k][0], psi[k][1]);
        const double solid_angle = (above[1] - below[1]) - (above[0] - below[0]);
        if (solid_angle > 0.0) {
            col->row_solid_angle[r] += solid_angle;
            col->lowest = r < col->lowest ? r : col->lowest;
            col->highest = r > col->highest ? r : col->highest;
        }
        if (height[0] >= g->edge_cos[r + 1])
            break;
        above[0] = below[0];
        above[1] = below[1];
    }
}

/* One cube texel: walk the source columns that it overlaps, from one column border or corner azimuth to the next. */
static enum err integrate_texel(const struct source_grid *g, uint32_t face, const double u[2], const double v[2],
                                struct column *col, struct overlap_row *o, uint32_t *count)
{
    double stops[6];
    const int n = texel_azimuths(face, u, v, stops);
    const double columns_per_radian = g->width / (2.0 * PI);

    for (int s = 0; s + 1 < n; s++) {
        /* The source's own azimuth: phi = pi - 2 pi x / width, after the rotation is undone. */
        double at = stops[s];
        while (at < stops[s + 1] - 1e-14) {
            const double x = (PI - (at - g->rotation)) * columns_per_radian;
            const double border = ceil(x - 1e-9) - 1.0; /* the column border that comes next with rising azimuth */
            double next = PI - border / columns_per_radian + g->rotation;
            if (next > stops[s + 1])
                next = stops[s + 1];
            integrate_interval(g, face, u, v, at, next, col);
            const double wrapped = border - g->width * floor(border / g->width);
            const uint32_t column = (uint32_t)wrapped < g->width ? (uint32_t)wrapped : g->width - 1;
            const enum err e = flush_column(g, col, column, o, count);
            if (e)
                return e;
            at = next;
        }
    }
    return ERR_OK;
}

static void integrate_row(const struct source_grid *g, uint32_t n, uint32_t row, struct overlap_row *o)
{
    const uint32_t face = row / n, i = row % n;
    const double v[2] = { -1.0 + 2.0 * i / n, -1.0 + 2.0 * (i + 1) / n };
    struct column col = { mem_alloc(g->height, sizeof(double)), g->height, 0 };

    o->count = mem_alloc(n, sizeof(*o->count));
    o->e = col.row_solid_angle && o->count ? ERR_OK : ERR_NOMEM;
    for (uint32_t j = 0; j < n && !o->e; j++) {
        const double u[2] = { -1.0 + 2.0 * j / n, -1.0 + 2.0 * (j + 1) / n };
        o->e = integrate_texel(g, face, u, v, &col, o, &o->count[j]);
    }
    mem_free(col.row_solid_angle);
}

/* Weights are shares of what was integrated, so that a constant stays constant to the last bit of float. */
static void normalise(struct resampler *r, const double *overlap)
{
    const size_t texels = (size_t)CUBE_FACES * r->n * r->n;

#pragma omp parallel for schedule(static)
    for (size_t t = 0; t < texels; t++) {
        double sum = 0.0;
        for (size_t k = r->first[t]; k < r->first[t + 1]; k++)
            sum += overlap[k];
        for (size_t k = r->first[t]; k < r->first[t + 1]; k++)
            r->weight[k] = (float)(overlap[k] / sum);
    }
}

/* The rows' pieces, one after another, as one table. */
static enum err gather(struct resampler *r, const struct overlap_row *rows, double **overlap)
{
    const uint32_t row_count = CUBE_FACES * r->n;
    size_t total = 0, texel = 0;

    for (uint32_t i = 0; i < row_count; i++) {
        if (rows[i].e)
            return rows[i].e;
        total += rows[i].used;
    }
    r->first = mem_alloc((size_t)row_count * r->n + 1, sizeof(*r->first));
    r->index = mem_alloc(total, sizeof(*r->index));
    r->weight = mem_alloc(total, sizeof(*r->weight));
    *overlap = mem_alloc(total, sizeof(**overlap));
    if (!r->first || !r->index || !r->weight || !*overlap)
        return ERR_NOMEM;
    total = 0;
    for (uint32_t i = 0; i < row_count; i++) {
        memcpy(r->index + total, rows[i].index, rows[i].used * sizeof(*r->index));
        memcpy(*overlap + total, rows[i].solid_angle, rows[i].used * sizeof(**overlap));
        for (uint32_t j = 0; j < r->n; j++, texel++)
            r->first[texel + 1] = r->first[texel] + rows[i].count[j];
        total += rows[i].used;
    }
    return ERR_OK;
}

enum err resampler_create(enum layout layout, uint32_t width, uint32_t height, uint32_t n, double rotation,
                          struct resampler **out)
{
    const uint32_t row_count = CUBE_FACES * n;
    double *overlap = NULL;
    enum err e = ERR_NOMEM;

    *out = NULL;
    if (layout != LAYOUT_LATLONG && layout != LAYOUT_LATLONG_BOTTOM_FIRST)
        return ERR_UNSUPPORTED;
    struct resampler *r = mem_alloc(1, sizeof(*r));
    struct overlap_row *rows = mem_alloc(row_count, sizeof(*rows));
    double *edge_cos = mem_alloc((size_t)height + 1, sizeof(*edge_cos));
    if (!r || !rows || !edge_cos)
        goto done;
    *r = (struct resampler){ .layout = layout, .width = width, .height = height, .n = n, .rotation = rotation };
    for (uint32_t i = 0; i <= height; i++)
        edge_cos[i] = i == 0 ? 1.0 : i == height ? -1.0 : cos(PI * i / height);
    const struct source_grid g = { width, height, rotation, edge_cos, layout == LAYOUT_LATLONG_BOTTOM_FIRST };
#pragma omp parallel for schedule(dynamic, 8)
    for (uint32_t i = 0; i < row_count; i++)
        integrate_row(&g, n, i, &rows[i]);
    e = gather(r, rows, &overlap);
    if (!e) {
        normalise(r, overlap);
        *out = r;
        r = NULL;
    }
done:
    for (uint32_t i = 0; rows && i < row_count; i++) {
        mem_free(rows[i].count);
        mem_free(rows[i].index);
        mem_free(rows[i].solid_angle);
    }
    mem_free(rows);
    mem_free(edge_cos);
    mem_free(overlap);
    resampler_destroy(r);
    return e;
}

void resampler_destroy(struct resampler *r)
{
    if (!r)
        return;
    mem_free(r->first);
    mem_free(r->index);
    mem_free(r->weight);
    mem_free(r);
}

/* Where a coarse cube map meets a fine source, thousands of terms add up: in double, so that the sum stays exact. */
static void sum_many(const struct resampler *r, const float *rgb, uint64_t first, uint64_t last, float out[3])
{
    double sum[3] = { 0.0, 0.0, 0.0 };

    for (uint64_t k = first; k < last; k++)
        for (int c = 0; c < 3; c++)
            sum[c] += (double)r->weight[k] * rgb[3 * (size_t)r->index[k] + (size_t)c];
    for (int c = 0; c < 3; c++)
        out[c] = (float)sum[c];
}

void resampler_row(const struct resampler *r, const float *rgb, float gain, uint32_t row, float *texels)
{
    const uint64_t *first = r->first + (size_t)row * r->n;

    assert(row < CUBE_FACES * r->n);
    for (uint32_t j = 0; j < r->n; j++) {
        float sum[3] = { 0.0f, 0.0f, 0.0f };
        if (first[j + 1] - first[j] > MANY) {
            sum_many(r, rgb, first[j], first[j + 1], sum);
        } else {
            for (uint64_t k = first[j]; k < first[j + 1]; k++) {
                const float *s = rgb + 3 * (size_t)r->index[k];
                sum[0] += r->weight[k] * s[0];
                sum[1] += r->weight[k] * s[1];
                sum[2] += r->weight[k] * s[2];
            }
        }
        for (int c = 0; c < 3; c++)
            texels[4 * j + (uint32_t)c] = gain * sum[c];
    }
}
