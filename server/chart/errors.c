#include "chart/errors.h"

#include "film/film.h"
#include "compare/flip.h"
#include "base/mem.h"
#include "compare/metrics.h"

#include <math.h>

#define KEY 0.18

static const struct error_about kinds[ERROR_KINDS] = {
    [ERROR_REL_MSE] = { "rel_mse", "relative squared error (relMSE)", -1.0,
                        "The square of how far a pixel is off, in proportion to its brightness; 0.01 is 10 % off." },
    [ERROR_NOISE] = { "noise", "noise alone (relMSE without bias)", -1.0,
                      "The part of that error that goes away with more samples: how much two runs differ." },
    [ERROR_DELTA_E] = { "delta_e", "visible difference (mean delta E*ab)", -0.5,
                        "How different the finished picture looks; 1 is just noticeable side by side, 5 is plain." },
    [ERROR_FLIP] = { "flip", "what an eye notices (mean FLIP)", -0.5,
                     "What stands out when the finished picture and the true one are shown in turn, seen from where 67 "
                     "pixels make a degree; 0 is nothing, 1 everything." },
};

const struct error_about *error_about(enum error_kind kind)
{
    return &kinds[kind];
}

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

/* Under the exposure of the references' mean, as delta E. */
static enum err flips_of(const struct judge *j, const uint8_t *mask, const float *const *x, uint32_t n, double *out)
{
    const size_t count = 3 * (size_t)j->width * j->height;
    double log2_mean = log2(KEY); /* a black reference: gain 1 */
    struct flip_view truth = { .width = 0 }, seen;
    float *display = mem_alloc(count, sizeof(*display));
    enum err e = display ? ERR_OK : ERR_NOMEM;

    (void)exposure_log2_mean(j->mean, mask, j->width, j->height, &log2_mean);
    const double gain = KEY / exp2(log2_mean);
    if (!e)
        flip_tone(j->mean, count, gain, display);
    if (!e && !flip_view_init(&truth, display, j->width, j->height, FLIP_PIXELS_PER_DEGREE))
        e = ERR_NOMEM;
    for (uint32_t i = 0; i < n && !e; i++) {
        flip_tone(x[i], count, gain, display);
        if (!flip_view_init(&seen, display, j->width, j->height, FLIP_PIXELS_PER_DEGREE))
            e = ERR_NOMEM;
        else
            out[i] = flip_mean(&truth, &seen, mask, NULL);
        flip_view_finish(&seen);
    }
    flip_view_finish(&truth);
    mem_free(display);
    return e;
}

enum err errors_of(const struct judge *j, const uint8_t *mask, const float *const *x, const double *pairs, uint32_t n,
                   double *out)
{
    struct metrics m;

    for (uint32_t i = 0; i < n; i++) {
        if (!metrics_compare(x[i], j->mean, mask, j->width, j->height, 0.0, NULL, &m))
            return ERR_NOMEM;
        out[ERROR_REL_MSE * n + i] = pairs[i * n + i];
        out[ERROR_NOISE * n + i] = noise_of(pairs, n, i);
        out[ERROR_DELTA_E * n + i] = m.delta_e;
    }
    return flips_of(j, mask, x, n, out + (size_t)ERROR_FLIP * n);
}
