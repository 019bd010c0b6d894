/* Prepares the threads of libraries (OpenMP, TBB, OpenBLAS) and tests whether the system can start them. */
#pragma once

#include "base/err.h"

#include <stdbool.h>

/* OpenMP's idle threads spin by default and take processors from other work, and OpenBLAS starts threads that nobody
 * needs. Both libraries read OMP_WAIT_POLICY and OPENBLAS_NUM_THREADS when they are loaded: unless the user has set
 * them, sets them and executes the program again. A program that contains a call does this before any library starts,
 * and where sanitizers forbid that, in the call, which must be the first in main. */
void threads_wait_passively(char **argv);

/* Whether `count` more threads can run, which is tested by starting and ending them: OpenMP and TBB abort the program
 * if a thread cannot be started. *why names the limit. Any thread. */
MUST_CHECK bool threads_can_start(unsigned count, struct reason *why);
