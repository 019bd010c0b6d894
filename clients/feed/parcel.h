/* clients/feed/parcel.h */
/* One frame of a source as relight.v1 carries it: header and payload (PROTOCOL.md 7). Files travel as they are; texels,
 * and files that a server does not take from a network, travel raw. One thread per parcel. */
#ifndef FEED_PARCEL_H
#define FEED_PARCEL_H

#include "frame.h"
#include "image.h"
#include "relight_protocol.h"

#include <stdbool.h>

struct parcel_desc {
    enum protocol_layout layout; /* what the header states; AUTO: by the file or its aspect */
    bool bottom_first;
    bool raw;  /* files are decoded here and sent as texels, always */
    bool half; /* texels as half floats; else float */
};

struct parcel {         /* zeroed memory is an empty one; memory is reused from frame to frame */
    struct frame frame; /* in: what the source gave */
    struct protocol_environment header;
    uint8_t head[PROTOCOL_ENVIRONMENT_BYTES];
    const uint8_t *payload; /* header.payload bytes, the parcel's own */
    struct reason barred;   /* why servers do not take this file from a network, so that it was decoded here; or "" */

    struct image image;
    uint16_t *half;
    size_t half_count;
};

/* Fills everything but `frame` from it. ERR_FORMAT: neither EXR nor Radiance, or damaged where it had to be decoded.
 * ERR_RANGE: more than a message carries, or a frame number above PROTOCOL_NUMBER_MAX. ERR_NOMEM. */
MUST_CHECK enum err parcel_pack(struct parcel *p, const struct parcel_desc *d, struct reason *why);
void parcel_finish(struct parcel *p);

/* "auto", "latlong", "latlong-bottom", "cube", "hcross", "vcross", "ball", "fisheye". ERR_USAGE. */
MUST_CHECK enum err parcel_layout_parse(const char *name, struct parcel_desc *out, struct reason *why);

#endif
