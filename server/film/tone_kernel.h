/* server/film/tone_kernel.h */
/* From exposed light to code values, by tables made for one curve: what film.h's tone_map spends its time in. Inside
 * this room and for its tests and benchmarks. Any thread. */
#ifndef FILM_TONE_KERNEL_H
#define FILM_TONE_KERNEL_H

#include "film.h"

#include <stddef.h>
#include <stdint.h>

/* Light in 32 half octaves from 1.5e-4, below which the code is 0, to 9.8, from where on it is 255, each a cubic of the
 * place within it. With x = light * gain * TONE_SCALE clamped to [2^-13, 2^3), the curve's bits are the float's own:
 * the last bit of its exponent and the first of its mantissa tell the half octave, the next 14 the place u in
 * [-1/4, 1/4), the middle of 2^-14 th parts; the rest is dropped, so that a curve has no more than 2^19 different
 * inputs. Code = floor(c0 + u (c1 + u (c2 + u c3))), a half for rounding being in c0. */
#define TONE_SEGMENTS 32
#define TONE_LOWEST 0x1p-13f
#define TONE_HIGHEST 0x1.fffffep2f
#define TONE_SCALE (0x1p-13 / 1.5e-4)

struct tone_table {
    _Alignas(64) float c[4][TONE_SEGMENTS]; /* by bits 22 to 26 of the float */
};

/* curve: TONE_FILMIC or TONE_LINEAR. */
void tone_table_fill(struct tone_table *t, enum tone_curve curve);

struct tone_kernel {
    const char *level; /* as base/cpu.h names them; "baseline" everywhere */
    /* out[i] = code of in[i]. gain: TONE_SCALE is in it. NaN is 0, infinity 255. No overlap, any alignment, count may
     * be 0. Bit-exact with tone_ref. */
    void (*codes)(const struct tone_table *t, const float *in, size_t count, float gain, uint8_t *out);
};

/* That of a level's name, as --cpu has it; the best that this CPU has where that is NULL or a level it lacks. */
const struct tone_kernel *tone_kernel_select(const char *level);

/* All that this CPU has, the reference first, ended by NULL: for tests. */
const struct tone_kernel *const *tone_kernels_all(void);

/* The specification. */
void tone_ref(const struct tone_table *t, const float *in, size_t count, float gain, uint8_t *out);

#ifdef __x86_64__
void tone_v3(const struct tone_table *t, const float *in, size_t count, float gain, uint8_t *out); /* AVX2 */
void tone_v4(const struct tone_table *t, const float *in, size_t count, float gain, uint8_t *out); /* AVX-512 */
#endif

#endif
