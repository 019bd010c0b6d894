/* Decides whether `auto` uses the light transport cache (light/cache_direct/transport.h), which has a high initial
 * cost, a low cost per frame, and a bias. It is never used unless its bias is allowed (--allow-bias), and never for a
 * target error below the bias. Pure functions. Thread: any.
 *
 *     break-even, in frames = precomputation / (a frame without the cache - a frame with it)
 *
 * With sample counts the number of frames has no influence, so an image never depends on it. By the clock, a known
 * number of frames is compared with the break-even. With an unknown number, the cache is computed once frames have
 * taken as much time as the cache would: the total is then at most twice the optimum [Karlin et al. 1988]. It is also
 * computed after as many frames as would take that time with 64 samples: with fewer samples, a frame with the cache
 * takes about as long and is far more accurate.
 *
 * If the bits must not depend on a clock, times are measured in light samples per point, whose relative costs hardly
 * depend on the machine: the cache of direct light costs 2048 (measured: 1920 under an overcast sky, 2210 at noon), the
 * cache of indirect light 1250 more, a frame with the cache 4, and eye paths as much as the light samples of the same
 * frame. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

#define COST_SAMPLES 2048.0          /* measured: see above */
#define COST_SAMPLES_INDIRECT 1250.0 /* likewise */
#define COST_FRAME_SAMPLES 4.0       /* likewise */
#define COST_GOOD_SAMPLES 64.0       /* of a frame that needs no more */
#define COST_MADE 4                  /* frames before the decision by the clock */

/* relMSE of the cache's bias, and of N samples, which is COST_NOISE / N; for direct light and with indirect light
 * (docs/internals/transport-cache.md). */
#define COST_BIAS 4.5e-4
#define COST_BIAS_INDIRECT 1e-2
#define COST_BIAS_COARSE 3e-3 /* of its coarse blocks, direct light only */
#define COST_NOISE 0.3
#define COST_NOISE_INDIRECT 4.0

struct cost_facts {
    uint64_t frames; /* by the clock: remaining frames; 0: unknown */
    double allowed;  /* relMSE of the allowed bias; 0: none */
    bool indirect;   /* indirect light is requested; the cache includes it */
    /* With sample counts. */
    uint32_t samples; /* N_s of a frame without the cache */
    /* By the clock. */
    uint64_t points;
    double error;    /* requested or else estimated relMSE; 0: unknown */
    double sample_s; /* seconds per light sample of a point */
    double frame_s;  /* seconds per frame without the cache */
    double spent_s;  /* on frames so far */
    uint64_t made;   /* frames so far */
};

struct cost_verdict {
    bool yes;
    double break_even; /* frames; 0: the cache never pays off */
    double build_s;    /* by the clock: expected seconds of the precomputation */
    const char *why;   /* a phrase; static */
};

/* Whether the cache's bias is allowed. */
bool cost_allows_cache(const struct cost_facts *f);

/* Whether it is, and the target error permits it. */
bool cost_suits_cache(const struct cost_facts *f);

/* cost_by_counts uses sample counts and no clock; cost_by_clock uses measured frames. Both fill *out. */
void cost_by_counts(const struct cost_facts *f, struct cost_verdict *out);
void cost_by_clock(const struct cost_facts *f, struct cost_verdict *out);
