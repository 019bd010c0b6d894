/* This process and its system: what it uses, the threads it may start, what it tells the service manager. Resource
 * usage is as the system reports it. Thread: any. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stdint.h>

/* A value that could not be determined is -1. */
struct process_usage {
    int64_t resident_bytes, virtual_bytes;
    int64_t open_files, max_files; /* descriptors; max_files 0: no limit */
    int64_t threads;
    double processor_s;
    double started_s; /* seconds since 1970-01-01 UTC */
};

void process_usage(struct process_usage *out); /* reads the current values */

/* The number of descriptors, at most `wanted`, that the process may use for connections besides its other files. Logs
 * a warning if that is fewer. */
uint32_t process_connections_allowed(uint32_t wanted);

/* ---- Threads ---- */

/* Prepares the threads of libraries (OpenMP, TBB, OpenBLAS) and tests whether the system can start them. */

/* OpenMP's idle threads spin by default and take processors from other work, OpenBLAS starts threads that nobody needs,
 * and malloc takes small pages, whose tables cost a good part of a frame. These libraries read OMP_WAIT_POLICY,
 * OPENBLAS_NUM_THREADS and GLIBC_TUNABLES when they are loaded: unless the user has set them, this sets them and
 * executes the program again. A program that contains a call does so before any library starts, and where sanitizers
 * forbid that, in the call, which must be the first in main. */
void process_settle(char **argv);

/* Whether `count` more threads can run, which is tested by starting and ending them: OpenMP and TBB abort the program
 * if a thread cannot be started. *why names the limit. Any thread. */
MUST_CHECK bool threads_can_start(unsigned count, struct reason *why);

/* ---- The service manager ---- */

/* Status messages to the service manager, as systemd's sd_notify(3): one datagram to the socket named by NOTIFY_SOCKET.
 * Does nothing if the variable is unset or no one listens. Thread: any. */

/* Whether a service manager expects messages. */
bool notify_enabled(void);

/* Sends a message such as "READY=1\nSTATUS=...", formatted as by printf. False if it could not be sent. */
bool notify_send(const char *format, ...) PRINTF_LIKE(1, 2);

/* The interval within which WATCHDOG=1 must be sent repeatedly, in microseconds; 0 if the watchdog is off. */
uint64_t notify_watchdog_us(void);
