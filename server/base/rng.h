/* server/base/rng.h */
/* Random numbers that are functions of their counters: the same seed, pass and index give the same number in any
 * thread and order. */
#ifndef BASE_RNG_H
#define BASE_RNG_H

#include <stdint.h>

/* A bijection of 64 bits that scatters well: the finaliser of SplitMix64 [Steele, Lea and Flood 2014]. */
static inline uint64_t rng_hash(uint64_t x)
{
    x += 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
}

/* A stream's own number out of two: not symmetric in a and b. */
static inline uint64_t rng_mix(uint64_t a, uint64_t b)
{
    return rng_hash(rng_hash(a) ^ (b + 0x632be59bd9b4e019u));
}

/* 53 bits of x as a double in [0, 1). */
static inline double rng_unit(uint64_t x)
{
    return (double)(x >> 11) * 0x1p-53;
}

/* A sequential stream: state may be any value, one stream per rng_mix of seed and index. */
struct rng {
    uint64_t state;
};

static inline double rng_next(struct rng *r)
{
    r->state += 0x9e3779b97f4a7c15u;
    return rng_unit(rng_hash(r->state));
}

/* Point `index` of the two-dimensional Sobol sequence, each coordinate under its own nested uniform (Owen) scramble
 * of 53 bits drawn from `seed` [Sobol' 1967; Owen 1995]. Every point alone is uniform over the seeds, every prefix of
 * 2^k points is a (0, k, 2)-net in base 2: a progressive sequence. out in [0, 1). */
void rng_sobol2(uint64_t seed, uint32_t index, double out[2]);

#endif
