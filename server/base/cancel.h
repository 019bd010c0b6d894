/* Cancels long computations: the owner sets a flag from any thread, and the computation checks it now and then. */
#pragma once

#include <stdatomic.h>
#include <stdbool.h>

/* False for NULL: such work cannot be cancelled. Relaxed: nothing else is published by the flag. Any thread. */
static inline bool is_cancelled(const atomic_bool *cancel)
{
    return cancel && atomic_load_explicit(cancel, memory_order_relaxed);
}
