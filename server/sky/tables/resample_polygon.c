#include "base/mem.h"
#include "base/vec.h"
#include "sky/tables/resample.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define CORNERS_MAX 384     /* bounds a ring of bent borders; assertions check it */
#define STRAIGHT 1e-8       /* likewise: treated as straight */
#define BEND_DEPTH 7        /* halvings of a border; chosen, not measured */
#define RIM_DEPTH 5         /* likewise, at the rim of a disc */
#define BEND_TOLERANCE 1e-3 /* relative to a piece's length: maximum distance of a curved border from its chord */

/* The border of a block as directions joined by great circles; equivalently, on the plane of a face, points (u, v)
 * joined by straight lines. */
struct ring {
    int count;
    double w[CORNERS_MAX][3];
};

struct polygon {
    int count;
    double p[CORNERS_MAX][2];
};

/* The polygon being clipped, and buffers for intermediate results. */
struct cutter {
    const struct cube_side *cube;
    struct ring ring, clipped[2];
    struct polygon face, rest[2], strip, row_rest[2], cell;
};

static void ring_add(struct ring *r, const double w[3])
{
    assert(r->count < CORNERS_MAX);
    memcpy(r->w[r->count++], w, sizeof(r->w[0]));
}

static void polygon_add(struct polygon *g, double u, double v)
{
    assert(g->count < CORNERS_MAX);
    g->p[g->count][0] = u;
    g->p[g->count++][1] = v;
}

/* About +Y: moves what the source shows at +Z towards +X. */
static void rotate(double c, double s, double w[3])
{
    const double x = w[0], z = w[2];

    w[0] = c * x + s * z;
    w[2] = c * z - s * x;
}

static int is_rim(const double p[2])
{
    return p[0] * p[0] + p[1] * p[1] > 1.0 - 1e-9;
}

/* A point near the middle of a piece in terms of direction. Near a ball's rim, direction varies as the square root of
 * the distance from it, so the middle is a quarter of the way. */
static void halve(enum layout layout, const double a[2], const double b[2], double m[2])
{
    const double share = layout != LAYOUT_BALL || is_rim(a) == is_rim(b) ? 0.5 : is_rim(a) ? 0.25 : 0.75;

    for (int k = 0; k < 2; k++)
        m[k] = a[k] + share * (b[k] - a[k]);
}

/* Adds the points between a and b (exclusive) of a border that is straight in a ball's or fisheye's image. The last
 * pieces are approximated by parabolas, whose area (Archimedes) equals a triangle 4/3 as high, so the corner is placed
 * that far out. Pieces that touch the rim are always halved a few times: a ball's whole rim is one direction, and a
 * block there may be a sliver whose only area lies between its curves. */
static void bend(enum layout layout, const double a[2], const double b[2], int depth, struct ring *out)
{
    double m[2], wa[3], wb[3], wm[3];

    halve(layout, a, b, m);
    layout_disc_direction(layout, a[0], a[1], wa);
    layout_disc_direction(layout, b[0], b[1], wb);
    layout_disc_direction(layout, m[0], m[1], wm);
    const double normal[3] = { wa[1] * wb[2] - wa[2] * wb[1], wa[2] * wb[0] - wa[0] * wb[2],
                               wa[0] * wb[1] - wa[1] * wb[0] };
    const double length2 = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
    const double off = normal[0] * wm[0] + normal[1] * wm[1] + normal[2] * wm[2];
    const int rim = depth > BEND_DEPTH - RIM_DEPTH && (is_rim(a) || is_rim(b));
    const int room = out->count < CORNERS_MAX / 4; /* clipping adds corners too */
    if (depth > 0 && room && (rim || fabs(off) > BEND_TOLERANCE * length2)) {
        bend(layout, a, m, depth - 1, out);
        ring_add(out, wm);
        bend(layout, m, b, depth - 1, out);
    } else if (fabs(off) > STRAIGHT * length2 && out->count < CORNERS_MAX / 2) {
        for (int k = 0; k < 3; k++)
            wm[k] += off / (3.0 * length2) * normal[k];
        ring_add(out, wm);
    }
}

/* Neighbours traverse a common border in the same direction, so that it gets the same corners for both. */
static void outline_disc(const struct blocks *b, const double low[2], const double high[2], struct ring *out)
{
    const double size[2] = { b->width, b->height }, side = fmin(b->width, b->height);
    double from[2], to[2], pieces[4][2][2];

    for (int k = 0; k < 2; k++) {
        from[k] = (2.0 * low[k] - size[k]) / side;
        to[k] = (2.0 * high[k] - size[k]) / side;
    }
    const int count = layout_disc_border(from, to, pieces);
    for (int k = 0; k < count; k++) {
        const double *p = pieces[k][0], *q = pieces[k][1];
        double w[3];
        layout_disc_direction(b->layout, p[0], p[1], w);
        ring_add(out, w);
        const int first = out->count;
        const int backwards = p[0] > q[0] || p[1] > q[1];
        bend(b->layout, backwards ? q : p, backwards ? p : q, BEND_DEPTH, out);
        for (int i = first, j = out->count - 1; backwards && i < j; i++, j--)
            for (int c = 0; c < 3; c++) {
                const double swap = out->w[i][c];
                out->w[i][c] = out->w[j][c];
                out->w[j][c] = swap;
            }
        const double *next = pieces[(k + 1) % count][0];
        layout_disc_direction(b->layout, q[0], q[1], w);
        if (next[0] != q[0] || next[1] != q[1])
            ring_add(out, w);
    }
}

/* The corners of a block of a cube face, whose borders are great circles. */
static void outline_cube(const struct blocks *b, uint32_t column, uint32_t row, const double low[2],
                         const double high[2], struct ring *out)
{
    const struct layout_face *faces = layout_faces(b->layout);
    const uint32_t x = column / b->per_cell[0], y = row / b->per_cell[1];

    for (int f = 0; f < CUBE_FACES; f++) {
        if (faces[f].column != (int)x || faces[f].row != (int)y)
            continue;
        for (int k = 0; k < 4; k++) {
            const double s = 2.0 * ((k == 1 || k == 2 ? high : low)[0] / b->cell[0] - x) - 1.0;
            const double t = 2.0 * ((k >= 2 ? high : low)[1] / b->cell[1] - y) - 1.0;
            double w[3] = { 0.0, 0.0, 0.0 };
            w[f >> 1] = f & 1 ? -1.0 : 1.0;
            w[abs(faces[f].right) - 1] = faces[f].right > 0 ? s : -s;
            w[abs(faces[f].down) - 1] = faces[f].down > 0 ? t : -t;
            ring_add(out, w);
        }
    }
}

/* Clips to sign * w[b] <= w[a] * facing by a plane through the centre [Sutherland and Hodgman]. */
static void clip_ring(const struct ring *in, int a, double facing, int b, double sign, struct ring *out)
{
    out->count = 0;
    for (int k = 0; k < in->count; k++) {
        const double *p = in->w[k], *q = in->w[(k + 1) % in->count];
        const double dp = facing * p[a] - sign * p[b], dq = facing * q[a] - sign * q[b];
        if (dp >= 0.0)
            ring_add(out, p);
        if ((dp > 0.0 && dq < 0.0) || (dp < 0.0 && dq > 0.0)) {
            const double t = dp / (dp - dq);
            ring_add(out,
                     (const double[3]){ p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]), p[2] + t * (q[2] - p[2]) });
        }
    }
}

/* Splits a polygon at a line across `axis`. */
static void cut(const struct polygon *in, int axis, double at, struct polygon *below, struct polygon *above)
{
    below->count = above->count = 0;
    for (int k = 0; k < in->count; k++) {
        const double *p = in->p[k], *q = in->p[k + 1 < in->count ? k + 1 : 0];
        const double dp = p[axis] - at, dq = q[axis] - at;
        if (dp <= 0.0)
            polygon_add(below, p[0], p[1]);
        if (dp >= 0.0)
            polygon_add(above, p[0], p[1]);
        if ((dp > 0.0 && dq < 0.0) || (dp < 0.0 && dq > 0.0)) {
            const double t = dp / (dp - dq);
            double m[2] = { p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]) };
            m[axis] = at;
            polygon_add(below, m[0], m[1]);
            polygon_add(above, m[0], m[1]);
        }
    }
}

/* Sums triangles between the face's foot point and each side [Van Oosterom and Strackee 1983]: the tangent of half the
 * solid angle is y / x, so solid angles add like the arguments of complex numbers, and a single arctangent suffices. */
static double solid_angle_of(const struct polygon *g)
{
    double x = 1.0, y = 0.0;
    const double *p = g->p[g->count - 1];
    double p_length = sqrt(p[0] * p[0] + p[1] * p[1] + 1.0);

    for (int k = 0; k < g->count; k++) {
        const double *q = g->p[k];
        const double q_length = sqrt(q[0] * q[0] + q[1] * q[1] + 1.0);
        const double cx = p_length * q_length + p_length + q_length + p[0] * q[0] + p[1] * q[1] + 1.0;
        const double cy = (p[0] * q[1] - p[1] * q[0]) / cx;
        const double turned = x - y * cy;
        y += x * cy;
        x = turned;
        p = q;
        p_length = q_length;
    }
    return fabs(2.0 * atan2(y, x));
}

/* The columns or rows of the grid that a polygon touches. */
static void reach(const struct polygon *g, int axis, uint32_t n, uint32_t *from, uint32_t *to)
{
    double low = 1.0, high = -1.0;

    for (int k = 0; k < g->count; k++) {
        low = fmin(low, g->p[k][axis]);
        high = fmax(high, g->p[k][axis]);
    }
    const double a = floor(0.5 * (low + 1.0) * n), b = floor(0.5 * (high + 1.0) * n);
    *from = a < n ? (uint32_t)a : n - 1;
    *to = b < n ? (uint32_t)b : n - 1;
}

/* Splits a row of grid cells from left to right. */
static enum err cut_strip(struct cutter *c, const struct polygon *strip, uint32_t face, uint32_t i, uint32_t block,
                          double whole, struct overlaps *out)
{
    const uint32_t n = c->cube->n;
    uint32_t j, last;

    reach(strip, 0, n, &j, &last);
    for (int turn = 0; j <= last && strip->count > 2; j++, turn ^= 1) {
        const struct polygon *cell = strip;
        if (j < last) {
            cut(strip, 0, -1.0 + 2.0 * (j + 1) / n, &c->cell, &c->row_rest[turn]);
            cell = &c->cell;
            strip = &c->row_rest[turn];
        }
        const double found = cell->count > 2 ? solid_angle_of(cell) : 0.0;
        if (found <= OVERLAP_MIN * fmin(whole, c->cube->solid_angle[(size_t)i * n + j]))
            continue;
        const enum err e = overlaps_add(out, (face * n + i) * n + j, block, found);
        if (e)
            return e;
    }
    return ERR_OK;
}

static enum err cut_face(struct cutter *c, const struct ring *ring, uint32_t face, uint32_t block, double whole,
                         struct overlaps *out)
{
    const uint32_t n = c->cube->n, a = face >> 1;
    const struct polygon *rest = &c->face;
    uint32_t i, last;

    c->face.count = 0;
    for (int k = 0; k < ring->count; k++) {
        const double scale = 1.0 / fabs(ring->w[k][a]);
        polygon_add(&c->face, fmin(1.0, fmax(-1.0, scale * ring->w[k][(a + 1) % 3])),
                    fmin(1.0, fmax(-1.0, scale * ring->w[k][(a + 2) % 3])));
    }
    reach(rest, 1, n, &i, &last);
    for (int turn = 0; i <= last && rest->count > 2; i++, turn ^= 1) {
        const struct polygon *strip = rest;
        if (i < last) {
            cut(rest, 1, -1.0 + 2.0 * (i + 1) / n, &c->strip, &c->rest[turn]);
            strip = &c->strip;
            rest = &c->rest[turn];
        }
        const enum err e = cut_strip(c, strip, face, i, block, whole, out);
        if (e)
            return e;
    }
    return ERR_OK;
}

/* The face that contains all corners, or CUBE_FACES. */
static uint32_t common_face(const struct ring *r)
{
    const double *w = r->w[0], x = fabs(w[0]), y = fabs(w[1]), z = fabs(w[2]);
    const int a = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
    const double facing = w[a] < 0.0 ? -1.0 : 1.0;

    for (int k = 1; k < r->count; k++) {
        const double depth = facing * r->w[k][a];
        if (depth <= 0.0 || fabs(r->w[k][(a + 1) % 3]) > depth || fabs(r->w[k][(a + 2) % 3]) > depth)
            return CUBE_FACES;
    }
    return 2 * (uint32_t)a + (facing < 0.0);
}

static enum err cut_block(struct cutter *c, uint32_t block, double whole, struct overlaps *out)
{
    const uint32_t common = common_face(&c->ring);
    enum err e = ERR_OK;

    if (common < CUBE_FACES)
        return cut_face(c, &c->ring, common, block, whole, out);
    for (uint32_t f = 0; f < CUBE_FACES && !e; f++) {
        const int a = (int)f >> 1;
        const double facing = f & 1 ? -1.0 : 1.0;
        const struct ring *ring = &c->ring;
        for (int k = 0; k < 4 && ring->count > 2; k++) {
            clip_ring(ring, a, facing, (a + 1 + (k >> 1)) % 3, k & 1 ? -1.0 : 1.0, &c->clipped[k & 1]);
            ring = &c->clipped[k & 1];
        }
        if (ring->count > 2)
            e = cut_face(c, ring, f, block, whole, out);
    }
    return e;
}

void resample_polygon_row(const struct blocks *b, const struct cube_side *side, uint32_t row, struct overlaps *out)
{
    const double cosine = cos(side->rotation), sine = sin(side->rotation);
    struct cutter *c = mem_alloc(1, sizeof(*c));

    out->e = c ? ERR_OK : ERR_NOMEM;
    for (uint32_t x = 0; x < b->columns && !out->e; x++) {
        double low[2], high[2];
        blocks_bounds(b, x, row, low, high);
        c->cube = side;
        c->ring.count = 0;
        if (layout_is_disc(b->layout))
            outline_disc(b, low, high, &c->ring);
        else
            outline_cube(b, x, row, low, high, &c->ring);
        if (c->ring.count < 3)
            continue;
        for (int k = 0; k < c->ring.count; k++)
            rotate(cosine, sine, c->ring.w[k]);
        const double whole = layout_solid_angle(b->layout, b->width, b->height, low, high);
        out->e = cut_block(c, row * b->columns + x, whole, out);
    }
    mem_free(c);
}
