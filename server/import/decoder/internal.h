/* What decoder.c and video.c share. Private to this room. Thread: one per decoder. */
#pragma once

#include "base/err.h"
#include "image/codec/decode.h"
#include "image/codec/image.h"
#include "image/codec/signal.h"
#include "import/decoder/decoder.h"
#include "import/sandbox/helper_process.h"

#include <stdint.h>

/* ---- Messages ---- */

/* Messages between relightd and relight-decoder (import/sandbox/helper_process.h). File bytes and texels are exchanged
 * through two blocks of shared memory. Private to this room. */

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
    int64_t taken_us;   /* IMAGE: as image.taken_us */
    double exposure_s;  /* IMAGE: as image.exposure_s */
    uint64_t nan, infinite, negative, clipped;
    struct reason why;
    char note[320]; /* IMAGE, CONVERT: as image.note */
};

struct decoder {
    char program[4096];
    size_t file_bytes, memory_bytes;
    uint32_t timeout_ms;
    const atomic_bool *stop;
    struct child_memory file, picture;

    struct child child;
    bool video;              /* it is relight-video */
    bool streaming;          /* the process has a video stream */
    unsigned crashes_in_row; /* consecutive crashes */
    int64_t restart_ms;      /* earliest restart */
    atomic_uint_fast64_t files, crashed, timed_out, invalid, refused, starts;
};

/* Sends a request with q->size bytes beside it, to a running process, started if necessary, and waits for the answer.
 * On ERR_OK *a is a valid one. Else counts what went wrong, if it was the process, and delays its restart. */
MUST_CHECK enum err decoder_exchange(struct decoder *d, const struct wire_request *q, const uint8_t *bytes,
                                     struct wire_answer *a, struct reason *why);

/* What the answer says is not valid: counts that, delays the restart and says so. */
enum err decoder_report_invalid(struct decoder *d, const char *name, struct reason *why);

/* Copies the shared texels into im->rgb, which has room for them, and counts what had to be corrected: nothing, unless
 * the process was taken over. */
void decoder_take_texels(const struct decoder *d, struct image *im);

/* Returns memory to the system that only much larger contents than `bytes` needed. */
void decoder_trim(struct child_memory *m, size_t bytes);

/* ---- The process ---- */

/* The main loop of relight-decoder and relight-video: decodes files or video on request until the socket is closed.
 * Thread: main. */

struct wire_answer;
struct wire_request;

/* The work per request. */
struct decoder_work {
    /* A file: see decode_image. */
    enum err (*decode)(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why);
    /* All other requests (internal.h); NULL: they are refused. */
    enum err (*video)(void *context, const struct wire_request *q, const uint8_t *bytes, struct image *im,
                      struct wire_answer *a);
    void *context;
};

/* argv: maximum bytes of a file, of an image, and of further memory for decoding. Returns the exit code. */
int decoder_serve(int argc, char **argv, const struct decoder_work *work);

/* ---- Stream ---- */

/* The work of relight-video: one video stream, packet by packet, through libavcodec. Part of relight-video alone.
 * Thread: main. */

struct stream;

struct stream *stream_create(void);    /* NULL: out of memory */
void stream_destroy(struct stream *s); /* NULL is allowed */

/* As decoder_work.video; `context` is the stream. Errors: ERR_FORMAT: a damaged packet, later ones may do.
 * ERR_UNSUPPORTED: no decoder for this codec, or a colour or pixel format that this program does not know. ERR_RANGE:
 * too large. ERR_NOMEM. */
enum err stream_work(void *context, const struct wire_request *q, const uint8_t *bytes, struct image *im,
                     struct wire_answer *a);

/* ---- Texels ---- */

/* Images of libavcodec to linear texels. Part of relight-video alone. Thread: one. */

struct AVFrame;

struct texels {              /* zeroed memory is empty */
    struct signal_desc desc; /* of `signal`, if it is prepared */
    struct signal *signal;   /* owned */
    bool prepared;
    float *rows; /* owned; five rows of `width` floats */
    uint32_t width;
    enum signal_transfer override;
    double peak_cdm2;
};

/* Converts every component of an image that is planar or packed, RGB, grey or Y'CbCr, with any subsampling and 8 to 16
 * bits: linear Rec.709 in cd/m^2. Chroma is interpolated between its sites. ERR_UNSUPPORTED: another pixel format or
 * colour. ERR_RANGE: too large. ERR_NOMEM. */
MUST_CHECK enum err texels_convert(struct texels *t, const struct AVFrame *f, const char *name, struct image *im,
                                   struct reason *why);
void texels_finish(struct texels *t);
