/* Converts a producer's raw texels to float RGB. Any thread. */
#pragma once

#include "image/codec/frame.h"
#include "net/stream/assembly.h"

/* Fills *f as FRAME_TEXELS, top row first, and leaves its other fields unchanged. Float texels are not copied: frame
 * and payload swap blocks. ERR_NOMEM leaves FRAME_NONE. */
MUST_CHECK enum err texels_take(struct frame *f, const struct protocol_environment *header, struct block *payload);

/* A half float's value [IEEE 754-2019, 3.4]: exact, NaN and infinity included. */
float texels_half(uint16_t bits);
