/* The main loop of relight-decoder and relight-video: decodes files or video on request until the socket is closed.
 * Thread: main. */
#pragma once

#include "image/codec/decode.h"

struct wire_answer;
struct wire_request;

/* The work per request. */
struct decoder_work {
    /* A file: see decode_image. */
    enum err (*decode)(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why);
    /* All other requests (wire.h); NULL: they are refused. */
    enum err (*video)(void *context, const struct wire_request *q, const uint8_t *bytes, struct image *im,
                      struct wire_answer *a);
    void *context;
};

/* argv: maximum bytes of a file, of an image, and of further memory for decoding. Returns the exit code. */
int decoder_serve(int argc, char **argv, const struct decoder_work *work);
