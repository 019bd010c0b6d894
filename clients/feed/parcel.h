/* A frame in the form in which relight.v1 transmits it: header and payload (PROTOCOL.md 7). Files are sent as they are;
 * texels, and files of kinds that a server does not accept from the network, are sent raw. Thread: one per parcel. */
#pragma once

#include "image/codec/frame.h"
#include "image/codec/image.h"
#include "protocol/relight_protocol.h"

enum raw {
    RAW_NOT, /* files are sent as they are; texels as floats */
    RAW_HALF,
    RAW_FLOAT,
};

struct parcel_desc {
    enum layout layout; /* stated in the header; AUTO: by the file or its aspect ratio */
    enum raw raw;       /* else: always decode files and send texels */
    const char *layer;  /* as image.layer; given: likewise */
};

struct parcel {         /* zeroed memory is empty; buffers are reused from frame to frame */
    struct frame frame; /* in: the frame from the source */
    struct protocol_environment header;
    uint8_t head[PROTOCOL_ENVIRONMENT_BYTES];
    const uint8_t *payload; /* header.payload bytes, owned by the parcel */
    struct reason barred;   /* why servers do not accept this file from the network, so that it was decoded; or "" */

    bool decoded; /* here, into: */
    struct image image;
    uint16_t *half;
    size_t half_count;
};

/* Fills everything except `frame` from `frame`. ERR_FORMAT: neither EXR nor Radiance, or damaged when it had to be
 * decoded. ERR_RANGE: exceeds the size of a message, or a frame number above PROTOCOL_NUMBER_MAX. ERR_NOMEM. */
MUST_CHECK enum err parcel_pack(struct parcel *p, const struct parcel_desc *d, struct reason *why);
void parcel_finish(struct parcel *p);
