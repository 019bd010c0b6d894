/* server/base/threads.h */
/* How OpenMP's threads wait for each other. Main thread. */
#ifndef BASE_THREADS_H
#define BASE_THREADS_H

/* OpenMP's waiting threads spin by default and take the processors from whatever else runs. The library reads the
 * variable that says otherwise as it is loaded, so that it must stand before the program begins: sets it and starts the
 * program anew, unless the user has set it. Called first in a main, with its argv. */
void threads_wait_passively(char **argv);

#endif
