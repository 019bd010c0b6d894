/* H.264 through libavcodec and libx264, for live streams: each frame is output at once, and every frame except a
 * keyframe encodes only the difference to the previous one [H.264]. Thread: one per encoder; the output buffer is
 * reused. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Whether this build supports H.264. Thread: any. */
bool h264_built(void);

/* Whether the encoder is on this machine too; loads it (ffmpeg.h). Thread: any. */
bool h264_available(void);

struct h264_encoder;

struct h264_encoder *h264_encoder_create(void);    /* NULL: out of memory or not available */
void h264_encoder_destroy(struct h264_encoder *h); /* NULL is allowed */

struct h264_desc {
    uint32_t width, height;
    int quality;            /* 1..100, as for JPEG; 100 is visually lossless */
    double bits_per_second; /* limit over H264_CAP_S seconds, reached by lowering the quality; 0: no limit */
    int64_t time_us;        /* time of the frame, by any monotonic clock; the rate is measured with it */
    bool key;               /* make this a keyframe */
};
#define H264_CAP_S 1.0 /* the window of bits_per_second */

/* The highest useful bit rate, bits per second, for a size in pixels and a rate in frames per second. Thread: any. */
double h264_max_useful_rate(uint32_t width, uint32_t height, double rate);

struct h264_output {
    const uint8_t *bytes; /* one access unit in Annex B form; parameter sets precede a keyframe */
    size_t size;
    bool key; /* a keyframe: requested, the first, after a size change, or after an error */
};

/* Encodes uint8_t[height][width][3] sRGB as 4:2:0, BT.709, full range. An odd side is padded by repeating its last
 * pixel; decoders crop it. The encoder owns the output, which stays valid until the next call. ERR_RANGE: a side of 0
 * or above 16384. ERR_NOMEM. ERR_UNSUPPORTED: the encoder refuses the settings or is not available. */
MUST_CHECK enum err h264_encode(struct h264_encoder *h, const uint8_t *rgb, const struct h264_desc *desc,
                                struct h264_output *out);

/* ---- Access units ---- */

/* H.264 access units in Annex B form, where each NAL unit follows a start code [H.264, B.1]. Thread: any. */

/* The length of the parameter sets at the start of an access unit, with an access unit delimiter in front of them if
 * there is one; 0: it does not start with both kinds of set. What follows starts with a start code. */
size_t annexb_header_size(const uint8_t *bytes, size_t size);
