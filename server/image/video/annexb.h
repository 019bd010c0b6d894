/* H.264 access units in Annex B form, where each NAL unit follows a start code [H.264, B.1]. Thread: any. */
#pragma once

#include <stddef.h>
#include <stdint.h>

/* The length of the parameter sets at the start of an access unit, with an access unit delimiter in front of them if
 * there is one; 0: it does not start with both kinds of set. What follows starts with a start code. */
size_t annexb_header_size(const uint8_t *bytes, size_t size);
