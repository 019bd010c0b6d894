/* Which points of a block see so nearly the same that each traces a quarter of the directions for all of them. */
#include "light/cache_direct/internal.h"

#include <math.h>
#include <string.h>

#define ENOUGH 8     /* neighbours of a point, itself included; */
#define REACH 3.0f   /* times the distance of the last of these: points farther away do not count */
#define TURNED 0.06f /* 1 - cosine of the largest angle between normals, 20 degrees */
#define OFF 0.15f    /* of the reach: how far a neighbour may lie above or below the plane of a point */
#define STEEP 2.0f   /* largest weight of one point; else the plane would magnify it */
#define NOBODY TRANSPORT_POINTS
#define FLAT 1e-3 /* share of the mean squared distance: no slope is fitted along directions with less */

/* x of A x = b, A symmetric and positive. */
static void solve3(const double a[3][3], const double b[3], double x[3])
{
    const double c0 = a[1][1] * a[2][2] - a[1][2] * a[1][2], c1 = a[0][2] * a[1][2] - a[0][1] * a[2][2],
                 c2 = a[0][1] * a[1][2] - a[0][2] * a[1][1];
    const double d1 = a[0][0] * a[2][2] - a[0][2] * a[0][2], d2 = a[0][1] * a[0][2] - a[0][0] * a[1][2],
                 e2 = a[0][0] * a[1][1] - a[0][1] * a[0][1];
    const double determinant = a[0][0] * c0 + a[0][1] * c1 + a[0][2] * c2;

    x[0] = (c0 * b[0] + c1 * b[1] + c2 * b[2]) / determinant;
    x[1] = (c1 * b[0] + d1 * b[1] + d2 * b[2]) / determinant;
    x[2] = (c2 * b[0] + d2 * b[1] + e2 * b[2]) / determinant;
}

void transport_fit_plane(const float *const at[3], const uint16_t *list, uint32_t count, const float to[3], float *w)
{
    double sum = 0.0, mean[3] = { 0.0 }, spread[3][3] = { { 0.0 } }, off[3], slope[3];

    for (uint32_t k = 0; k < count; k++) {
        const uint32_t q = list[k];
        sum += (double)w[q];
        for (int c = 0; c < 3; c++)
            mean[c] += (double)w[q] * (double)at[c][q];
    }
    for (int c = 0; c < 3; c++) {
        mean[c] /= sum;
        off[c] = (double)to[c] - mean[c];
    }
    for (uint32_t k = 0; k < count; k++) {
        const uint32_t q = list[k];
        const double d[3] = { (double)at[0][q] - mean[0], (double)at[1][q] - mean[1], (double)at[2][q] - mean[2] };
        for (int i = 0; i < 3; i++)
            for (int j = i; j < 3; j++)
                spread[i][j] += (double)w[q] / sum * d[i] * d[j];
    }
    const double flat = FLAT * (spread[0][0] + spread[1][1] + spread[2][2]) + 1e-30;
    for (int i = 0; i < 3; i++) {
        spread[i][i] += flat;
        for (int j = 0; j < i; j++)
            spread[i][j] = spread[j][i];
    }
    solve3((const double(*)[3])spread, off, slope);
    for (uint32_t k = 0; k < count; k++) {
        const uint32_t q = list[k];
        const double on = ((double)at[0][q] - mean[0]) * slope[0] + ((double)at[1][q] - mean[1]) * slope[1] +
                          ((double)at[2][q] - mean[2]) * slope[2];
        w[q] = (float)((double)w[q] / sum * (1.0 + on));
    }
}

struct places { /* of a block's points */
    float at[3][TRANSPORT_POINTS], normal[3][TRANSPORT_POINTS];
    bool used[TRANSPORT_POINTS];
};

static void take_places(const struct shade_packet *packets, struct places *out)
{
    for (uint32_t i = 0; i < TRANSPORT_POINTS; i++) {
        const struct shade_packet *p = &packets[i / PACKET];
        const uint32_t l = i % PACKET;
        const float at[3] = { p->x[l], p->y[l], p->z[l] }, normal[3] = { p->ns_x[l], p->ns_y[l], p->ns_z[l] };
        for (int c = 0; c < 3; c++) {
            out->at[c][i] = at[c];
            out->normal[c][i] = normal[c];
        }
        out->used[i] = p->valid[l] != 0;
    }
}

/* Distances from point p to the others that are turned like it, and how far they lie off its plane; INFINITY: to
 * those that are not. */
static void measure(const struct places *s, uint32_t p, float distance[TRANSPORT_POINTS], float off[TRANSPORT_POINTS])
{
    for (uint32_t q = 0; q < TRANSPORT_POINTS; q++) {
        const float x = s->at[0][q] - s->at[0][p], y = s->at[1][q] - s->at[1][p], z = s->at[2][q] - s->at[2][p];
        const float *n[3] = { s->normal[0], s->normal[1], s->normal[2] };
        const float same = n[0][q] * n[0][p] + n[1][q] * n[1][p] + n[2][q] * n[2][p];
        const float mine = fabsf(n[0][p] * x + n[1][p] * y + n[2][p] * z);
        const float its = fabsf(n[0][q] * x + n[1][q] * y + n[2][q] * z);
        distance[q] = s->used[q] && 1.0f - same < TURNED ? sqrtf(x * x + y * y + z * z) : INFINITY;
        off[q] = fmaxf(mine, its);
    }
}

/* The distance of the ENOUGH-th nearest point. */
static float nearest(const float distance[TRANSPORT_POINTS])
{
    float least[ENOUGH];

    for (uint32_t k = 0; k < ENOUGH; k++)
        least[k] = INFINITY;
    for (uint32_t q = 0; q < TRANSPORT_POINTS; q++) {
        float x = distance[q];
        for (uint32_t k = 0; k < ENOUGH && x < INFINITY; k++)
            if (x < least[k]) {
                const float swap = least[k];
                least[k] = x;
                x = swap;
            }
    }
    return least[ENOUGH - 1];
}

/* Writes the weights of a turn's points for point p to out[lane][stride]; those of `without` do not count. False: they
 * do not tell what it sees. */
static bool weigh(const struct places *s, uint32_t p, uint32_t turn, const float near[TRANSPORT_POINTS],
                  uint32_t without, float *out, size_t stride)
{
    const float *const at[3] = { s->at[0], s->at[1], s->at[2] }, to[3] = { s->at[0][p], s->at[1][p], s->at[2][p] };
    float plane[TRANSPORT_POINTS];
    uint16_t list[PACKET];
    uint32_t count = 0;
    bool told = true;

    for (uint32_t l = 0; l < PACKET; l++) {
        const uint32_t q = transport_turn_point(turn, l);
        out[l * stride] = 0.0f;
        if (near[q] > 0.0f && q != without)
            list[count++] = (uint16_t)q;
    }
    if (count < 2)
        return false;
    memcpy(plane, near, sizeof(plane));
    transport_fit_plane(at, list, count, to, plane);
    for (uint32_t k = 0; k < count; k++) {
        out[list[k] % PACKET * stride] = plane[list[k]];
        told = told && fabsf(plane[list[k]]) <= STEEP;
    }
    return told;
}

void transport_find_neighbours(const struct shade_packet *packets, struct transport_neighbours *out)
{
    struct places s;

    take_places(packets, &s);
    out->alone = 0;
    for (uint32_t p = 0; p < TRANSPORT_POINTS; p++) {
        float distance[TRANSPORT_POINTS], off[TRANSPORT_POINTS], near[TRANSPORT_POINTS];
        measure(&s, p, distance, off);
        const float reach = REACH * nearest(distance);
        bool told = reach < INFINITY;
        for (uint32_t q = 0; q < TRANSPORT_POINTS; q++)
            near[q] = told && distance[q] < reach && off[q] < OFF * reach ? 1.0f - distance[q] / reach : 0.0f;
        for (uint32_t turn = 0; turn < TRANSPORT_PACKETS; turn++) {
            for (uint32_t l = 0; l < PACKET; l++)
                out->near[turn][l][p] = near[transport_turn_point(turn, l)];
            told = weigh(&s, p, turn, near, NOBODY, &out->plane[turn][0][p], TRANSPORT_POINTS) && told;
            if (transport_turn_point(turn, p % PACKET) == p)
                weigh(&s, p, turn, near, p, out->others[p], 1);
        }
        out->alone |= (uint64_t)(s.used[p] && !told) << p;
    }
}
