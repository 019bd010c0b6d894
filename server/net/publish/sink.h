/* An opened output of one target: a connection, a folder of HLS segments, or a recording. Thread: the target's. */
#pragma once

#include "base/err.h"
#include "image/video/movie.h"
#include "net/publish/publish.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Borrowed until sink_close, except `header`, which is borrowed until sink_open returns. */
struct sink_desc {
    const struct publish_target *target;
    const uint8_t *header; /* parameter sets of the stream, Annex B */
    size_t header_size;
    uint32_t width, height;
    bool (*cancelled)(void *user); /* as in movie.h */
    void *user;
};

/* One access unit. */
struct sink_unit {
    const uint8_t *bytes; /* Annex B; a keyframe starts with its parameter sets */
    size_t size;
    int64_t time_us; /* any monotonic clock; later than the previous unit */
    bool key;
};

struct sink;

/* ERR_IO, ERR_NOMEM, ERR_UNSUPPORTED: the reason names no URL. On ERR_OK the caller owns *out. */
MUST_CHECK enum err sink_open(const struct sink_desc *desc, struct sink **out, struct reason *why);
/* The first unit must be a keyframe. After an error only sink_close may follow. */
MUST_CHECK enum err sink_write(struct sink *s, const struct sink_unit *unit, struct reason *why);
/* Completes the output as far as possible, also after an error, and frees s. NULL is allowed. */
void sink_close(struct sink *s);

/* ---- For the kinds of sinks ---- */

/* A muxer whose times begin at 0 with the first unit. */
struct sink_stream {
    struct mux *mux;
    bool begun;
    bool bare; /* put parameter sets into the header only, as "avc1" in MP4 and FLV requires */
    int64_t first_us, last;
};
/* Opens the muxer for the stream that desc describes. Errors as mux_open. */
MUST_CHECK enum err sink_stream_open(const struct sink_desc *desc, const struct mux_desc *to, bool bare,
                                     struct sink_stream *out, struct reason *why);
/* Errors as mux_write. */
MUST_CHECK enum err sink_stream_write(struct sink_stream *s, const struct sink_unit *unit, struct reason *why);
/* Errors as mux_close. Zeroed memory is allowed. */
MUST_CHECK enum err sink_stream_close(struct sink_stream *s, bool complete, struct reason *why);

struct sink_ops {
    enum err (*write)(struct sink *s, const struct sink_unit *unit, struct reason *why);
    void (*close)(struct sink *s);
};

/* The first member of each sink type. */
struct sink {
    const struct sink_ops *ops;
};

/* sink_open for each sink type: RTMP, RTSP and SRT; a folder of HLS; a folder of recordings. */
MUST_CHECK enum err network_open(const struct sink_desc *desc, struct sink **out, struct reason *why);
/* As network_open. */
MUST_CHECK enum err hls_open(const struct sink_desc *desc, struct sink **out, struct reason *why);
/* As network_open. */
MUST_CHECK enum err record_open(const struct sink_desc *desc, struct sink **out, struct reason *why);

/* ---- folder.c: files of the last two ---- */

/* Creates the folder if necessary and locks it against other processes. public: a new folder is world-readable
 * regardless of the umask. *fd: to be closed by the caller; -1 after an error. ERR_IO. */
MUST_CHECK enum err sink_folder_lock(const char *folder, bool public, int *fd, struct reason *why);

/* Writes all bytes to a file. Returns 0 or errno. */
MUST_CHECK int sink_write_all(int fd, const uint8_t *bytes, size_t size);

#define SINK_TIME 20 /* the text below takes 17 */
/* Writes "YYYYMMDDThhmmssZ". wall_us: as clock_wall_us. */
void sink_time(int64_t wall_us, char out[SINK_TIME]);
