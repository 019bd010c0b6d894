#include "sky/daylight/reinhart.h"

#include "base/vec.h"

#include <assert.h>

#define ROWS 7     /* of Tregenza's, below the zenith */
#define AROUND 720 /* texels: the least by which the halves of 30, 24, 18, 12 and 6 patches divide */
#define TALL 24    /* texels of a row: the image is about as fine in height as in width, and half a row is whole */

static const uint32_t tregenza[ROWS] = { 30, 30, 24, 24, 18, 12, 6 };

static uint32_t in_row(uint32_t mf, uint32_t row)
{
    return row < ROWS * mf ? mf * tregenza[row / mf] : 1;
}

uint32_t reinhart_count(uint32_t mf)
{
    uint32_t count = 2; /* ground and zenith */

    assert(mf == 1 || mf == 2 || mf == 4);
    for (uint32_t row = 0; row < ROWS * mf; row++)
        count += in_row(mf, row);
    return count;
}

/* The first patch of a row. */
static uint32_t first_of(uint32_t mf, uint32_t row)
{
    uint32_t first = 1;

    for (uint32_t k = 0; k < row; k++)
        first += in_row(mf, k);
    return first;
}

struct reinhart_patch reinhart_patch(uint32_t mf, uint32_t patch)
{
    const double height = 0.5 * PI / (ROWS * mf + 0.5);
    uint32_t row = 0;

    assert(patch < reinhart_count(mf));
    if (patch == 0)
        return (struct reinhart_patch){ .altitude = -0.5 * PI, .solid_angle = 2.0 * PI };
    if (patch == reinhart_count(mf) - 1)
        return (struct reinhart_patch){ 0.5 * PI, 0.0, 2.0 * PI * (1.0 - cos(0.5 * height)), ROWS * mf };
    while (patch >= first_of(mf, row + 1))
        row++;
    const double around = 2.0 * PI / in_row(mf, row);
    return (struct reinhart_patch){ .altitude = height * (row + 0.5),
                                    .azimuth = around * (patch - first_of(mf, row)),
                                    .solid_angle = around * (sin(height * (row + 1)) - sin(height * row)),
                                    .row = row };
}

uint32_t reinhart_subdivision(uint64_t count)
{
    for (uint32_t mf = 1; mf <= 4; mf *= 2)
        if (count == reinhart_count(mf))
            return mf;
    return 0;
}

struct reinhart_row reinhart_row(uint32_t mf, uint32_t row)
{
    const double height = 0.5 * PI / (ROWS * mf + 0.5);

    assert(row <= ROWS * mf);
    return (struct reinhart_row){ .bottom = height * row,
                                  .top = fmin(height * (row + 1), 0.5 * PI),
                                  .first = first_of(mf, row),
                                  .count = in_row(mf, row) };
}

void reinhart_size(uint32_t mf, uint32_t *width, uint32_t *height)
{
    *width = AROUND * mf;
    *height = TALL * (2 * ROWS * mf + 1); /* two hemispheres of 7 MF rows and a half */
}

/* North is the middle of the image and east lies to its right: the azimuth of column x is 2 pi x / width - pi, and
 * patches begin half of their width before their middle. */
uint32_t reinhart_at(uint32_t mf, uint32_t x, uint32_t y)
{
    uint32_t width, height;

    reinhart_size(mf, &width, &height);
    if (y >= height / 2)
        return 0;
    const uint32_t row = (height / 2 - 1 - y) / TALL, wide = width / in_row(mf, row);
    return first_of(mf, row) + (row < ROWS * mf ? (x + width / 2 + wide / 2) % width / wide : 0);
}

void reinhart_sky(uint32_t mf, const float (*radiance)[3], float *rgb)
{
    uint32_t width, height;

    reinhart_size(mf, &width, &height);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++, rgb += 3) {
            const float *from = radiance[reinhart_at(mf, x, y)];
            for (int c = 0; c < 3; c++)
                rgb[c] = from[c];
        }
}
