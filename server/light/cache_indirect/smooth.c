/* Reduces the noise of gathered light: each point gets a weighted mean over similar points, whose rays are
 * independent. */
#include "light/cache_indirect/internal.h"

#include "base/mem.h"

#include <cblas.h>

#include <math.h>
#include <string.h>

#define LIKENESS 0.3f /* largest difference of points that are averaged, as the error of [Ward et al. 1988] */

struct indirect_smoother *indirect_smoother_create(void)
{
    return mem_alloc(1, sizeof(struct indirect_smoother));
}

void indirect_smoother_destroy(struct indirect_smoother *s)
{
    mem_free(s);
}

/* Weight of point q in the mean of point p: 0 if their distance, relative to the surfaces around, or their normals
 * differ too much. */
static inline float likeness(const struct indirect_smoother *s, uint32_t p, uint32_t q)
{
    const float x = s->at[0][q] - s->at[0][p], y = s->at[1][q] - s->at[1][p], z = s->at[2][q] - s->at[2][p];
    const float same =
        s->normal[0][q] * s->normal[0][p] + s->normal[1][q] * s->normal[1][p] + s->normal[2][q] * s->normal[2][p];
    const float near = s->near[q] < s->near[p] ? s->near[q] : s->near[p];
    const float turned = same < 1.0f ? 1.0f - same : 0.0f;
    const float unlike = sqrtf(x * x + y * y + z * z) / near + sqrtf(turned);

    return s->used[q] && unlike < LIKENESS ? 1.0f - unlike / LIKENESS : 0.0f;
}

static void fill_likeness(const struct indirect_smoother *s, uint32_t p, uint32_t first, uint32_t until, float *out)
{
    for (uint32_t q = first; q < until; q++)
        out[q] = likeness(s, p, q);
}

/* The points that block b is averaged with. */
static void find_reach(uint32_t b, uint32_t blocks, uint32_t reach, uint32_t *first, uint32_t *until)
{
    *first = b > reach ? (b - reach) * TRANSPORT_POINTS : 0;
    *until = (b + reach < blocks ? b + reach + 1 : blocks) * TRANSPORT_POINTS;
}

float indirect_alike(const struct indirect_smoother *s, uint32_t blocks, uint32_t reach, uint32_t p)
{
    uint32_t first, until;
    float sum = 1.0f;

    find_reach(p / TRANSPORT_POINTS, blocks, reach, &first, &until);
    for (uint32_t q = first + p % 4; q < until; q += 4)
        sum += q == p ? 0.0f : 4.0f * likeness(s, p, q);
    return sum;
}

/* Writes the points from first to until - 1 whose weight is not 0; returns their number. */
static uint32_t list_alike(const float *w, uint32_t first, uint32_t until, uint16_t *out)
{
    uint32_t count = 0;

    for (uint32_t q = first; q < until; q++) {
        out[count] = (uint16_t)q;
        count += w[q] != 0.0f;
    }
    return count;
}

/* Turns likeness into weights that evaluate at p the plane fitted to the others' light. */
static void centre(const struct indirect_smoother *s, uint32_t p, uint32_t first, uint32_t until, float *w)
{
    const float *const at[3] = { s->at[0], s->at[1], s->at[2] }, to[3] = { s->at[0][p], s->at[1][p], s->at[2][p] };
    uint16_t list[INDIRECT_GROUP_POINTS];

    transport_fit_plane(at, list, list_alike(w, first, until, list), to, w);
}

static bool is_zero(const float *w, uint32_t stride, uint32_t first)
{
    for (uint32_t p = 0; p < TRANSPORT_POINTS; p++)
        for (uint32_t q = 0; q < TRANSPORT_POINTS; q++)
            if (w[p * stride + first + q] != 0.0f)
                return false;
    return true;
}

void indirect_smooth(struct indirect_smoother *s, uint32_t blocks, uint32_t reach, uint32_t wide, const float *from,
                     float *to)
{
    const uint32_t side = TRANSPORT_POINTS;

    for (uint32_t b = 0; b < blocks; b++) {
        uint32_t first, until;
        find_reach(b, blocks, reach, &first, &until);
        memset(s->weights, 0, sizeof(s->weights));
        for (uint32_t p = 0; p < side; p++)
            if (s->used[b * side + p]) {
                fill_likeness(s, b * side + p, first, until, s->weights[p]);
                centre(s, b * side + p, first, until, s->weights[p]);
            }
        memset(to + (size_t)b * side * wide, 0, (size_t)side * wide * sizeof(*to));
        for (uint32_t k = first; k < until; k += side)
            if (!is_zero(s->weights[0], INDIRECT_GROUP * side, k))
                cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, (int)side, (int)wide, (int)side, 1.0f,
                            s->weights[0] + k, (int)(INDIRECT_GROUP * side), from + (size_t)k * wide, (int)wide, 1.0f,
                            to + (size_t)b * side * wide, (int)wide);
    }
}
