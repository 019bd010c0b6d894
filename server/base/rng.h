/* Counter-based random numbers: the same seed, pass and index give the same number in any thread and any order. Thread:
 * any; one thread per struct rng. */
#pragma once

#include <stdint.h>

/* A well-mixing bijection of 64 bits: the finaliser of SplitMix64 [Steele, Lea and Flood 2014]. */
static inline uint64_t rng_hash(uint64_t x)
{
    x += 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
}

/* Combines two numbers into the seed of a stream; not symmetric in a and b. */
static inline uint64_t rng_mix(uint64_t a, uint64_t b)
{
    return rng_hash(rng_hash(a) ^ (b + 0x632be59bd9b4e019u));
}

/* The top 53 bits of x as a double in [0, 1). */
static inline double rng_unit(uint64_t x)
{
    return (double)(x >> 11) * 0x1p-53;
}

/* A sequential stream. Any state is valid; seed one stream by rng_mix of seed and index. */
struct rng {
    uint64_t state;
};

static inline double rng_next(struct rng *r)
{
    r->state += 0x9e3779b97f4a7c15u;
    return rng_unit(rng_hash(r->state));
}

/* Point `index` of the two-dimensional Sobol sequence in [0, 1)^2, each coordinate under its own nested uniform (Owen)
 * scramble of 53 bits derived from `seed` [Sobol' 1967; Owen 1995]. Each point is uniform over the seeds; every prefix
 * of 2^k points is a (0, k, 2)-net in base 2, so the sequence is progressive. */
void rng_sobol2(uint64_t seed, uint32_t index, double out[2]);

/* A shuffled order of the sequence in which every aligned block of 2^k points remains a block, so that the pairs of
 * numbers a path takes from two sequences are independent, and each sequence remains progressive [Burley 2020]. */
uint32_t rng_shuffled(uint64_t seed, uint32_t index);
