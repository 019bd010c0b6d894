#include "clients/feed/reader.h"

#include "base/file_store.h"
#include "base/log.h"
#include "clients/common/client.h"
#include "image/codec/encode.h"

#include <inttypes.h>
#include <string.h>
#include <strings.h>

struct writer {
    struct file_pattern pattern;
    struct parcel_desc parcel; /* texels as floats */
    enum exr_depth depth;
    uint64_t written, faulty;
    unsigned said; /* by image_report */
};

static enum err check_pattern(const struct reader_desc *d, const char *pattern, struct source *s,
                              struct file_pattern *out, struct reason *why)
{
    const struct setting_frames *frames = &d->source.frames;
    const char *dot = strrchr(pattern, '.');
    const bool one = frames->given ? frames->first == frames->last : source_count(s) == 1;
    const enum err e = file_pattern_parse(pattern, "--out", out, why);

    if (e)
        return e;
    if (!dot || strcasecmp(dot, ".exr") != 0)
        return err_say(why, ERR_USAGE, "--out '%s': expected a file name that ends in .exr", pattern);
    if (source_kind(s) == SOURCE_SKY && !frames->given)
        return err_say(why, ERR_USAGE, "%s never ends: select frames, such as --frames 0-9", d->source.spec);
    if (out->length == 0 && !one)
        return err_say(why, ERR_USAGE,
                       "--out '%s' names one file: add %%04d for the frame number, or select one frame with --frames",
                       pattern);
    return ERR_OK;
}

static enum err write_one(struct writer *w, struct parcel *p, struct reason *why)
{
    char name[4096];
    enum err e = parcel_pack(p, &w->parcel, why);

    if (e) {
        log_error("%s; skipped", why->text);
        w->faulty++;
        return ERR_OK;
    }
    if (p->decoded)
        image_report(&p->image, p->frame.name, &w->said);
    e = file_pattern_name(&w->pattern, p->frame.number, name, sizeof(name), why);
    if (e)
        return e;
    const struct exr_desc d = { .rgb = (const float *)(const void *)p->payload,
                                .width = p->header.width,
                                .height = p->header.height,
                                .depth = w->depth };
    e = exr_write(&d, name, why);
    w->written += !e;
    return e;
}

static enum err write_all(struct writer *w, struct source *s, struct reason *why)
{
    struct parcel p = { .payload = NULL };
    enum err e = ERR_OK;

    while (!e && !client_interrupted()) {
        e = source_next(s, &p.frame, why);
        if (e == ERR_END)
            break;
        if (e == ERR_IO || e == ERR_RANGE) {
            log_error("%s; skipped", why->text);
            w->faulty++;
            e = ERR_OK;
        } else if (!e && p.frame.kind != FRAME_NONE) {
            e = write_one(w, &p, why);
        }
    }
    parcel_finish(&p);
    if (e && e != ERR_END)
        return e;
    log_info("%" PRIu64 " frames written", w->written);
    if (w->faulty)
        return err_say(why, ERR_IO, "frames that could not be read: %" PRIu64, w->faulty);
    return e == ERR_END ? ERR_OK : err_say(why, ERR_IO, "interrupted");
}

enum err files_write(const struct reader_desc *d, const char *pattern, struct reason *why)
{
    struct writer w = { .parcel = { .layout = d->parcel.layout, .raw = RAW_FLOAT, .layer = d->parcel.layer },
                        .depth = d->parcel.raw == RAW_HALF ? EXR_HALF : EXR_FLOAT };
    struct source *s;
    enum err e = source_open(&d->source, &s, why);

    if (e)
        return e;
    e = check_pattern(d, pattern, s, &w.pattern, why);
    if (!e)
        e = write_all(&w, s, why);
    source_close(s);
    return e;
}
