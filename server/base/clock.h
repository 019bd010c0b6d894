/* server/base/clock.h */
/* Clocks: monotonic time and calendar time. The rooms that compute light must not include this header. Thread: any. */
#ifndef BASE_CLOCK_H
#define BASE_CLOCK_H

#include <stdint.h>

int64_t clock_ms(void);          /* monotonic, milliseconds since an arbitrary start */
double clock_seconds(void);      /* monotonic, seconds */
double clock_boot_seconds(void); /* seconds since boot, suspend included */
double clock_processor(void);    /* processor time of all threads of this process, seconds */
int64_t clock_wall_us(void);     /* microseconds since 1970-01-01 UTC; may step */

#endif
