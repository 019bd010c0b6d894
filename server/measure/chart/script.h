/* The Python script that makes pages and tables of what a program measures (server/measure/scripts). One thread. */
#pragma once

#include "base/err.h"

#include <jansson.h>
#include <sys/types.h>

struct script {
    const char *name;
    pid_t pid; /* 0: not started */
    int socket;
};

/* Starts the script `name`, which lies in relight-scripts beside the programs; its standard input is a socket to this
 * process. argument: may be NULL. ERR_IO: it is not there, or there is no python3. */
MUST_CHECK enum err script_start(struct script *s, const char *name, const char *argument, struct reason *why);

/* Sends a line of JSON and returns when the script has done its work with it, which would disturb a measurement. Takes
 * the reference to `what`. ERR_IO: what the script says; ERR_NOMEM: also where `what` is NULL. */
MUST_CHECK enum err script_tell(struct script *s, json_t *what, struct reason *why);

void script_end(struct script *s); /* waits for its end; zeroed memory is allowed */

/* null for NaN and infinities. Owned by the caller. */
json_t *script_number(double v);

/* Threads, build and kernels of a measurement, without which times mean nothing. level: of the kernels. Owned by the
 * caller. */
json_t *script_machine(int threads, const char *level);
