#include "image/output/output.h"

#include "base/file_store.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/sort.h"
#include "image/codec/encode.h"
#include "image/video/movie.h"

#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct output {
    struct output_desc desc;
    struct file_pattern pattern;
    const struct format *format;
    uint32_t width, height;
    struct exposure exposure;
    bool fixed; /* the gain is 2^stops; else exposure adapts */
    double stops;
    bool replaced; /* an existing file, which was reported */
    const struct exr_channel *channels;
    const struct exr_attribute *attributes;
    size_t channel_count, attribute_count;
    struct jpeg_encoder *jpeg;
    struct movie *movie; /* of a format that is one file for all frames; else NULL */
    void *display;       /* [height][width][3 or 4], 8 or 16 bits: the tone-mapped image */
    float *straight;     /* [height][width][4]: the foreground, not premultiplied; NULL without alpha */
};

struct image_parts { /* what output_write gets */
    const float *rgb, *rgba;
    double gain;
};

static enum err write_exr(struct output *o, const struct image_parts *i, const char *name, struct reason *why)
{
    const struct exr_desc d = { .rgb = i->rgba ? i->rgba : i->rgb,
                                .width = o->width,
                                .height = o->height,
                                .depth = o->desc.half ? EXR_HALF : EXR_FLOAT,
                                .alpha = i->rgba != NULL,
                                .channels = o->channels,
                                .channel_count = o->channel_count,
                                .attributes = o->attributes,
                                .attribute_count = o->attribute_count };

    return exr_write(&d, name, why); /* linear radiance */
}

static enum err write_jpeg(struct output *o, const struct image_parts *i, const char *name, struct reason *why)
{
    const struct tone_desc tone = { i->gain, o->desc.tone, o->desc.level };
    const uint8_t *bytes;
    size_t size;

    tone_map(i->rgb, o->width, o->height, &tone, o->display);
    const enum err e = jpeg_encode(o->jpeg, o->display, o->width, o->height, o->desc.quality, &bytes, &size);
    return e ? err_say(why, e, "%s: cannot be encoded", name) : file_store(name, bytes, size, why);
}

static void divide_by_alpha(struct output *o, const float *rgba)
{
    const size_t pixels = (size_t)o->width * o->height;

    for (size_t k = 0; k < 4 * pixels; k += 4) {
        const float alpha = rgba[k + 3], scale = alpha > 0.0f ? 1.0f / alpha : 0.0f;
        for (size_t c = 0; c < 3; c++)
            o->straight[k + c] = rgba[k + c] * scale;
        o->straight[k + 3] = alpha;
    }
}

/* The high bytes of 16 bits, rounded: 255 is 65535. */
static void round_to_bytes(void *display, size_t count)
{
    const uint16_t *from = display;
    uint8_t *to = display;

    for (size_t k = 0; k < count; k++)
        to[k] = (uint8_t)((from[k] + 128u) / 257u); /* is written behind what is read */
}

static enum err write_png(struct output *o, const struct image_parts *i, const char *name, struct reason *why)
{
    const struct tone_desc tone = { i->gain, o->desc.tone, o->desc.level };
    const uint32_t channels = i->rgba ? 4 : 3;
    const struct png_desc d = { o->display, o->width, o->height, o->desc.deep, i->rgba != NULL };
    uint8_t *bytes;
    size_t size;

    if (i->rgba)
        divide_by_alpha(o, i->rgba);
    if (o->desc.deep || i->rgba)
        tone_map_deep(i->rgba ? o->straight : i->rgb, o->width, o->height, channels, &tone, o->display);
    else
        tone_map(i->rgb, o->width, o->height, &tone, o->display);
    if (i->rgba && !o->desc.deep)
        round_to_bytes(o->display, (size_t)o->width * o->height * channels);
    enum err e = png_encode(&d, &bytes, &size, why);
    if (!e)
        e = file_store(name, bytes, size, why);
    mem_free(bytes);
    return e;
}

static const char *place_of(const struct output *o)
{
    return file_is_stdout(o->desc.pattern) ? "standard output" : o->desc.pattern;
}

static enum err write_movie(struct output *o, const struct image_parts *i, const char *name, struct reason *why)
{
    const struct tone_desc tone = { i->gain, o->desc.tone, o->desc.level };
    struct reason cause;

    if (o->desc.tone == TONE_PQ)
        tone_map_pq(i->rgb, o->width, o->height, i->gain, o->display);
    else
        tone_map_deep(i->rgb, o->width, o->height, 3, &tone, o->display);
    const enum err e = movie_add(o->movie, o->display, &cause);
    (void)name; /* of a numbered file */
    return e ? err_say(why, e, "%s: %s", place_of(o), cause.text) : ERR_OK;
}

static const struct format {
    const char *extension;
    bool alpha, deep; /* can be requested */
    bool exposed;     /* depends on exposure */
    bool movie;       /* all frames in one file */
    enum err (*write)(struct output *o, const struct image_parts *i, const char *name, struct reason *why);
} formats[] = {
    { ".exr", true, false, false, false, write_exr },  { ".jpg", false, false, true, false, write_jpeg },
    { ".png", true, true, true, false, write_png },    { ".mp4", false, false, true, true, write_movie },
    { ".mkv", false, false, true, true, write_movie }, { ".webm", false, false, true, true, write_movie },
};

static const struct format *format_of(const struct output_desc *desc)
{
    const char *pattern = desc->pattern;
    const size_t length = strlen(pattern);

    for (size_t k = 0; k < sizeof(formats) / sizeof(formats[0]); k++) {
        const char *extension = formats[k].extension;
        const size_t end = strlen(extension);
        if (file_is_stdout(pattern) ? desc->format && strcmp(desc->format, extension + 1) == 0
                                    : length >= end && strcmp(pattern + length - end, extension) == 0)
            return &formats[k];
    }
    return NULL;
}

const char *output_extension(const struct output_desc *desc)
{
    const struct format *f = format_of(desc);

    return f ? f->extension : NULL;
}

static enum err check_format(const struct output_desc *desc, struct reason *why)
{
    if (!file_is_stdout(desc->pattern) && desc->format)
        return err_say(why, ERR_USAGE, "--format is for --out -; the extension of --out '%s' sets the format",
                       desc->pattern);
    if (format_of(desc))
        return ERR_OK;
    if (!file_is_stdout(desc->pattern))
        return err_say(why, ERR_USAGE, "--out '%s' must end in .exr, .jpg, .png, .mp4, .mkv or .webm", desc->pattern);
    return err_say(why, ERR_USAGE, "%s%s%s: standard output takes exr, jpg, png, mp4, mkv or webm",
                   desc->format ? "--format '" : "--out - needs --format", desc->format ? desc->format : "",
                   desc->format ? "'" : "");
}

bool output_has_movies(void)
{
    return movie_available();
}

enum err output_check(const struct output_desc *desc, struct reason *why)
{
    struct file_pattern parsed;
    enum err e = file_pattern_parse(desc->pattern, "--out", &parsed, why);
    const struct format *format = format_of(desc);

    if (!e)
        e = check_format(desc, why);
    if (e)
        return e;
    if (format->movie && parsed.length > 0)
        return err_say(why, ERR_USAGE, "--out '%s': a video holds all frames; leave out the %%d", desc->pattern);
    if (format->movie && !movie_available())
        return err_say(why, ERR_UNSUPPORTED,
                       "--out '%s': this build writes no video: it was made without libavcodec or libavformat",
                       desc->pattern);
    if (desc->tone == TONE_PQ && format->exposed && !format->movie)
        return err_say(why, ERR_USAGE, "--tone pq is for --out in .mp4, .mkv or .webm, not in %s", format->extension);
    if (desc->layers && format->write != write_exr)
        return err_say(why, ERR_USAGE, "--layers is for --out in .exr, not in %s", format->extension);
    if (desc->alpha && !format->alpha)
        return err_say(why, ERR_USAGE, "--alpha needs --out in .exr or .png, not in %s", format->extension);
    if (desc->deep && !format->deep)
        return err_say(why, ERR_USAGE, "--bits 16 is for --out in .png, not in %s", format->extension);
    return ERR_OK;
}

static enum err create_movie(struct output *o, struct reason *why)
{
    const struct movie_desc m = { .path = o->desc.pattern,
                                  .container = o->format->extension + 1,
                                  .width = o->width,
                                  .height = o->height,
                                  .rate = o->desc.rate,
                                  .quality = o->desc.quality,
                                  .pq = o->desc.tone == TONE_PQ };
    struct reason cause;

    if (!file_is_stdout(o->desc.pattern) && access(o->desc.pattern, F_OK) == 0)
        log_info("%s exists and is replaced", o->desc.pattern);
    const enum err e = movie_create(&m, &o->movie, &cause);
    return e ? err_say(why, e, "--out '%s': %s", o->desc.pattern, cause.text) : ERR_OK;
}

static enum err check_place(const char *pattern, struct reason *why)
{
    const char *slash = strrchr(pattern, '/');
    char folder[4096];

    if (file_is_stdout(pattern))
        return isatty(STDOUT_FILENO)
                   ? err_say(why, ERR_USAGE,
                             "--out -: standard output is a terminal; redirect it: '> FILE' or '| PROGRAM'")
                   : ERR_OK;
    snprintf(folder, sizeof(folder), "%.*s", slash ? (int)(slash - pattern) + 1 : 1, slash ? pattern : ".");
    return access(folder, W_OK) != 0 ? err_say(why, ERR_IO, "--out '%s': %s", pattern, strerror(errno)) : ERR_OK;
}

enum err output_create(const struct output_desc *desc, uint32_t width, uint32_t height, struct output **out,
                       struct reason *why)
{
    *out = NULL;
    enum err e = output_check(desc, why);
    if (!e)
        e = check_place(desc->pattern, why);
    if (e)
        return e;
    struct output *o = mem_alloc(1, sizeof(*o));
    if (!o)
        return err_say(why, ERR_NOMEM, "out of memory");
    o->desc = *desc;
    o->format = format_of(desc);
    o->width = width;
    o->height = height;
    exposure_init(&o->exposure);
    o->jpeg = jpeg_encoder_create();
    o->display =
        mem_alloc((size_t)width * height, desc->alpha || desc->deep || o->format->movie ? 4 * sizeof(uint16_t) : 3);
    o->straight = desc->alpha ? mem_alloc((size_t)width * height, 4 * sizeof(float)) : NULL;
    if (!o->jpeg || !o->display || (desc->alpha && !o->straight) ||
        file_pattern_parse(desc->pattern, "--out", &o->pattern, why)) {
        output_destroy(o);
        return err_say(why, ERR_NOMEM, "no memory for images of %ux%u", width, height);
    }
    const enum err movie = o->format->movie ? create_movie(o, why) : ERR_OK;
    if (movie) {
        output_destroy(o);
        return movie;
    }
    *out = o;
    return ERR_OK;
}

enum err output_finish(struct output *o, struct reason *why)
{
    struct reason cause;
    const enum err e = o->movie ? movie_finish(o->movie, &cause) : ERR_OK;

    return e ? err_say(why, e, "%s: %s", place_of(o), cause.text) : ERR_OK;
}

void output_destroy(struct output *o)
{
    if (!o)
        return;
    jpeg_encoder_destroy(o->jpeg);
    movie_destroy(o->movie);
    mem_free(o->display);
    mem_free(o->straight);
    mem_free(o);
}

bool output_is_numbered(const struct output *o)
{
    const bool images_in_turn = file_is_stdout(o->desc.pattern); /* as ffmpeg's image2pipe takes them */

    return o->pattern.length > 0 || o->format->movie || images_in_turn;
}

bool output_is_stream(const struct output *o)
{
    return o->format->movie || file_is_stdout(o->desc.pattern);
}

bool output_exists(const struct output *o, uint64_t frame)
{
    char name[4096];

    return file_pattern_name(&o->pattern, frame, name, sizeof(name), NULL) == ERR_OK && access(name, F_OK) == 0;
}

enum err output_numbers(const struct output *o, uint64_t **out, size_t *count)
{
    const char *slash = strrchr(o->pattern.text, '/');
    const size_t length = slash ? (size_t)(slash - o->pattern.text) : 0, before = slash ? length + 1 : 0;
    char folder[4096], name[4096];
    size_t capacity = 0;
    struct dirent *d;

    *out = NULL;
    *count = 0;
    if (o->pattern.length == 0 || o->pattern.at < before || length >= sizeof(folder)) /* the number is a folder's */
        return ERR_OK;
    snprintf(folder, sizeof(folder), "%.*s", (int)(slash == o->pattern.text ? 1 : length),
             slash ? o->pattern.text : ".");
    if (!slash)
        strcpy(folder, ".");
    DIR *dir = opendir(folder);
    while (dir && (d = readdir(dir)) != NULL) {
        if (strlen(d->d_name) <= o->pattern.at - before)
            continue;
        const uint64_t number = strtoull(d->d_name + (o->pattern.at - before), NULL, 10);
        if (file_pattern_name(&o->pattern, number, name, sizeof(name), NULL) || strcmp(name + before, d->d_name) != 0)
            continue;
        if (!mem_reserve(out, *count, &capacity, sizeof(**out))) {
            closedir(dir);
            mem_free(*out);
            *out = NULL;
            return ERR_NOMEM;
        }
        (*out)[(*count)++] = number;
    }
    if (dir)
        closedir(dir);
    if (*count > 1)
        qsort(*out, *count, sizeof(**out), sort_compares_whole);
    return ERR_OK;
}

bool output_is_movie(const struct output *o)
{
    return o && o->format->movie;
}

bool output_is_exposed(const struct output *o)
{
    return o->format->exposed;
}

double output_exposure(const struct output *o)
{
    return o->stops;
}

void output_fix_exposure(struct output *o, double stops)
{
    o->fixed = true;
    o->stops = stops;
}

void output_set_layers(struct output *o, const struct exr_channel *channels, size_t channel_count,
                       const struct exr_attribute *attributes, size_t attribute_count)
{
    o->channels = channels;
    o->channel_count = channel_count;
    o->attributes = attributes;
    o->attribute_count = attribute_count;
}

enum err output_write(struct output *o, const float *rgb, const float *rgba, uint64_t frame, struct reason *why)
{
    const struct image_parts parts = { rgb, rgba,
                                       o->fixed ? exp2(o->stops)
                                                : exposure_step(&o->exposure, rgb, o->width, o->height, 1) };
    char name[4096];
    const enum err e = file_pattern_name(&o->pattern, frame, name, sizeof(name), why);

    if (!o->fixed)
        o->stops = log2(parts.gain);
    if (!e && !o->replaced && !o->movie && !file_is_stdout(name) && access(name, F_OK) == 0) {
        log_info("%s exists and is replaced%s", name, o->pattern.length > 0 ? ", and so are others" : "");
        o->replaced = true;
    }
    return e ? e : o->format->write(o, &parts, name, why);
}
