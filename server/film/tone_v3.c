#include "film/tone_loop.h"

/* The reference loop, vectorised by the compiler with AVX2 gathers of four floats. */
void tone_v3(const struct tone_table *t, const float *in, size_t count, float gain, uint8_t *out)
{
    tone_loop(t, in, count, gain, out);
}
