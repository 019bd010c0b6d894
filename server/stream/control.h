/* server/stream/control.h */
/* What controllers have asked for and what is in force. All of it is guarded by the server's lock. */
#ifndef STREAM_CONTROL_H
#define STREAM_CONTROL_H

#include "err.h"
#include "server.h"

#define CONTROL_WAITING 16 /* changes asked for and not taken; further ones are joined to the last */
#define CONTROL_ANSWERS 32

struct control_answer {
    uint64_t by, request;
    char error[sizeof(struct reason)]; /* "": it was done */
    const char *clause;
};

struct control {
    struct server_control waiting[CONTROL_WAITING];
    unsigned waiting_count;
    struct control_answer answers[CONTROL_ANSWERS]; /* to be told; when full the oldest goes */
    unsigned answer_count;
    char *shared;         /* what is in force, see message_control_shared; NULL before anybody said */
    uint64_t version;     /* rises with each change */
    uint64_t by, request; /* of the last change */
};

/* Takes the lock itself. Any thread. */
void control_ask(struct server *s, const struct server_control *c);

#endif
