/* server/stream/texels.h */
/* Texels as they come from a producer into the float RGB that a frame carries. Any thread. */
#ifndef STREAM_TEXELS_H
#define STREAM_TEXELS_H

#include "assembly.h"
#include "frame.h"

/* Fills *f as FRAME_TEXELS from a raw payload, top row first; other fields of the frame are left alone. Float texels
 * stay where they are: the payload's block becomes the frame's, and *payload the one that the frame had. ERR_NOMEM
 * leaves FRAME_NONE. */
MUST_CHECK enum err texels_take(struct frame *f, const struct protocol_environment *header, struct block *payload);

/* A half float's value [IEEE 754-2019, 3.4]: exact, NaN and infinity included. */
float texels_half(uint16_t bits);

#endif
