/* Reads ahead from a source on a separate thread, so that slow disks, watched folders and computed skies do not delay
 * the connection. Holds at most two parcels, in order. */
#pragma once

#include "image/codec/frame.h"
#include "image/codec/image.h"
#include "protocol/relight_protocol.h"
#include "sky/source/source.h"

/* ---- Parcels ---- */

/* A frame in the form in which relight.v1 transmits it: header and payload (PROTOCOL.md 7). Files are sent as they are;
 * texels, and files of kinds that a server does not accept from the network, are sent raw. Thread: one per parcel. */

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

#define READER_SLOTS 2 /* one is sent while the next is read */

struct reader;

struct reader_desc {
    struct source_desc source;
    struct parcel_desc parcel;
    void (*wake)(void *user); /* a new parcel is available, or the source has ended; called on the reader's thread */
    void *user;
};

struct reader_counts {
    uint64_t passed; /* frames skipped because of reader_begin's `after` */
    uint64_t faulty; /* frames that could not be read or packed; each was reported on standard error */
};

/* Opens the source; the caller owns *out. Reading starts with reader_begin. Errors of source_open; ERR_NOMEM. */
MUST_CHECK enum err reader_create(const struct reader_desc *d, struct reader **out, struct reason *why);
void reader_destroy(struct reader *r); /* stops the thread; NULL is allowed */

/* Starts, or restarts from the source's first frame with nothing held. With has_after, only frames with numbers above
 * `after` are returned. Invalidates the result of reader_take. ERR_NOMEM: cannot start a thread. */
MUST_CHECK enum err reader_begin(struct reader *r, bool has_after, uint64_t after, struct reason *why);

/* The oldest parcel, which stays valid until reader_drop; NULL: none yet, or the end. Thread: one. */
struct parcel *reader_take(struct reader *r);
void reader_drop(struct reader *r); /* releases the oldest parcel */

bool reader_is_done(struct reader *r);                           /* the source has ended and nothing is held */
uint64_t reader_total(const struct reader *r);                   /* frames in one pass; 0: unknown or infinite */
void reader_counts(struct reader *r, struct reader_counts *out); /* thread: any */

/* ---- Files ---- */

/* Writes the frames of a source as OpenEXR files instead of sending them: computed skies and videos for other programs.
 * Thread: one; the caller's. */

/* Writes every frame to `pattern`, a name with %d or %04d for the frame number, as linear Rec.709 with 32-bit floats,
 * or 16-bit floats with RAW_HALF, in the layout of the frame. Frames that cannot be read are reported and skipped;
 * then, and if Ctrl-C ends it early, the result is ERR_IO. ERR_USAGE: a pattern of no EXR file, one name for many
 * frames, a source that never ends. Errors of source_open and exr_write, which name the file. */
MUST_CHECK enum err files_write(const struct reader_desc *d, const char *pattern, struct reason *why);
