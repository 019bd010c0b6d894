/* Doubles that agree within an absolute bound; cmocka's own comparison is of floats. Says both when they do not. */
#pragma once

#include "support/unit.h"

#include <math.h>

#define assert_near(got, want, most) near_check(got, want, most, __FILE__, __LINE__)

static inline void near_check(double got, double want, double most, const char *file, int line)
{
    if (got == want || fabs(got - want) <= most)
        return;
    print_error("%.17g is not %.17g within %g\n", got, want, most);
    _fail(file, line);
}
