#include "light/plan/pilot_measure.h"

#include <math.h>

#define READINGS 12.0 /* that a running mean holds */
#define RAN_STEP 0.5  /* weight of a new time, in the logarithm, */
#define RAN_MOST 3.0  /* which is believed up to this factor */

void model_read(struct model *m, double n, double error)
{
    m->count = ++m->fresh > 1 ? m->count + 1 : 1;
    m->variance += (error * n - m->variance) / fmin(m->count, READINGS);
    m->known = true;
}

void model_age(struct model *m)
{
    m->fresh = 0;
    m->known = m->variance > 0.0; /* a black sky teaches nothing */
}

void model_ran(struct model *m, double n, double seconds)
{
    const double expected = model_seconds(m, n);

    if (expected > 0.0)
        m->unit_s *= pow(fmin(RAN_MOST, fmax(1.0 / RAN_MOST, seconds / expected)), RAN_STEP);
    else
        m->unit_s = seconds / n;
}

double model_error(const struct model *m, double n)
{
    return n > 0.0 ? m->variance / n : 0.0;
}

double model_seconds(const struct model *m, double n)
{
    return m->unit_s * n;
}
