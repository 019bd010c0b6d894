#include "base/mem.h"
#include "env/resample_build.h"
#include "base/vec.h"

#include <math.h>

/* A source column while a cube texel is integrated over it: solid angle per source row, from the north pole. */
struct column {
    double *row_solid_angle; /* [rows], 0 outside lowest..highest */
    uint32_t lowest, highest;
    double whole; /* width of the column, radians */
};

/* The cube texel being integrated, and the list for its overlaps. */
struct target {
    uint32_t texel;
    double solid_angle;
    const double *edge_cos;
    struct overlaps *out;
};

/* A straight border of a cube texel, seen from the centre: a horizontal line at height y, at distance d in direction
 * `azimuth`. With k = y / d and psi the azimuth relative to it, the height of the unit vector along the line is h(psi)
 * = k cos(psi) / sqrt(1 + k^2 cos(psi)^2), and the integral of h = asin(k sin(psi) / sqrt(1 + k^2)). If the texel
 * contains a pole, the border is the pole itself and h is constant. */
struct border {
    double k, azimuth;
    double constant; /* 1 or -1 at a pole, else 0 */
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

/* Integral of min(h(psi), cap) from psi0 to psi1. |h| decreases away from psi = 0, so it crosses the cap at -psi* and
 * psi*, where cos(psi*) = cap / (k sqrt(1 - cap^2)). */
static double capped_integral(const struct border *b, double cap, double psi0, double psi1)
{
    if (b->constant != 0.0)
        return fmin(b->constant, cap) * (psi1 - psi0);
    if (b->k * cap <= 0.0) /* the border lies entirely on one side of the cap */
        return b->k > 0.0 || (b->k == 0.0 && cap < 0.0) ? cap * (psi1 - psi0) : height_integral(b, psi0, psi1);
    const double ratio = cap / (b->k * sqrt(fmax(1e-300, 1.0 - cap * cap)));
    const double crossing = ratio < 1.0 ? acos(ratio) : 0.0;
    const double in0 = fmin(psi1, fmax(psi0, -crossing)), in1 = fmin(psi1, fmax(psi0, crossing));
    if (b->k > 0.0) /* above the cap between the crossings */
        return cap * (in1 - in0) + height_integral(b, psi0, in0) + height_integral(b, in1, psi1);
    return height_integral(b, in0, in1) + cap * ((psi1 - psi0) - (in1 - in0));
}

static enum err flush_column(const struct blocks *b, struct column *col, uint32_t x, struct target *t)
{
    for (uint32_t r = col->lowest; r <= col->highest && r < b->rows; r++) {
        const uint32_t y = b->layout == LAYOUT_LATLONG_BOTTOM_FIRST ? b->rows - 1 - r : r;
        const double found = col->row_solid_angle[r], whole = col->whole * (t->edge_cos[r] - t->edge_cos[r + 1]);
        if (found > OVERLAP_MIN * fmin(whole, t->solid_angle)) {
            const enum err e = overlaps_add(t->out, t->texel, y * b->columns + x, found);
            if (e)
                return e;
        }
        col->row_solid_angle[r] = 0.0;
    }
    col->lowest = b->rows;
    col->highest = 0;
    return ERR_OK;
}

/* The azimuths of the texel's corners and extremes, ascending. Returns their number. */
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
            continue; /* a pole has no azimuth */
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

/* The borders where the meridian at phi enters and leaves the texel, the lower one first. */
static void find_borders(uint32_t face, const double u[2], const double v[2], double phi, struct border out[2])
{
    static const double normal_azimuth[4] = { 0.5 * PI, -0.5 * PI, 0.0, PI }; /* +x, -x, +z, -z */

    if (face >> 1 != 1) { /* a side face: bottom and top edge, at distance 1 */
        const double *y = face >> 1 == 0 ? u : v, azimuth = normal_azimuth[face < 2 ? face : face - 2];
        for (int k = 0; k < 2; k++)
            out[k] = (struct border){ y[k], azimuth, 0.0 };
        return;
    }
    /* A polar face: u runs along z, v along x. The meridian is a ray from the plane's origin, clipped against both
     * slabs. */
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

/* Integrates the texel between two azimuths exactly: between its lower and upper border, row by row of the source. */
static void integrate_interval(const struct blocks *b, const double *edge_cos, uint32_t face, const double u[2],
                               const double v[2], double phi0, double phi1, struct column *col)
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
    uint32_t r = (uint32_t)(acos(fmin(1.0, fmax(-1.0, height[1]))) / PI * b->height / b->factor);
    r = r < b->rows ? r : b->rows - 1;
    while (r > 0 && height[1] > edge_cos[r]) /* rounding at a boundary */
        r--;
    for (int k = 0; k < 2; k++)
        above[k] = capped_integral(&border[k], edge_cos[r], psi[k][0], psi[k][1]);
    for (; r < b->rows; r++) {
        double below[2];
        for (int k = 0; k < 2; k++)
            below[k] = capped_integral(&border[k], edge_cos[r + 1], psi[k][0], psi[k][1]);
        const double solid_angle = (above[1] - below[1]) - (above[0] - below[0]);
        if (solid_angle > 0.0) {
            col->row_solid_angle[r] += solid_angle;
            col->lowest = r < col->lowest ? r : col->lowest;
            col->highest = r > col->highest ? r : col->highest;
        }
        if (height[0] >= edge_cos[r + 1])
            break;
        above[0] = below[0];
        above[1] = below[1];
    }
}

/* Integrates one cube texel: visits the source columns it overlaps, from one column border or corner azimuth to the
 * next. */
static enum err integrate_texel(const struct blocks *b, double rotation, uint32_t face, const double u[2],
                                const double v[2], struct column *col, struct target *t)
{
    double stops[6];
    const int n = texel_azimuths(face, u, v, stops);
    const double texels_per_radian = b->width / (2.0 * PI);

    for (int s = 0; s + 1 < n; s++) {
        /* Azimuth in the source: phi = pi - 2 pi x / width, after undoing the rotation. */
        double at = stops[s];
        while (at < stops[s + 1] - 1e-14) {
            const double x = (PI - (at - rotation)) * texels_per_radian;
            /* The block to the left of x and its left border, which is the next one with increasing azimuth. */
            const double turn = b->width * floor((x - 1e-9) / b->width);
            const double block = fmax(0.0, ceil((x - turn) / b->factor - 1e-9) - 1.0);
            const uint32_t column = block < b->columns ? (uint32_t)block : b->columns - 1;
            const double border = turn + (double)b->factor * column;
            double next = PI - border / texels_per_radian + rotation;
            if (next > stops[s + 1])
                next = stops[s + 1];
            integrate_interval(b, t->edge_cos, face, u, v, at, next, col);
            col->whole = fmin(b->factor, b->width - (double)b->factor * column) / texels_per_radian;
            const enum err e = flush_column(b, col, column, t);
            if (e)
                return e;
            at = next;
        }
    }
    return ERR_OK;
}

void resample_latlong_row(const struct blocks *b, const struct cube_side *c, const double *edge_cos, uint32_t row,
                          struct overlaps *out)
{
    const uint32_t n = c->n, face = row / n, i = row % n;
    const double v[2] = { -1.0 + 2.0 * i / n, -1.0 + 2.0 * (i + 1) / n };
    struct column col = { .row_solid_angle = mem_alloc(b->rows, sizeof(double)), .lowest = b->rows };

    out->e = col.row_solid_angle ? ERR_OK : ERR_NOMEM;
    for (uint32_t j = 0; j < n && !out->e; j++) {
        const double u[2] = { -1.0 + 2.0 * j / n, -1.0 + 2.0 * (j + 1) / n };
        struct target t = { row * n + j, c->solid_angle[(size_t)i * n + j], edge_cos, out };
        out->e = integrate_texel(b, c->rotation, face, u, v, &col, &t);
    }
    mem_free(col.row_solid_angle);
}
