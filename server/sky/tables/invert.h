/* Inversion of CDFs for samplers, and directions from positions on faces. Thread: any. */
#pragma once

#include "sky/tables/cube.h"

#include <math.h>
#include <stdint.h>

/* The first entry of an ascending CDF that exceeds target. If rounding made target equal to the total, the last entry
 * with nonzero probability, so that an impossible entry is never chosen. */
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

/* The last position within an entry: added to a number below 2^20 it is still exact. */
#define INVERT_LAST (1.0 - 0x1p-32)

/* Real-valued position in 0..n for x in [0, 1): the entry plus the fraction within it. */
static inline double invert(const double *cdf, uint32_t n, double x)
{
    const double target = x * cdf[n - 1];
    const uint32_t k = invert_find(cdf, n, target);
    const double below = k ? cdf[k - 1] : 0.0;
    const double within = (target - below) / (cdf[k] - below);

    return k + fmin(fmax(within, 0.0), INVERT_LAST);
}

/* Rounding to float may move a direction across the border of the chosen texel, possibly onto a black one, so positions
 * are kept this fraction of a texel away from borders. At 1024 texels per edge, rounding moves a position by at most
 * 1e-4 of a texel: one sample in several thousand is moved, by less than this margin. */
#define INVERT_MARGIN 0x1p-10

static inline double invert_hold(double place)
{
    const double whole = floor(place);
    return whole + fmin(fmax(place - whole, INVERT_MARGIN), 1.0 - INVERT_MARGIN);
}

/* The unit direction through a position on a face of n x n texels, in texels. It always lies in the texel of that
 * position. */
void invert_direction(uint32_t n, uint32_t face, double row, double column, float w[3]);
