#include "sky/between/deflicker.h"

#include "base/vec.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

enum { CELLS = DEFLICKER_HIGH * DEFLICKER_WIDE };

#define SEEN_LEAST 0.05 /* of the hemisphere: with less, a sky is blind */
/* Tuned with docs/examples/timelapse.py: what lasts about three minutes is taken for light. Exposures that scatter by 5
 * %, 15 s apart, come out with 1.0 to 1.3 times the flicker of a steady camera's, and dusk within 0.1 %, or 2 % of
 * them. */
#define LEVEL_S 200.0       /* within which the level follows the camera's path, and the steady one the level */
#define TREND_S 300.0       /* the trend the level */
#define ERROR_MEAN 0.1      /* weight of the newest error in their mean */
#define FOUND_ERROR 0.003   /* of the camera's ratio as it is found: a scatter of this size is not the camera's */
#define JUMP 0.173          /* a quarter of a stop: least jump */
#define DUSK_PER_S 0.0035   /* 0.3 stops a minute: as fast as a low sun fades in the tropics */
#define UNIFORM_PART 0.6    /* of the sky follows a jump ... */
#define UNIFORM_WITHIN 0.35 /* ... within this part of it */

struct ratio {
    float log, weight;
};

/* One row of cells: logarithms of their means, NAN for a cell in which a value reaches `limit`. */
static void shrink_row(const float *rgb, uint32_t width, uint32_t height, const float limit[3], size_t row,
                       float (*out)[CELLS])
{
    const uint32_t half = (height + 1) / 2;
    const size_t y0 = row * half / DEFLICKER_HIGH, y1 = (row + 1) * half / DEFLICKER_HIGH;

    for (size_t k = 0; k < DEFLICKER_WIDE; k++) {
        const size_t x0 = k * width / DEFLICKER_WIDE, x1 = (k + 1) * width / DEFLICKER_WIDE;
        float sum[3] = { 0.0f }, most[3] = { 0.0f };
        for (size_t y = y0; y < y1; y++)
            for (const float *v = rgb + 3 * (y * width + x0); v < rgb + 3 * (y * width + x1); v += 3)
                for (int c = 0; c < 3; c++) {
                    sum[c] += v[c];
                    most[c] = v[c] > most[c] ? v[c] : most[c];
                }
        const float count = (float)(x1 - x0) * (float)(y1 - y0);
        for (int c = 0; c < 3; c++)
            out[c][row * DEFLICKER_WIDE + k] =
                sum[c] > 0.0f && isfinite(sum[c]) && most[c] < limit[c] ? logf(sum[c] / count) : NAN;
    }
}

/* Cells with the sky's highest value are left out: these are the sun, or where the image was clipped. If that leaves
 * too few, as of an even sky, all cells are taken. */
static void shrink(const float *rgb, uint32_t width, uint32_t height, float out[3][CELLS])
{
    float limit[3] = { 0.0f };

    for (const float *v = rgb; v < rgb + 3 * (size_t)((height + 1) / 2) * width; v += 3)
        for (int c = 0; c < 3; c++)
            limit[c] = 0.99f * v[c] > limit[c] ? 0.99f * v[c] : limit[c];
    for (size_t row = 0; row < DEFLICKER_HIGH; row++)
        shrink_row(rgb, width, height, limit, row, out);
    size_t left = 0;
    for (size_t i = 0; i < CELLS; i++)
        left += !isnan(out[1][i]);
    if ((double)left >= SEEN_LEAST * CELLS)
        return;
    limit[0] = limit[1] = limit[2] = INFINITY;
    for (size_t row = 0; row < DEFLICKER_HIGH; row++)
        shrink_row(rgb, width, height, limit, row, out);
}

static int by_log(const void *a, const void *b)
{
    const float x = ((const struct ratio *)a)->log, y = ((const struct ratio *)b)->log;
    return (x > y) - (x < y);
}

struct ratios {
    struct ratio at[CELLS]; /* ascending */
    size_t count;
    double weight; /* part of the hemisphere */
};

/* Ratios of the cells that both skies have, weighted by solid angle. */
static void compare(const float *now, const float *last, struct ratios *out)
{
    out->count = 0;
    out->weight = 0.0;
    for (size_t i = 0; i < CELLS; i++) {
        const double row = (double)(i / DEFLICKER_WIDE);
        const double solid = cos(0.5 * PI * row / DEFLICKER_HIGH) - cos(0.5 * PI * (row + 1.0) / DEFLICKER_HIGH);
        if (isnan(now[i]) || isnan(last[i]))
            continue;
        out->at[out->count++] = (struct ratio){ now[i] - last[i], (float)(solid / DEFLICKER_WIDE) };
        out->weight += solid / DEFLICKER_WIDE;
    }
    qsort(out->at, out->count, sizeof(out->at[0]), by_log);
}

/* The ratio below which this part of the weight lies. */
static double quantile(const struct ratios *r, double part)
{
    double sum = 0.0;
    size_t i = 0;

    while (i + 1 < r->count && sum + (double)r->at[i].weight < part * r->weight)
        sum += (double)r->at[i++].weight;
    return (double)r->at[i].log;
}

/* Whether most of the sky changed as its median did. */
static bool is_uniform(const struct ratios *r, double median, double change)
{
    double inside = 0.0;

    for (size_t i = 0; i < r->count; i++)
        if (fabs((double)r->at[i].log - median) <= UNIFORM_WITHIN * fabs(change))
            inside += (double)r->at[i].weight;
    return inside >= UNIFORM_PART * r->weight;
}

/* Moves the level by what the camera's exposure changed, `step`, in the time since the sky before. */
static void track(struct deflicker_channel *c, double step, double seconds, unsigned count)
{
    const double expected = c->level + c->trend * seconds - step, error = -expected, first = 1.0 / (count + 1);

    c->error += fmax(ERROR_MEAN, first) * (error - c->error);
    c->scatter += fmax(ERROR_MEAN, 1.0 / count) * (fabs(error) - c->scatter);
    /* 0 while signs change, 1 where the errors' mean is as large as they are: the light itself changes. */
    double bias = count > 4 && c->scatter > 0.0 ? fmin(fmax(2.0 * fabs(c->error) / c->scatter - 1.0, 0.0), 1.0) : 0.0;
    bias *= bias * (3.0 - 2.0 * bias);
    /* The first skies are averaged. */
    const double slow = 1.0 - exp(-seconds / LEVEL_S), gain = fmax(slow + (1.0 - slow) * bias, first);
    c->level = expected + gain * error;
    c->trend += gain * (1.0 - exp(-seconds / TREND_S)) * error / seconds;
    c->steady += c->trend * seconds - step;
    c->steady += gain * (c->level - c->steady);
}

/* A jump is the camera's. A large change that most of the sky does not share is the weather's: the camera did nothing.
 * All channels are judged at once, so that no mistake colours the sky. */
static void take_ratios(struct deflicker *d, const struct ratios r[3], double seconds, struct deflicker_result *out)
{
    double step[3], change[3], most = 0.0, limit = 0.0;

    for (int k = 0; k < 3; k++) {
        step[k] = quantile(&r[k], 0.5);
        change[k] = step[k] - d->channel[k].trend * seconds;
        most = fmax(most, fabs(change[k]));
        limit = fmax(limit, JUMP + DUSK_PER_S * seconds + 3.0 * d->channel[k].scatter);
    }
    const bool uniform =
        is_uniform(&r[0], step[0], most) && is_uniform(&r[1], step[1], most) && is_uniform(&r[2], step[2], most);
    out->jumped = most > limit && uniform;
    const bool real = most > 2.0 * limit && !uniform;
    for (int k = 0; k < 3; k++) {
        struct deflicker_channel *c = &d->channel[k];
        c->undone += out->jumped ? change[k] : 0.0;
        track(c, step[k] - (out->jumped || real ? change[k] : 0.0), seconds, d->count);
        const double sure = c->scatter * c->scatter / (c->scatter * c->scatter + FOUND_ERROR * FOUND_ERROR);
        d->gain[k] = (float)exp(sure * c->steady - c->undone);
    }
    out->spread = (float)((quantile(&r[1], 0.75) - quantile(&r[1], 0.25)) / log(2.0));
}

static void restart(struct deflicker *d)
{
    memset(d->channel, 0, sizeof(d->channel));
    for (int k = 0; k < 3; k++)
        d->gain[k] = 1.0f;
    d->pending_s = d->usual_s = 0.0;
    d->count = 0;
}

/* The time since the sky that the next is compared with. Short ones are lengthened, since a trend is a quotient. */
static double since_last(struct deflicker *d, double seconds)
{
    if (seconds <= 0.0)
        seconds = d->usual_s > 0.0 ? d->usual_s : 1.0;
    d->usual_s = d->usual_s > 0.0 ? 0.9 * d->usual_s + 0.1 * seconds : seconds;
    d->pending_s += seconds;
    return fmax(d->pending_s, 0.25 * d->usual_s);
}

void deflicker_take(struct deflicker *d, const float *rgb, uint32_t width, uint32_t height, double seconds,
                    struct deflicker_result *out)
{
    struct ratios ratios[3];

    *out = (struct deflicker_result){ .spread = 0.0f };
    if (d->count == 0 || !(seconds >= 0.0 && d->pending_s + seconds <= DEFLICKER_GAP_S)) {
        restart(d);
        out->restarted = true;
    }
    shrink(rgb, width, height, d->now);
    const double since = d->count > 0 ? since_last(d, seconds) : 0.0;
    for (int k = 0; k < 3; k++) {
        compare(d->now[k], d->count > 0 ? d->last[k] : d->now[k], &ratios[k]);
        out->blind = out->blind || ratios[k].weight < SEEN_LEAST;
    }
    if (d->count > 0 && !out->blind)
        take_ratios(d, ratios, since, out);
    if (!out->blind) {
        memcpy(d->last, d->now, sizeof(d->last));
        d->pending_s = 0.0;
        d->count++;
    }
    memcpy(out->gain, d->gain, sizeof(d->gain));
    out->stops = log2f(d->gain[1]);
}
