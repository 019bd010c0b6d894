#include "import/parts.h"

#include "base/mem.h"

#include <math.h>
#include <png.h>
#include <string.h>
#include <turbojpeg.h>

#define FILE_MAX (256u << 20)

/* [IEC 61966-2-1, section 5.2]: encoded value in 0..1 to linear. */
static float srgb_to_linear(float v)
{
    return v <= 0.04045f ? v / 12.92f : powf((v + 0.055f) / 1.055f, 2.4f);
}

/* Converts 8-bit texels of `channels` bytes to the texture's floats. */
static enum err take_texels(const uint8_t *texels, int channels, enum texture_values values, struct texture *out)
{
    float linear[256];
    const size_t count = (size_t)out->width * out->height;

    out->rgb = mem_alloc(count, 3 * sizeof(float));
    if (!out->rgb)
        return ERR_NOMEM;
    for (int i = 0; i < 256; i++)
        linear[i] = values == TEXTURE_SRGB ? srgb_to_linear((float)i / 255.0f) : (float)i / 255.0f;
    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < 3; k++)
            out->rgb[3 * i + k] = linear[texels[(size_t)channels * i + k]];
    }
    return ERR_OK;
}

static enum err check_size(uint64_t width, uint64_t height, const char *name, struct reason *why)
{
    if (width < 1 || height < 1 || width > TEXTURE_SIDE_MAX || height > TEXTURE_SIDE_MAX ||
        width * height > TEXTURE_TEXELS_MAX)
        return err_say(why, ERR_RANGE, "%s: %llu x %llu texels; the limit is %d per side and 2^26 in all", name,
                       (unsigned long long)width, (unsigned long long)height, TEXTURE_SIDE_MAX);
    return ERR_OK;
}

static enum err decode_png(const void *bytes, size_t count, enum texture_values values, const char *name,
                           struct texture *out, struct reason *why)
{
    png_image image = { .version = PNG_IMAGE_VERSION };
    uint8_t *texels = NULL;
    enum err e;

    if (!png_image_begin_read_from_memory(&image, bytes, count))
        return err_say(why, ERR_FORMAT, "%s: PNG: %s", name, image.message);
    e = check_size(image.width, image.height, name, why);
    if (e)
        goto done;
    image.format = PNG_FORMAT_RGBA; /* alpha is read so that libpng does not blend with it */
    texels = mem_alloc((size_t)image.width * image.height, 4);
    if (!texels) {
        e = ERR_NOMEM;
        goto done;
    }
    if (!png_image_finish_read(&image, NULL, texels, 0, NULL)) {
        e = err_say(why, ERR_FORMAT, "%s: PNG: %s", name, image.message);
        goto done;
    }
    out->width = image.width;
    out->height = image.height;
    e = take_texels(texels, 4, values, out);
done:
    mem_free(texels);
    png_image_free(&image);
    return e;
}

static enum err decode_jpeg(const void *bytes, size_t count, enum texture_values values, const char *name,
                            struct texture *out, struct reason *why)
{
    int width, height, subsampling, colours;
    uint8_t *texels = NULL;
    enum err e;

    tjhandle tj = tjInitDecompress();
    if (!tj)
        return ERR_NOMEM;
    if (tjDecompressHeader3(tj, bytes, count, &width, &height, &subsampling, &colours)) {
        e = err_say(why, ERR_FORMAT, "%s: JPEG: %s", name, tjGetErrorStr2(tj));
        goto done;
    }
    e = check_size((uint64_t)width, (uint64_t)height, name, why);
    if (e)
        goto done;
    texels = mem_alloc((size_t)width * (size_t)height, 3);
    if (!texels) {
        e = ERR_NOMEM;
        goto done;
    }
    if (tjDecompress2(tj, bytes, count, texels, width, 0, height, TJPF_RGB, TJFLAG_STOPONWARNING)) {
        e = err_say(why, ERR_FORMAT, "%s: JPEG: %s", name, tjGetErrorStr2(tj));
        goto done;
    }
    out->width = (uint32_t)width;
    out->height = (uint32_t)height;
    e = take_texels(texels, 3, values, out);
done:
    mem_free(texels);
    tjDestroy(tj);
    return e;
}

enum err texture_decode(const void *bytes, size_t count, enum texture_values values, const char *name,
                        struct texture *out, struct reason *why)
{
    static const uint8_t png_start[8] = { 0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n' };
    static const uint8_t jpeg_start[3] = { 0xff, 0xd8, 0xff };

    *out = (struct texture){ 0 };
    if (count >= sizeof(png_start) && memcmp(bytes, png_start, sizeof(png_start)) == 0)
        return decode_png(bytes, count, values, name, out, why);
    if (count >= sizeof(jpeg_start) && memcmp(bytes, jpeg_start, sizeof(jpeg_start)) == 0)
        return decode_jpeg(bytes, count, values, name, out, why);
    return err_say(why, ERR_UNSUPPORTED, "%s: texture is neither PNG nor JPEG", name);
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
