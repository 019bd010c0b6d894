/* Decides whether `auto` uses the cache of light transport (transport/transport.h), which costs much once and little
 * per frame, and is biased: never unless its bias is allowed (--allow-bias), and never for an error below it. Pure
 * functions; any thread.
 *
 *     break-even, in frames = precomputation / (a frame without the cache - a frame with it)
 *
 * By counts the number of frames does not matter, so that a picture never depends on it. By the clock, a known number
 * of frames is compared with that. For an unknown number the cache is computed once as much time has gone into frames
 * as it takes: the total is then at most twice the optimum [Karlin et al. 1988]. Or once as many frames came as would
 * have taken that time with 64 samples: with fewer samples, a frame by the cache takes about as long and is far better.
 *
 * Where bits must not depend on a clock, everything is counted in light samples per point, whose relative times hardly
 * depend on the machine: the cache of direct light takes as long as 2048 (measured: 1920 under an overcast sky, 2210 at
 * noon), that of interreflection as 1250 more, a frame by the cache as 4, and eye paths as the samples beside them. */
#ifndef CHOOSE_BUY_H
#define CHOOSE_BUY_H

#include <stdbool.h>
#include <stdint.h>

#define BUY_SAMPLES 2048.0
#define BUY_SAMPLES_INDIRECT 1250.0
#define BUY_FRAME_SAMPLES 4.0
#define BUY_GOOD_SAMPLES 64.0
#define BUY_MADE 4 /* frames before the clock decides */

/* relMSE of the cache's bias, and of N samples, which is BUY_NOISE / N; for direct light, and with interreflection
 * (docs/internals/transport-cache.md). */
#define BUY_BIAS 4.5e-4
#define BUY_BIAS_INDIRECT 1e-2
#define BUY_BIAS_COARSE 3e-3 /* of its coarse blocks, direct light alone */
#define BUY_NOISE 0.3
#define BUY_NOISE_INDIRECT 4.0

struct buy_facts {
    uint64_t frames; /* by the clock: still to come; 0: unknown */
    double allowed;  /* relMSE of a bias that is allowed; 0: none */
    bool indirect;   /* interreflection is requested, and the cache has it too */
    /* By counts. */
    uint32_t samples; /* N_s of a frame without the cache */
    /* By the clock. */
    uint64_t points;
    double error;    /* relMSE that is requested, else estimated; 0: unknown */
    double sample_s; /* seconds per light sample of a point */
    double frame_s;  /* seconds per frame without the cache */
    double spent_s;  /* on frames so far */
    uint64_t made;   /* frames so far */
};

struct buy {
    bool yes;
    double break_even; /* frames; 0: it never pays */
    double build_s;    /* by the clock: expected seconds of the precomputation */
    const char *why;   /* a phrase; static */
};

/* Whether the cache's bias is allowed. */
bool buy_is_allowed(const struct buy_facts *f);

/* Whether it is, and a picture of this error may have it. */
bool buy_suits(const struct buy_facts *f);

/* By counts of samples: no clock decides. By the clock: from measured frames. Both fill *out. */
void buy_by_counts(const struct buy_facts *f, struct buy *out);
void buy_by_clock(const struct buy_facts *f, struct buy *out);

#endif
