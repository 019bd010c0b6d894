#include "image/film/film.h"

#include "base/vec.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#define BANDS 64                       /* partial sums, added in order: the same result at any number of threads */
#define EXPONENTS 256                  /* one histogram bin per exponent of a float, that is, per stop */
#define REACH_STOPS 8.0                /* stops around the median; a clear sky and its shadows span about 12 stops */
#define PRODUCT_LENGTH 6               /* floats whose product stays within a double: 6 * 149 < 1022 stops */
#define LANES 16                       /* products computed side by side */
#define BLOCK (PRODUCT_LENGTH * LANES) /* pixels */
/* Four pixels as one vector. */
#define FOUR_FLOATS __attribute__((vector_size(4 * sizeof(float)))) float
#define APART 4          /* separate tables for counting exponents */
#define LAG_STOPS 1.0    /* maximum distance from the target exposure */
#define GAIN_STOPS 120.0 /* the gain fits a float, and times a float it fits a double */

const struct setting_choice exposure_choices[] = {
    { "auto", EXPOSURE_AUTO, "one value for all images, from the first", 0 },
    { "follow", EXPOSURE_FOLLOW, "each image adapts to its predecessors", 0 },
    { NULL, 0, NULL, 0 },
};

void exposure_init(struct exposure *e)
{
    *e = (struct exposure){ .key = 0.18, .adapt = 0.2 };
}

/* Luminances of four pixels, as rgb_luminance: twelve floats to one vector per channel. */
static inline FOUR_FLOATS luminances(const float *rgb)
{
    FOUR_FLOATS t[3];

    memcpy(t, rgb, sizeof(t));
    const FOUR_FLOATS r = __builtin_shufflevector(__builtin_shufflevector(t[0], t[1], 0, 3, 6, 6), t[2], 0, 1, 2, 5);
    const FOUR_FLOATS g = __builtin_shufflevector(__builtin_shufflevector(t[0], t[1], 1, 4, 7, 7), t[2], 0, 1, 2, 6);
    const FOUR_FLOATS b = __builtin_shufflevector(__builtin_shufflevector(t[0], t[1], 2, 5, 5, 5), t[2], 0, 1, 4, 7);
    return 0.2126f * r + 0.7152f * g + 0.0722f * b;
}

/* Luminances of pixels `from` .. from + count - 1, 0 where masked out; count <= BLOCK. Pads with 0. */
static inline void take_block(const float *rgb, const uint8_t *mask, size_t from, size_t count, float l[BLOCK])
{
    const float *p = rgb + 3 * from;
    size_t i = 0;

    for (; i + 4 <= count; i += 4) {
        const FOUR_FLOATS four = luminances(p + 3 * i);
        memcpy(l + i, &four, sizeof(four));
    }
    for (; i < BLOCK; i++)
        l[i] = i < count ? rgb_luminance(p[3 * i], p[3 * i + 1], p[3 * i + 2]) : 0.0f;
    for (i = 0; i < BLOCK; i++)
        l[i] = l[i] > 0.0f ? l[i] : 0.0f;
    for (i = 0; mask && i < count; i++)
        l[i] = mask[from + i] ? l[i] : 0.0f;
}

static inline uint32_t exponent_of(float l)
{
    uint32_t bits;

    memcpy(&bits, &l, sizeof(bits));
    return bits >> 23;
}

/* Counts pixels per float exponent. Integer sums do not depend on their order. Adjacent pixels have similar exponents,
 * and consecutive increments of one counter stall, so several tables are used. Luminance 0 is counted with the smallest
 * exponent and subtracted afterwards. */
static void count_exponents(const float *rgb, const uint8_t *mask, size_t pixels, uint32_t count[EXPONENTS])
{
    memset(count, 0, EXPONENTS * sizeof(count[0]));
#pragma omp parallel
    {
        uint32_t own[APART][EXPONENTS] = { { 0 } };
#pragma omp for schedule(static) nowait
        for (size_t at = 0; at < pixels; at += BLOCK) {
            float l[BLOCK];
            uint32_t black = 0;
            take_block(rgb, mask, at, pixels - at < BLOCK ? pixels - at : BLOCK, l);
            for (size_t i = 0; i < BLOCK; i += APART)
                for (size_t a = 0; a < APART; a++)
                    own[a][exponent_of(l[i + a])]++;
            for (size_t i = 0; i < BLOCK; i++)
                black += l[i] == 0.0f;
            own[0][0] -= black;
        }
#pragma omp critical
        for (int k = 0; k < EXPONENTS; k++)
            for (int a = 0; a < APART; a++)
                count[k] += own[a][k];
    }
}

/* The median of log2 luminance, assumed uniform within its bin, so that it changes continuously from frame to frame. */
static double median_stop(const uint32_t count[EXPONENTS], uint64_t total)
{
    const double half = 0.5 * (double)total;
    double below = 0.0;
    int bin = 0;

    while (bin < EXPONENTS - 1 && below + count[bin] < half)
        below += count[bin++];
    return bin - 127 + (half - below) / count[bin];
}

/* A product of many factors as mantissa x 2^exponent: one logarithm at the end instead of one per factor. */
struct product {
    double mantissa; /* 1 .. 2 */
    int64_t exponent;
};

static inline void multiply(struct product *p, double by)
{
    uint64_t bits;

    by *= p->mantissa; /* never subnormal: PRODUCT_LENGTH floats and a mantissa */
    memcpy(&bits, &by, sizeof(bits));
    p->exponent += (int64_t)(bits >> 52) - 1023;
    bits = (bits & 0xfffffffffffffu) | (uint64_t)1023 << 52;
    memcpy(&p->mantissa, &bits, sizeof(bits));
}

/* Sum of log2 luminance, clamped to low .. high, over pixels begin .. end - 1. */
static double band_sum(const float *rgb, const uint8_t *mask, size_t begin, size_t end, float low, float high)
{
    struct product whole = { 1.0, 0 };

    for (size_t at = begin; at < end; at += BLOCK) {
        float l[BLOCK];
        double product[LANES];
        take_block(rgb, mask, at, end - at < BLOCK ? end - at : BLOCK, l);
        for (size_t i = 0; i < BLOCK; i++) {
            const float kept = l[i] < low ? low : l[i] > high ? high : l[i];
            l[i] = l[i] > 0.0f ? kept : 1.0f;
        }
        for (size_t k = 0; k < LANES; k++)
            product[k] = (double)l[k];
        for (size_t i = LANES; i < BLOCK; i += LANES)
            for (size_t k = 0; k < LANES; k++)
                product[k] *= (double)l[i + k];
        for (size_t k = 0; k < LANES; k++)
            multiply(&whole, product[k]);
    }
    return (double)whole.exponent + log2(whole.mantissa);
}

bool exposure_log2_mean(const float *rgb, const uint8_t *mask, uint32_t width, uint32_t height, double *out)
{
    uint32_t count[EXPONENTS];
    double bands[BANDS];
    uint64_t total = 0;
    double sum = 0.0;

    count_exponents(rgb, mask, (size_t)width * height, count);
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
        /* [Reinhard 2002, Eq. 2]: gain = key / log-average. Covering a share of at most 1 of the distance, in stops,
         * can neither overshoot nor oscillate. */
        const double target = log2(e->key) - mean;
        /* Limit the distance to one stop first: otherwise a sequence with large changes would clip or go black before
         * exposure follows. */
        const double distance = fmin(fmax(target - e->log2_gain, -LAG_STOPS), LAG_STOPS);
        e->log2_gain = e->started ? target - distance * pow(1.0 - e->adapt, (double)frames) : target;
        e->started = 1;
    }
    return exp2(fmin(fmax(e->log2_gain, -GAIN_STOPS), GAIN_STOPS));
}
