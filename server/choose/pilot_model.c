#include "choose/pilot_model.h"

#include <math.h>

#define READINGS 12.0   /* that a running mean holds */
#define STEP 0.3        /* weight of a new time, */
#define RAN_STEP 0.5    /* and of a whole picture's, in the logarithm */
#define RAN_MOST 3.0    /* a picture is believed up to this factor, */
#define FIRST_MOST 10.0 /* the first up to this one */
#define TIME_MOST 2.5

static double within(double x, double factor)
{
    return fmin(factor, fmax(1.0 / factor, x));
}

/* The product of two noisy estimates scatters as 1 / n, so readings of the energy are weighted by n^2 instead of by
 * their own error: where a group has much of the light, it has much of the noise, too. */
void model_read(struct model *m, const struct reading *r)
{
    const double step = 1.0 / fmin(++m->fresh, READINGS), weight = r->n * r->n;

    m->count = m->fresh > 1 ? m->count + 1 : 1;
    m->variance += (r->error * r->n - m->variance) / fmin(m->count, READINGS);
    m->weight += step * (weight - m->weight);
    m->light += step * (weight * r->energy - m->light);
    const double mean = m->light / m->weight, off = weight * (r->energy - mean);
    m->scatter += step * (off * off - m->scatter);
    m->energy = fmax(0.0, mean);
    m->energy_most = m->energy + sqrt(step * m->scatter) / m->weight;
    m->known = true;
}

void model_age(struct model *m)
{
    m->fresh = 0;
    m->known = m->variance > 0.0; /* a black sky teaches nothing */
}

static void blend(double *old, double reading, bool known)
{
    *old = known ? *old * (1.0 + STEP * (within(reading / *old, TIME_MOST) - 1.0)) : reading;
}

void model_time(struct model *m, double begin_s, double n, double seconds, double share)
{
    blend(&m->begin_s, begin_s, m->timed && m->begin_s > 0.0);
    blend(&m->unit_s, seconds / (n * share), m->timed && m->unit_s > 0.0);
    m->timed = true;
}

void model_ran(struct model *m, double n, double seconds)
{
    const double expected = model_seconds(m, n), ratio = expected > 0.0 ? seconds / expected : 1.0;
    const double factor = m->ran ? pow(within(ratio, RAN_MOST), RAN_STEP) : within(ratio, FIRST_MOST);

    m->begin_s *= factor;
    m->unit_s = m->timed ? m->unit_s * factor : seconds / n;
    m->timed = m->ran = true;
}

double model_error(const struct model *m, double n)
{
    return m->variance / n;
}

double model_seconds(const struct model *m, double n)
{
    return m->begin_s + m->unit_s * n;
}
