/* Messages between a program and relight-demux (import/sandbox/helper_process.h). A packet's bytes are passed through
 * shared memory. Private to this room. */
#pragma once

#include "base/err.h"
#include "image/codec/signal.h"
#include "import/sandbox/helper_process.h"

#include <stddef.h>
#include <stdint.h>

enum { DEMUX_MEMORY = WIRE_SOCKET + 1, DEMUX_INPUT }; /* descriptors that the process starts with; the latter: a file */

enum demux_ask {
    DEMUX_ASK_OPEN,
    DEMUX_ASK_NEXT,
    DEMUX_ASK_SEEK, /* to the keyframe at or before time_us */
};

struct demux_request {
    uint32_t magic;
    uint32_t ask;    /* enum demux_ask */
    int64_t time_us; /* SEEK */
    char url[2048];  /* OPEN; "" of a file. Not an argument of the process: it may hold a password. */
};

struct demux_answer {
    uint32_t magic;
    int32_t result;  /* enum err; ERR_END: no packet is left */
    uint32_t kind;   /* NEXT: enum demux_event */
    uint32_t key;    /* PACKET: 1: a keyframe */
    uint32_t hidden; /* PACKET: 1: decoded for others alone */
    uint64_t size;   /* bytes of the packet, or of the codec's extra data */
    int64_t time_us;
    struct stream_format format; /* FORMAT; PACKET: only realtime_us, which may become known late */
    struct reason why;
};

/* ---- The work of relight-demux ---- */

/* The work of relight-demux: one container or network stream, through libavformat. Thread: main. */

struct reading;

struct reading_desc {
    const uint8_t *file; /* the whole file, or NULL: a URL */
    size_t file_bytes;
    const char *ca;     /* as struct demux_desc has it */
    const char *device; /* input format of a device ("v4l2"), or NULL */
    uint8_t *packet;    /* where packets go */
    size_t packet_bytes;
};

struct reading *reading_create(const struct reading_desc *desc); /* NULL: out of memory */
void reading_destroy(struct reading *r);                         /* NULL is allowed */

/* Each fills *a as its wire message says, and returns what goes to a->result. `url` is "" of a file. */
enum err reading_open(struct reading *r, const char *url, struct demux_answer *a);
enum err reading_next(struct reading *r, struct demux_answer *a);
enum err reading_seek(struct reading *r, int64_t time_us, struct demux_answer *a);
