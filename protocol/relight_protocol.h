/* The binary headers of relight.v1 as defined in PROTOCOL.md sections 6 and 7: little-endian, fixed offsets, no
 * padding. Pure functions without allocations or state, safe on untrusted input. Thread: any. Depends on no other
 * header of the project. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#define PROTOCOL_NAME "relight.v1" /* the WebSocket subprotocol */
#define PROTOCOL_PATH "/ws"
#define PROTOCOL_MAJOR 1 /* a peer with another one is refused */
#define PROTOCOL_MINOR 2 /* what this PROTOCOL.md describes */

#define PROTOCOL_PICTURE_BYTES 80            /* size of a picture's header in this version */
#define PROTOCOL_PICTURE_FLAGS_AT 7          /* offset of its flags */
#define PROTOCOL_ENVIRONMENT_BYTES 48        /* size of an environment frame's header in this version */
#define PROTOCOL_HEADER_MAX 1024             /* maximum header size in later minor versions */
#define PROTOCOL_SIDE_MAX 16384              /* maximum width and height */
#define PROTOCOL_TEXT_MAX 16384              /* maximum bytes of a text message to the server */
#define PROTOCOL_CREDIT 2                    /* pictures sent to a viewer and not yet acknowledged */
#define PROTOCOL_CREDIT_H264 16              /* the same for a chain of H.264 pictures */
#define PROTOCOL_NAME_MAX 64                 /* characters of a sequence name */
#define PROTOCOL_NUMBER_MAX 9007199254740991 /* 2^53 - 1: exact in every JSON reader */

enum protocol_result {
    PROTOCOL_OK = 0,
    PROTOCOL_SHORT,  /* the message is shorter than its header */
    PROTOCOL_MAGIC,  /* wrong magic bytes */
    PROTOCOL_HEADER, /* the stated header length is out of range or not a multiple of 4 */
    PROTOCOL_LENGTH, /* header and payload do not add up to the message's length */
    PROTOCOL_FORMAT, /* unknown format, encoding or layout */
    PROTOCOL_SIZE,   /* width or height out of range, or inconsistent with the payload */
    PROTOCOL_VALUE,  /* a number out of range */
};

/* The clause of PROTOCOL.md that a result violates, such as "6.2"; "" for PROTOCOL_OK. picture: nonzero for a picture's
 * header, 0 for an environment frame's. Static. */
const char *protocol_clause(enum protocol_result result, int picture);
/* The result as part of a sentence, such as "the message ends inside its header". Static. */
const char *protocol_result_text(enum protocol_result result);

enum protocol_format {
    PROTOCOL_JPEG = 1,     /* tone-mapped sRGB, baseline JPEG */
    PROTOCOL_EXR_HALF = 2, /* linear Rec.709 before exposure */
    PROTOCOL_EXR_FLOAT = 3,
    PROTOCOL_H264 = 4,    /* tone-mapped, one access unit of H.264 in Annex B form */
    PROTOCOL_CHANGES = 5, /* which pixels changed, as PNG */
};

enum {
    PROTOCOL_PICTURE_LAST = 1,     /* flag: the source has ended, no picture follows */
    PROTOCOL_PICTURE_REPEAT = 2,   /* flag: rendered before this viewer connected, so its age is not a latency */
    PROTOCOL_PICTURE_LOCKSTEP = 4, /* flag: the only picture of a lockstep frame */
    PROTOCOL_PICTURE_HALF = 8,     /* flag: half width and height, for viewers that cannot receive more */
    PROTOCOL_PICTURE_QUARTER = 16, /* flag: quarter width and height */
    PROTOCOL_PICTURE_FINER = 32,   /* flag: a refinement of the frame shown before; its age is not a latency */
    PROTOCOL_PICTURE_KEY = 64,     /* flag: an H.264 keyframe */
};

/* The header of a picture. Times are microseconds since 1970-01-01 UTC on the server's clock, unless stated otherwise.
 */
struct protocol_picture {
    enum protocol_format format;
    uint8_t flags;          /* PROTOCOL_PICTURE_*; unknown bits are kept */
    uint64_t sequence;      /* 1, 2, ... within a session of the server; gaps are skipped pictures */
    uint64_t frame;         /* number of the environment frame that lit it, from its producer */
    int64_t capture_us;     /* capture time of that frame, on the producer's clock; 0: unknown */
    int64_t published_us;   /* when the picture was handed to the network */
    uint32_t queued_us;     /* waiting time of the frame */
    uint32_t decoded_us;    /* reading the frame and building its sampling tables */
    uint32_t shaded_us;     /* relighting */
    uint32_t encoded_us;    /* exposure, tone curve, compression */
    uint32_t width, height; /* pixels, 1..16384 */
    float gain;             /* factor from radiance to the tone curve's input; finite, >= 0 */
    uint32_t samples;       /* N_s per shading point; 0: does not apply */
    uint32_t payload;       /* bytes after the header */
};

enum protocol_encoding {
    PROTOCOL_FILE_EXR = 1,
    PROTOCOL_FILE_HDR = 2, /* Radiance RGBE */
    PROTOCOL_RAW_HALF = 3, /* width * height * channels half floats, top row first, channels interleaved */
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
    PROTOCOL_CUBE_3X2 = 7,
    PROTOCOL_CUBE_6X1 = 8,
};

enum {
    PROTOCOL_BOTTOM_FIRST = 1, /* flag: rows from bottom to top */
};

/* The header of an environment frame. */
struct protocol_environment {
    enum protocol_encoding encoding;
    enum protocol_layout layout;
    uint8_t flags;
    uint8_t channels;       /* raw: 3 or 4; files: 0 */
    uint32_t width, height; /* raw: texels, 1..16384; files: 0 */
    uint64_t frame;         /* the producer's frame number */
    int64_t capture_us;     /* on the producer's clock; 0: unknown */
    uint32_t payload;       /* bytes after the header */
};

/* Writes exactly PROTOCOL_PICTURE_BYTES to out. Values must be in range; they are not checked. */
void protocol_picture_encode(const struct protocol_picture *p, uint8_t out[PROTOCOL_PICTURE_BYTES]);

/* Decodes and checks a whole message. On PROTOCOL_OK the payload is bytes[*offset .. *offset + p->payload); otherwise
 * *p is unchanged. */
enum protocol_result protocol_picture_decode(const uint8_t *bytes, size_t length, struct protocol_picture *p,
                                             size_t *offset);

/* The sequence number of a picture that protocol_picture_decode refused, so that a reader can acknowledge and skip it;
 * 0 if that cannot be read. */
uint64_t protocol_picture_sequence(const uint8_t *bytes, size_t length);

/* As protocol_picture_encode, for an environment frame: writes PROTOCOL_ENVIRONMENT_BYTES. */
void protocol_environment_encode(const struct protocol_environment *e, uint8_t out[PROTOCOL_ENVIRONMENT_BYTES]);

/* As protocol_picture_decode, for an environment frame. `total` is the length of the whole message, of which only the
 * first `length` bytes need to have arrived, so that a frame can be refused before its payload arrives. */
enum protocol_result protocol_environment_decode(const uint8_t *bytes, size_t length, size_t total,
                                                 struct protocol_environment *e, size_t *offset);
