#include "sky/between/drift.h"

#include "base/luminance.h"
#include "base/mem.h"
#include "base/vec.h"

#include <math.h>
#include <string.h>

/* WINDS: tried along each axis, WIND_STEP apart: up to 1.5 times the clouds' height per interval, 56 degrees at the
 * zenith. LEVELS: of the pyramid, halved each time. ROUNDS: on each level. WINDOW: radius over which a place has one
 * motion, texels of its level. STIFF: holds still what has no contrast, in squares of log luminance. AGREE: the way
 * back ends at most so far from where the way there began. WORTH: a motion must leave at most this share of what
 * standing still leaves. EDGE: no motion from here on to the horizon, where it is foreshortened to nothing. ALIKE:
 * skies that differ by less, squared log luminance, have nothing to move. */
#define SIDE DRIFT_SIDE
#define AREA ((size_t)SIDE * SIDE)
#define WINDS 31
#define WIND_STEP 0.1
#define LEVELS 3
#define ROUNDS 3
#define WINDOW 4
#define STIFF 2e-4f
#define AGREE 0.04f
#define WORTH 0.8
#define EDGE 0.95f
#define ALIKE 1e-5
#define NODE 8        /* texels between places whose motion is computed; bilinear between them */
#define NEAR_ZENITH 3 /* of these from the zenith */
#define SPREAD 4.0f   /* of these: neighbours whose origins are so far apart */

/* Thumbnails of all levels, one after another, and the buffers of a round. */
struct work {
    float *image[2][LEVELS];
    float *flow[2], *back[2]; /* of the two coordinates */
    float *sums[5], *swap;
};

#define WORK_FLOATS (2 * AREA * 2 + 4 * AREA + 6 * AREA)

static void lay_out(float *memory, struct work *w)
{
    float *at = memory;

    for (int k = 0; k < 2; k++)
        for (int l = 0; l < LEVELS; at += AREA >> 2 * l, l++)
            w->image[k][l] = at;
    at = memory + 4 * AREA;
    for (int k = 0; k < 2; k++, at += AREA)
        w->flow[k] = at;
    for (int k = 0; k < 2; k++, at += AREA)
        w->back[k] = at;
    for (int k = 0; k < 5; k++, at += AREA)
        w->sums[k] = at;
    w->swap = at;
}

static float place_of(uint32_t k, uint32_t side)
{
    return ((float)k + 0.5f) * 2.0f / (float)side - 1.0f;
}

/* The direction of a stereographic place. */
static void direction_of(float px, float pz, float w[3])
{
    const float square = px * px + pz * pz, scale = 1.0f / (1.0f + square);

    w[0] = 2.0f * px * scale;
    w[1] = (1.0f - square) * scale;
    w[2] = 2.0f * pz * scale;
}

/* Where a direction is in a lat-long image, in texels. */
static void texel_of(const float w[3], uint32_t width, uint32_t height, float *x, float *y)
{
    *x = (float)width * (0.5f - atan2f(w[0], w[2]) * (float)(0.5 / PI));
    *y = (float)height * acosf(fmaxf(-1.0f, fminf(1.0f, w[1]))) * (float)(1.0 / PI);
}

/* The logarithm of the luminance around (x, y), over a box of `reach` texels each way. */
static float look(const float *rgb, uint32_t width, uint32_t height, float x, float y, float reach)
{
    const long x0 = lrintf(x - reach - 0.5f), x1 = lrintf(x + reach - 0.5f);
    const long y0 = lrintf(y - reach - 0.5f), y1 = lrintf(y + reach - 0.5f);
    float sum = 0.0f, count = 0.0f;

    for (long j = y0; j <= y1; j++) {
        const long row = j < 0 ? 0 : j >= (long)height ? (long)height - 1 : j;
        for (long i = x0; i <= x1; i++) {
            const long column = ((i % (long)width) + (long)width) % (long)width;
            const float *t = rgb + 3 * ((size_t)row * width + (size_t)column);
            sum += rgb_luminance(t[0], t[1], t[2]);
            count += 1.0f;
        }
    }
    return logf(sum / count + 1e-12f);
}

/* Below the horizon is what is at the horizon. */
static void shrink(const float *rgb, uint32_t width, uint32_t height, float *out)
{
    const float reach =
        0.5f * (float)height / (float)SIDE; /* of the horizon's quarter: half a texel of the thumbnail */

#pragma omp parallel for schedule(dynamic, 8)
    for (uint32_t j = 0; j < SIDE; j++)
        for (uint32_t i = 0; i < SIDE; i++) {
            float px = place_of(i, SIDE), pz = place_of(j, SIDE), w[3], x, y;
            const float length = sqrtf(px * px + pz * pz), cut = length > 0.99f ? 0.99f / length : 1.0f;
            direction_of(px * cut, pz * cut, w);
            texel_of(w, width, height, &x, &y);
            out[j * SIDE + i] = look(rgb, width, height, x, y, reach);
        }
}

static void halve(const float *from, uint32_t side, float *to)
{
    for (uint32_t j = 0; j < side / 2; j++)
        for (uint32_t i = 0; i < side / 2; i++) {
            const float *f = from + 2 * j * side + 2 * i;
            to[j * (side / 2) + i] = 0.25f * (f[0] + f[1] + f[side] + f[side + 1]);
        }
}

/* Takes out the mean, so that a change of exposure is no motion. */
static void centre(float *image)
{
    double sum = 0.0;

    for (size_t k = 0; k < AREA; k++)
        sum += (double)image[k];
    for (size_t k = 0; k < AREA; k++)
        image[k] -= (float)(sum / (double)AREA);
}

/* Bilinear, in stereographic coordinates; the border goes on. */
static float sample(const float *image, uint32_t side, float px, float pz)
{
    const float half = 0.5f * (float)side, most = (float)side - 1.001f;
    const float x = fmaxf(0.0f, fminf(most, (px + 1.0f) * half - 0.5f));
    const float y = fmaxf(0.0f, fminf(most, (pz + 1.0f) * half - 0.5f));
    const uint32_t i = (uint32_t)x, j = (uint32_t)y;
    const float *t = image + j * side + i, u = x - (float)i, v = y - (float)j;

    return (1.0f - v) * ((1.0f - u) * t[0] + u * t[1]) + v * ((1.0f - u) * t[side] + u * t[side + 1]);
}

static bool is_sky(float px, float pz)
{
    return px * px + pz * pz < EDGE * EDGE;
}

/* The way of a place by a wind: to the plane of the clouds and back, foreshortened towards the horizon. */
static void blow(const double wind[2], float px, float pz, float flow[2])
{
    float w[3];

    direction_of(px, pz, w);
    const float x = w[0] + (float)wind[0] * w[1], z = w[2] + (float)wind[1] * w[1];
    const float scale = 1.0f / (sqrtf(x * x + z * z + w[1] * w[1]) + w[1]); /* 1 + y of the unit vector */
    flow[0] = x * scale - px;
    flow[1] = z * scale - pz;
}

/* Mean squared difference of the second image at the end of the way from the first; flow NULL: of a wind. */
static double misfit(const float *first, const float *second, uint32_t side, const double wind[2], float *const *flow)
{
    double sum = 0.0, count = 0.0;

    for (uint32_t j = 0; j < side; j++)
        for (uint32_t i = 0; i < side; i++) {
            const float px = place_of(i, side), pz = place_of(j, side);
            float way[2];
            if (!is_sky(px, pz))
                continue;
            blow(wind, px, pz, way);
            for (int k = 0; k < 2 && flow; k++)
                way[k] = flow[k][j * side + i];
            if (!is_sky(px + way[0], pz + way[1]))
                continue; /* out of sight */
            const float d = sample(second, side, px + way[0], pz + way[1]) - first[j * side + i];
            sum += (double)(d * d);
            count += 1.0;
        }
    return count > 0.25 * 0.7 * side * side ? sum / count : INFINITY;
}

static void find_wind(const float *first, const float *second, uint32_t side, double wind[2])
{
    const double none[2] = { 0.0, 0.0 };
    double least = 0.98 * misfit(first, second, side, none, NULL); /* calm, unless another is better */

    wind[0] = wind[1] = 0.0;
    for (int a = -WINDS / 2; a <= WINDS / 2; a++)
        for (int b = -WINDS / 2; b <= WINDS / 2; b++) {
            const double tried[2] = { WIND_STEP * a, WIND_STEP * b };
            const double left = misfit(first, second, side, tried, NULL);
            if (left < least) {
                least = left;
                wind[0] = tried[0];
                wind[1] = tried[1];
            }
        }
}

/* Box filter of radius WINDOW along rows, written transposed: twice gives both directions. */
static void blur_once(const float *from, uint32_t side, float *to)
{
    for (uint32_t j = 0; j < side; j++)
        for (uint32_t i = 0; i < side; i++) {
            float sum = 0.0f;
            for (int k = -WINDOW; k <= WINDOW; k++) {
                const int at = (int)i + k;
                sum += from[j * side + (uint32_t)(at < 0 ? 0 : at >= (int)side ? (int)side - 1 : at)];
            }
            to[i * side + j] = sum / (2 * WINDOW + 1);
        }
}

static void blur(float *image, float *swap, uint32_t side)
{
    blur_once(image, side, swap);
    blur_once(swap, side, image);
}

/* The flow from the buffers of its two coordinates, blurred: neighbours move alike. */
static void smooth(const struct work *w, uint32_t side, float *const *flow)
{
    for (int k = 0; k < 2; k++) {
        blur(w->sums[k], w->swap, side);
        memcpy(flow[k], w->sums[k], (size_t)side * side * sizeof(float));
    }
}

/* A round of [Lucas and Kanade 1981, Eq. 11]: a step that lessens the difference under the last flow. */
static void improve(const struct work *w, const float *first, const float *second, uint32_t side, float *const *flow)
{
    const float step = 2.0f / (float)side;

    for (uint32_t j = 0; j < side; j++)
        for (uint32_t i = 0; i < side; i++) {
            const uint32_t at = j * side + i;
            const float x = place_of(i, side) + flow[0][at], z = place_of(j, side) + flow[1][at];
            const bool seen = is_sky(place_of(i, side), place_of(j, side)) && is_sky(x, z);
            const float dx = 0.5f * (sample(second, side, x + step, z) - sample(second, side, x - step, z));
            const float dz = 0.5f * (sample(second, side, x, z + step) - sample(second, side, x, z - step));
            const float dt = sample(second, side, x, z) - first[at], on = seen ? 1.0f : 0.0f;
            w->sums[0][at] = on * dx * dx;
            w->sums[1][at] = on * dx * dz;
            w->sums[2][at] = on * dz * dz;
            w->sums[3][at] = on * dx * dt;
            w->sums[4][at] = on * dz * dt;
        }
    for (int k = 0; k < 5; k++)
        blur(w->sums[k], w->swap, side);
    for (uint32_t at = 0; at < side * side; at++) {
        const float a = w->sums[0][at] + STIFF, b = w->sums[1][at], c = w->sums[2][at] + STIFF;
        const float det = a * c - b * b;
        const float u = -(c * w->sums[3][at] - b * w->sums[4][at]) / det;
        const float v = -(a * w->sums[4][at] - b * w->sums[3][at]) / det;
        /* A texel a round: steps beyond are not to be trusted. */
        w->sums[0][at] = flow[0][at] + step * fmaxf(-1.0f, fminf(1.0f, u));
        w->sums[1][at] = flow[1][at] + step * fmaxf(-1.0f, fminf(1.0f, v));
    }
    smooth(w, side, flow);
}

/* The flow of the next finer level, in place: each place takes that of the coarse place it lies in. */
static void refine_grid(float *flow, uint32_t side)
{
    for (uint32_t at = side * side; at-- > 0;)
        flow[at] = flow[at / side / 2 * (side / 2) + at % side / 2];
}

static void follow(const struct work *w, int from, const double wind[2], float *const *flow)
{
    uint32_t side = SIDE >> (LEVELS - 1);

    for (uint32_t at = 0; at < side * side; at++) {
        float way[2];
        blow(wind, place_of(at % side, side), place_of(at / side, side), way);
        flow[0][at] = way[0];
        flow[1][at] = way[1];
    }
    for (int l = LEVELS - 1; l >= 0; l--, side *= 2) {
        for (int k = 0; k < ROUNDS; k++)
            improve(w, w->image[from][l], w->image[1 - from][l], side, flow);
        for (int k = 0; k < 2 && l > 0; k++)
            refine_grid(flow[k], 2 * side);
    }
}

/* Sets the flow to 0 where forward and backward flow disagree and near the horizon, then smooths it. */
static void trust(const struct work *w, float *const *flow)
{
    for (uint32_t at = 0; at < AREA; at++) {
        const float px = place_of(at % SIDE, SIDE), pz = place_of(at / SIDE, SIDE);
        const float x = px + w->flow[0][at], z = pz + w->flow[1][at],
                    far = sqrtf(fmaxf(px * px + pz * pz, x * x + z * z));
        const float off =
            hypotf(w->flow[0][at] + sample(w->back[0], SIDE, x, z), w->flow[1][at] + sample(w->back[1], SIDE, x, z));
        const float agrees = fmaxf(0.0f, fminf(1.0f, 2.0f - off / AGREE));
        const float keep = far < EDGE ? agrees * fminf(1.0f, (EDGE - far) * 10.0f) : 0.0f;
        w->sums[0][at] = keep * w->flow[0][at];
        w->sums[1][at] = keep * w->flow[1][at];
    }
    smooth(w, SIDE, flow);
}

enum err drift_find(struct drift *d, const float *first, const float *second, uint32_t width, uint32_t height)
{
    const float *const image[2] = { first, second };
    const double none[2] = { 0.0, 0.0 };
    double back[2];
    struct work w;

    d->work = d->work ? d->work : mem_alloc(WORK_FLOATS, sizeof(float));
    for (int k = 0; k < 2; k++)
        d->flow[k] = d->flow[k] ? d->flow[k] : mem_alloc(AREA, sizeof(float));
    if (!d->work || !d->flow[0] || !d->flow[1])
        return ERR_NOMEM;
    lay_out(d->work, &w);
    for (int k = 0; k < 2; k++) {
        shrink(image[k], width, height, w.image[k][0]);
        centre(w.image[k][0]);
        for (int l = 1; l < LEVELS; l++)
            halve(w.image[k][l - 1], SIDE >> (l - 1), w.image[k][l]);
    }
    find_wind(w.image[0][LEVELS - 1], w.image[1][LEVELS - 1], SIDE >> (LEVELS - 1), d->wind);
    for (int k = 0; k < 2; k++)
        back[k] = -d->wind[k];
    follow(&w, 0, d->wind, w.flow);
    follow(&w, 1, back, w.back);
    trust(&w, d->flow);
    const double still = misfit(w.image[0][0], w.image[1][0], SIDE, none, NULL);
    const double left = misfit(w.image[0][0], w.image[1][0], SIDE, none, d->flow);
    d->gain = still > ALIKE ? left / still : 1.0;
    d->moves = d->gain < WORTH;
    return ERR_OK;
}

void drift_finish(struct drift *d)
{
    mem_free(d->flow[0]);
    mem_free(d->flow[1]);
    mem_free(d->work);
    *d = (struct drift){ .moves = false };
}

/* ---- Images between ---- */

/* Where the clouds of a texel, at t of the way, were in the first sky (side 0) or will be in the second (side 1): they
 * started where start + t flow(start) is here. */
static void origin_of(const struct drift *d, const float w[3], double t, int side, float out[3])
{
    const float px = w[0] / (1.0f + w[1]), pz = w[2] / (1.0f + w[1]), back = (float)t, on = 1.0f - (float)t;
    float u = sample(d->flow[0], SIDE, px, pz), v = sample(d->flow[1], SIDE, px, pz);

    for (int k = 0; k < 2; k++) {
        const float x = px - back * u, z = pz - back * v;
        u = sample(d->flow[0], SIDE, x, z);
        v = sample(d->flow[1], SIDE, x, z);
    }
    if (side == 0)
        direction_of(px - back * u, pz - back * v, out);
    else
        direction_of(px + on * u, pz + on * v, out);
}

/* A place whose clouds' origins are computed. Below the horizon nothing moves. */
struct node {
    float x[2], y[2]; /* texels of the first and the second sky */
};

static void set_node(const struct drift *d, uint32_t width, uint32_t height, float x, float y, double t, struct node *n)
{
    const float theta = (float)PI * y / (float)height, phi = (float)PI - 2.0f * (float)PI * x / (float)width;
    const float w[3] = { sinf(theta) * sinf(phi), cosf(theta), sinf(theta) * cosf(phi) };

    for (int side = 0; side < 2; side++) {
        float from[3];
        if (w[1] <= 0.0f) {
            n->x[side] = x;
            n->y[side] = y;
            continue;
        }
        origin_of(d, w, t, side, from);
        texel_of(from, width, height, &n->x[side], &n->y[side]);
        n->x[side] += (float)width * rintf((x - n->x[side]) / (float)width); /* the nearest turn */
    }
}

/* Adds gain x the image at (x, y), bilinear. */
static void add_at(const float *rgb, uint32_t width, uint32_t height, float x, float y, float gain, float out[3])
{
    const float fx = floorf(x - 0.5f), fy = floorf(y - 0.5f), u = x - 0.5f - fx, v = y - 0.5f - fy;
    const long i = ((long)fx % (long)width + (long)width) % (long)width, j = (long)fy;
    const long next = i + 1 == (long)width ? 0 : i + 1;
    const long top = j < 0 ? 0 : j >= (long)height ? (long)height - 1 : j;
    const long low = j + 1 < 0 ? 0 : j + 1 >= (long)height ? (long)height - 1 : j + 1;
    const float *a = rgb + 3 * ((size_t)top * width), *b = rgb + 3 * ((size_t)low * width);

    for (int c = 0; c < 3; c++)
        out[c] += gain * ((1.0f - v) * ((1.0f - u) * a[3 * i + c] + u * a[3 * next + c]) +
                          v * ((1.0f - u) * b[3 * i + c] + u * b[3 * next + c]));
}

static void blend_texel(const float *first, const float *second, uint32_t width, uint32_t height, const struct node *n,
                        double t, float out[3])
{
    out[0] = out[1] = out[2] = 0.0f;
    add_at(first, width, height, n->x[0], n->y[0], (float)(1.0 - t), out);
    add_at(second, width, height, n->x[1], n->y[1], (float)t, out);
}

/* Columns x .. x + NODE - 1 of a row between the nodes of a cell's corners. */
static void blend_span(const float *first, const float *second, uint32_t width, uint32_t height,
                       const struct node corner[4], float v, double t, uint32_t count, float *out)
{
    for (uint32_t i = 0; i < count; i++) {
        const float u = ((float)i + 0.5f) / NODE;
        struct node n;
        for (int side = 0; side < 2; side++) {
            n.x[side] = (1.0f - v) * ((1.0f - u) * corner[0].x[side] + u * corner[1].x[side]) +
                        v * ((1.0f - u) * corner[2].x[side] + u * corner[3].x[side]);
            n.y[side] = (1.0f - v) * ((1.0f - u) * corner[0].y[side] + u * corner[1].y[side]) +
                        v * ((1.0f - u) * corner[2].y[side] + u * corner[3].y[side]);
        }
        blend_texel(first, second, width, height, &n, t, out + 3 * i);
    }
}

/* Whether places between the corners must be computed themselves: near the zenith columns crowd together, and ways that
 * cross it jump to the other side. */
static bool is_bent(const struct node corner[4])
{
    bool bent = false;

    for (int side = 0; side < 2; side++) {
        float least = INFINITY, most = -INFINITY;
        for (int k = 0; k < 4; k++) {
            bent |= corner[k].y[side] < NEAR_ZENITH * NODE;
            least = fminf(least, corner[k].x[side]);
            most = fmaxf(most, corner[k].x[side]);
        }
        bent |= most - least > SPREAD * NODE;
    }
    return bent;
}

static void blend_rows(const struct drift *d, const float *first, const float *second, uint32_t width, uint32_t height,
                       double t, uint32_t top, float *out)
{
    const uint32_t rows = height - top < NODE ? height - top : NODE;

    for (uint32_t x = 0; x < width; x += NODE) {
        const uint32_t count = width - x < NODE ? width - x : NODE;
        struct node corner[4];
        for (int k = 0; k < 4; k++)
            set_node(d, width, height, (float)(x + NODE * (k % 2)), (float)(top + NODE * (k / 2)), t, &corner[k]);
        const bool exact = top < NEAR_ZENITH * NODE || is_bent(corner);
        for (uint32_t j = 0; j < rows; j++) {
            float *row = out + 3 * ((size_t)(top + j) * width + x);
            if (!exact) {
                blend_span(first, second, width, height, corner, ((float)j + 0.5f) / NODE, t, count, row);
                continue;
            }
            for (uint32_t i = 0; i < count; i++) {
                struct node n;
                set_node(d, width, height, (float)(x + i) + 0.5f, (float)(top + j) + 0.5f, t, &n);
                blend_texel(first, second, width, height, &n, t, row + 3 * i);
            }
        }
    }
}

void drift_blend(const struct drift *d, const float *first, const float *second, uint32_t width, uint32_t height,
                 double t, float *out)
{
    const uint32_t moving = d && d->moves ? (height / 2 + NODE - 1) / NODE * NODE : 0;
    const size_t from = 3 * (size_t)(moving < height ? moving : height) * width, all = 3 * (size_t)width * height;
    const float a = (float)(1.0 - t), b = (float)t;

#pragma omp parallel for schedule(dynamic, 1)
    for (uint32_t top = 0; top < moving; top += NODE)
        blend_rows(d, first, second, width, height, t, top, out);
#pragma omp parallel for simd schedule(static)
    for (size_t k = from; k < all; k++)
        out[k] = a * first[k] + b * second[k];
}
