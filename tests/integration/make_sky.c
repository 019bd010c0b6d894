/* Writes one sky as a flat Radiance image of any layout, for the test that all layouts light a scene alike:
 *     make_sky LAYOUT WIDTH HEIGHT > FILE.hdr
 * The sky has different colours all around and a soft, bright sun off every axis; below the horizon it is the mean of
 * the upper half, as for a fisheye. */
#include "support/layouts.h"

#include <stdio.h>
#include <stdlib.h>

#define PARTS 4 /* along each side of a texel, so that it holds the mean of what it spans */

static void sky_above(const double w[3], double rgb[3])
{
    static const double sun[3] = { 0.48, 0.60, 0.64 };
    const double toward = sun[0] * w[0] + sun[1] * w[1] + sun[2] * w[2], glow = 30.0 * exp(60.0 * (toward - 1.0));

    rgb[0] = 0.4 + 0.25 * w[0] + 0.2 * w[1] + glow;
    rgb[1] = 0.5 + 0.1 * w[0] * w[2] + 0.3 * w[1] + 0.9 * glow;
    rgb[2] = 0.6 + 0.3 * w[2] + 0.3 * w[1] + 0.7 * glow;
}

static void mean_above(double mean[3])
{
    const int rows = 200, columns = 400;

    mean[0] = mean[1] = mean[2] = 0.0;
    for (int i = 0; i < rows * columns; i++) {
        const double y = (i / columns + 0.5) / rows, s = sqrt(1.0 - y * y); /* uniform in solid angle */
        const double phi = 6.283185307179586 * (i % columns) / columns, w[3] = { s * cos(phi), y, s * sin(phi) };
        double rgb[3];
        sky_above(w, rgb);
        for (int c = 0; c < 3; c++)
            mean[c] += rgb[c] / (rows * columns);
    }
}

/* Shared exponent from the largest component; mantissas are rounded. */
static void put_rgbe(const double rgb[3])
{
    const double largest = fmax(rgb[0], fmax(rgb[1], rgb[2]));
    unsigned char out[4] = { 0, 0, 0, 0 };
    int exponent;

    if (largest > 1e-30) {
        const double scale = frexp(largest * 256.0 / 255.5, &exponent) > 0.0 ? ldexp(256.0, -exponent) : 0.0;
        for (int c = 0; c < 3; c++)
            out[c] = (unsigned char)(rgb[c] * scale + 0.5);
        out[3] = (unsigned char)(exponent + 128);
    }
    fwrite(out, 1, sizeof(out), stdout);
}

static void texel(const char *layout, int width, int height, int x, int y, const double below[3], double out[3])
{
    int shown = 0;

    out[0] = out[1] = out[2] = 0.0;
    for (int k = 0; k < PARTS * PARTS; k++) {
        double w[3], rgb[3];
        if (!test_direction(layout, width, height, x + (k % PARTS + 0.5) / PARTS, y + (k / PARTS + 0.5) / PARTS, w))
            continue;
        sky_above(w, rgb);
        shown++;
        for (int c = 0; c < 3; c++)
            out[c] += w[1] > 0.0 ? rgb[c] : below[c];
    }
    for (int c = 0; c < 3 && shown; c++)
        out[c] /= shown;
}

int main(int argc, char **argv)
{
    const int width = argc == 4 ? atoi(argv[2]) : 0, height = argc == 4 ? atoi(argv[3]) : 0;
    double below[3], rgb[3];

    if (width < 1 || height < 1) {
        fprintf(stderr, "usage: make_sky LAYOUT WIDTH HEIGHT\n");
        return 2;
    }
    mean_above(below);
    printf("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n", height, width);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            texel(argv[1], width, height, x, y, below, rgb);
            put_rgbe(rgb);
        }
    return ferror(stdout) || fflush(stdout) ? 1 : 0;
}
