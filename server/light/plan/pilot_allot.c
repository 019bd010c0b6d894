#include "light/plan/pilot_measure.h"

#include "base/mem.h"

#include <math.h>

#define SHARE_LEAST 0.125f /* of the mean: a low reading may be luck */
#define SHARE_MOST 8.0f
#define EVEN_PART 0.1f   /* of the mean, that is added to every packet's reading */
#define READING_STEP 0.2 /* of a new reading, once there are several */
#define READINGS_MOST 255
#define ROUNDS 20 /* of bringing a mean within limits; six are enough for 1e-6 */
#define GOLDEN 0.6180339887498949

/* The weight of a packet in the image: each of a pixel's k points has a k-th of its error if their noise is equal. */
static void guess(struct allotment *a)
{
    const struct gbuffer *g = a->gbuffer;
    const size_t pixels = (size_t)g->width * g->height;

    for (size_t i = 0; i < pixels; i++)
        for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++) {
            const float *w = g->entries[k].weight;
            a->hard[g->entries[k].point / PACKET] += (w[0] + w[1] + w[2]) / (3.0f * PACKET);
        }
}

static float share_of(float root, double scale)
{
    return fminf(SHARE_MOST, fmaxf(SHARE_LEAST, (float)(scale * (double)root)));
}

/* Shares: sqrt(h_i) within the limits, of mean 1. */
static void set_shares(struct allotment *a)
{
    double scale = 1.0;

    for (uint32_t k = 0; k < a->list.count; k++) {
        const uint32_t i = a->list.index[k];
        a->share[i] = sqrtf((1.0f - EVEN_PART) * a->hard[i] + EVEN_PART);
    }
    for (int round = 0; round < ROUNDS; round++) {
        double sum = 0.0;
        for (uint32_t k = 0; k < a->list.count; k++)
            sum += (double)share_of(a->share[a->list.index[k]], scale);
        scale *= a->list.count / sum;
    }
    for (uint32_t k = 0; k < a->list.count; k++)
        a->share[a->list.index[k]] = share_of(a->share[a->list.index[k]], scale);
}

/* hard[] of mean 1. */
static void normalise(struct allotment *a)
{
    double sum = 0.0;

    for (uint32_t k = 0; k < a->list.count; k++)
        sum += (double)a->hard[a->list.index[k]];
    for (uint32_t k = 0; k < a->list.count; k++)
        a->hard[a->list.index[k]] = sum > 0.0 ? (float)(a->hard[a->list.index[k]] * a->list.count / sum) : 1.0f;
}

bool allot_init(struct allotment *a, const struct gbuffer *g, const struct packet_list *list)
{
    *a = (struct allotment){ .gbuffer = g, .list = *list };
    a->hard = mem_alloc(g->packet_count, sizeof(*a->hard));
    a->share = mem_alloc(g->packet_count, sizeof(*a->share));
    a->readings = mem_alloc(g->packet_count, sizeof(*a->readings));
    a->counts = mem_alloc(g->packet_count, sizeof(*a->counts));
    if (!a->hard || !a->share || !a->readings || !a->counts)
        return false;
    guess(a);
    normalise(a);
    set_shares(a);
    return true;
}

void allot_finish(struct allotment *a)
{
    mem_free(a->hard);
    mem_free(a->share);
    mem_free(a->readings);
    mem_free(a->counts);
    *a = (struct allotment){ 0 };
}

/* Packets below the minimum count are raised to it, and the others share the rest, which may push more of them
 * below. */
double allot_factor(const struct allotment *a, const struct allot_count *mean)
{
    double factor = mean->n, before = INFINITY;

    for (int round = 0; round < ROUNDS && factor < before; round++) {
        double left = mean->n * a->list.count, above = 0.0;
        before = factor;
        for (uint32_t k = 0; k < a->list.count; k++) {
            const double share = (double)a->share[a->list.index[k]];
            const bool is_above = factor * share > mean->step;
            above += is_above ? share : 0.0;
            left -= is_above ? 0.0 : mean->step;
        }
        factor = above > 0.0 ? left / above : 0.0;
    }
    return factor;
}

double allot_real(const struct allotment *a, const struct allot_count *mean, double factor, uint32_t packet)
{
    return fmax(mean->step, factor * (double)a->share[packet]);
}

uint32_t allot_counts(struct allotment *a, const struct allot_count *mean, const struct packet_list *of)
{
    const double factor = allot_factor(a, mean);
    uint32_t most = 0;

    for (uint32_t k = 0; k < of->count; k++) {
        const uint32_t i = of->index[k];
        const double real = allot_real(a, mean, factor, i);
        a->counts[i] = mean->step * (uint32_t)floor(real / mean->step + fmod(i * GOLDEN, 1.0));
        most = a->counts[i] > most ? a->counts[i] : most;
    }
    return most;
}

double allot_mean(const struct allotment *a, const struct allot_count *mean, const struct packet_list *of)
{
    const double factor = allot_factor(a, mean);
    double sum = 0.0;

    for (uint32_t k = 0; k < of->count; k++)
        sum += allot_real(a, mean, factor, of->index[k]);
    return of->count ? sum / of->count : 0.0;
}

static double sum_of(const float error[PACKET])
{
    double sum = 0.0;

    for (int l = 0; l < PACKET; l++)
        sum += (double)error[l];
    return fmax(0.0, sum);
}

void allot_read(struct allotment *a, const struct packet_list *of, const float (*error)[PACKET],
                const struct allot_count *mean)
{
    const double factor = allot_factor(a, mean);
    double unit = 0.0; /* of h */

    for (uint32_t k = 0; k < of->count; k++)
        unit += sum_of(error[of->index[k]]) * allot_real(a, mean, factor, of->index[k]) / of->count;
    if (!(unit > 0.0))
        return;
    for (uint32_t k = 0; k < of->count; k++) {
        const uint32_t i = of->index[k];
        const double now = sum_of(error[i]) * allot_real(a, mean, factor, i) / unit;
        const double step = fmax(READING_STEP, 1.0 / (a->readings[i] + 1.0));
        a->hard[i] += (float)(step * (now - (double)a->hard[i]));
        a->readings[i] += a->readings[i] < READINGS_MOST;
    }
}

void allot_age(struct allotment *a)
{
    for (uint32_t k = 0; k < a->list.count; k++)
        if (a->readings[a->list.index[k]] > 1)
            a->readings[a->list.index[k]] = 1;
}

/* E of the shares, up to a factor. */
static double error_of(const struct allotment *a)
{
    double sum = 0.0;

    for (uint32_t k = 0; k < a->list.count; k++)
        sum += (double)a->hard[a->list.index[k]] / (double)a->share[a->list.index[k]];
    return sum;
}

double allot_deal(struct allotment *a)
{
    normalise(a);
    const double before = error_of(a);
    set_shares(a);
    return before > 0.0 ? error_of(a) / before : 1.0;
}
