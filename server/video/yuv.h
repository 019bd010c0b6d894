/* server/video/yuv.h */
/* R'G'B' to Y'CbCr [ITU-R BT.709-6, 3.2 and 3.3] in full range: code value 255 is 1, and 128 is a colour difference of
 * 0. Thread: any. */
#ifndef VIDEO_YUV_H
#define VIDEO_YUV_H

#include <stdint.h>

/* The output planes and their row pitches in bytes. The caller owns them. */
struct yuv_planes {
    uint8_t *y, *cb, *cr;
    int y_pitch, cb_pitch, cr_pitch;
};

/* rgb: uint8_t[height][width][3]. Writes luma, both sides rounded up to even, and one pair of colour differences per 2
 * x 2 pixels, from their mean. Odd sides repeat the last pixel. */
void yuv_from_rgb(const uint8_t *rgb, uint32_t width, uint32_t height, const struct yuv_planes *out);

#endif
