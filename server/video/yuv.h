/* server/video/yuv.h */
/* R'G'B' to Y'CbCr as [ITU-R BT.709-6, 3.2 and 3.3] has it, in full range: a code value of 255 is 1, and colour
 * differences of 0 are 128. Pure function, any thread. */
#ifndef VIDEO_YUV_H
#define VIDEO_YUV_H

#include <stdint.h>

/* Where the planes are, and how many bytes lie between the beginnings of two rows of each. */
struct yuv_planes {
    uint8_t *y, *cb, *cr;
    int y_pitch, cb_pitch, cr_pitch;
};

/* rgb: uint8_t[height][width][3]. Writes luma of both sides rounded up to even, and one pair of colour differences, of
 * the mean of its pixels, for each square of 2 x 2; beyond an odd side the last pixel is repeated. */
void yuv_from_rgb(const uint8_t *rgb, uint32_t width, uint32_t height, const struct yuv_planes *out);

#endif
