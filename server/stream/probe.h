/* Questions about pixels (PROTOCOL.md 4.15 to 4.17): which wait to be taken, which answers wait to be told, and which
 * pixels are followed from picture to picture. All of it is guarded by the server's lock. */
#ifndef STREAM_PROBE_H
#define STREAM_PROBE_H

#include "err.h"
#include "server.h"

#define PROBES_WAITING 8
#define PROBES_ANSWERS 8
#define PROBES_RATE 4.0  /* answers a second that the server gives in the long run, to all together; */
#define PROBES_BURST 8.0 /* so many at once */

struct probe_words {
    uint64_t by, request;
    bool sky_alone;
    char *text; /* the answer's fields; NULL: there is none, since */
    char error[sizeof(struct reason)];
};

struct probe_followed {
    struct server_follow pixel;
    struct server_radiance radiance;
    bool due; /* not told yet */
};

struct probes {
    struct server_probe waiting[PROBES_WAITING];
    unsigned waiting_count;
    struct probe_words answers[PROBES_ANSWERS]; /* to be told; when full the oldest goes */
    unsigned answer_count;
    struct probe_followed followed[SERVER_FOLLOWED_MAX];
    unsigned followed_count;
    double tokens;
    int64_t tokens_us; /* 0: never used */
};

void probes_finish(struct probes *p);

#endif
