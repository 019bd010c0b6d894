/* server/video/h264.h */
/* H.264 through libavcodec and libx264, for live pictures: each picture comes out as it goes in, none is held back, and
 * each but a key picture says only what has changed since the one before [H.264]. One encoder per thread; its output
 * memory is reused. */
#ifndef VIDEO_H264_H
#define VIDEO_H264_H

#include "err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Whether this program was built with it and the encoder is there. */
bool h264_available(void);

struct h264_encoder;

struct h264_encoder *h264_encoder_create(void);    /* NULL when out of memory, or not available */
void h264_encoder_destroy(struct h264_encoder *h); /* NULL is allowed */

struct h264_desc {
    uint32_t width, height;
    int quality;          /* 1..100, as of JPEG: 100 is hardly told from the picture, */
    double bits_a_second; /* as long as that takes no more than this, over H264_CAP_S; 0: whatever it takes */
    int64_t time_us;      /* when the picture comes, by any clock that never steps: bits a second are by this */
    bool key;             /* the picture is to need none of those before it */
};
#define H264_CAP_S 1.0

/* Bits a second that are worth while: for a size, and pictures a second. */
double h264_enough(uint32_t width, uint32_t height, double rate);

struct h264_output {
    const uint8_t *bytes; /* one access unit in Annex B form; before a key picture stand its parameter sets */
    size_t size;
    bool key; /* it needs none before it: it was asked for, the first, of another size, or after an error */
};

/* Encodes uint8_t[height][width][3] sRGB as 4:2:0, BT.709, full range. Sides of an odd length become one pixel longer,
 * the last one repeated: readers cut it off. What *out points to is valid until the next call.
 * ERR_RANGE: a side of 0 or above 16384. ERR_NOMEM. ERR_UNSUPPORTED: the encoder does not take it, or there is none. */
MUST_CHECK enum err h264_encode(struct h264_encoder *h, const uint8_t *rgb, const struct h264_desc *desc,
                                struct h264_output *out);

#endif
