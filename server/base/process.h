/* Resource usage of this process, as the system reports it. Thread: any. */
#pragma once

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
