/* server/base/notify.h */
/* Words to the service manager that started this program, as sd_notify(3) of systemd speaks: one datagram to the socket
 * that the variable NOTIFY_SOCKET names. Without that variable, or where nobody listens, nothing happens. Any thread.
 */
#ifndef BASE_NOTIFY_H
#define BASE_NOTIFY_H

#include "err.h"

#include <stdbool.h>
#include <stdint.h>

/* Whether a service manager waits for words. */
bool notify_wanted(void);

/* "READY=1\nSTATUS=..." as a printf. False where it could not be said. */
bool notify_say(const char *format, ...) PRINTF_LIKE(1, 2);

/* Within how long WATCHDOG=1 has to come again and again, in microseconds; 0: nobody asks this process for it. */
uint64_t notify_watchdog_us(void);

#endif
