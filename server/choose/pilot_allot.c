#include "choose/pilot_allot.h"

#include "base/mem.h"

#include <math.h>
#include <stdlib.h>

#define SHARE_LEAST 0.125f /* of the mean: what looks easy may have been lucky */
#define SHARE_MOST 8.0f
#define EVEN_PART 0.1f   /* of the mean, that each packet is taken to leave besides its own */
#define READING_STEP 0.2 /* of a new reading, once there are several */
#define READINGS_MOST 255
#define WORTH_DEALING 0.92 /* of the error, that other shares must promise */
#define ROUNDS 20          /* of bringing the mean to 1 within the limits; six are enough for 1e-6 */
#define GOLDEN 0.6180339887498949

/* How much of a packet is seen: each of a pixel's k points has a k-th of its error, where their noise is alike. */
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

static int rising(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static void sort(struct allotment *a)
{
    const uint32_t count = a->list.count;

    for (uint32_t k = 0; k < count; k++)
        a->sorted[k] = a->share[a->list.index[k]];
    qsort(a->sorted, count, sizeof(*a->sorted), rising);
    a->above[count] = 0.0;
    for (uint32_t k = count; k-- > 0;)
        a->above[k] = a->above[k + 1] + (double)a->sorted[k];
}

static float share_of(float root, double scale)
{
    return fminf(SHARE_MOST, fmaxf(SHARE_LEAST, (float)(scale * (double)root)));
}

/* sqrt(h_i) within the limits, of mean 1. */
static void shares_of(const struct allotment *a, float *share)
{
    double scale = 1.0;

    for (uint32_t k = 0; k < a->list.count; k++) {
        const uint32_t i = a->list.index[k];
        share[i] = sqrtf((1.0f - EVEN_PART) * a->hard[i] + EVEN_PART);
    }
    for (int round = 0; round < ROUNDS; round++) {
        double sum = 0.0;
        for (uint32_t k = 0; k < a->list.count; k++)
            sum += (double)share_of(share[a->list.index[k]], scale);
        scale *= a->list.count / sum;
    }
    for (uint32_t k = 0; k < a->list.count; k++)
        share[a->list.index[k]] = share_of(share[a->list.index[k]], scale);
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
    a->spare = mem_alloc(g->packet_count, sizeof(*a->spare));
    a->readings = mem_alloc(g->packet_count, sizeof(*a->readings));
    a->counts = mem_alloc(g->packet_count, sizeof(*a->counts));
    a->sorted = mem_alloc(list->count, sizeof(*a->sorted));
    a->above = mem_alloc((size_t)list->count + 1, sizeof(*a->above));
    if (!a->hard || !a->share || !a->spare || !a->readings || !a->counts || !a->sorted || !a->above)
        return false;
    guess(a);
    normalise(a);
    shares_of(a, a->share);
    sort(a);
    return true;
}

void allot_finish(struct allotment *a)
{
    mem_free(a->hard);
    mem_free(a->share);
    mem_free(a->spare);
    mem_free(a->readings);
    mem_free(a->counts);
    mem_free(a->sorted);
    mem_free(a->above);
    *a = (struct allotment){ 0 };
}

/* With the `low` smallest at the least count, the others share what is left. */
double allot_factor(const struct allotment *a, const struct allot_count *mean)
{
    const uint32_t count = a->list.count;
    const double all = mean->n * count, least = mean->step;
    uint32_t low = 0, high = count; /* the first that is above the least count lies in low..high */

    while (low < high) {
        const uint32_t k = low + (high - low) / 2;
        if (((all - least * k) / a->above[k]) * (double)a->sorted[k] >= least)
            high = k;
        else
            low = k + 1;
    }
    return low < count ? (all - least * low) / a->above[low] : 0.0;
}

double allot_real(const struct allotment *a, const struct allot_count *mean, double factor, uint32_t packet)
{
    return fmax(mean->step, factor * (double)a->share[packet]);
}

uint32_t allot_counts(struct allotment *a, const struct allot_count *mean, const struct packet_list *of)
{
    const double factor = allot_factor(a, mean), step = mean->step;
    uint32_t most = 0;

    for (uint32_t k = 0; k < of->count; k++) {
        const uint32_t i = of->index[k];
        const double turn = fmod(i * GOLDEN, 1.0);
        a->counts[i] = mean->step * (uint32_t)floor(allot_real(a, mean, factor, i) / step + turn);
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

double allot_work(const struct allotment *a, const struct allot_count *mean, const struct packet_list *of)
{
    return a->list.count ? allot_mean(a, mean, of) * of->count / (mean->n * a->list.count) : 0.0;
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

double allot_deal(struct allotment *a)
{
    double now = 0.0, then = 0.0;
    float *const share = a->spare;

    if (a->list.count == 0)
        return 1.0;
    normalise(a);
    shares_of(a, share);
    for (uint32_t k = 0; k < a->list.count; k++) {
        const uint32_t i = a->list.index[k];
        now += (double)a->hard[i] / (double)a->share[i];
        then += (double)a->hard[i] / (double)share[i];
    }
    if (!(then < WORTH_DEALING * now))
        return 1.0;
    a->spare = a->share;
    a->share = share;
    sort(a);
    return then / now;
}
