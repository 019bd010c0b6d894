/* Whether `auto` takes the cache of light transport (transport/transport.h), which costs much once and little a frame.
 * Never for a single frame; never where a better picture was asked for than its bias allows. Pure functions; any
 * thread.
 *
 *     break-even, in frames = its computation / (a frame by other means - a frame by the cache)
 *
 * Where the number of frames is known, it is taken when they are more. Where it is not, it is computed once as much
 * time has gone into frames as it takes: then whatever comes costs at most twice what it would have cost to know it
 * beforehand [Karlin et al. 1988]. Or once as many frames were made as would have cost that with 64 samples: who makes
 * do with fewer, for want of time, gets a frame of the cache in about the same time, and it is far better.
 *
 * Where bits must not depend on a clock all is counted in light samples a point, whose time is much the same on any
 * machine: 2048 of them take as long as the cache of direct light (measured: 1920 under an overcast sky, 2210 at noon),
 * 1250 more as long as that of interreflection, and 4 as long as a frame. Eye paths are taken to take as long again as
 * the samples with which they come. */
#ifndef CHOOSE_BUY_H
#define CHOOSE_BUY_H

#include <stdbool.h>
#include <stdint.h>

#define BUY_SAMPLES 2048.0
#define BUY_SAMPLES_INDIRECT 1250.0
#define BUY_FRAME_SAMPLES 4.0
#define BUY_GOOD_SAMPLES 64.0
#define BUY_LOAD_SHARE 0.01 /* of its computation, to load it */
#define BUY_MADE 4          /* frames, before a clock is believed; a file is looked for after one */

/* relMSE of the cache against what is right, and of N samples, which is this / N; each of direct light alone, and with
 * interreflection (docs/transport-cache.md). */
#define BUY_BIAS 4.5e-4
#define BUY_BIAS_INDIRECT 1e-2
#define BUY_BIAS_COARSE 3e-3 /* of its coarse blocks, direct light alone */
#define BUY_NOISE 0.3
#define BUY_NOISE_INDIRECT 4.0

struct buy_facts {
    uint64_t frames; /* by counts: all; by the clock: still to come. 0: unknown */
    bool indirect;   /* interreflection is asked for, and the cache has it too */
    bool kept;       /* in a file: loading it is all that it takes */
    /* By counts. */
    uint32_t samples; /* N_s of a frame by other means */
    /* By the clock. */
    uint64_t points;
    double error;    /* relMSE that was wished for or, where none was, as estimated; 0: unknown */
    double sample_s; /* seconds a light sample of a point */
    double frame_s;  /* seconds a frame, by other means */
    double spent_s;  /* on frames, so far */
    uint64_t made;   /* frames, so far */
};

struct buy {
    bool yes;
    double break_even; /* frames; 0: it never pays */
    double build_s;    /* by the clock: what its computation is expected to take */
    const char *why;   /* a phrase, what decided */
};

void buy_by_counts(const struct buy_facts *f, struct buy *out);
void buy_by_clock(const struct buy_facts *f, struct buy *out);

#endif
