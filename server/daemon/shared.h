/* What the threads of relightd share. Everything else belongs to one thread: ingest.h, shade.h, encode.h,
 * housekeeping.h, service_manager.h. */
#ifndef DAEMON_SHARED_H
#define DAEMON_SHARED_H

#include "daemon/config.h"
#include "daemon/settings.h"
#include "daemon/slots.h"
#include "daemon/status.h"
#include "publish/publish.h"

#include <stdatomic.h>

/* The picture that is being made. The shade thread sets all but cancel, which the housekeeping thread sets. */
struct picture_watch {
    atomic_int_least64_t begun_ms; /* clock_ms; 0: none is being made */
    atomic_bool may_cancel;        /* a new setting may cancel it */
    atomic_bool cancel;
};

struct shared {
    /* Constant once the threads run. What the pointers show has locks of its own. */
    struct daemon_config config;
    struct server *server;
    struct ranks *ranks;         /* NULL: this process is no rank of a job */
    struct publisher *publisher; /* NULL: pictures are published nowhere else */

    struct settings_store settings;
    struct status_board status;
    struct frame_slots frames;     /* ingest -> shade */
    struct picture_slots pictures; /* shade -> encode */
    struct picture_watch watch;

    const atomic_bool *stop;      /* set by a signal: the program ends */
    atomic_bool *new_work;        /* any thread sets it to end the refinement pass under way */
    atomic_bool *reload;          /* set by a signal: the shade thread reloads the configuration */
    atomic_bool reading;          /* ingest thread: a frame is being decoded */
    atomic_bool repeat_requested; /* encode thread: a viewer needs the current picture's numbers again */
    struct config_readings readings;
};

/* s->config and the pointers are set, all else is zero. Allocates the slots and makes the initial settings current.
 * ERR_NOMEM; call shared_finish in either case. Main thread. */
MUST_CHECK enum err shared_init(struct shared *s, struct reason *why);
/* After all threads have ended. The server is the caller's. */
void shared_finish(struct shared *s);

/* Wakes every thread that waits for a frame or a picture, and makes shared_is_stopping true. Any thread. */
void shared_close(struct shared *s);
bool shared_is_stopping(struct shared *s);

/* What clients of the server want and what is published (publish/publish.h), which counts as a viewer of H.264 at full
 * size. Any thread. */
void shared_demand(struct shared *s, struct server_demand *out);
#define SHARED_PUBLISH_TRACK 0 /* full size, no limit on the rate */

#endif
