/* Video files: frames of one size at a constant rate, encoded as H.264 by libx264 or AV1 by SVT-AV1. A file appears
 * whole or not at all (base/file_store.h). Thread: one per movie; the encoder starts threads of its own. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Whether this build writes video files. Thread: any. */
bool movie_available(void);

struct movie_desc {
    const char *path;       /* borrowed until movie_create returns, as is the next one */
    const char *container;  /* "mp4" or "mkv" with H.264, "webm" with AV1 */
    uint32_t width, height; /* an odd side is padded by repeating its last pixel */
    double rate;            /* frames per second */
    int quality;            /* 1..100 */
    bool pq;                /* 10 bits, BT.2020, PQ, with mastering metadata; else 8 bits, BT.709; limited range */
};

struct movie;

/* ERR_UNSUPPORTED: not in this build, or the encoder refuses the size. ERR_IO: the file. ERR_NOMEM. On ERR_OK the
 * caller owns *out. */
MUST_CHECK enum err movie_create(const struct movie_desc *desc, struct movie **out, struct reason *why);

/* The next frame: uint16_t[height][width][3], 65535 a signal of 1 in the colours of the desc. ERR_IO, ERR_NOMEM: no
 * file will appear; only movie_destroy may follow. */
MUST_CHECK enum err movie_add(struct movie *m, const uint16_t *rgb, struct reason *why);

/* Encodes what is pending and puts the file in its place; without a frame there is no file. Only movie_destroy may
 * follow. Errors of movie_add. */
MUST_CHECK enum err movie_finish(struct movie *m, struct reason *why);

/* Leaves no file unless movie_finish succeeded. NULL is allowed. */
void movie_destroy(struct movie *m);

/* ---- Containers ---- */

/* Packets of one video stream into a container, through libavformat. Thread: one per muxer. */

enum mux_codec {
    MUX_H264, /* access units in Annex B form */
    MUX_AV1,
};

enum mux_colour {
    MUX_BT709, /* limited range */
    MUX_PQ,    /* limited range, BT.2020, PQ, with mastering metadata */
    MUX_SRGB,  /* full range, BT.709, the transfer function of sRGB: as h264.h encodes */
};

/* The mastering display of MUX_PQ: primaries of BT.2020, white D65, these luminances in cd/m2. */
#define MUX_PQ_PEAK 1000
#define MUX_PQ_BLACK 0.0001

struct mux_stream {
    enum mux_codec codec;
    enum mux_colour colour;
    uint32_t width, height;
    int rate_num, rate_den; /* frames per second; rate_num 0: they vary, and times are in 1 / MUX_TICKS s */
    const uint8_t *header;  /* parameter sets; H.264: in Annex B form too */
    size_t header_size;
};

#define MUX_TICKS 90000 /* the clock of RTP and MPEG transport streams */

/* One of path, url and write says where the bytes go. */
struct mux_desc {
    const char *format;  /* libavformat's name: "mp4", "matroska" */
    const char *path;    /* the file, or FILE_STORE_STDOUT */
    const char *url;     /* of a network protocol of libavformat */
    const char *options; /* "key=value:key=value" of the muxer and the protocol; NULL: none */

    /* Takes the next bytes. False: they are lost, and so is the output. */
    bool (*write)(void *user, const uint8_t *bytes, size_t size);
    /* Asked several times a second while the network is waited for; true ends the wait with an error. NULL: it may
     * last. */
    bool (*cancelled)(void *user);
    void *user;
};

struct mux_packet {
    const uint8_t *bytes; /* borrowed for the call */
    size_t size;
    int64_t shown, decoded; /* in frames, or ticks */
    int64_t duration;       /* likewise; 0: a frame */
    bool key;
};

struct mux;

/* Opens the output and writes its header. ERR_UNSUPPORTED: no such muxer. ERR_IO: the output; the reason is the cause
 * alone, without path and URL. ERR_NOMEM. On ERR_OK the caller owns *out. */
MUST_CHECK enum err mux_open(const struct mux_desc *desc, const struct mux_stream *stream, struct mux **out,
                             struct reason *why);
/* ERR_IO: the output is lost; only mux_close may follow. */
MUST_CHECK enum err mux_write(struct mux *m, const struct mux_packet *packet, struct reason *why);
/* Writes the trailer where `complete` and closes; m is gone in every case, NULL is allowed. ERR_IO: the end could not
 * be written. */
MUST_CHECK enum err mux_close(struct mux *m, bool complete, struct reason *why);
