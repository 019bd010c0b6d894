#include "image/codec/encode.h"

#include "base/text.h"

#include <png.h>
#include <setjmp.h>

#define SIDE_MAX 1000000u /* libpng's own default limit */

struct sink {
    struct text file;
    jmp_buf out;
};

static void on_error(png_structp png, png_const_charp text)
{
    struct sink *s = png_get_error_ptr(png);

    (void)text;
    longjmp(s->out, 1);
}

static void on_warning(png_structp png, png_const_charp text)
{
    (void)png;
    (void)text;
}

static void append(png_structp png, png_bytep bytes, png_size_t count)
{
    struct sink *s = png_get_io_ptr(png);

    text_add_bytes(&s->file, (const char *)bytes, count);
    if (s->file.failed)
        png_error(png, "out of memory");
}

static void flush(png_structp png)
{
    (void)png;
}

/* False: s->file.failed, or the library refused the image. No local changes between setjmp and longjmp. */
static bool write_all(const struct png_desc *d, struct sink *s, png_structp png, png_infop info)
{
    const size_t row = (size_t)d->width * (d->alpha ? 4 : 3) * (d->deep ? 2 : 1);
    const uint16_t inspection = 1;

    if (setjmp(s->out))
        return false;
    png_set_write_fn(png, s, append, flush);
    png_set_IHDR(png, info, d->width, d->height, d->deep ? 16 : 8,
                 d->alpha ? PNG_COLOR_TYPE_RGB_ALPHA : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_RELATIVE);
    png_write_info(png, info);
    if (d->deep && *(const uint8_t *)&inspection == 1) /* the file is big-endian */
        png_set_swap(png);
    for (uint32_t y = 0; y < d->height; y++)
        png_write_row(png, (png_const_bytep)d->samples + y * row);
    png_write_end(png, info);
    return true;
}

enum err png_encode(const struct png_desc *d, uint8_t **bytes, size_t *size, struct reason *why)
{
    struct sink s = { .file = { .bytes = NULL } };

    *bytes = NULL;
    *size = 0;
    if (d->width < 1 || d->height < 1 || d->width > SIDE_MAX || d->height > SIDE_MAX)
        return err_say(why, ERR_RANGE, "PNG: %ux%u: each side must be 1 to %u", d->width, d->height, SIDE_MAX);
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &s, on_error, on_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    const bool good = info && write_all(d, &s, png, info);

    png_destroy_write_struct(png ? &png : NULL, info ? &info : NULL);
    if (good) {
        *bytes = (uint8_t *)s.file.bytes;
        *size = s.file.size;
        return ERR_OK;
    }
    text_finish(&s.file);
    return err_say(why, ERR_NOMEM, "PNG: no memory for %ux%u pixels", d->width, d->height);
}
