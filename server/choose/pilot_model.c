#include "choose/pilot_model.h"

#include <math.h>

#define STEP 0.3     /* share of a new reading of a time, */
#define RAN_STEP 0.5 /* and of a whole picture's, in the logarithm */
#define RAN_MOST 3.0 /* times as long as expected, or as short, that a picture is believed; the first more: */
#define FIRST_MOST 10.0

static double clamp(double x, double low, double high)
{
    return x < low ? low : x > high ? high : x;
}

/* A product of two noisy estimates scatters as 1 / n: each counts by n^2, not by its own error, since where a group has
 * much of the light it has much of the noise too. */
static void fit_energy(struct model *m)
{
    double weights = 0.0, sum = 0.0, scatter = 0.0;

    for (uint32_t k = 0; k < m->count; k++) {
        weights += m->reading[k].n * m->reading[k].n;
        sum += m->reading[k].n * m->reading[k].n * m->reading[k].energy;
    }
    const double mean = sum / weights;
    for (uint32_t k = 0; k < m->count; k++) {
        const double off = m->reading[k].n * m->reading[k].n * (m->reading[k].energy - mean);
        scatter += off * off;
    }
    m->energy = fmax(0.0, mean);
    m->energy_most = m->energy + sqrt(scatter) / weights;
}

/* Noise falls a little faster than 1 / n: readings far from the newest in n say less about what is in use now. */
static void fit_variance(struct model *m, double newest)
{
    double sum = 0.0, weights = 0.0;

    for (uint32_t k = 0; k < m->count; k++) {
        const double far = log(m->reading[k].n / newest), w = 1.0 / (1.0 + 4.0 * far * far);
        sum += w * m->reading[k].error * m->reading[k].n;
        weights += w;
    }
    m->variance = sum / weights;
}

void model_read(struct model *m, const struct reading *r)
{
    m->reading[m->next] = *r;
    m->next = (m->next + 1) % MODEL_READINGS;
    m->count += m->count < MODEL_READINGS;
    m->fresh++;
    m->known = true;
    fit_variance(m, r->n);
    fit_energy(m);
}

void model_scale_errors(struct model *m, double times)
{
    for (uint32_t k = 0; k < m->count; k++)
        m->reading[k].error *= times;
    m->variance *= times;
}

void model_age(struct model *m)
{
    m->count = m->next = m->fresh = 0;
    m->known = m->variance > 0.0; /* of a black sky nothing was learnt */
}

static void blend(double *old, double reading, bool known)
{
    *old += known ? STEP * (clamp(reading, 0.4 * *old, 2.5 * *old) - *old) : reading - *old;
}

void model_time(struct model *m, double begin_s, double n, double seconds, double share)
{
    blend(&m->begin_s, begin_s, m->timed && m->begin_s > 0.0);
    blend(&m->unit_s, seconds / (n * share), m->timed);
    m->timed = true;
}

void model_ran(struct model *m, double n, double seconds)
{
    const double expected = model_seconds(m, n), ratio = expected > 0.0 ? seconds / expected : 1.0;

    if (!m->timed) {
        m->unit_s = seconds / n;
    } else {
        const double times =
            m->ran ? pow(clamp(ratio, 1.0 / RAN_MOST, RAN_MOST), RAN_STEP) : clamp(ratio, 1.0 / FIRST_MOST, FIRST_MOST);
        m->begin_s *= times;
        m->unit_s *= times;
    }
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
