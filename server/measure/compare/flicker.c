#include "measure/compare/metrics.h"

#include <stdlib.h>

void flicker_add(struct flicker *f, const uint8_t *newest, const uint8_t *middle, const uint8_t *oldest, size_t count)
{
    for (size_t i = 0; i < count; i++)
        f->of[abs(newest[i] - 2 * middle[i] + oldest[i])]++;
    f->triples++;
}

int flicker_percentile(const struct flicker *f, double share)
{
    uint64_t all = 0, below = 0;
    int code = 0;

    for (int k = 0; k <= FLICKER_MOST; k++)
        all += f->of[k];
    for (; code < FLICKER_MOST && (double)(below + f->of[code]) < share * (double)all; code++)
        below += f->of[code];
    return code;
}
