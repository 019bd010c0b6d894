/* Queries about pixels (PROTOCOL.md 4.15 to 4.17): pending queries, unsent answers, and pixels followed from image to
 * image. Guarded by the server's lock. */
#pragma once

#include "base/err.h"
#include "net/stream/limits.h"
#include "net/stream/server.h"

#define INSPECTIONS_WAITING 8
#define INSPECTIONS_ANSWERS 8
#define INSPECTIONS_RATE 4.0  /* answers per second, for all clients together: a token bucket */
#define INSPECTIONS_BURST 8.0 /* its size */

struct inspect_reply {
    uint64_t by, request;
    bool sky_alone;
    char *text; /* the answer's fields; NULL: none, because of */
    char error[sizeof(struct reason)];
};

struct inspect_followed {
    struct server_follow pixel;
    struct server_radiance radiance;
    bool due; /* not sent yet */
};

struct inspections {
    struct server_inspection waiting[INSPECTIONS_WAITING];
    unsigned waiting_count;
    struct inspect_reply answers[INSPECTIONS_ANSWERS]; /* to send; when full, the oldest is dropped */
    unsigned answer_count;
    struct inspect_followed followed[SERVER_FOLLOWED_MAX];
    unsigned followed_count;
    struct bucket questions;
};

/* Frees the unsent answers; zeroed memory is allowed. Thread: the owner's, when no other thread uses p. */
void inspections_finish(struct inspections *p);
