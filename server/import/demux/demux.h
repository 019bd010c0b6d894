/* Takes containers and network streams apart into packets of one video stream, in a separate process, relight-demux,
 * through libavformat. For a file, that process has the file's bytes and may use neither files nor the network. For a
 * network source it may use the network, by the protocols that its URL needs and no others, but no files: a playlist
 * that names a local file is refused. A crash or hang of the process is an error of the source. What comes back is
 * untrusted: sizes are checked, text is made printable. Thread: one per demux. */
#pragma once

#include "base/err.h"
#include "image/codec/signal.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define DEMUX_SCHEMES "rtsp://, rtsps://, rtmp://, rtmps://, srt://, http://, https:// and v4l2:DEVICE"

/* What a spec on the command line is to this room. */
enum demux_kind {
    DEMUX_NOTHING, /* no video: another kind of source */
    DEMUX_FILE,    /* a file whose name ends as a video's */
    DEMUX_WEB,     /* http:// or https://: a live playlist, or a video of known length */
    DEMUX_LIVE,    /* rtsp://, rtmp://, srt:// */
    DEMUX_DEVICE,  /* v4l2:/dev/video0 */
};

/* ERR_USAGE: a URL of a scheme that is no source; *why lists those that are. */
MUST_CHECK enum err demux_kind_of(const char *spec, enum demux_kind *out, struct reason *why);

/* The spec without user name and password, for messages. Returns out. */
const char *demux_name(const char *spec, char *out, size_t size);

#define DEMUX_ANY_CA "none"

bool demux_available(void); /* whether this build reads video */

/* What is known without opening: ERR_UNSUPPORTED: this build reads no video, or cannot verify certificates of such a
 * spec; ERR_USAGE: the file `ca` of demux_desc cannot be read. */
MUST_CHECK enum err demux_check(const char *spec, const char *ca, struct reason *why);

struct demux;

struct demux_desc {
    const char *spec;        /* of any kind but NOTHING */
    const char *ca;          /* PEM file with the authorities that TLS servers must be signed by; NULL: the system's;
                                DEMUX_ANY_CA: any certificate is accepted */
    const char *program;     /* default: relight-demux beside this program, or in ../lib/relightd relative to it */
    uint32_t timeout_ms;     /* to connect, and for each packet; default 15 s */
    const atomic_bool *stop; /* when set, a waiting call returns ERR_END; may be NULL */
};

/* Opens the source. The caller owns *out, NULL on error. ERR_IO: not there, no connection, no video in it.
 * ERR_UNSUPPORTED: this build has no libavformat, the source refers to what it may not open, or its certificate is not
 * trusted. ERR_FORMAT: it is no video, or the process crashed. ERR_NOMEM. */
MUST_CHECK enum err demux_open(const struct demux_desc *desc, struct demux **out, struct reason *why);
void demux_close(struct demux *d); /* ends the process; NULL is allowed */

enum demux_event {
    DEMUX_QUIET, /* nothing within the time; ask again */
    DEMUX_FORMAT,
    DEMUX_PACKET,
};

struct demux_item {
    enum demux_event event;
    struct stream_format format; /* FORMAT: of the packets that follow; comes first of all. PACKET: realtime_us alone */
    const uint8_t *bytes;        /* of the packet or the codec's extra data; borrowed until the next call */
    size_t size;
    int64_t time_us; /* PACKET: its time stamp, INT64_MIN: none */
    bool key;
    bool hidden; /* PACKET: to be decoded for those that refer to it, but not shown */
};

/* Waits up to wait_ms for what comes next. ERR_END: the stream is over. ERR_IO, ERR_FORMAT, ERR_RANGE: it failed,
 * *why has the reason; only demux_close is allowed then. */
MUST_CHECK enum err demux_next(struct demux *d, int wait_ms, struct demux_item *out, struct reason *why);

/* The next packet is the keyframe at or before time_us. Not while demux_next has returned QUIET and nothing since.
 * ERR_UNSUPPORTED: the source cannot do that. */
MUST_CHECK enum err demux_seek(struct demux *d, int64_t time_us, struct reason *why);
