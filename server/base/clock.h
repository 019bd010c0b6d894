/* server/base/clock.h */
/* Time that never steps back (CLOCK_MONOTONIC), and the calendar's. Not for server/shade, which knows no clock. */
#ifndef BASE_CLOCK_H
#define BASE_CLOCK_H

#include <stdint.h>

int64_t clock_ms(void);          /* monotonic, milliseconds since an arbitrary start */
double clock_seconds(void);      /* monotonic, seconds */
double clock_boot_seconds(void); /* since the machine was switched on, its sleep included */
double clock_processor(void);    /* seconds of all threads of this process on processors */
int64_t clock_wall_us(void);     /* since 1970-01-01 UTC, microseconds; may step */

#endif
