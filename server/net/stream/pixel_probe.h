/* Queries about pixels (PROTOCOL.md 4.15 to 4.17): pending queries, unsent answers, and pixels followed from picture to
 * picture. Guarded by the server's lock. */
#pragma once

#include "base/err.h"
#include "net/stream/server.h"

#define PROBES_WAITING 8
#define PROBES_ANSWERS 8
#define PROBES_RATE 4.0  /* answers per second, for all clients together: a token bucket */
#define PROBES_BURST 8.0 /* its size */

struct probe_reply {
    uint64_t by, request;
    bool sky_alone;
    char *text; /* the answer's fields; NULL: none, because of */
    char error[sizeof(struct reason)];
};

struct probe_followed {
    struct server_follow pixel;
    struct server_radiance radiance;
    bool due; /* not sent yet */
};

struct probes {
    struct server_probe waiting[PROBES_WAITING];
    unsigned waiting_count;
    struct probe_reply answers[PROBES_ANSWERS]; /* to send; when full, the oldest is dropped */
    unsigned answer_count;
    struct probe_followed followed[SERVER_FOLLOWED_MAX];
    unsigned followed_count;
    double tokens;
    int64_t tokens_us; /* 0: never used */
};

/* Frees the unsent answers; zeroed memory is allowed. Thread: the owner's, when no other thread uses p. */
void probes_finish(struct probes *p);
