/* The main loop of relight-decoder and relight-video: decodes files or video on request until the socket is closed.
 * Thread: main. */
#pragma once

#include "image/codec/decode.h"
#include "image/codec/image.h"
#include "image/codec/signal.h"

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
struct wire_answer;
struct wire_request;

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
