/* One harness per parser: feeds it any bytes and aborts if it violates its header. Called by libFuzzer with generated
 * inputs and by replay with the corpus. */
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

/* libFuzzer's entry point. Always 0: keeps every input in the corpus. */
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static inline void require(int holds, const char *what)
{
    if (holds)
        return;
    fprintf(stderr, "broken promise: %s\n", what);
    abort();
}
