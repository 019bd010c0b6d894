#include "import/parts/texture_decode.h"

#include <png.h>
#include <string.h>
#include <turbojpeg.h>
#include <webp/decode.h>

#define FILE_MAX (256u << 20) /* bounds memory before the image's size is known */

enum err texture_check_size(uint64_t width, uint64_t height, const char *name, struct reason *why)
{
    if (width < 1 || height < 1 || width > TEXTURE_SIDE_MAX || height > TEXTURE_SIDE_MAX ||
        width * height > TEXTURE_TEXELS_MAX)
        return err_say(why, ERR_RANGE, "%s: %llu x %llu texels; the limit is %d per side and 2^26 in all", name,
                       (unsigned long long)width, (unsigned long long)height, TEXTURE_SIDE_MAX);
    return ERR_OK;
}

/* Straight into the texture's finest level. */
static enum err decode_png(const void *bytes, size_t count, enum texture_values values, const char *name,
                           struct texture *out, struct reason *why)
{
    png_image image = { .version = PNG_IMAGE_VERSION };
    enum err e;

    if (!png_image_begin_read_from_memory(&image, bytes, count))
        return err_say(why, ERR_FORMAT, "%s: PNG: %s", name, image.message);
    e = texture_check_size(image.width, image.height, name, why);
    if (e)
        goto done;
    image.format = PNG_FORMAT_RGBA;
    image.flags |=
        PNG_IMAGE_FLAG_16BIT_sRGB; /* else libpng takes 16-bit files for linear; they are rounded to 8 bits */
    e = texture_init(out, image.width, image.height, values);
    if (!e && !png_image_finish_read(&image, NULL, out->texels, 0, NULL))
        e = err_say(why, ERR_FORMAT, "%s: PNG: %s", name, image.message);
done:
    png_image_free(&image);
    return e;
}

static enum err decode_jpeg(const void *bytes, size_t count, enum texture_values values, const char *name,
                            struct texture *out, struct reason *why)
{
    int width = 0, height = 0, subsampling, colours; /* not set where a file ends before its image */
    enum err e;

    tjhandle tj = tjInitDecompress();
    if (!tj)
        return ERR_NOMEM;
    if (tjDecompressHeader3(tj, bytes, count, &width, &height, &subsampling, &colours)) {
        e = err_say(why, ERR_FORMAT, "%s: JPEG: %s", name, tjGetErrorStr2(tj));
        goto done;
    }
    e = width < 1 || height < 1 ? err_say(why, ERR_FORMAT, "%s: JPEG: it contains no image", name)
                                : texture_check_size((uint64_t)width, (uint64_t)height, name, why);
    if (!e)
        e = texture_init(out, (uint32_t)width, (uint32_t)height, values);
    /* TJPF_RGBA sets alpha to 255 */
    if (!e && tjDecompress2(tj, bytes, count, out->texels, width, 0, height, TJPF_RGBA, TJFLAG_STOPONWARNING))
        e = err_say(why, ERR_FORMAT, "%s: JPEG: %s", name, tjGetErrorStr2(tj));
done:
    tjDestroy(tj);
    return e;
}

static enum err decode_webp(const void *bytes, size_t count, enum texture_values values, const char *name,
                            struct texture *out, struct reason *why)
{
    int width, height;

    if (!WebPGetInfo(bytes, count, &width, &height))
        return err_say(why, ERR_FORMAT, "%s: WebP: the header is damaged", name);
    enum err e = texture_check_size((uint64_t)width, (uint64_t)height, name, why);
    if (!e)
        e = texture_init(out, (uint32_t)width, (uint32_t)height, values);
    const size_t row = 4 * (size_t)width;
    if (!e && !WebPDecodeRGBAInto(bytes, count, out->texels, row * (size_t)height, (int)row))
        e = err_say(why, ERR_FORMAT, "%s: WebP: the image is damaged, or animated", name);
    return e;
}

/* Alpha that means nothing must not show in a digest. */
static void drop_alpha(struct texture *t)
{
    const size_t count = (size_t)t->width * t->height;

    for (size_t i = 0; i < count; i++)
        t->texels[4 * i + 3] = UINT8_MAX;
}

enum err texture_decode(const void *bytes, size_t count, enum texture_values values, const char *name,
                        struct texture *out, struct reason *why)
{
    static const uint8_t png_start[8] = { 0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n' };
    static const uint8_t jpeg_start[3] = { 0xff, 0xd8, 0xff }, ktx_start[5] = { 0xab, 'K', 'T', 'X', ' ' };

    enum err e;

    *out = (struct texture){ 0 };
    if (count >= sizeof(png_start) && memcmp(bytes, png_start, sizeof(png_start)) == 0)
        e = decode_png(bytes, count, values, name, out, why);
    else if (count >= sizeof(jpeg_start) && memcmp(bytes, jpeg_start, sizeof(jpeg_start)) == 0)
        e = decode_jpeg(bytes, count, values, name, out, why);
    else if (count >= 12 && memcmp(bytes, "RIFF", 4) == 0 && memcmp((const uint8_t *)bytes + 8, "WEBP", 4) == 0)
        e = decode_webp(bytes, count, values, name, out, why);
    else if (count >= sizeof(ktx_start) && memcmp(bytes, ktx_start, sizeof(ktx_start)) == 0)
        e = err_say(why, ERR_UNSUPPORTED,
                    "%s: KTX2 is not supported; convert it to PNG, for instance with 'ktx extract'", name);
    else if (tga_recognise(bytes, count))
        e = tga_decode(bytes, count, values, name, out, why);
    else
        e = err_say(why, ERR_UNSUPPORTED, "%s: texture is neither PNG nor JPEG nor WebP nor TGA", name);
    if (e) {
        texture_finish(out);
        return e;
    }
    if (values == TEXTURE_SRGB)
        drop_alpha(out);
    texture_build_levels(out);
    return ERR_OK;
}

enum err texture_load(const struct host *host, const char *path, enum texture_values values, struct texture *out,
                      struct reason *why)
{
    struct bytes bytes;

    *out = (struct texture){ 0 };
    enum err e = host_read(host, path, &bytes, why);
    if (e)
        return e;
    if (bytes.size > FILE_MAX)
        e = err_say(why, ERR_RANGE, "%s: %zu bytes, more than the limit of %u", path, bytes.size, FILE_MAX);
    else
        e = texture_decode(bytes.at, bytes.size, values, path, out, why);
    bytes_finish(&bytes);
    return e;
}
