/* From exposed light to code values by tables made for one curve: the inner loop of tone_map. Private to this room, its
 * tests and benchmarks. Thread: any. The caller owns all arrays. */
#pragma once

#include "base/cpu.h"
#include "image/film/film.h"

#include <stddef.h>
#include <stdint.h>

/* Light from 1.5e-4, below which the code is 0, to 9.8, above which it is 255, is divided into 32 half octaves with a
 * cubic each. Let x = light * gain * TONE_SCALE, clamped to [2^-13, 2^3). The float's bits give everything: the last
 * exponent bit and the first mantissa bit select the half octave, the next 14 bits give u in [-1/4, 1/4) as the
 * midpoint of one of 2^14 intervals, and the rest is dropped. A curve thus has at most 2^19 different inputs. Code =
 * floor(c0 + u (c1 + u (c2 + u c3))); c0 includes 1/2 for rounding. */
#define TONE_SEGMENTS 32
#define TONE_LOWEST 0x1p-13f
#define TONE_HIGHEST 0x1.fffffep2f
#define TONE_SCALE (0x1p-13 / 1.5e-4)

struct tone_table {
    _Alignas(64) float c[4][TONE_SEGMENTS]; /* indexed by bits 22 to 26 of the float */
};

/* Computes the table of a curve: TONE_FILMIC or TONE_LINEAR. */
void tone_table_fill(struct tone_table *t, enum tone_curve curve);

struct tone_kernel {
    enum cpu_level cpu;
    /* out[i] = code value of in[i]. gain includes TONE_SCALE. NaN gives 0, infinity 255. Buffers must not overlap; any
     * alignment; count may be 0. The same bits at all levels. */
    void (*codes)(const struct tone_table *t, const float *in, size_t count, float gain, uint8_t *out);
};

/* The kernel of a CPU level by name (base/cpu.h); the best supported one if level is NULL or not supported. */
const struct tone_kernel *tone_kernel_select(const char *level);
