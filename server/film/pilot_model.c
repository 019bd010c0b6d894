#include "pilot_model.h"

#include <math.h>

/* The slope of log error over log n begins at that of independent samples and needs readings at several n to leave it:
 * as if there were readings of it, this far apart. */
#define PRIOR_SPREAD 4.0
#define ORDER_LEAST 0.7
#define ORDER_MOST 1.8
#define TIME_STEP 0.3 /* share of a new reading */
#define CLEAN_WANTED 2
#define WHOLE_RANGE 3.0
#define FAR_APART 0.25 /* of two counts, in their logarithm */
#define TILT_MOST 2.0
#define DOUBT_LEAST 0.4 /* of one reading, relative: several scatter by more at times, and few may agree by chance */

static double clamp(double x, double low, double high)
{
    return x < low ? low : x > high ? high : x;
}

/* Products of two noisy estimates scatter as n falls: each counts by the inverse square of the error that its n lets
 * expect. Not by its own error: where a group has much of the light, it has much of the noise too. To their mean comes
 * one standard error, lest a part be left out because a first look missed it. */
static void fit_energy(struct model *m, bool rough)
{
    double weights = 0.0, sum = 0.0, scatter = 0.0;

    for (uint32_t k = 0; k < m->count; k++) {
        const double w = m->reading[k].rough && !rough ? 0.0 : pow(m->reading[k].n, 2.0 * m->order);
        weights += w;
        sum += w * m->reading[k].energy;
    }
    const double mean = sum / weights;
    for (uint32_t k = 0; k < m->count; k++) {
        const double w = m->reading[k].rough && !rough ? 0.0 : pow(m->reading[k].n, 2.0 * m->order);
        const double apart = m->reading[k].energy - mean;
        scatter += w * w * apart * apart;
    }
    const double alone = m->count < 3 ? 0.1 * m->reading[0].error : 0.0;
    m->energy = mean > 0.0 ? mean : 0.0;
    m->energy_most = m->energy + sqrt(scatter) / weights + alone;
}

bool model_is_rough(const struct model *m)
{
    uint32_t clean = 0;

    for (uint32_t k = 0; k < m->count; k++)
        clean += !m->reading[k].rough;
    return clean < CLEAN_WANTED;
}

static bool counts(const struct reading *r, bool rough)
{
    return r->error > 0.0 && (rough || !r->rough);
}

/* Slope of log error over log n. A hard place tells more of it than one where there is little to be wrong. */
static void fit_order(struct model *m, bool rough)
{
    double x = 0.0, y = 0.0, xx = 0.0, xy = 0.0, weights = 0.0;

    for (uint32_t k = 0; k < m->count; k++) {
        const struct reading *r = &m->reading[k];
        const double w = 2.0 * r->hard / (1.0 + r->hard);
        if (!counts(r, rough))
            continue;
        x += w * log(r->n);
        y += w * log(r->error / r->hard);
        weights += w;
    }
    for (uint32_t k = 0; k < m->count && weights > 0.0; k++) {
        const struct reading *r = &m->reading[k];
        const double w = 2.0 * r->hard / (1.0 + r->hard);
        if (!counts(r, rough))
            continue;
        const double dx = log(r->n) - x / weights;
        xx += w * dx * dx;
        xy += w * dx * (log(r->error / r->hard) - y / weights);
    }
    m->order = clamp((PRIOR_SPREAD - xy) / (PRIOR_SPREAD + xx), ORDER_LEAST, ORDER_MOST);
}

/* Errors of some places over how hard these are, the sums' ratio: where there is next to nothing to be wrong, a ratio
 * of its own would say nothing [Cochran 1977, chapter 6]. Readings far from the newest in n say less about what is in
 * use now: the order is a guess. */
static void fit_variance(struct model *m, bool rough)
{
    const double newest = m->reading[(m->next + MODEL_READINGS - 1) % MODEL_READINGS].n;
    double sum = 0.0, hard = 0.0, hards = 0.0, apart = 0.0;

    for (int pass = 0; pass < 2; pass++)
        for (uint32_t k = 0; k < m->count; k++) {
            const struct reading *r = &m->reading[k];
            const double far = log(r->n / newest), w = 1.0 / (1.0 + 4.0 * far * far);
            const double one = r->error * pow(r->n, m->order), off = one - m->variance * r->hard;
            if (r->rough && !rough)
                continue;
            if (pass == 1) {
                apart += w * w * off * off;
                continue;
            }
            sum += w * one;
            hard += w * r->hard;
            hards += w * w * r->hard * r->hard;
            m->variance = sum / hard;
        }
    /* Of `hard` squared over `hards` readings, as it were. */
    const double scatter = m->variance > 0.0 ? apart / (m->variance * m->variance) : 0.0;
    m->doubt = sqrt(fmax(DOUBT_LEAST * DOUBT_LEAST * hards, scatter)) / hard;
}

static void fit(struct model *m)
{
    const bool rough = model_is_rough(m);

    fit_order(m, rough);
    fit_variance(m, rough);
    m->energy = m->energy_most = 0.0;
    fit_energy(m, rough);
}

void model_read(struct model *m, const struct reading *r)
{
    m->reading[m->next] = *r;
    m->next = (m->next + 1) % MODEL_READINGS;
    m->count += m->count < MODEL_READINGS;
    m->fresh++;
    m->chosen += m->chosen < MODEL_READINGS;
    m->known = true;
    fit(m);
}

void model_ease(struct model *m, double times)
{
    for (uint32_t k = 0; k < m->count; k++)
        m->reading[k].error *= times;
    m->variance *= times;
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

void model_scale(struct model *m, double times)
{
    m->tables_s *= times;
    m->run_s *= times;
    m->base_s *= times;
    m->unit_s *= times;
    m->ran_s[0] *= times;
    m->ran_s[1] *= times;
}

bool model_whole(const struct model *m, double *base_times, double *unit_times)
{
    const double unit = (m->ran_s[0] - m->ran_s[1]) / (m->ran_n[0] - m->ran_n[1]);
    const double base = m->ran_s[0] - m->tables_s - m->run_s - unit * m->ran_n[0];

    if (!(m->ran_n[1] > 0.0) || !(unit > 0.0) || !(m->unit_s > 0.0))
        return false;
    *unit_times = clamp(unit / m->unit_s, 1.0 / WHOLE_RANGE, WHOLE_RANGE);
    *base_times = m->base_s > 0.0 ? clamp(base / m->base_s, 1.0 / WHOLE_RANGE, WHOLE_RANGE) : 1.0;
    return true;
}

void model_time(struct model *m, double tables_s, double n, double seconds, double share)
{
    if (!m->ran)
        blend(&m->tables_s, tables_s, m->timed && m->tables_s > 0.0);
    if (m->sloped) {
        const double ratio = seconds / (m->run_s + share * (m->base_s + m->unit_s * n));
        const double scale = pow(clamp(ratio, 0.4, 2.5), TIME_STEP);
        m->run_s *= scale;
        m->base_s *= scale;
        m->unit_s *= scale;
    } else {
        blend(&m->unit_s, seconds / (n * share), m->timed);
    }
    m->timed = true;
}

void model_slope(struct model *m, double tables_s, const double n[2], const double seconds[2], const double none[2],
                 const double share[2])
{
    /* A hiccup in one of them must not make samples cost nothing. */
    const double few = fmax(0.0, seconds[0] - none[0]) / share[0];
    const double many = fmax(0.5 * seconds[1], seconds[1] - none[1]) / share[1];
    const double unit = fmax((many - few) / (n[1] - n[0]), 0.3 * many / n[1]);

    if (!m->ran)
        m->tables_s = tables_s;
    m->run_s = fmin(none[0], none[1]);
    m->unit_s = unit;
    m->base_s = fmax(0.0, many - unit * n[1]);
    m->timed = m->sloped = true;
}

/* Groups' times may put too much into a sample and too little into the beginning, and then another count never seems to
 * fit: two whole pictures know better. What the present count takes stays. */
static void tilt(struct model *m)
{
    const double unit = (m->ran_s[0] - m->ran_s[1]) / (m->ran_n[0] - m->ran_n[1]), n = m->ran_n[0];

    if (!m->sloped || !(m->ran_n[1] > 0.0) || fabs(log(n / m->ran_n[1])) < FAR_APART || !(unit > 0.0))
        return;
    const double step = TIME_STEP * (clamp(unit, m->unit_s / TILT_MOST, m->unit_s * TILT_MOST) - m->unit_s);
    const double most = m->base_s / n; /* the beginning takes no less than nothing */
    m->unit_s += fmin(step, most);
    m->base_s -= n * fmin(step, most);
}

void model_ran(struct model *m, double n, double seconds)
{
    const double expected = model_seconds(m, n), ratio = expected > 0.0 ? seconds / expected : 1.0;

    if (!m->timed) {
        m->base_s = 0.1 * seconds;
        m->unit_s = 0.9 * seconds / n;
    } else {
        /* The first whole picture is believed; after that a reading is one of many. */
        const double scale = m->ran ? pow(clamp(ratio, 0.3, 3.0), TIME_STEP) : clamp(ratio, 0.1, 10.0);
        model_scale(m, scale);
    }
    if (m->ran_n[0] != n) {
        m->ran_n[1] = m->ran_n[0];
        m->ran_s[1] = m->ran_s[0];
    }
    m->ran_n[0] = n;
    m->ran_s[0] = seconds;
    m->timed = m->ran = true;
    tilt(m);
}

double model_error(const struct model *m, double n)
{
    return m->variance * pow(n, -m->order);
}

double model_error_told(const struct model *m, double n)
{
    const bool rough = model_is_rough(m);
    double sum = 0.0;
    uint32_t count = 0;

    for (uint32_t k = 1; k <= m->chosen; k++) {
        const struct reading *r = &m->reading[(m->next + MODEL_READINGS - k) % MODEL_READINGS];
        if (r->rough && !rough)
            continue;
        sum += r->error * pow(r->n / n, m->order);
        count++;
    }
    return count ? sum / count : model_error(m, n);
}

double model_begin(const struct model *m)
{
    return m->tables_s + m->run_s + m->base_s;
}

double model_seconds(const struct model *m, double n)
{
    return model_begin(m) + m->unit_s * n;
}
