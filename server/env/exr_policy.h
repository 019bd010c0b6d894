/* server/env/exr_policy.h */
/* Which EXR files may be decoded when they came over a network. The decoders of the other compressions are large, old
 * and have had faults: confined as decoding is (decoder.h), a stranger still does not get to choose them.
 * Reads the header itself, without the library that it is to protect: every step is checked against `size`, nothing is
 * allocated, and the time it takes is bounded by EXR_POLICY_ATTRIBUTES. Any thread. */
#ifndef ENV_EXR_POLICY_H
#define ENV_EXR_POLICY_H

#include "err.h"

#include <stddef.h>
#include <stdint.h>

#define EXR_POLICY_ATTRIBUTES 1024 /* the most that a header may have */

/* ERR_OK: one part, scanlines, and no, RLE, ZIPS or ZIP compression. ERR_UNSUPPORTED: whole, but not that: *why names
 * what it is. ERR_FORMAT: not an EXR file, damaged or cut short within its header. What follows the header is not
 * looked at. `name` begins the reason. */
MUST_CHECK enum err exr_policy_check(const uint8_t *bytes, size_t size, const char *name, struct reason *why);

#endif
