/* server/film/tone_loop.h */
/* The reference loop of tone_kernel.h, compiled once per CPU level. Private to this room. */
#ifndef FILM_TONE_LOOP_H
#define FILM_TONE_LOOP_H

#include "film/tone_kernel.h"

#include <string.h>

#define INDEX_BIT 22 /* lowest bit of a float's half-octave index */
#define PLACE 0x003fff00u
#define PLACE_MIDDLE 0x00000080u
#define ONE 0x3f800000u

static inline void tone_loop(const struct tone_table *restrict t, const float *restrict in, size_t count, float gain,
                             uint8_t *restrict out)
{
    for (size_t i = 0; i < count; i++) {
        /* The comparisons are written so that NaN fails the first one and yields the lowest value. */
        const float exposed = in[i] * gain;
        const float floored = exposed > TONE_LOWEST ? exposed : TONE_LOWEST;
        const float x = floored < TONE_HIGHEST ? floored : TONE_HIGHEST;
        uint32_t bits, place;
        float u;
        memcpy(&bits, &x, sizeof(bits));
        place = (bits & PLACE) | PLACE_MIDDLE | ONE;
        memcpy(&u, &place, sizeof(u));
        u -= 1.25f;
        const uint32_t s = bits >> INDEX_BIT & (TONE_SEGMENTS - 1);
        const float y = ((t->c[3][s] * u + t->c[2][s]) * u + t->c[1][s]) * u + t->c[0][s];
        out[i] = (uint8_t)(int32_t)(y < 255.5f ? y : 255.5f);
    }
}

#endif
