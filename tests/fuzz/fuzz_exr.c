#include "harness.h"

#include "picture.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    struct image im = { 0 };
    struct reason why = { "" };
    const enum err e = decode_exr(bytes, size, IMAGE_NAME, &im, &why);

    image_check(e, &im, &why);
    image_check_again(decode_exr, bytes, size, e, &im);
    image_finish(&im);
    return 0;
}
