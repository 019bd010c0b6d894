/* server/decoder/serve.h */
/* The inside of relight-decoder: decodes what it is told to until nobody is there any more. */
#ifndef DECODER_SERVE_H
#define DECODER_SERVE_H

#include "decode.h"

/* What the process does for one file, as decode_image does. */
struct decoder_work {
    enum err (*decode)(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why);
};

/* argv: the bytes of the largest file, of the largest picture, and those that decoding may take beside. Returns the
 * exit code. */
int decoder_serve(int argc, char **argv, const struct decoder_work *work);

#endif
