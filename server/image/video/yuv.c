#include "image/video/yuv.h"

#include <stddef.h>

/* In units of 2^-16. The rows sum to 1 and to 0, so that grey stays grey despite rounding. */
enum {
    Y_R = 13933,  /* 0.2126 */
    Y_G = 46871,  /* 0.7152 */
    Y_B = 4732,   /* 0.0722 */
    CB_R = -7509, /* -0.2126 / 1.8556 */
    CB_G = -25259,
    CB_B = 32768,
    CR_R = 32768,
    CR_G = -29763, /* -0.7152 / 1.5748 */
    CR_B = -3005,
};

static uint8_t luma(const uint8_t *p)
{
    return (uint8_t)((Y_R * p[0] + Y_G * p[1] + Y_B * p[2] + 32768) >> 16);
}

/* The sum of four pixels: 2^18 units are one code value. Clamps 255.5 to 255. */
static uint8_t difference(int32_t sum)
{
    const int32_t v = (sum + (128 << 18) + (1 << 17)) >> 18;
    return (uint8_t)(v > 255 ? 255 : v);
}

static void convert_pair(const uint8_t *const row[2], uint32_t width, uint8_t *const y[2], uint8_t *cb, uint8_t *cr)
{
    for (uint32_t x = 0; x < width; x += 2) {
        const size_t left = 3 * (size_t)x, right = x + 1 < width ? left + 3 : left;
        int32_t sum[3];
        for (int j = 0; j < 2; j++) {
            y[j][x] = luma(row[j] + left);
            y[j][x + 1] = luma(row[j] + right);
        }
        for (int c = 0; c < 3; c++)
            sum[c] = row[0][left + c] + row[0][right + c] + row[1][left + c] + row[1][right + c];
        cb[x / 2] = difference(CB_R * sum[0] + CB_G * sum[1] + CB_B * sum[2]);
        cr[x / 2] = difference(CR_R * sum[0] + CR_G * sum[1] + CR_B * sum[2]);
    }
}

void yuv_from_rgb(const uint8_t *rgb, uint32_t width, uint32_t height, const struct yuv_planes *out)
{
    const size_t pitch = 3 * (size_t)width;

    for (uint32_t row = 0; row < height; row += 2) {
        const uint8_t *above = rgb + row * pitch, *const rows[2] = { above, row + 1 < height ? above + pitch : above };
        uint8_t *const y[2] = { out->y + (ptrdiff_t)row * out->y_pitch, out->y + (ptrdiff_t)(row + 1) * out->y_pitch };
        convert_pair(rows, width, y, out->cb + (ptrdiff_t)(row / 2) * out->cb_pitch,
                     out->cr + (ptrdiff_t)(row / 2) * out->cr_pitch);
    }
}
