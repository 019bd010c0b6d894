#include "pilot_model.h"

#include <math.h>

/* The slope of log error over log n begins at that of independent samples and needs readings at several n to leave it:
 * as if there were readings of it, this far apart. */
#define PRIOR_SPREAD 4.0
#define ORDER_LEAST 0.7
#define ORDER_MOST 1.8
#define TIME_STEP 0.3 /* share of a new reading */

static double clamp(double x, double low, double high)
{
    return x < low ? low : x > high ? high : x;
}

/* Products of two noisy estimates scatter as these do: each counts by the inverse square of its error. To their mean
 * comes one standard error, lest a part be left out because a first look missed it. */
static void fit_energy(struct model *m)
{
    double weights = 0.0, sum = 0.0, scatter = 0.0;

    for (uint32_t k = 0; k < m->count; k++) {
        const struct reading *r = &m->reading[k];
        const double w = 1.0 / (r->error * r->error + 1e-20);
        weights += w;
        sum += w * r->energy;
    }
    const double mean = sum / weights;
    for (uint32_t k = 0; k < m->count; k++) {
        const struct reading *r = &m->reading[k];
        const double w = 1.0 / (r->error * r->error + 1e-20);
        scatter += w * w * (r->energy - mean) * (r->energy - mean);
    }
    const double alone = m->count < 3 ? 0.1 * m->reading[0].error : 0.0;
    m->energy = mean > 0.0 ? mean : 0.0;
    m->energy_most = m->energy + sqrt(scatter) / weights + alone;
}

static void fit(struct model *m)
{
    double x = 0.0, y = 0.0, xx = 0.0, xy = 0.0, variance = 0.0, weights = 0.0;
    uint32_t logs = 0;

    for (uint32_t k = 0; k < m->count; k++) {
        const struct reading *r = &m->reading[k];
        if (!(r->error > 0.0))
            continue;
        x += log(r->n);
        y += log(r->error);
        logs++;
    }
    for (uint32_t k = 0; k < m->count; k++) {
        const struct reading *r = &m->reading[k];
        const double dx = log(r->n) - x / logs;
        if (!(r->error > 0.0))
            continue;
        xx += dx * dx;
        xy += dx * (log(r->error) - y / logs);
    }
    m->order = clamp((PRIOR_SPREAD - xy) / (PRIOR_SPREAD + xx), ORDER_LEAST, ORDER_MOST);
    /* Readings far from the newest in n say less about what is in use now: the order is a guess. */
    const double newest = m->reading[(m->next + MODEL_READINGS - 1) % MODEL_READINGS].n;
    for (uint32_t k = 0; k < m->count; k++) {
        const double apart = log(m->reading[k].n / newest), w = 1.0 / (1.0 + 4.0 * apart * apart);
        variance += w * m->reading[k].error * pow(m->reading[k].n, m->order);
        weights += w;
    }
    m->variance = variance / weights;
    m->energy = m->energy_most = 0.0;
    fit_energy(m);
}

void model_read(struct model *m, double n, double error, double energy)
{
    m->reading[m->next] = (struct reading){ n, error, energy };
    m->next = (m->next + 1) % MODEL_READINGS;
    m->count += m->count < MODEL_READINGS;
    m->fresh++;
    m->chosen += m->chosen < MODEL_READINGS;
    m->known = true;
    fit(m);
}

void model_age(struct model *m)
{
    /* What was last known goes on being used until the first new reading takes its place. */
    m->count = m->next = 0;
    m->fresh = m->chosen = 0;
    m->known = m->variance > 0.0; /* of a black sky nothing was learnt */
}

static void blend(double *old, double reading, bool known)
{
    *old = known ? *old + TIME_STEP * (clamp(reading, 0.4 * *old, 2.5 * *old) - *old) : reading;
}

void model_time(struct model *m, double begin_s, double n, double run_s, double share)
{
    if (!m->ran)
        blend(&m->begin_s, begin_s, m->timed && m->begin_s > 0.0);
    blend(&m->unit_s, run_s / (n * share), m->timed);
    m->timed = true;
}

void model_ran(struct model *m, double n, double seconds)
{
    const double expected = model_seconds(m, n), ratio = expected > 0.0 ? seconds / expected : 1.0;

    if (!m->timed) {
        m->begin_s = 0.1 * seconds;
        m->unit_s = 0.9 * seconds / n;
    } else {
        /* The first whole picture is believed; after that a reading is one of many. */
        const double scale = m->ran ? pow(clamp(ratio, 0.3, 3.0), TIME_STEP) : clamp(ratio, 0.1, 10.0);
        m->begin_s *= scale;
        m->unit_s *= scale;
    }
    m->timed = m->ran = true;
}

double model_error(const struct model *m, double n)
{
    return m->variance * pow(n, -m->order);
}

double model_error_told(const struct model *m, double n)
{
    double sum = 0.0;

    if (m->chosen == 0)
        return model_error(m, n);
    for (uint32_t k = 1; k <= m->chosen; k++) {
        const struct reading *r = &m->reading[(m->next + MODEL_READINGS - k) % MODEL_READINGS];
        sum += r->error * pow(r->n / n, m->order);
    }
    return sum / m->chosen;
}

double model_seconds(const struct model *m, double n)
{
    return m->begin_s + m->unit_s * n;
}
