/* Numbers in ascending order. Any thread. */
#pragma once

#include <stdint.h>
#include <stdlib.h>

/* For qsort and bsearch of uint64_t. */
static inline int sort_compares_whole(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static inline int sort_compares(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* v[n], without NaN. */
static inline void sort_doubles(double *v, size_t n)
{
    qsort(v, n, sizeof(*v), sort_compares);
}
