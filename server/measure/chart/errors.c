#include "measure/chart/judge.h"

#include "measure/compare/metrics.h"

#include <math.h>

const char *const error_names[ERROR_KINDS] = { "rel_mse", "noise", "delta_e", "flip" };

/* n / (n - 1) times the square of x_i - m, m the mean of all: their mean is the variance. Both references cancel. */
static double noise_of(const double *pairs, uint32_t n, uint32_t i)
{
    double row = 0.0, all = 0.0;

    for (uint32_t k = 0; k < n * n; k++) {
        all += pairs[k] / ((double)n * n);
        row += k / n == i ? pairs[k] / n : 0.0;
    }
    const double square = pairs[i * n + i] - 2.0 * row + all;
    return isfinite(square) ? square * n / (n - 1) : INFINITY;
}

enum err errors_of(const struct judge *j, const uint8_t *mask, const float *const *x, const double *pairs, uint32_t n,
                   double *out)
{
    struct metrics m;

    for (uint32_t i = 0; i < n; i++) {
        if (!metrics_compare(x[i], j->mean, mask, j->width, j->height, 0.0, NULL, &m) ||
            !flip_compare(x[i], j->mean, mask, j->width, j->height, FLIP_PIXELS_PER_DEGREE, NULL,
                          &out[ERROR_FLIP * n + i]))
            return ERR_NOMEM;
        out[ERROR_REL_MSE * n + i] = pairs[i * n + i];
        out[ERROR_NOISE * n + i] = noise_of(pairs, n, i);
        out[ERROR_DELTA_E * n + i] = m.delta_e;
    }
    return ERR_OK;
}
