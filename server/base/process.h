/* What the system says of this process. Any thread. */
#ifndef BASE_PROCESS_H
#define BASE_PROCESS_H

#include <stdint.h>

/* What could not be found out is -1. */
struct process_usage {
    int64_t resident_bytes, virtual_bytes;
    int64_t open_files, most_files; /* descriptors; most_files 0: no limit */
    int64_t threads;
    double processor_s;
    double started_s; /* since 1970-01-01 UTC */
};

void process_usage(struct process_usage *out);

/* Of so many descriptors that somebody would like to hold, those that this process may have beside the rest of its
 * files; a warning where that is fewer. */
uint32_t process_files(uint32_t wanted);

#endif
