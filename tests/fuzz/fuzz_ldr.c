/* JPEG and PNG images are decoded to texels from 0 to 1, or refused with a reason. */
#include "harness.h"

#include "image/codec/decode.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    struct image im = { .max_side = 1024 };
    struct reason why = { "" };
    const enum err e = decode_image(bytes, size, "input", &im, &why);

    require(!e || why.text[0], "a refusal has a reason");
    require(e || !im.low_range || decode_is_low_range(bytes, size), "low range of a JPEG or PNG alone");
    for (size_t i = 0; !e && im.low_range && i < 3 * (size_t)im.width * im.height; i++)
        require(im.rgb[i] >= 0.0f && im.rgb[i] <= 1.0f, "texels from black to white");
    image_finish(&im);
    return 0;
}
