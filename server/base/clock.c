#include "base/clock.h"

#include <time.h>

static int64_t read_ns(clockid_t id)
{
    struct timespec t;
    clock_gettime(id, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

int64_t clock_ms(void)
{
    return read_ns(CLOCK_MONOTONIC) / 1000000;
}

double clock_seconds(void)
{
    return (double)read_ns(CLOCK_MONOTONIC) * 1e-9;
}

double clock_boot_seconds(void)
{
    return (double)read_ns(CLOCK_BOOTTIME) * 1e-9;
}

double clock_processor(void)
{
    return (double)read_ns(CLOCK_PROCESS_CPUTIME_ID) * 1e-9;
}

int64_t clock_wall_us(void)
{
    struct timespec t;

    clock_gettime(CLOCK_REALTIME, &t);
    if (t.tv_sec >= CLOCK_WALL_MAX_US / 1000000) /* multiplying first could overflow */
        return CLOCK_WALL_MAX_US;
    if (t.tv_sec <= -(CLOCK_WALL_MAX_US / 1000000))
        return -CLOCK_WALL_MAX_US;
    return (int64_t)t.tv_sec * 1000000 + t.tv_nsec / 1000;
}

void clock_condition(pthread_cond_t *c)
{
    pthread_condattr_t monotonic;

    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(c, &monotonic);
    pthread_condattr_destroy(&monotonic);
}

bool clock_wait(pthread_cond_t *c, pthread_mutex_t *lock, int64_t until_ms)
{
    const struct timespec until = { .tv_sec = until_ms / 1000, .tv_nsec = until_ms % 1000 * 1000000 };

    return pthread_cond_timedwait(c, lock, &until) == 0;
}
