/* Numbers in ascending order. Any thread. */
#pragma once

#include <stdlib.h>

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
