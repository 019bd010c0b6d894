/* The work of relight-video: one video stream, packet by packet, through libavcodec. Part of relight-video alone.
 * Thread: main. */
#pragma once

#include "image/codec/image.h"

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
