/* tests/fuzz/harness.h */
/* One harness per parser: feeds it any bytes and aborts when it breaks what its header promises. libFuzzer calls it
 * with what it invents, replay with the files of the corpus. */
#ifndef TESTS_FUZZ_HARNESS_H
#define TESTS_FUZZ_HARNESS_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

/* libFuzzer's name for it. Always 0: the input is of interest whatever came of it. */
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static inline void require(int holds, const char *what)
{
    if (holds)
        return;
    fprintf(stderr, "broken promise: %s\n", what);
    abort();
}

#endif
