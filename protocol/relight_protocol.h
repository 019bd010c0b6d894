/* protocol/relight_protocol.h */
/* The binary headers of relight.v1, as PROTOCOL.md sections 6 and 7 lay them down: little-endian, fixed offsets, no
 * padding. Pure functions of their bytes: nothing is allocated or kept, so any thread may call them, on anything that
 * came over a network. Stands alone: no other header of the project is needed. */
#ifndef RELIGHT_PROTOCOL_H
#define RELIGHT_PROTOCOL_H

#include <stddef.h>
#include <stdint.h>

#define PROTOCOL_NAME "relight.v1" /* the WebSocket subprotocol */
#define PROTOCOL_PATH "/ws"
#define PROTOCOL_MAJOR 1
#define PROTOCOL_MINOR 1

#define PROTOCOL_PICTURE_BYTES 80            /* header of a picture as written today */
#define PROTOCOL_PICTURE_FLAGS_AT 7          /* where its flags stand */
#define PROTOCOL_ENVIRONMENT_BYTES 48        /* header of an environment frame as written today */
#define PROTOCOL_HEADER_MAX 1024             /* what a later minor version may lengthen a header to */
#define PROTOCOL_SIDE_MAX 16384              /* width and height of anything */
#define PROTOCOL_TEXT_MAX 16384              /* bytes of a text message to the server */
#define PROTOCOL_CREDIT 2                    /* pictures under way to a viewer and not yet acknowledged */
#define PROTOCOL_CREDIT_H264 16              /* of a chain of H.264 pictures */
#define PROTOCOL_NAME_MAX 64                 /* characters of a sequence's name */
#define PROTOCOL_NUMBER_MAX 9007199254740991 /* 2^53 - 1: what every JSON reader keeps exactly */

enum protocol_result {
    PROTOCOL_OK = 0,
    PROTOCOL_SHORT,  /* the message ends inside its header */
    PROTOCOL_MAGIC,  /* it begins with other bytes */
    PROTOCOL_HEADER, /* the header's own length is not in the allowed range, or not a multiple of 4 */
    PROTOCOL_LENGTH, /* header and payload do not add up to the message */
    PROTOCOL_FORMAT, /* an unknown format, encoding or layout */
    PROTOCOL_SIZE,   /* width or height out of range, or not what the payload holds */
    PROTOCOL_VALUE,  /* a number out of its range */
};

/* PROTOCOL.md's clause for the result, as "6.2"; "" for PROTOCOL_OK. `picture` says which of the two headers it was. */
const char *protocol_clause(enum protocol_result result, int picture);
/* The result as half a sentence, as "the message ends inside its header". */
const char *protocol_result_text(enum protocol_result result);

enum protocol_format {
    PROTOCOL_JPEG = 1,     /* tone-mapped sRGB, baseline JPEG */
    PROTOCOL_EXR_HALF = 2, /* linear Rec.709 before exposure */
    PROTOCOL_EXR_FLOAT = 3,
    PROTOCOL_H264 = 4, /* tone-mapped, one access unit of H.264 in Annex B form */
};

enum {
    PROTOCOL_PICTURE_LAST = 1,     /* flags: the source has ended, no picture follows */
    PROTOCOL_PICTURE_REPEAT = 2,   /* flags: made before this viewer came, so its age is no measure of latency */
    PROTOCOL_PICTURE_LOCKSTEP = 4, /* flags: the one picture that a lockstep frame yields */
    PROTOCOL_PICTURE_HALF = 8,     /* flags: both sides halved, for viewers that take no larger one */
    PROTOCOL_PICTURE_QUARTER = 16, /* flags: both sides quartered */
    PROTOCOL_PICTURE_FINER = 32,   /* flags: of the frame shown before, and better: its age is no latency */
    PROTOCOL_PICTURE_KEY = 64,     /* flags: of H.264, and needs none of those before it */
};

/* The header of a picture. Times of day are microseconds since 1970-01-01 UTC on the server's clock. */
struct protocol_picture {
    enum protocol_format format;
    uint8_t flags;          /* of PROTOCOL_PICTURE_LAST and the others; unknown bits are kept */
    uint64_t sequence;      /* 1, 2, ... within one session of the server; gaps are pictures skipped */
    uint64_t frame;         /* number of the environment frame that lit it, as its producer counts */
    int64_t capture_us;     /* when that frame was captured, on the producer's clock; 0: unknown */
    int64_t published_us;   /* when the picture was handed to the network */
    uint32_t queued_us;     /* what the frame waited for */
    uint32_t decoded_us;    /* reading it, and building its sampling tables */
    uint32_t shaded_us;     /* relighting */
    uint32_t encoded_us;    /* exposure, tone curve, compression */
    uint32_t width, height; /* pixels, 1..16384 */
    float gain;             /* factor from radiance to the tone curve's input; finite, >= 0 */
    uint32_t samples;       /* N_s per shade point; 0: does not apply */
    uint32_t payload;       /* bytes that follow the header */
};

enum protocol_encoding {
    PROTOCOL_FILE_EXR = 1,
    PROTOCOL_FILE_HDR = 2, /* Radiance RGBE */
    PROTOCOL_RAW_HALF = 3, /* width * height * channels half floats, rows top to bottom, channels interleaved */
    PROTOCOL_RAW_FLOAT = 4,
};

enum protocol_layout {
    PROTOCOL_LAYOUT_AUTO = 0, /* the file's own attribute, else its aspect ratio */
    PROTOCOL_LATLONG = 1,
    PROTOCOL_CUBE = 2,   /* OpenEXR's 1:6 */
    PROTOCOL_HCROSS = 3, /* 4:3 */
    PROTOCOL_VCROSS = 4, /* 3:4 */
    PROTOCOL_BALL = 5,   /* mirror ball */
    PROTOCOL_FISHEYE = 6,
};

enum {
    PROTOCOL_BOTTOM_FIRST = 1, /* flags: rows bottom to top */
};

/* The header of an environment frame. */
struct protocol_environment {
    enum protocol_encoding encoding;
    enum protocol_layout layout;
    uint8_t flags;
    uint8_t channels;       /* raw: 3 or 4; files: 0 */
    uint32_t width, height; /* raw: texels, 1..16384; files: 0, the file says */
    uint64_t frame;         /* the producer's number */
    int64_t capture_us;     /* the producer's clock; 0: unknown */
    uint32_t payload;       /* bytes that follow the header */
};

/* Writes exactly PROTOCOL_PICTURE_BYTES. Out-of-range values are the caller's mistake and are not checked. */
void protocol_picture_encode(const struct protocol_picture *p, uint8_t out[PROTOCOL_PICTURE_BYTES]);

/* Reads a whole message; on PROTOCOL_OK its payload is bytes[*offset .. *offset + p->payload). Else *p is untouched. */
enum protocol_result protocol_picture_decode(const uint8_t *bytes, size_t length, struct protocol_picture *p,
                                             size_t *offset);

/* The same two for environment frames. `total` is the length of the whole message, of which only the first `length`
 * bytes need to have arrived: a frame's size is known, and can be refused, before its payload is. */
void protocol_environment_encode(const struct protocol_environment *e, uint8_t out[PROTOCOL_ENVIRONMENT_BYTES]);
enum protocol_result protocol_environment_decode(const uint8_t *bytes, size_t length, size_t total,
                                                 struct protocol_environment *e, size_t *offset);

#endif
