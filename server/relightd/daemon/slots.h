/* Handoff between threads: frames from ingest to shade, images from shade to encode. Three slots each
 * (base/handoff.h): the newest wins, and one thread at a time writes or reads a slot. As a job, the shade thread takes
 * frames early, and there are four. */
#pragma once

#include "base/err.h"
#include "base/handoff.h"
#include "net/stream/server.h"
#include "sky/source/sky.h"
#include "sky/source/source.h"
#include "sky/tables/environment.h"
#include "sky/tables/sky_table.h"

struct daemon_config;

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
