/* Cryptomatte [Friedman and Jones 2015], specification 1.2.0: a name becomes a 32-bit number by MurmurHash3, the number
 * a float, and a pixel holds pairs of such floats and their coverage, in descending order. Functions of their
 * arguments, any thread. */
#pragma once

#include "base/err.h"

#include <stddef.h>
#include <stdint.h>

/* MurmurHash3_x86_32 with seed 0. */
uint32_t cryptomatte_hash(const char *name);

/* The name's id. Bits that would make it a NaN, an infinity or a denormal are changed. */
float cryptomatte_id(const char *name);

/* The header attributes of one layer, such as "CryptoObject". Free with cryptomatte_finish. */
struct cryptomatte {
    char key[4][64]; /* cryptomatte/1a2b3c4/name, hash, conversion, manifest */
    const char *value[4];
    char *manifest; /* {"name":"id in hexadecimal",...}; each name once */
};

/* names: count of them, UTF-8, may repeat. layer is borrowed. ERR_NOMEM. */
MUST_CHECK enum err cryptomatte_init(struct cryptomatte *c, const char *layer, const char *const *names, size_t count);
void cryptomatte_finish(struct cryptomatte *c); /* zeroed memory is allowed */
