/* perf_event_open has no wrapper in the C library. */
#define _GNU_SOURCE
#include "bench/bench_parts.h"

#include <string.h>

#ifdef __linux__
#include <linux/perf_event.h>
#include <sys/syscall.h>
#include <unistd.h>

bool instructions_of(enum err (*work)(void *), void *context, uint64_t *out)
{
    struct perf_event_attr a;
    uint64_t before = 0, after = 0;

    memset(&a, 0, sizeof(a));
    a.size = sizeof(a);
    a.type = PERF_TYPE_HARDWARE;
    a.config = PERF_COUNT_HW_INSTRUCTIONS;
    a.exclude_kernel = 1;
    a.exclude_hv = 1;
    const int fd = (int)syscall(SYS_perf_event_open, &a, 0, -1, -1, 0);
    if (fd < 0)
        return false;
    const bool began = read(fd, &before, sizeof(before)) == sizeof(before);
    const enum err e = work(context);
    const bool ended = read(fd, &after, sizeof(after)) == sizeof(after);
    close(fd);
    *out = after - before;
    return began && ended && !e && after > before;
}

#else

bool instructions_of(enum err (*work)(void *), void *context, uint64_t *out)
{
    (void)work, (void)context, (void)out;
    return false;
}

#endif
