/* Status messages to the service manager, as systemd's sd_notify(3): one datagram to the socket named by NOTIFY_SOCKET.
 * Does nothing if the variable is unset or no one listens. Thread: any. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stdint.h>

/* Whether a service manager expects messages. */
bool notify_enabled(void);

/* Sends a message such as "READY=1\nSTATUS=...", formatted as by printf. False if it could not be sent. */
bool notify_send(const char *format, ...) PRINTF_LIKE(1, 2);

/* The interval within which WATCHDOG=1 must be sent repeatedly, in microseconds; 0 if the watchdog is off. */
uint64_t notify_watchdog_us(void);
