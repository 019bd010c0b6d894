/* server/base/threads.h */
/* OpenMP's wait policy. Thread: main. */
#ifndef BASE_THREADS_H
#define BASE_THREADS_H

/* OpenMP's idle threads spin by default and take processors from other work. The library reads OMP_WAIT_POLICY when it
 * is loaded, so it must be set before the program starts: sets it and re-executes the program, unless the user has set
 * it. Call it first in main, with its argv. */
void threads_wait_passively(char **argv);

#endif
