/* Denormals take a hundred cycles and contribute no visible light. They are flushed to zero in every thread, so that
 * results agree. Thread: affects the calling thread only. */
#pragma once

#ifdef __x86_64__
#include <pmmintrin.h>
#endif

/* Enables flushing; returns the state for denormals_restore. */
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
