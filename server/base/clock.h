/* Clocks: monotonic time and calendar time. The rooms that compute light must not include this header. Thread: any. */
#pragma once

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

int64_t clock_ms(void);          /* monotonic, milliseconds since an arbitrary start */
double clock_seconds(void);      /* monotonic, seconds */
double clock_boot_seconds(void); /* seconds since boot, suspend included */
double clock_processor(void);    /* processor time of all threads of this process, seconds */

/* The largest time that PROTOCOL.md 1.5 allows: in the year 2255. */
#define CLOCK_WALL_MAX_US ((INT64_C(1) << 53) - 1)
/* Microseconds since 1970-01-01 UTC, within plus or minus CLOCK_WALL_MAX_US; may step. */
int64_t clock_wall_us(void);

/* A condition for clock_wait; pthread_cond_destroy ends it. */
void clock_condition(pthread_cond_t *c);
/* Waits for it, as pthread_cond_wait does; false: clock_ms() has come to until_ms. */
bool clock_wait(pthread_cond_t *c, pthread_mutex_t *lock, int64_t until_ms);
