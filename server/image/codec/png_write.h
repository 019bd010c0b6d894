/* PNG encoding through libpng. Thread: any. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct png_desc {
    const void *samples; /* [height][width][3], with alpha [4]: sRGB, alpha straight; uint8_t, or uint16_t where deep */
    uint32_t width, height;
    bool deep, alpha;
};

/* Encodes to memory, marked as sRGB; the caller frees *bytes with mem_free. The output is deterministic. ERR_RANGE: a
 * side of 0 or above a million. ERR_NOMEM. On error *bytes is NULL. */
MUST_CHECK enum err png_encode(const struct png_desc *d, uint8_t **bytes, size_t *size, struct reason *why);
