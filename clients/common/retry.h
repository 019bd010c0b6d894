/* Decides what to do after a connection has ended: PROTOCOL.md section 8 as a table, and the back-off. Pure; any
 * thread. */
#pragma once

#include "base/rng.h"

#include <stdbool.h>

#define RETRY_FIRST_MS 500  /* the back-off of PROTOCOL.md, section 8 */
#define RETRY_MOST_MS 10000 /* also what "later" waits at least */
#define RETRY_JITTER 0.2

enum retry_when {
    RETRY_AGAIN, /* with back-off */
    RETRY_LATER, /* the same, but not before RETRY_MOST_MS */
    RETRY_NEVER, /* until a person or a program changes something */
};

struct retry_rule {
    enum retry_when when;
    bool refused;     /* the server does not want this client; else a fault, or an accident */
    const char *name; /* of the close code, as section 8 has it; for messages */
};

/* After a close frame with this code; 1006 for none. Codes that are not known here are tried again later. */
struct retry_rule retry_after_close(int code);

/* After a handshake that was answered with this HTTP status; 0 for no answer at all. */
struct retry_rule retry_after_status(int status);

/* How long to wait before try number `tries` (from 0) since the last success: 500 ms doubling up to 10 s, 20 % more or
 * less, so that many clients do not come back at the same moment. */
int retry_wait_ms(unsigned tries, enum retry_when when, struct rng *rng);
