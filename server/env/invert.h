/* server/env/invert.h */
/* Inversion of running sums, for the samplers of this room. Pure functions; any thread. */
#ifndef ENV_INVERT_H
#define ENV_INVERT_H

#include "cube.h"

#include <math.h>
#include <stdint.h>

/* The first entry of ascending sums that exceeds target. Where rounding put target on the total, the
 * last entry that has mass, so that nothing of probability zero is ever chosen. */
static inline uint32_t invert_find(const double *cdf, uint32_t n, double target)
{
    uint32_t low = 0, high = n;

    while (low < high) {
        const uint32_t mid = (low + high) / 2;
        if (cdf[mid] > target)
            high = mid;
        else
            low = mid + 1;
    }
    if (low == n)
        for (low = n - 1; low > 0 && cdf[low] == cdf[low - 1];)
            low--;
    return low;
}

/* The last place within an entry: the sum of it and a number below 2^20 is still exact. */
#define INVERT_LAST (1.0 - 0x1p-32)

/* Position in 0..n, real-valued: the entry that x in [0, 1) falls in and the place within it. */
static inline double invert(const double *cdf, uint32_t n, double x)
{
    const double target = x * cdf[n - 1];
    const uint32_t k = invert_find(cdf, n, target);
    const double below = k ? cdf[k - 1] : 0.0;
    const double within = (target - below) / (cdf[k] - below);

    return k + fmin(fmax(within, 0.0), INVERT_LAST);
}

/* Where rounding to float carries a direction over the border of the texel that was chosen, perhaps onto a black one,
 * the place within the texel is held off its border by this part of it. At 1024 texels an edge rounding moves a place
 * by 1e-4 of a texel at most: one sample in several thousand is moved, by less than this. */
#define INVERT_MARGIN 0x1p-10

static inline double invert_hold(double place)
{
    const double whole = floor(place);
    return whole + fmin(fmax(place - whole, INVERT_MARGIN), 1.0 - INVERT_MARGIN);
}

/* The unit direction through a place of a face of n x n texels, counted in texels; always in the very texel that the
 * place is in. */
void invert_direction(uint32_t n, uint32_t face, double row, double column, float w[3]);

#endif
