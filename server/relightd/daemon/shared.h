/* Data shared by the threads of relightd. All other data belongs to one thread: ingest.h, shade.h, encode.h,
 * service_manager.h. */
#pragma once

#include "base/err.h"
#include "base/handoff.h"
#include "net/publish/publish.h"
#include "net/stream/server.h"
#include "relightd/daemon/config.h"
#include "relightd/daemon/settings.h"
#include "sky/daylight/sky.h"
#include "sky/source/source.h"
#include "sky/tables/environment.h"
#include "sky/tables/sky_table.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

/* The running mean of readings: a new one has a fifth of the weight; `old` 0: there is none yet. */
static inline double smooth(double old, double reading)
{
    return old > 0.0 ? old + 0.2 * (reading - old) : reading;
}

/* ---- Status ---- */

/* What relightd reports about itself: status for viewers, figures for /metrics, lines for the terminal and the service
 * manager. Each thread reports its events here; the board aggregates them and passes them to the server. The board
 * locks. Thread: any. */

struct ingested;
struct pilot_stats;
struct shared;

struct status_board {
    struct server *server; /* constant */
    struct handoff *frames, *images;

    pthread_mutex_t lock;
    struct server_figures figures; /* {lock} */
    double uneven_ms;              /* {lock} by which images last longer or shorter than figures.shaded_ms */
    uint64_t cache_rays;           /* {lock} traced for the current cache */
    const char **cameras;          /* {lock} names, terminated by NULL, followed by their text */
};

/* shared must outlive the board. */
void status_init(struct status_board *b, struct shared *shared);
void status_finish(struct status_board *b);

/* The server runs and the source is open: fills in the configuration's values. */
void status_begin(struct status_board *b, const struct shared *shared);
/* The scene was loaded or views were saved: the available cameras, and the current one. */
void status_set_cameras(struct status_board *b, struct settings_store *settings, const char *shown);
/* The current camera as a free view (scene/geometry/view.h). */
void status_set_view(struct status_board *b, const char *view);

/* shared->settings.source_kind or source_length has changed. */
void status_set_kind(struct status_board *b, const struct shared *shared);
/* The source's state. detail: a phrase for viewers, "" for none. */
void status_set_source(struct status_board *b, enum server_source source, const char *detail);
/* What images between two skies do, and how far (s) they are behind; "": there are none. */
void status_between(struct status_board *b, const char *what, double delay_s);
/* The producer disconnected without ending its stream. */
void status_producer_left(struct status_board *b);

/* A frame arrived but could not be read; log: also log `why`. */
void status_frame_unreadable(struct status_board *b, const char *why, bool log);
/* A frame arrived and was read; replaced: an earlier one was dropped for it. */
void status_frame_received(struct status_board *b, const struct image_faults *faults, bool replaced);
/* A frame was read, but the current method cannot use it. */
void status_frame_unusable(struct status_board *b, const char *why);

/* An image of a frame: its inputs, its statistics and the time since the previous one. */
struct image_report {
    const struct ingested *in;
    struct protocol_picture header;
    const struct relight_desc *light;
    const struct relight_stats *stats;
    const struct pilot_stats *pilot; /* NULL: the pilot did not choose */
    double interval_s;               /* 0: the first image */
    bool coarse;                     /* of a first view whose camera rays are not complete */
};
/* Adds the report to the figures and publishes them. Keeps no pointers. Thread: shade. */
void status_image_shaded(struct status_board *b, const struct image_report *report);
/* The next image is a refinement of the same frame. */
void status_image_refined(struct status_board *b, const struct refiner_stats *stats);
void status_image_encoded(struct status_board *b, double ms);

/* The current image exceeds its time limit; seconds so far, or 0: it is finished. first: not reported for this
 * image before. */
void status_image_late(struct status_board *b, double seconds, bool first);

/* Counts of the decoder for producers' files; confined: the kernel limits its system calls. */
void status_decoder(struct status_board *b, const struct decoder_counts *counts, bool confined);

/* The computed share of the camera's view, 0..1; 1: it is displayed now. */
void status_camera_progress(struct status_board *b, const char *camera, double share);

/* The scene has lamps: samples of their light in the newest image, and the final number. */
void status_set_lamps(struct status_board *b, uint32_t samples, uint32_t wanted);

/* Whether every received frame was shaded, dropped or refused. */
bool status_all_frames_done(struct status_board *b);
/* Milliseconds by which shading recently takes longer than reading a frame, but for what images differ by: a frame that
 * is late costs time, one that is early is only that much older. 0 if it does not. */
double status_shading_excess_ms(struct status_board *b);

/* The targets of live images. */
void status_set_publish(struct status_board *b, const struct server_publish *targets, uint32_t count);

/* For the terminal: "29.8 images/s, 3 viewers, error 2.1e-04, cache 34 %"; "" before the first image. */
void status_line(struct status_board *b, uint32_t viewers, char *text, size_t size);
/* The computed share of a light transport cache, 0 to 1; 0: there is none. */
double status_cache_share(struct status_board *b);
/* For the service manager: one sentence without line ends. */
void status_sentence(struct status_board *b, uint32_t viewers, char *text, size_t size);

/* ---- Slots ---- */

/* Handoff between threads: frames from ingest to shade, images from shade to encode. Three slots each
 * (base/handoff.h): the newest wins, and one thread at a time writes or reads a slot. As a job, the shade thread takes
 * frames early, and there are four. */

/* An environment frame, ready to light the scene. */
struct ingested {
    struct environment *environment;
    struct server_ticket ticket; /* id 0: not from a producer */
    double decode_ms;
    int64_t ready_ms;    /* clock_ms of its publication */
    uint64_t position;   /* in the source */
    bool has_sky;        /* a computed sky, described by */
    struct sky_desc sky; /* this */
    bool has_place;      /* a weather file: of */
    struct source_place place;
    bool has_sun; /* another map, with a sun */
    struct sun_place sun;
};

/* A linear image, float[height][width][3], ready to encode. */
struct shaded {
    float *rgb;
    uint8_t *changes; /* [height][width][3]: which pixels changed (light/frame/changes.h), if has_changes */
    bool has_changes; /* somebody asked for them */
    struct protocol_picture header;
    struct server_ticket ticket;
    bool new_view; /* first image of another camera: automatic exposure restarts */
};

struct frame_slots {
    struct handoff handoff;
    struct ingested slot[HANDOFF_SLOTS_EARLY];
    int count;                      /* of slots with an environment */
    struct resample_tables *tables; /* shared by these environments */
};

struct image_slots {
    struct handoff handoff;
    struct shaded slot[HANDOFF_SLOTS];
};

/* Main thread, before the others start. ERR_NOMEM; call finish in either case, which accepts zeroed memory. */
MUST_CHECK enum err frame_slots_init(struct frame_slots *s, const struct daemon_config *config, int count);
void frame_slots_finish(struct frame_slots *s);
MUST_CHECK enum err image_slots_init(struct image_slots *s, uint32_t width, uint32_t height);
void image_slots_finish(struct image_slots *s);

/* Shade thread: hands the slot to the encode thread. An image that this replaces is reported as superseded. */
void image_slots_publish(struct image_slots *s, int slot, struct server *server);

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
