#include "image/codec/decode.h"

#include "base/luminance.h"
#include "base/mem.h"

#include <math.h>
#include <png.h>
#include <turbojpeg.h>

enum { CODES = 256 };

/* sRGB code values as light, 1 for white. */
static void fill_light(float light[CODES])
{
    for (int i = 0; i < CODES; i++)
        light[i] = (float)srgb_decode(i / 255.0);
}

/* bytes: `channels` a texel, of which the first three count. */
static void take_codes(const uint8_t *bytes, size_t channels, struct image *im)
{
    const size_t count = (size_t)im->width * im->height;
    float light[CODES];

    fill_light(light);
    for (size_t t = 0; t < count; t++)
        for (size_t c = 0; c < 3; c++)
            im->rgb[3 * t + c] = light[bytes[channels * t + c]];
}

static enum err begin(struct image *im, uint64_t width, uint64_t height, const char *name, struct reason *why)
{
    enum err e = image_check_size(im, width, height, name, why);

    if (!e && image_resize(im, (uint32_t)width, (uint32_t)height))
        e = err_say(why, ERR_NOMEM, "%s: out of memory for its texels", name);
    im->low_range = !e;
    return e;
}

enum err decode_jpeg(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why)
{
    int width = 0, height, subsampling, colours; /* all unset where a file ends before its image */
    uint8_t *codes = NULL;
    enum err e;

    tjhandle tj = tjInitDecompress();
    if (!tj)
        return err_say(why, ERR_NOMEM, "%s: out of memory", name);
    if (tjDecompressHeader3(tj, bytes, size, &width, &height, &subsampling, &colours)) {
        e = err_say(why, ERR_FORMAT, "%s: JPEG: %s", name, tjGetErrorStr2(tj));
        goto done;
    }
    if (width == 0) {
        e = err_say(why, ERR_FORMAT, "%s: JPEG: it contains no image", name);
        goto done;
    }
    e = colours == TJCS_CMYK || colours == TJCS_YCCK
            ? err_say(why, ERR_UNSUPPORTED, "%s: a CMYK JPEG; convert it to RGB", name)
            : begin(im, (uint64_t)width, (uint64_t)height, name, why);
    if (e)
        goto done;
    codes = mem_alloc_raw((size_t)width * (size_t)height, 3);
    if (!codes)
        e = err_say(why, ERR_NOMEM, "%s: out of memory for its texels", name);
    else if (tjDecompress2(tj, bytes, size, codes, width, 0, height, TJPF_RGB, TJFLAG_STOPONWARNING))
        e = err_say(why, ERR_FORMAT, "%s: JPEG: %s", name, tjGetErrorStr2(tj));
    else
        take_codes(codes, 3, im);
done:
    mem_free(codes);
    tjDestroy(tj);
    return e;
}

/* Files of 16 bits: libpng makes them linear. */
static enum err read_wide(png_image *image, const char *name, struct image *im, struct reason *why)
{
    const size_t count = (size_t)im->width * im->height;
    uint16_t *light = mem_alloc_raw(count, 4 * sizeof(*light));
    enum err e = ERR_OK;

    if (!light)
        return err_say(why, ERR_NOMEM, "%s: out of memory for its texels", name);
    image->format = PNG_FORMAT_LINEAR_RGB_ALPHA;
    image->flags |= PNG_IMAGE_FLAG_16BIT_sRGB; /* unless the file declares otherwise */
    if (!png_image_finish_read(image, NULL, light, 0, NULL))
        e = err_say(why, ERR_FORMAT, "%s: PNG: %s", name, image->message);
    for (size_t t = 0; t < count && !e; t++)
        for (size_t c = 0; c < 3; c++)
            im->rgb[3 * t + c] = (float)light[4 * t + c] / 65535.0f;
    mem_free(light);
    return e;
}

static enum err read_narrow(png_image *image, const char *name, struct image *im, struct reason *why)
{
    uint8_t *codes = mem_alloc_raw((size_t)im->width * im->height, 4);
    enum err e = ERR_OK;

    if (!codes)
        return err_say(why, ERR_NOMEM, "%s: out of memory for its texels", name);
    image->format = PNG_FORMAT_RGBA;
    if (!png_image_finish_read(image, NULL, codes, 0, NULL))
        e = err_say(why, ERR_FORMAT, "%s: PNG: %s", name, image->message);
    else
        take_codes(codes, 4, im);
    mem_free(codes);
    return e;
}

enum err decode_png(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why)
{
    png_image image = { .version = PNG_IMAGE_VERSION };

    if (!png_image_begin_read_from_memory(&image, bytes, size))
        return err_say(why, ERR_FORMAT, "%s: PNG: %s", name, image.message);
    enum err e = begin(im, image.width, image.height, name, why);
    if (!e)
        e = image.format & PNG_FORMAT_FLAG_LINEAR ? read_wide(&image, name, im, why)
                                                  : read_narrow(&image, name, im, why);
    png_image_free(&image);
    return e;
}
