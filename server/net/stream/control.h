/* Controllers' requests and the current settings. Guarded by the server's lock. */
#pragma once

#include "base/err.h"
#include "net/stream/server.h"

#define CONTROL_WAITING 16 /* pending requests */
#define CONTROL_ANSWERS 32

struct control_answer {
    uint64_t by, request;
    char error[sizeof(struct reason)]; /* "": success */
    const char *clause;
};

struct control {
    struct server_control waiting[CONTROL_WAITING];
    unsigned waiting_count;
    struct control_answer answers[CONTROL_ANSWERS]; /* to send; when full, the oldest is dropped */
    unsigned answer_count;
    char *shared;         /* the settings, see message_control_shared; NULL: unknown */
    uint64_t version;     /* increases with each change */
    uint64_t by, request; /* of the last change */
};

/* Queues a request, or merges it into the last one of the same controller. False: the queue is full. Takes the lock
 * itself. Any thread. */
MUST_CHECK bool control_ask(struct server *s, const struct server_control *c);
