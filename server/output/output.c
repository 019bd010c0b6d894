#include "output/output.h"

#include "base/file_pattern.h"
#include "base/file_store.h"
#include "base/mem.h"
#include "codec/exr_write.h"
#include "codec/jpeg.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

struct output {
    struct output_desc desc;
    struct file_pattern pattern;
    const struct format *format;
    uint32_t width, height;
    struct exposure exposure;
    struct jpeg_encoder *jpeg;
    uint8_t *display; /* [height][width][3]: the tone-mapped image */
};

static enum err write_exr(struct output *o, const float *rgb, double gain, const char *name, struct reason *why)
{
    const struct exr_desc d = { rgb, o->width, o->height, o->desc.half ? EXR_HALF : EXR_FLOAT, NULL, 0 };

    (void)gain; /* linear radiance */
    return exr_write(&d, name, why);
}

static enum err write_jpeg(struct output *o, const float *rgb, double gain, const char *name, struct reason *why)
{
    const uint8_t *bytes;
    size_t size;

    tone_map(rgb, o->width, o->height, &(struct tone_desc){ gain, o->desc.tone, o->desc.level }, o->display);
    const enum err e = jpeg_encode(o->jpeg, o->display, o->width, o->height, o->desc.quality, &bytes, &size);
    return e ? err_say(why, e, "%s: cannot be encoded", name) : file_store(name, bytes, size, why);
}

static const struct format {
    const char *extension;
    enum err (*write)(struct output *o, const float *rgb, double gain, const char *name, struct reason *why);
} formats[] = {
    { ".exr", write_exr },
    { ".jpg", write_jpeg },
};

static const struct format *format_of(const char *pattern)
{
    const size_t length = strlen(pattern);

    for (size_t k = 0; k < sizeof(formats) / sizeof(formats[0]); k++) {
        const size_t end = strlen(formats[k].extension);
        if (length >= end && strcmp(pattern + length - end, formats[k].extension) == 0)
            return &formats[k];
    }
    return NULL;
}

enum err output_check(const char *pattern, struct reason *why)
{
    struct file_pattern parsed;
    const enum err e = file_pattern_parse(pattern, "--out", &parsed, why);

    if (!e && !format_of(pattern))
        return err_say(why, ERR_USAGE, "--out '%s' must end in .exr or .jpg", pattern);
    return e;
}

enum err output_create(const struct output_desc *desc, uint32_t width, uint32_t height, struct output **out,
                       struct reason *why)
{
    const char *slash = strrchr(desc->pattern, '/');
    char folder[4096];

    *out = NULL;
    const enum err e = output_check(desc->pattern, why);
    if (e)
        return e;
    snprintf(folder, sizeof(folder), "%.*s", slash ? (int)(slash - desc->pattern) + 1 : 1, slash ? desc->pattern : ".");
    if (access(folder, W_OK) != 0)
        return err_say(why, ERR_IO, "--out '%s': %s", desc->pattern, strerror(errno));
    struct output *o = mem_alloc(1, sizeof(*o));
    if (!o)
        return err_say(why, ERR_NOMEM, "out of memory");
    o->desc = *desc;
    o->format = format_of(desc->pattern);
    o->width = width;
    o->height = height;
    exposure_init(&o->exposure);
    o->jpeg = jpeg_encoder_create();
    o->display = mem_alloc((size_t)width * height, 3);
    if (!o->jpeg || !o->display || file_pattern_parse(desc->pattern, "--out", &o->pattern, why)) {
        output_destroy(o);
        return err_say(why, ERR_NOMEM, "no memory for pictures of %ux%u", width, height);
    }
    *out = o;
    return ERR_OK;
}

void output_destroy(struct output *o)
{
    if (!o)
        return;
    jpeg_encoder_destroy(o->jpeg);
    mem_free(o->display);
    mem_free(o);
}

bool output_is_numbered(const struct output *o)
{
    return o->pattern.length > 0;
}

enum err output_write(struct output *o, const float *rgb, uint64_t frame, struct reason *why)
{
    const double gain = exposure_step(&o->exposure, rgb, o->width, o->height, 1);
    char name[4096];
    const enum err e = file_pattern_name(&o->pattern, frame, name, sizeof(name), why);

    return e ? e : o->format->write(o, rgb, gain, name, why);
}
