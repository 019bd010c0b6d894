#include "resample.h"

#include "cube.h"
#include "mem.h"
#include "vec.h"

#include <assert.h>
#include <string.h>

#define FIT_ROUNDS 60
#define FIT_TOLERANCE 1e-6

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

/* Heights (cosines of the polar angle) between which the meridian at phi runs through the rectangle of a face. */
static void meridian_heights(uint32_t face, const double u[2], const double v[2], double phi, double out[2])
{
    const double s = sin(phi), c = cos(phi);

    if (face >> 1 == 1) { /* a pole: u along z, v along x; the meridian is a ray from the origin of the plane */
        double near = 0.0, far = 1e30;
        const double along[2] = { c, s }, low[2] = { u[0], v[0] }, high[2] = { u[1], v[1] };
        for (int k = 0; k < 2; k++) {
            if (fabs(along[k]) < 1e-15)
                continue;
            const double a = low[k] / along[k], b = high[k] / along[k];
            near = fmax(near, fmin(a, b));
            far = fmin(far, fmax(a, b));
        }
        far = fmax(far, near);
        const double high_y = 1.0 / sqrt(1.0 + near * near), low_y = 1.0 / sqrt(1.0 + far * far);
        out[0] = face & 1 ? -high_y : low_y;
        out[1] = face & 1 ? -low_y : high_y;
        return;
    }
    /* A side: the meridian is the vertical line across = z / |x| (or x / |z|), y runs along the other coordinate. */
    const int x_face = face >> 1 == 0;
    const double across = x_face ? c / fabs(s) : s / fabs(c);
    const double *y = x_face ? u : v;
    const double d = 1.0 + across * across;
    out[0] = y[0] / sqrt(d + y[0] * y[0]);
    out[1] = y[1] / sqrt(d + y[1] * y[1]);
}

static void spread_over_rows(const struct source_grid *g, struct column *col, const double h[2], double weight)
{
    uint32_t r = (uint32_t)(acos(fmin(1.0, fmax(-1.0, h[1]))) / PI * g->height);
    if (r >= g->height)
        r = g->height - 1;
    while (r > 0 && h[1] > g->edge_cos[r]) /* rounding at a boundary */
        r--;
    for (; r < g->height; r++) {
        const double top = fmin(h[1], g->edge_cos[r]), bottom = fmax(h[0], g->edge_cos[r + 1]);
        if (top > bottom) {
            col->row_solid_angle[r] += weight * (top - bottom);
            col->lowest = r < col->lowest ? r : col->lowest;
            col->highest = r > col->highest ? r : col->highest;
        }
        if (h[0] >= g->edge_cos[r + 1])
            break;
    }
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

static double wrap_angle(double a)
{
    while (a > PI)
        a -= 2.0 * PI;
    while (a <= -PI)
        a += 2.0 * PI;
    return a;
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

/* Four Gauss-Legendre nodes on an interval of azimuth over which the texel's border is smooth. What its crossings of
 * the source's rows leave as an error is taken out by the fit. */
static void integrate_interval(const struct source_grid *g, uint32_t face, const double u[2], const double v[2],
                               double phi0, double phi1, struct column *col)
{
    static const double node[4] = { -0.8611363115940526, -0.3399810435848563, 0.3399810435848563, 0.8611363115940526 };
    static const double weight[4] = { 0.3478548451374538, 0.6521451548625461, 0.6521451548625461, 0.3478548451374538 };
    const double half = 0.5 * (phi1 - phi0), mid = 0.5 * (phi1 + phi0);

    for (int k = 0; k < 4; k++) {
        double h[2];
        meridian_heights(face, u, v, mid + half * node[k], h);
        if (h[1] > h[0])
            spread_over_rows(g, col, h, half * weight[k]);
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

/* Iterative proportional fitting: rows and columns of the overlap matrix are scaled in turn to the solid angles that
 * they must add up to [Deming and Stephan 1940]. Ends with the rows, which makes a constant exact. */
static enum err fit(struct resampler *r, double *overlap, const double *edge_cos)
{
    const size_t texels = (size_t)CUBE_FACES * r->n * r->n, sources = (size_t)r->width * r->height;
    double *sum = mem_alloc(sources, sizeof(*sum));
    double worst = 1.0;

    if (!sum)
        return ERR_NOMEM;
    for (int round = 0; round < FIT_ROUNDS && worst > FIT_TOLERANCE; round++) {
        memset(sum, 0, sources * sizeof(*sum));
        for (size_t k = 0; k < r->first[texels]; k++)
            sum[r->index[k]] += overlap[k];
        worst = 0.0;
        for (size_t s = 0; s < sources; s++) {
            const size_t y = s / r->width, row = r->layout == LAYOUT_LATLONG ? y : r->height - 1 - y;
            const double want = (edge_cos[row] - edge_cos[row + 1]) * 2.0 * PI / r->width;
            worst = fmax(worst, fabs(sum[s] / want - 1.0));
            sum[s] = sum[s] > 0.0 ? want / sum[s] : 0.0;
        }
#pragma omp parallel for schedule(static)
        for (size_t t = 0; t < texels; t++) {
            const uint32_t i = (uint32_t)(t / r->n % r->n), j = (uint32_t)(t % r->n);
            const double step = 2.0 / r->n;
            const double want =
                cube_solid_angle(-1.0 + step * j, -1.0 + step * i, -1.0 + step * (j + 1), -1.0 + step * (i + 1));
            double got = 0.0;
            for (size_t k = r->first[t]; k < r->first[t + 1]; k++)
                got += overlap[k] *= sum[r->index[k]];
            for (size_t k = r->first[t]; k < r->first[t + 1]; k++) {
                overlap[k] *= want / got;
                r->weight[k] = (float)(overlap[k] / want);
            }
        }
    }
    mem_free(sum);
    return ERR_OK;
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
    if (!e)
        e = fit(r, overlap, edge_cos);
    if (!e) {
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

void resampler_row(const struct resampler *r, const float *rgb, float gain, uint32_t row, float *texels)
{
    const uint64_t *first = r->first + (size_t)row * r->n;

    assert(row < CUBE_FACES * r->n);
    for (uint32_t j = 0; j < r->n; j++) {
        float red = 0.0f, green = 0.0f, blue = 0.0f;
        for (uint64_t k = first[j]; k < first[j + 1]; k++) {
            const float *s = rgb + 3 * (size_t)r->index[k];
            red += r->weight[k] * s[0];
            green += r->weight[k] * s[1];
            blue += r->weight[k] * s[2];
        }
        texels[4 * j] = gain * red;
        texels[4 * j + 1] = gain * green;
        texels[4 * j + 2] = gain * blue;
    }
}
