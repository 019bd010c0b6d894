/* What relightd reports about itself: status for viewers, figures for /metrics, lines for the terminal and the service
 * manager. Each thread reports its events here; the board aggregates them and passes them to the server. The board
 * locks. Thread: any. */
#pragma once

#include "base/err.h"
#include "net/stream/server.h"

#include <pthread.h>
#include <stdbool.h>

struct decoder_counts;
struct handoff;
struct image_faults;
struct ingested;
struct pilot_stats;
struct relight_desc;
struct relight_stats;
struct scene;
struct settings_store;
struct shared;
struct refiner_stats;

struct status_board {
    struct server *server; /* constant */
    struct handoff *frames, *images;

    pthread_mutex_t lock;
    struct server_figures figures; /* {lock} */
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
/* The current camera as a free view (scene/geometry/free_view.h). */
void status_set_view(struct status_board *b, const char *view);

/* shared->settings.source_kind or source_length has changed. */
void status_set_kind(struct status_board *b, const struct shared *shared);
/* The source's state. detail: a phrase for viewers, "" for none. */
void status_set_source(struct status_board *b, enum server_source source, const char *detail);
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
/* Milliseconds by which shading recently takes longer than reading a frame; 0 if it does not. */
double status_shading_excess_ms(struct status_board *b);

/* The targets of live images. */
void status_set_publish(struct status_board *b, const struct server_publish *targets, uint32_t count);

/* For the terminal: "29.8 images/s, 3 viewers, error 2.1e-04, cache 34 %"; "" before the first image. */
void status_line(struct status_board *b, uint32_t viewers, char *text, size_t size);
/* The computed share of a light transport cache, 0 to 1; 0: there is none. */
double status_cache_share(struct status_board *b);
/* For the service manager: one sentence without line ends. */
void status_sentence(struct status_board *b, uint32_t viewers, char *text, size_t size);
