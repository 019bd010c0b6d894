#include "image/codec/calendar.h"
#include "image/codec/decode.h"
#include "image/codec/exr_file.h"

#include <math.h>
#include <string.h>

/* False: the part does not have it, or it is damaged, which is noted: another type, or not from `least` to `most`. */
static bool take_number(const struct exr_file *x, const char *key, double least, double most, struct image *im,
                        double *out)
{
    float v = 0.0f;
    const exr_result_t r = exr_attr_get_float(x->context, x->part, key, &v);

    if (r == EXR_ERR_NO_ATTR_BY_NAME)
        return false;
    if (r == EXR_ERR_SUCCESS && (double)v >= least && (double)v <= most) {
        *out = (double)v;
        return true;
    }
    image_note(im, "its %s is damaged and is ignored", key);
    return false;
}

void exr_file_take_time(struct exr_file *x, struct image *im)
{
    const struct reason before = x->library_fault;
    const char *text = NULL;
    int32_t length = 0;
    double offset = 0.0;
    char shown[40];

    const exr_result_t r = exr_attr_get_string(x->context, x->part, "capDate", &length, &text);
    if (r == EXR_ERR_SUCCESS && text && length > 0)
        im->taken_us = calendar_of_text(text, (size_t)length);
    if (r != EXR_ERR_NO_ATTR_BY_NAME && im->taken_us == 0)
        image_note(im, "its capDate '%s' is no time and is ignored",
                   r == EXR_ERR_SUCCESS && text ? decode_printable(text, (size_t)length, shown, sizeof(shown)) : "");
    /* OpenEXR's standard attributes: UTC is capDate + utcOffset. No zone is more than 14 hours away. */
    if (im->taken_us && take_number(x, "utcOffset", -50400.0, 50400.0, im, &offset))
        im->taken_us += llround(offset * 1e6);
    if (im->taken_us < 0)
        im->taken_us = 0;
    (void)take_number(x, "expTime", 0.0, IMAGE_EXPOSURE_MAX_S, im, &im->exposure_s);
    x->library_fault = before; /* an attribute of another type does not explain a fault in the texels */
}
