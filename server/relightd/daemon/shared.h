/* Data shared by the threads of relightd. All other data belongs to one thread: ingest.h, shade.h, encode.h,
 * service_manager.h, service_manager.h. */
#pragma once

#include "net/publish/publish.h"
#include "relightd/daemon/config.h"
#include "relightd/daemon/settings.h"
#include "relightd/daemon/slots.h"
#include "relightd/daemon/status.h"

#include <stdatomic.h>

/* The current image. The shade thread sets all but cancel, which the housekeeping thread sets. */
struct image_watch {
    atomic_int_least64_t begun_ms; /* clock_ms; 0: no image in progress */
    atomic_bool may_cancel;        /* a new setting may cancel it */
    atomic_bool cancel;
};

struct shared {
    /* Constant once the threads run. The objects behind the pointers have their own locks. */
    struct daemon_config config;
    struct server *server;
    struct ranks *ranks;         /* NULL: this process is not a rank of a job */
    struct publisher *publisher; /* NULL: no publish targets */

    struct settings_store settings;
    struct status_board status;
    struct frame_slots frames; /* ingest -> shade */
    struct image_slots images; /* shade -> encode */
    struct image_watch watch;

    const atomic_bool *stop;      /* a signal sets it: the program ends */
    atomic_bool *new_work;        /* any thread sets it to end the current refinement pass */
    atomic_bool *reload;          /* a signal sets it: the shade thread reloads the configuration */
    atomic_bool reading;          /* ingest thread: a frame is being decoded */
    atomic_bool repeat_requested; /* encode thread: a viewer needs the current image's numbers again */
    struct config_readings readings;
};

/* Allocates the slots and applies the initial settings. s->config and the pointers must be set, everything else zero.
 * ERR_NOMEM; call shared_finish in either case. Main thread. */
MUST_CHECK enum err shared_init(struct shared *s, struct reason *why);
/* Call it after all threads have ended. The caller owns the server. */
void shared_finish(struct shared *s);

/* Wakes every thread that waits for a frame or an image, and makes shared_is_stopping true. Thread: any. */
void shared_close(struct shared *s);
bool shared_is_stopping(struct shared *s);

/* The demand of the server's clients and of the publisher (net/publish/publish.h), which counts as a viewer of
 * full-size H.264. Thread: any. */
void shared_demand(struct shared *s, struct server_demand *out);
#define SHARED_PUBLISH_TRACK 0 /* full size, no limit on the rate */
