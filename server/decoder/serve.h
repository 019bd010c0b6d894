/* server/decoder/serve.h */
/* The main loop of relight-decoder: decodes files on request until the socket is closed. Thread: main. */
#ifndef DECODER_SERVE_H
#define DECODER_SERVE_H

#include "codec/decode.h"

/* The work per file; see decode_image. */
struct decoder_work {
    enum err (*decode)(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why);
};

/* argv: maximum bytes of a file, of an image, and of further memory for decoding. Returns the exit code. */
int decoder_serve(int argc, char **argv, const struct decoder_work *work);

#endif
