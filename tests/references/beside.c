/* beside LEFT.exr RIGHT.exr OUT.jpg: two images of one size side by side, under one exposure. */
#include "base/mem.h"
#include "image/codec/decode.h"
#include "image/output/output.h"

#include <stdio.h>
#include <string.h>

static enum err write_both(const struct image side[2], const char *path, struct reason *why)
{
    const uint32_t width = side[0].width, height = side[0].height;
    const struct output_desc desc = { .pattern = path, .tone = TONE_FILMIC, .quality = 95 };
    const size_t row = 3 * (size_t)width;
    struct output *out = NULL;
    enum err e = ERR_OK;

    float *both = mem_alloc(2 * row * height, sizeof(*both));
    if (!both)
        return err_say(why, ERR_NOMEM, "out of memory");
    for (size_t y = 0; y < height; y++)
        for (size_t i = 0; i < 2; i++)
            memcpy(both + (2 * y + i) * row, side[i].rgb + y * row, row * sizeof(*both));
    e = output_create(&desc, 2 * width, height, &out, why);
    if (!e)
        e = output_write(out, both, NULL, 0, why);
    output_destroy(out);
    mem_free(both);
    return e;
}

int main(int argc, char **argv)
{
    struct image side[2] = { { 0 }, { 0 } };
    struct reason why = { "usage: beside LEFT.exr RIGHT.exr OUT.jpg" };
    enum err e = argc == 4 ? ERR_OK : ERR_USAGE;

    for (int i = 0; i < 2 && !e; i++)
        e = decode_file(argv[1 + i], &side[i], &why);
    if (!e && (side[0].width != side[1].width || side[0].height != side[1].height))
        e = err_say(&why, ERR_RANGE, "%s and %s differ in size", argv[1], argv[2]);
    if (!e)
        e = write_both(side, argv[3], &why);
    if (e)
        fprintf(stderr, "beside: %s\n", why.text);
    image_finish(&side[0]);
    image_finish(&side[1]);
    return e == ERR_USAGE ? 2 : e ? 1 : 0;
}
