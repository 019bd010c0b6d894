#include "film.h"

#include "vec.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#define BANDS 64         /* sums are per band, bands are added in order: the thread count changes nothing */
#define EXPONENTS 256    /* of a float: one bin of the histogram per stop */
#define REACH_STOPS 8.0  /* from the median; a clear sky over its own shadows spans about 12 stops in all */
#define PRODUCT_LENGTH 6 /* floats that a double multiplies without leaving its range: 6 * 149 < 1022 stops */
#define LAG_STOPS 1.0    /* exposure is never further than this from what the picture asks for */
#define GAIN_STOPS 120.0 /* the gain stays a float, and times a float it stays a double */

void exposure_init(struct exposure *e)
{
    *e = (struct exposure){ .key = 0.18, .adapt = 0.2 };
}

/* Luminance of pixel i, 0 where it does not count. */
static float counted(const float *rgb, const uint8_t *mask, size_t i)
{
    const float l = rgb_luminance(rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]);
    return l > 0.0f && (!mask || mask[i]) ? l : 0.0f;
}

/* How many pixels have each float exponent. Integers: any order of adding gives the same. */
static void count_exponents(const float *rgb, const uint8_t *mask, uint32_t width, uint32_t height,
                            uint32_t count[EXPONENTS])
{
    memset(count, 0, EXPONENTS * sizeof(count[0]));
#pragma omp parallel for schedule(static) reduction(+ : count[:EXPONENTS])
    for (uint32_t y = 0; y < height; y++) {
        for (size_t i = (size_t)y * width; i < (size_t)(y + 1) * width; i++) {
            const float l = counted(rgb, mask, i);
            uint32_t bits;
            memcpy(&bits, &l, sizeof(bits));
            count[bits >> 23] += l > 0.0f;
        }
    }
}

/* The median of log2, taken as evenly spread within its bin, so that it moves without steps from frame to frame. */
static double median_stop(const uint32_t count[EXPONENTS], uint64_t total)
{
    const double half = 0.5 * (double)total;
    double below = 0.0;
    int bin = 0;

    while (bin < EXPONENTS - 1 && below + count[bin] < half)
        below += count[bin++];
    return bin - 127 + (half - below) / count[bin];
}

/* Sum of log2 over rows y0..y1 of luminances clamped to low..high: one logarithm of a product instead of six. */
static double band_sum(const float *rgb, const uint8_t *mask, size_t begin, size_t end, float low, float high)
{
    double sum = 0.0, product = 1.0;
    int length = 0;

    for (size_t i = begin; i < end; i++) {
        const float l = counted(rgb, mask, i);
        if (!(l > 0.0f))
            continue;
        product *= l < low ? low : l > high ? high : l;
        if (++length == PRODUCT_LENGTH) {
            sum += log2(product);
            product = 1.0;
            length = 0;
        }
    }
    return sum + log2(product);
}

bool exposure_log2_mean(const float *rgb, const uint8_t *mask, uint32_t width, uint32_t height, double *out)
{
    uint32_t count[EXPONENTS];
    double bands[BANDS];
    uint64_t total = 0;
    double sum = 0.0;

    count_exponents(rgb, mask, width, height, count);
    for (int i = 0; i < EXPONENTS; i++)
        total += count[i];
    if (total == 0)
        return false;

    const double median = median_stop(count, total);
    const float low = fmaxf((float)exp2(median - REACH_STOPS), 0x1p-149f);
    const float high = fminf((float)exp2(median + REACH_STOPS), 0x1.fffffep127f);
#pragma omp parallel for schedule(static)
    for (int b = 0; b < BANDS; b++) {
        const size_t begin = (size_t)((uint64_t)height * (uint64_t)b / BANDS) * width;
        const size_t end = (size_t)((uint64_t)height * (uint64_t)(b + 1) / BANDS) * width;
        bands[b] = band_sum(rgb, mask, begin, end, low, high);
    }
    for (int b = 0; b < BANDS; b++)
        sum += bands[b];
    *out = sum / (double)total;
    return true;
}

double exposure_step(struct exposure *e, const float *rgb, uint32_t width, uint32_t height, uint64_t frames)
{
    double mean;

    assert(e->key > 0.0 && e->adapt >= 0.0 && e->adapt <= 1.0);
    if (exposure_log2_mean(rgb, NULL, width, height, &mean)) {
        /* [Reinhard 2002, Eq. 2]: the gain is key over the log-average. A share of at most 1 of the way there, in
         * stops, can neither overshoot nor swing. */
        const double target = log2(e->key) - mean;
        /* What is left of the way is first cut to a stop: a sequence in long steps would otherwise burn out or sink
         * into black before exposure has followed. */
        const double way = fmin(fmax(target - e->log2_gain, -LAG_STOPS), LAG_STOPS);
        e->log2_gain = e->started ? target - way * pow(1.0 - e->adapt, (double)frames) : target;
        e->started = 1;
    }
    return exp2(fmin(fmax(e->log2_gain + e->bias_stops, -GAIN_STOPS), GAIN_STOPS));
}
