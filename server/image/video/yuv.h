/* R'G'B' to Y'CbCr [ITU-R BT.709-6, 3.2 and 3.3] in full range: code value 255 is 1, and 128 is a colour difference of
 * 0. Thread: any. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

/* The output planes and their row pitches in bytes. The caller owns them. */
struct yuv_planes {
    uint8_t *y, *cb, *cr;
    int y_pitch, cb_pitch, cr_pitch;
};

/* rgb: uint8_t[height][width][3]. Writes luma, both sides rounded up to even, and one pair of colour differences per 2
 * x 2 pixels, from their mean. Odd sides repeat the last pixel. */
void yuv_from_rgb(const uint8_t *rgb, uint32_t width, uint32_t height, const struct yuv_planes *out);

/* The same for files, in limited range with chroma to the left [ITU-R BT.709-6, 3.5]: from uint16_t[height][width][3],
 * 65535 a signal of 1. pq: by the matrix of BT.2020 [ITU-R BT.2100-2, Table 6] to 10 bits in uint16_t, pitches still in
 * bytes; else BT.709 to 8 bits. */
void yuv_limited_from_rgb(const uint16_t *rgb, uint32_t width, uint32_t height, bool pq, const struct yuv_planes *out);
