/* What the server reports about itself: one struct, filled by relightd and rendered by two formats from one table
 * (figures.c): the status message (PROTOCOL.md 4.8) and /metrics. To add a figure, add a field and its row.
 * Texts are phrases without capital and full stop, as inside a sentence; longer ones are cut. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum server_source {
    SERVER_WAITING, /* no frame yet */
    SERVER_LIVE,
    SERVER_PAUSED,
    SERVER_ENDED,  /* the last frame was shown and stays */
    SERVER_FAILED, /* the last frame could not be used, so the one before stays: `detail` says why */
};

/* Where live images are published (net/publish/publish.h). */
#define SERVER_PUBLISH_MAX 8
enum server_publish_state {
    SERVER_PUBLISH_WAITING, /* for the first image, or a receiver's call */
    SERVER_PUBLISH_CONNECTING,
    SERVER_PUBLISH_LIVE,
    SERVER_PUBLISH_RETRYING,
};
struct server_publish {
    char to[128]; /* scheme and host, or folder; no keys, no quotes and backslashes */
    enum server_publish_state state;
    char detail[sizeof(struct reason)]; /* why it waits or failed; "": nothing to say */
    double bits_per_second;             /* over the last second or so */
    uint64_t frames, bytes;             /* passed on */
    uint64_t dropped;                   /* frames left out because the target was slow */
    uint64_t retries;                   /* failures after which it was, or will be, tried again */
};

/* "waiting" and so on, as both formats have it. Any thread. */
const char *server_publish_state_name(enum server_publish_state state);

struct server_figures {
    bool loaded; /* the scene is there */
    char scene[1024], sky[1024], method[32], camera[64];
    uint32_t samples; /* per shading point */
    uint32_t width, height;

    enum server_source source;
    char detail[sizeof(struct reason)]; /* what the source waits for, or why it failed */
    int64_t since_us;                   /* wall clock when source or detail changed; 0: unknown */
    char kind[16];                      /* "files", "sky", "folder" (watched) or "producer" */
    uint64_t position, length;          /* of the frame shown, in the source, from 0; length 0: unknown or endless */
    char between[96];                   /* what happens between two skies that come by themselves; "": nothing */
    double between_delay_s;             /* images are so far behind the skies then */
    bool has_hour, has_sun, has_place;  /* a computed sky: hour and sun are known; weather: also the place */
    double hour;                        /* solar time, 0..24; of weather: local standard time */
    uint32_t day;                       /* of weather: of the year, from 1 */
    double latitude, longitude, zone;   /* likewise: degrees, degrees, hours ahead of UTC */
    double north, units; /* likewise: where north is, degrees from +Z to east; image units per W sr^-1 m^-2 */
    double sun_elevation, sun_azimuth; /* degrees: above the horizon; clockwise from north */
    char sky_time[8];                  /* "14:35" */

    uint64_t frame;                                         /* number of the environment frame shown */
    uint64_t received, used, dropped, refused;              /* environment frames */
    uint64_t unreadable, unusable;                          /* parts of refused: not decoded; no use to the method */
    char last_refusal[sizeof(struct reason)];               /* why, and which frame; "": none */
    uint64_t repaired;                                      /* NaN, infinite and negative texels */
    unsigned frames_waiting, images_waiting;              /* read and not lit, lit and not encoded */
    double fps;                                             /* smoothed images per second; 0: unknown */
    double queued_ms, decoded_ms, shaded_ms, encoded_ms;    /* smoothed */
    uint64_t direct_rays, eye_rays, light_rays, cache_rays; /* traced for images, and for the cache */
    uint64_t generated, chosen, effective;                  /* light samples */
    double audit_s;                                         /* processor time that estimates of images' errors took */

    uint64_t late; /* images that exceeded the limit on their time */
    double late_s; /* for how long the present one has been made, if beyond the limit; 0: it is not */

    char paths[320];     /* which light the image has and by which method: "direct light, caustics by light tracer" */
    char left_out[1024]; /* which it lacks, and why; "": none */
    double error;        /* estimated relMSE of the last image; 0: unknown */
    double error_at_most; /* an upper bound of it, where it is unknown; 0: none */
    uint64_t cache_bytes;
    double cache_share;  /* computed share of the cache, 0..1 */
    uint64_t passes;     /* unbiased ones in a refined still image; 0: it is not refined */
    uint64_t all_passes; /* since the start */
    bool converged;      /* refinement is complete */

    /* Decoding of producers' files in a process of its own (decoder.h). */
    bool decoder_separate, decoder_confined; /* there is one; the kernel limits its system calls */
    uint64_t decoder_files, decoder_starts, decoder_died, decoder_hung, decoder_lied, decoder_waited;

    struct server_publish publish[SERVER_PUBLISH_MAX];
    uint32_t publish_count;

    char view[64];      /* the shown camera as a free view (scene/geometry/view.h); "": unknown */
    char preparing[64]; /* camera whose view is being computed; "": none */
    double prepared;    /* share of that, 0..1 */
    uint32_t lamp_samples, lamp_samples_wanted; /* of the lamps' light; the second 0: the scene has no lamps */
    const char *const *cameras;     /* names, ended by NULL, that live as long as the server; NULL: not known yet */
    const char *const *views;       /* likewise: those of the cameras that controllers have saved */
    const char *const *not_offered; /* likewise: methods that the present sky cannot have; NULL: none. Static. */
};

/* ---- The table ---- */

enum figure_type {
    FIGURE_BOOL,
    FIGURE_U32,
    FIGURE_U64,
    FIGURE_DOUBLE,
    FIGURE_KNOWN, /* double; 0: unknown, which is null in JSON and absent from /metrics */
    FIGURE_TEXT,
    FIGURE_LIST, /* const char *const *: names, ended by NULL; NULL: none */
};

/* One figure of a struct. A metric whose name ends in _total is a counter, else a gauge. */
struct figure {
    const char *json;   /* place in the status, "frames.received"; NULL: not there */
    const char *metric; /* name, with labels if any: rows of one name stand together; NULL: not in /metrics */
    const char *help;   /* of the metric; NULL in all but the first row of a name */
    enum figure_type type;
    size_t offset; /* in the struct */
};

/* The rows of struct server_figures, ended by one without json and metric. */
extern const struct figure server_figure_table[];
