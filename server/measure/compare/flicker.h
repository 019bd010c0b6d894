/* Flicker: second differences in time of images as shown, |c(t) - 2 c(t-1) + c(t-2)| in 8-bit codes, which are 0 where
 * light changes evenly. Thread: one at a time. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#define FLICKER_MOST (2 * 255) /* |a - 2 b + c| of bytes */

struct flicker {
    uint64_t of[FLICKER_MOST + 1]; /* values by second difference */
    uint64_t triples;              /* of images */
};

/* Adds three images in a row, uint8_t[count] each. */
void flicker_add(struct flicker *f, const uint8_t *newest, const uint8_t *middle, const uint8_t *oldest, size_t count);

/* The least number of codes that a share of all values (0..1) does not exceed; 0 of none. */
int flicker_percentile(const struct flicker *f, double share);
