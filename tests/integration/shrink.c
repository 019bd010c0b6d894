/* shrink FROM.exr N TO.exr: each pixel is the mean of N by N. */
#include "base/mem.h"
#include "image/codec/decode.h"
#include "image/codec/encode.h"

#include <stdio.h>
#include <stdlib.h>

static void shrink(const struct image *from, uint32_t n, const struct exr_desc *to, float *rgb)
{
    for (size_t y = 0; y < to->height; y++)
        for (size_t x = 0; x < to->width; x++)
            for (size_t c = 0; c < 3; c++) {
                double sum = 0.0;
                for (size_t i = 0; i < (size_t)n * n; i++)
                    sum += (double)from->rgb[3 * ((y * n + i / n) * from->width + x * n + i % n) + c];
                rgb[3 * (y * to->width + x) + c] = (float)(sum / ((double)n * n));
            }
}

int main(int argc, char **argv)
{
    struct image from = { 0 };
    struct reason why;
    const uint32_t n = argc == 4 ? (uint32_t)atoi(argv[2]) : 0;

    if (n == 0 || decode_file(argv[1], &from, &why)) {
        fprintf(stderr, "%s\n", n ? why.text : "usage: shrink FROM.exr N TO.exr");
        return 2;
    }
    float *rgb = mem_alloc((size_t)from.width * from.height * 3, sizeof(*rgb));
    const struct exr_desc to = { .rgb = rgb, .width = from.width / n, .height = from.height / n };
    enum err e = rgb ? ERR_OK : ERR_NOMEM;
    if (!e) {
        shrink(&from, n, &to, rgb);
        e = exr_write(&to, argv[3], &why);
    }
    mem_free(rgb);
    image_finish(&from);
    return e ? 1 : 0;
}
