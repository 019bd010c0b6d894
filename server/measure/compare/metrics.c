#include "measure/compare/metrics.h"

#include "base/mem.h"
#include "base/sort.h"
#include "base/vec.h"
#include "image/film/film.h"

#include <assert.h>
#include <math.h>

#define BANDS 64 /* of pixels; added in order, so that the thread count changes nothing */
#define KEY 0.18
#define RADIUS 2 /* of the mean that divides an error by halves, pixels */

/* One band's sums over the pixels counted. */
struct sums {
    double x, r;  /* luminance */
    double r_rgb; /* all channels */
    double delta_e;
    uint64_t pixels;
};

struct lab lab_of_pixel(const float *rgb, double gain)
{
    double c[3];
    for (int k = 0; k < 3; k++)
        c[k] = tone_value(TONE_FILMIC, gain * (double)rgb[k]);
    return lab_from(c);
}

/* CIE76 [CIE 15:2004, 8.2.2]. */
static double delta_e(const float *x, const float *r, double gain)
{
    const struct lab p = lab_of_pixel(x, gain), q = lab_of_pixel(r, gain);
    return sqrt((p.l - q.l) * (p.l - q.l) + (p.a - q.a) * (p.a - q.a) + (p.b - q.b) * (p.b - q.b));
}

static void sum_band(const float *x, const float *r, const uint8_t *mask, double gain, size_t begin, size_t end,
                     struct sums *out)
{
    struct sums s = { 0 };
    for (size_t i = begin; i < end; i++) {
        if (mask && !mask[i])
            continue;
        const float *p = x + 3 * i, *q = r + 3 * i;
        s.x += rgb_luminance(p[0], p[1], p[2]);
        s.r += rgb_luminance(q[0], q[1], q[2]);
        s.r_rgb += (double)q[0] + (double)q[1] + (double)q[2];
        s.delta_e += delta_e(p, q, gain);
        s.pixels++;
    }
    *out = s;
}

static struct sums sum_all(const float *x, const float *r, const uint8_t *mask, double gain, size_t count)
{
    struct sums band[BANDS], all = { 0 };

#pragma omp parallel for schedule(static)
    for (size_t b = 0; b < BANDS; b++)
        sum_band(x, r, mask, gain, count * b / BANDS, count * (b + 1) / BANDS, &band[b]);
    for (int b = 0; b < BANDS; b++) {
        all.x += band[b].x;
        all.r += band[b].r;
        all.r_rgb += band[b].r_rgb;
        all.delta_e += band[b].delta_e;
        all.pixels += band[b].pixels;
    }
    return all;
}

/* (x - r)^2 / (r^2 + soft) of one pixel, the mean over its channels. NaN counts as infinitely wrong, and so does
 * light where the whole reference is black. */
static double pixel_error(const float *x, const float *r, double soft)
{
    double sum = 0.0;
    for (int k = 0; k < 3; k++) {
        const double d = (double)x[k] - (double)r[k];
        if (d != 0.0)
            sum += d * d / ((double)r[k] * (double)r[k] + soft);
    }
    return isfinite(sum) ? sum / 3.0 : INFINITY;
}

/* Mean of the first `kept` of sorted errors. */
static double mean_of(const double *errors, uint64_t kept)
{
    double sum = 0.0;
    for (uint64_t i = 0; i < kept; i++)
        sum += errors[i];
    return kept ? sum / (double)kept : 0.0;
}

bool metrics_compare(const float *x, const float *r, const uint8_t *mask, uint32_t width, uint32_t height, double trim,
                     float *error_map, struct metrics *out)
{
    const size_t count = (size_t)width * height;
    double log2_mean = log2(KEY); /* a black reference: gain 1 */
    uint64_t n = 0;

    assert(trim >= 0.0 && trim <= 1.0);
    (void)exposure_log2_mean(r, mask, width, height, &log2_mean);
    const struct sums s = sum_all(x, r, mask, KEY / exp2(log2_mean), count);
    double *errors = s.pixels ? mem_alloc(s.pixels, sizeof(*errors)) : NULL;
    if (!errors)
        return false;

    const double mean = s.r_rgb / (3.0 * (double)s.pixels);
    for (size_t i = 0; i < count; i++) {
        const bool counted = !mask || mask[i];
        const double error = counted ? pixel_error(x + 3 * i, r + 3 * i, 1e-2 * mean * mean) : 0.0;
        if (counted)
            errors[n++] = error;
        if (error_map)
            error_map[i] = (float)error;
    }
    sort_doubles(errors, n);
    *out = (struct metrics){
        .mean_ratio = s.x == s.r ? 1.0 : s.x / s.r,
        .rel_mse = mean_of(errors, n),
        .rel_mse_trimmed = mean_of(errors, n - (uint64_t)(trim * (double)n)),
        .delta_e = s.delta_e / (double)s.pixels,
        .pixels = n,
    };
    mem_free(errors);
    return true;
}

/* Mean over the counted pixels within RADIUS of (x, y), of one channel. */
static double mean_around(const float *a, const float *b, const uint8_t *mask, const uint32_t size[2], size_t i, int k)
{
    const long width = size[0], x = (long)i % width, y = (long)i / width;
    double sum = 0.0;
    int n = 0;

    for (long v = y - RADIUS; v <= y + RADIUS; v++)
        for (long u = x - RADIUS; u <= x + RADIUS; u++) {
            const size_t at = (size_t)(v * width + u);
            if (u < 0 || u >= width || v < 0 || v >= (long)size[1] || (mask && !mask[at]))
                continue;
            sum += 0.5 * ((double)a[3 * at + (size_t)k] + (double)b[3 * at + (size_t)k]);
            n++;
        }
    return sum / n;
}

bool metrics_halves(const float *x, const float *a, const float *b, const uint8_t *mask, uint32_t width,
                    uint32_t height, struct metrics_halves *out)
{
    const size_t count = (size_t)width * height;
    double mean = 0.0, sum = 0.0, square = 0.0;
    uint64_t n = 0;

    for (size_t i = 0; i < count; i++)
        for (size_t k = 3 * i; k < 3 * i + 3 && (!mask || mask[i]); k++) {
            mean += 0.5 * ((double)a[k] + (double)b[k]);
            n++;
        }
    mean /= fmax((double)n, 1.0);
#pragma omp parallel for schedule(static) reduction(+ : sum, square)
    for (size_t i = 0; i < count; i++) {
        double pixel = 0.0;
        for (int k = 0; k < 3 && (!mask || mask[i]); k++) {
            const size_t v = 3 * i + (size_t)k;
            const double r = mean_around(a, b, mask, (uint32_t[2]){ width, height }, i, k);
            pixel += ((double)x[v] - (double)a[v]) * ((double)x[v] - (double)b[v]) / (r * r + 1e-2 * mean * mean);
        }
        sum += pixel / 3.0;
        square += pixel * pixel / 9.0;
    }
    const double pixels = (double)n / 3.0, error = sum / pixels;
    *out = (struct metrics_halves){ error, sqrt(fmax(square / pixels - error * error, 0.0) / pixels) };
    return n > 0 && isfinite(error);
}
