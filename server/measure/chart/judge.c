#include "measure/chart/judge.h"

#include "base/mem.h"
#include "base/vec.h"

#include <math.h>

#define SOFT 1e-2 /* of mean(r)^2, added to r^2: docs, Conventions */
#define BANDS 64  /* of values; added in order, so that the thread count changes nothing */

/* Mean of r over the pixels that count, and how many those are. */
static double mean_of(const struct judge *j, const uint8_t *mask, uint64_t *pixels)
{
    double sum = 0.0;
    *pixels = 0;
    for (size_t i = 0; i < (size_t)j->width * j->height; i++) {
        if (!mask[i])
            continue;
        for (int c = 0; c < 3; c++)
            sum += (double)j->mean[3 * i + c];
        ++*pixels;
    }
    return *pixels ? sum / (3.0 * (double)*pixels) : 0.0;
}

/* Channels of a pixel share their paths, so that a pixel counts as one: with D the sum of q (a - b)^2 over its
 * channels, E D = 2 s and E D^2 = 12 s^2 where s is the variance of one reference there, all channels together. The
 * error of the truth is the sum of products of two independent noises, of variance s^2 each at most. */
static void weigh_noise(struct judge *j)
{
    double noise = 0.0, square = 0.0;

    for (size_t i = 0; i < (size_t)j->width * j->height; i++) {
        double d = 0.0;
        for (size_t v = 3 * i; v < 3 * i + 3; v++)
            d += (double)j->weight[v] * ((double)j->a[v] - (double)j->b[v]) * ((double)j->a[v] - (double)j->b[v]);
        noise += d;
        square += d * d;
    }
    j->noise = 0.25 * noise;
    j->doubt = sqrt(square / 12.0);
}

enum err judge_init(struct judge *j, const float *a, const float *b, const uint8_t *mask, uint32_t width,
                    uint32_t height, struct reason *why)
{
    *j = (struct judge){ .a = a, .b = b, .width = width, .height = height };
    const size_t values = 3 * (size_t)j->width * j->height;

    j->mean = mem_alloc(values, sizeof(float));
    j->weight = mem_alloc(values, sizeof(float));
    if (!j->mean || !j->weight) {
        judge_finish(j);
        return err_say(why, ERR_NOMEM, "no memory to compare images of %ux%u", width, height);
    }
    for (size_t v = 0; v < values; v++)
        j->mean[v] = 0.5f * (a[v] + b[v]);
    const double mean = mean_of(j, mask, &j->pixels);
    if (j->pixels == 0 || !(mean > 0.0) || !isfinite(mean)) {
        const bool none = j->pixels == 0;
        judge_finish(j);
        return err_say(why, ERR_RANGE, none ? "no pixel sees a surface" : "the reference is black or holds no numbers");
    }
    for (size_t v = 0; v < values; v++) {
        const double r = (double)j->mean[v];
        j->weight[v] = mask[v / 3] ? (float)(1.0 / ((r * r + SOFT * mean * mean) * 3.0 * (double)j->pixels)) : 0.0f;
    }
    weigh_noise(j);
    return ERR_OK;
}

void judge_finish(struct judge *j)
{
    mem_free(j->mean);
    mem_free(j->weight);
    *j = (struct judge){ .a = NULL };
}

/* Half the sum of q ((x - a)(y - b) + (y - a)(x - b)). */
static double product(const struct judge *j, const float *x, const float *y)
{
    const size_t values = 3 * (size_t)j->width * j->height;
    double band[BANDS], sum = 0.0;

#pragma omp parallel for schedule(static)
    for (size_t k = 0; k < BANDS; k++) {
        double s = 0.0;
        for (size_t v = values * k / BANDS; v < values * (k + 1) / BANDS; v++) {
            const double a = (double)j->a[v], b = (double)j->b[v], p = (double)x[v], q = (double)y[v];
            if (j->weight[v] != 0.0f)
                s += (double)j->weight[v] * ((p - a) * (q - b) + (q - a) * (p - b));
        }
        band[k] = s;
    }
    for (int k = 0; k < BANDS; k++)
        sum += 0.5 * band[k];
    return isfinite(sum) ? sum : INFINITY;
}

double judge_error(const struct judge *j, const float *x)
{
    return product(j, x, x);
}

void judge_map(const struct judge *j, const float *x, float *map)
{
    for (size_t i = 0; i < (size_t)j->width * j->height; i++) {
        double sum = 0.0;
        for (size_t v = 3 * i; v < 3 * i + 3; v++)
            if (j->weight[v] != 0.0f)
                sum += (double)j->weight[v] * ((double)x[v] - (double)j->a[v]) * ((double)x[v] - (double)j->b[v]);
        map[i] = (float)fmax(sum * (double)j->pixels, 0.0);
    }
}

void judge_pairs(const struct judge *j, const float *const *x, uint32_t n, double *out)
{
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t k = 0; k <= i; k++)
            out[i * n + k] = out[k * n + i] = product(j, x[i], x[k]);
}

double judge_energy(const struct judge *j, const float *x)
{
    double sum = 0.0, reference = 0.0;

    for (size_t i = 0; i < (size_t)j->width * j->height; i++) {
        if (j->weight[3 * i] == 0.0f)
            continue;
        sum += rgb_luminance(x[3 * i], x[3 * i + 1], x[3 * i + 2]);
        reference += rgb_luminance(j->mean[3 * i], j->mean[3 * i + 1], j->mean[3 * i + 2]);
    }
    return sum / reference;
}

/* Mean of the entries beside the diagonal, and the variance of that mean over the draw of the seeds. Each image takes
 * part in n - 1 pairs, so that the mean is a U-statistic of degree 2, with the variance [Hoeffding 1948]
 * (4 (n - 2) z1 + 2 z2) / (n (n - 1)): z2 is the variance of a pair, z1 that of its mean with one image held. */
static double bias_of(const double *pairs, uint32_t n, double *variance)
{
    double sum = 0.0, z1 = 0.0, z2 = 0.0;

    for (uint32_t i = 0; i < n; i++)
        for (uint32_t k = 0; k < i; k++)
            sum += pairs[i * n + k];
    const double count = 0.5 * n * (n - 1.0), mean = sum / count;
    for (uint32_t i = 0; i < n; i++) {
        double row = 0.0;
        for (uint32_t k = 0; k < n; k++) {
            const double d = pairs[i * n + k] - mean;
            row += i != k ? d / (n - 1.0) : 0.0;
            z2 += i > k ? d * d / (count - 1.0) : 0.0;
        }
        z1 += row * row / (n - 1.0);
    }
    z1 = fmax(z1 - z2 / (n - 1.0), 0.0); /* a row's mean over its pairs has their scatter too */
    *variance = (4.0 * (n - 2.0) * z1 + 2.0 * z2) / (n * (n - 1.0));
    return mean;
}

void judge_floor(const struct judge *j, const double *pairs, const double *luminance, uint32_t n,
                 struct judge_floor *out)
{
    double error = 0.0, energy = 0.0, spread = 0.0, seeds;

    for (uint32_t i = 0; i < n; i++) {
        error += pairs[i * n + i] / n;
        energy += luminance[i] / n;
    }
    for (uint32_t i = 0; i < n; i++)
        spread += (luminance[i] - energy) * (luminance[i] - energy) / (n - 1);
    const double bias = bias_of(pairs, n, &seeds);
    /* The references' noise against itself, and against a bias that is spread as their noise is. */
    const double references = j->doubt * j->doubt + 4.0 * fmax(bias, 0.0) * j->noise / (double)j->pixels;
    const double doubt = sqrt(seeds + references);
    *out = (struct judge_floor){
        .error = error,
        .bias = bias,
        .variance = error - bias,
        .doubt = doubt,
        .z = doubt > 0.0 ? bias / doubt : 0.0,
        .energy = energy,
        .energy_doubt = sqrt(spread / n),
    };
}
