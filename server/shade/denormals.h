/* server/shade/denormals.h */
/* Denormals cost a hundred cycles each and light nothing: flushed, in every thread alike, so that bits agree. */
#ifndef SHADE_DENORMALS_H
#define SHADE_DENORMALS_H

#ifdef __x86_64__
#include <pmmintrin.h>
#endif

/* Flushes them in this thread from now on; returns what denormals_restore takes back. */
static inline unsigned denormals_flush(void)
{
#ifdef __x86_64__
    const unsigned before = _mm_getcsr();
    _mm_setcsr(before | 0x8040); /* FTZ and DAZ */
    return before;
#else
    return 0;
#endif
}

static inline void denormals_restore(unsigned before)
{
#ifdef __x86_64__
    _mm_setcsr(before);
#else
    (void)before;
#endif
}

#endif
