#include "image/codec/encode.h"

#include "base/file_store.h"
#include "base/mem.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define RLE_MIN 8 /* shorter scan lines are flat */
#define RLE_MAX 32767
#define RUN_MIN 4 /* shorter runs cost more than they save */
#define RUN_MAX 127
#define PLAIN_MAX 128 /* larger counts mean runs */
#define BIAS 128      /* exponent bias */

/* The largest channel gets a mantissa of 128..255, which Radiance reads as v = (m + 1/2) / 256 x 2^(exponent - 128). */
static void encode_texel(const float rgb[3], uint8_t out[4])
{
    const float most = fmaxf(rgb[0], fmaxf(rgb[1], rgb[2]));
    int exponent;

    memset(out, 0, 4);
    if (!(most > 1e-32f)) /* Radiance's own threshold */
        return;
    (void)frexpf(most, &exponent);
    /* Of (255 + 1/2) / 512 and (128 + 1/2) / 256 the nearer one: an exact power of two lies between them. */
    exponent -= ldexpf(most, 8 - exponent) < 128.125f; /* at least -107, by the threshold */
    exponent = exponent > 255 - BIAS ? 255 - BIAS : exponent;
    for (int c = 0; c < 3; c++) {
        const float m = rgb[c] > 0.0f ? ldexpf(rgb[c], 8 - exponent) : 0.0f;
        out[c] = (uint8_t)(m < 255.0f ? m : 255.0f);
    }
    out[3] = (uint8_t)(exponent + BIAS);
}

/* Length of the run that starts at x, at most RUN_MAX. Values are 4 bytes apart. */
static uint32_t run_from(const uint8_t *plane, uint32_t x, uint32_t width)
{
    uint32_t n = 1;

    while (n < RUN_MAX && x + n < width && plane[4 * (size_t)(x + n)] == plane[4 * (size_t)x])
        n++;
    return n;
}

/* Encodes one of a scan line's four planes: runs (128 + count, value) and literals (count, values). */
static uint8_t *pack_plane(const uint8_t *plane, uint32_t width, uint8_t *to)
{
    for (uint32_t x = 0; x < width;) {
        const uint32_t run = run_from(plane, x, width);
        if (run >= RUN_MIN) {
            *to++ = (uint8_t)(128 + run);
            *to++ = plane[4 * (size_t)x];
            x += run;
            continue;
        }
        uint8_t *count = to++;
        *count = 0;
        do {
            *to++ = plane[4 * (size_t)x++];
            ++*count;
        } while (x < width && *count < PLAIN_MAX && run_from(plane, x, width) < RUN_MIN);
    }
    return to;
}

static uint8_t *pack_row(const float *rgb, uint32_t width, uint8_t *texels, uint8_t *to)
{
    for (uint32_t x = 0; x < width; x++)
        encode_texel(rgb + 3 * (size_t)x, texels + 4 * (size_t)x);
    if (width < RLE_MIN || width > RLE_MAX) {
        memcpy(to, texels, 4 * (size_t)width);
        return to + 4 * (size_t)width;
    }
    const uint8_t head[4] = { 2, 2, (uint8_t)(width >> 8), (uint8_t)(width & 255) };
    memcpy(to, head, sizeof(head));
    to += sizeof(head);
    for (int p = 0; p < 4; p++)
        to = pack_plane(texels + p, width, to);
    return to;
}

enum err hdr_encode(const struct hdr_desc *d, uint8_t **bytes, size_t *size, struct reason *why)
{
    static const char form[] = "#?RADIANCE\n%sFORMAT=32-bit_rle_rgbe\n\n-Y %" PRIu32 " +X %" PRIu32 "\n";
    const char *lines = d->lines ? d->lines : "";
    const size_t header = sizeof(form) + strlen(lines) + 24;
    const size_t row = 8 * (size_t)d->width + 16; /* a plane at most doubles: a literal takes two bytes at most */

    *size = 0;
    *bytes = mem_alloc(header + row * d->height, 1);
    uint8_t *texels = mem_alloc(d->width, 4);
    if (!*bytes || !texels) {
        mem_free(*bytes);
        mem_free(texels);
        *bytes = NULL;
        return err_say(why, ERR_NOMEM, "out of memory for an image of %" PRIu32 "x%" PRIu32, d->width, d->height);
    }
    uint8_t *to = *bytes + snprintf((char *)*bytes, header, form, lines, d->height, d->width);
    for (uint32_t y = 0; y < d->height; y++)
        to = pack_row(d->rgb + 3 * (size_t)d->width * y, d->width, texels, to);
    *size = (size_t)(to - *bytes);
    mem_free(texels);
    return ERR_OK;
}

enum err hdr_write(const struct hdr_desc *d, const char *path, struct reason *why)
{
    uint8_t *bytes = NULL;
    size_t size = 0;

    enum err e = hdr_encode(d, &bytes, &size, why);
    if (!e)
        e = file_store(path, bytes, size, why);
    mem_free(bytes);
    return e;
}
