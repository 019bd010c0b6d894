#include "image/film/film.h"

#include <stddef.h>
#include <string.h>

uint32_t scale_height(uint32_t width, uint32_t height, uint32_t to_width)
{
    const uint64_t rounded = ((uint64_t)height * to_width + width / 2) / width;

    return rounded > 0 ? (uint32_t)rounded : 1;
}

/* How much of pixel i lies between `from` and `to`. */
static float share(uint32_t i, double from, double to)
{
    const double begin = i > from ? i : from, end = i + 1.0 < to ? i + 1.0 : to;

    return (float)(end - begin);
}

/* Adds `weight` times the sums over each new pixel's columns of a row, fractions included. */
static void add_row(const float *row, uint32_t width, double step, float weight, float *out, uint32_t to_width)
{
    for (uint32_t x = 0; x < to_width; x++, out += 3) {
        const double from = x * step, to = (x + 1) * step;
        float sum[3] = { 0 };
        for (uint32_t i = (uint32_t)from; i < width && i < to; i++) {
            const float part = share(i, from, to), *pixel = row + 3 * (size_t)i;
            for (int c = 0; c < 3; c++)
                sum[c] += part * pixel[c];
        }
        for (int c = 0; c < 3; c++)
            out[c] += weight * sum[c];
    }
}

void scale_linear(const float *from, uint32_t width, uint32_t height, float *to, uint32_t to_width, uint32_t to_height)
{
    const double step_x = (double)width / to_width, step_y = (double)height / to_height;

    memset(to, 0, 3 * sizeof(float) * (size_t)to_width * to_height);
    for (uint32_t y = 0; y < to_height; y++)
        for (uint32_t row = (uint32_t)(y * step_y); row < height && row < (y + 1) * step_y; row++)
            add_row(from + 3 * (size_t)width * row, width, step_x,
                    share(row, y * step_y, (y + 1) * step_y) / (float)(step_x * step_y), to + 3 * (size_t)to_width * y,
                    to_width);
}
