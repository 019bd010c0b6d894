/* Messages between relightd and relight-decoder (import/sandbox/helper.h). File bytes and texels are exchanged through
 * two blocks of shared memory. Private to this room. */
#pragma once

#include "base/err.h"
#include "image/codec/stream_format.h"
#include "import/sandbox/helper.h"

#include <stdint.h>

enum { WIRE_FILE = WIRE_SOCKET + 1, WIRE_PICTURE }; /* descriptors that the process starts with */

enum wire_kind {
    WIRE_IMAGE,   /* decode a file */
    WIRE_STREAM,  /* begin a video stream of this format; the file is its codec's extra data */
    WIRE_PACKET,  /* decode a packet up to its first image */
    WIRE_NEXT,    /* the next image of the packets sent so far */
    WIRE_DRAIN,   /* no more packets: the next image that is still held back */
    WIRE_FLUSH,   /* forget what was decoded; packets from elsewhere in the stream follow */
    WIRE_CONVERT, /* the texels of the last image */
};

struct wire_request {
    uint32_t magic;
    uint32_t kind;               /* enum wire_kind */
    uint32_t max_side;           /* of the image; 0: IMAGE_MAX_SIDE */
    uint32_t transfer;           /* STREAM: enum signal_transfer that overrides the stream's; AUTO: none */
    uint64_t size;               /* bytes of the file */
    int64_t time_us;             /* PACKET: its time stamp */
    uint32_t hidden;             /* PACKET: 1: its image is not wanted */
    double peak_cdm2;            /* STREAM: as signal_desc */
    struct stream_format format; /* STREAM */
    char name[256];
    char layer[64]; /* IMAGE: as image.layer */
};

struct wire_answer {
    uint32_t magic;
    int32_t result; /* enum err */
    uint32_t width, height, layout;
    uint32_t picture;   /* PACKET, NEXT, DRAIN: 1: there is one; CONVERT: its transfer function, enum signal_transfer */
    int64_t time_us;    /* of the image */
    uint32_t assumed;   /* CONVERT: 1: the stream does not state its transfer function */
    uint32_t low_range; /* IMAGE: as image.low_range */
    uint64_t nan, infinite, negative, clipped;
    struct reason why;
    char note[320]; /* IMAGE, CONVERT: as image.note */
};
