#include "base/rng.h"

static uint64_t reverse_bits(uint64_t x)
{
    x = ((x >> 1) & 0x5555555555555555u) | ((x & 0x5555555555555555u) << 1);
    x = ((x >> 2) & 0x3333333333333333u) | ((x & 0x3333333333333333u) << 2);
    x = ((x >> 4) & 0x0f0f0f0f0f0f0f0fu) | ((x & 0x0f0f0f0f0f0f0f0fu) << 4);
    return __builtin_bswap64(x);
}

/* The second Sobol dimension. Its direction numbers, of the polynomial 1 + x, are the rows of Pascal's triangle modulo
 * 2, so that each follows from the previous one. */
static uint64_t sobol_second(uint32_t index)
{
    uint64_t v = (uint64_t)1 << 63, x = 0;
    for (; index; index >>= 1, v ^= v >> 1)
        if (index & 1)
            x ^= v;
    return x;
}

/* Flips each bit by a random bit that depends on the seed and all higher bits. */
static uint64_t owen_scramble(uint64_t x, uint64_t seed)
{
    uint64_t flips = rng_hash(seed) & ((uint64_t)1 << 63);
    for (int bit = 62; bit > 10; bit--) {
        const uint64_t above = x >> (bit + 1);
        const uint64_t node = above | ((uint64_t)1 << (63 - bit)); /* the leading 1 distinguishes depths */
        flips |= (rng_mix(seed, node) & 1) << bit;
    }
    return x ^ flips;
}

void rng_sobol2(uint64_t seed, uint32_t index, double out[2])
{
    out[0] = rng_unit(owen_scramble(reverse_bits(index), rng_mix(seed, 1)));
    out[1] = rng_unit(owen_scramble(sobol_second(index), rng_mix(seed, 2)));
}

uint32_t rng_shuffled(uint64_t seed, uint32_t index)
{
    double x[2];

    rng_sobol2(seed, (uint32_t)(reverse_bits(index) >> 32), x);
    return (uint32_t)(x[0] * 0x1p32);
}
