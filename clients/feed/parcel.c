#include "clients/feed/reader.h"

#include "base/half.h"
#include "base/mem.h"
#include "image/codec/decode.h"

#include <inttypes.h>
#include <string.h>

#define PAYLOAD_MAX UINT32_MAX

static const enum protocol_layout layouts[] = {
    [LAYOUT_AUTO] = PROTOCOL_LAYOUT_AUTO,
    [LAYOUT_LATLONG] = PROTOCOL_LATLONG,
    [LAYOUT_LATLONG_BOTTOM_FIRST] = PROTOCOL_LATLONG,
    [LAYOUT_CUBE] = PROTOCOL_CUBE,
    [LAYOUT_HCROSS] = PROTOCOL_HCROSS,
    [LAYOUT_VCROSS] = PROTOCOL_VCROSS,
    [LAYOUT_BALL] = PROTOCOL_BALL,
    [LAYOUT_FISHEYE] = PROTOCOL_FISHEYE,
    [LAYOUT_CUBE_3X2] = PROTOCOL_CUBE_3X2,
    [LAYOUT_CUBE_6X1] = PROTOCOL_CUBE_6X1,
};
_Static_assert(sizeof(layouts) / sizeof(layouts[0]) == LAYOUT_LAST + 1, "a layout lacks its number in the protocol");

static bool is_radiance(const uint8_t *bytes, size_t size)
{
    return size >= 2 && bytes[0] == '#' && bytes[1] == '?';
}

static enum err state_texels(struct parcel *p, const struct parcel_desc *d, const float *rgb, uint32_t width,
                             uint32_t height, struct reason *why)
{
    const uint64_t count = (uint64_t)width * height * 3, bytes = count * (d->raw == RAW_HALF ? 2 : 4);

    if (width > PROTOCOL_SIDE_MAX || height > PROTOCOL_SIDE_MAX || bytes > PAYLOAD_MAX)
        return err_say(why, ERR_RANGE, "%s: %" PRIu32 "x%" PRIu32 " texels exceed the size of a message%s",
                       p->frame.name, width, height, d->raw == RAW_HALF ? "" : "; try --raw half");
    p->header.encoding = d->raw == RAW_HALF ? PROTOCOL_RAW_HALF : PROTOCOL_RAW_FLOAT;
    p->header.width = width;
    p->header.height = height;
    p->header.channels = 3;
    p->header.payload = (uint32_t)bytes;
    p->payload = (const uint8_t *)rgb; /* little-endian, like all supported processors */
    if (d->raw != RAW_HALF)
        return ERR_OK;
    if (p->half_count < count) {
        mem_free(p->half);
        p->half_count = 0;
        p->half = mem_alloc((size_t)count, sizeof(*p->half));
        if (!p->half)
            return err_say(why, ERR_NOMEM, "%s: out of memory for its half floats", p->frame.name);
        p->half_count = (size_t)count;
    }
    for (size_t i = 0; i < count; i++) /* larger values would become infinite as half floats */
        p->half[i] = half_round(rgb[i] > 65504.0f ? 65504.0f : rgb[i]);
    p->payload = (const uint8_t *)p->half;
    return ERR_OK;
}

/* Of texels: a computed sky is lat-long; a video has the requested layout, else its own. */
static void state_layout(struct parcel *p, const struct parcel_desc *d)
{
    const struct frame *f = &p->frame;
    struct reason ignored;
    int own;

    if (!f->layout[0]) {
        p->header.layout = PROTOCOL_LATLONG;
        p->header.flags = 0;
    } else if (d->layout == LAYOUT_AUTO &&
               choice_parse(layout_choices, 0, "layout", f->layout, &own, &ignored) == ERR_OK) {
        p->header.layout = layouts[own];
    }
}

static enum err state_file(struct parcel *p, const struct parcel_desc *d, struct reason *why)
{
    const struct frame *f = &p->frame;
    const bool exr = f->size >= 4 && memcmp(f->bytes, "\x76\x2f\x31\x01", 4) == 0;
    /* A damaged file is sent as it is, so that the refusal appears in the server's counters. */
    const bool barred = exr && exr_policy_check(f->bytes, f->size, f->name, &p->barred) == ERR_UNSUPPORTED;

    const bool low = decode_is_low_range(f->bytes, f->size);

    if (!exr && !low && !is_radiance(f->bytes, f->size))
        return err_say(why, ERR_FORMAT, "%s: neither an OpenEXR nor a Radiance file, nor a JPEG or PNG", f->name);
    if (!barred)
        p->barred.text[0] = '\0';
    if (low)
        (void)err_say(&p->barred, ERR_UNSUPPORTED, "%s: a JPEG or PNG", f->name);
    p->decoded = barred || low || d->raw || d->layer;
    if (p->decoded) {
        p->image.layer = d->layer;
        const enum err e = decode_image(f->bytes, f->size, f->name, &p->image, why);
        if (e)
            return e;
        /* The layout declared in the file would otherwise be lost. */
        if (p->header.layout == PROTOCOL_LAYOUT_AUTO)
            p->header.layout = layouts[p->image.layout];
        return state_texels(p, d, p->image.rgb, p->image.width, p->image.height, why);
    }
    if (f->size > PAYLOAD_MAX)
        return err_say(why, ERR_RANGE, "%s: %zu bytes exceed the size of a message", f->name, f->size);
    p->header.encoding = exr ? PROTOCOL_FILE_EXR : PROTOCOL_FILE_HDR;
    p->header.payload = (uint32_t)f->size;
    p->payload = f->bytes;
    return ERR_OK;
}

enum err parcel_pack(struct parcel *p, const struct parcel_desc *d, struct reason *why)
{
    const struct frame *f = &p->frame;

    p->barred.text[0] = '\0';
    p->decoded = false;
    p->header = (struct protocol_environment){
        .layout = layouts[d->layout],
        .flags = d->layout == LAYOUT_LATLONG_BOTTOM_FIRST ? PROTOCOL_BOTTOM_FIRST : 0,
        .frame = f->number,
        .capture_us = f->capture_us,
    };
    if (f->number > PROTOCOL_NUMBER_MAX)
        return err_say(why, ERR_RANGE, "%s: the frame number exceeds 2^53 - 1", f->name);
    if (f->capture_us > PROTOCOL_NUMBER_MAX || f->capture_us < -PROTOCOL_NUMBER_MAX)
        p->header.capture_us = 0;
    enum err e;
    if (f->kind == FRAME_TEXELS) {
        state_layout(p, d);
        e = state_texels(p, d, f->rgb, f->width, f->height, why);
    } else {
        e = state_file(p, d, why);
    }
    if (!e)
        protocol_environment_encode(&p->header, p->head);
    return e;
}

void parcel_finish(struct parcel *p)
{
    frame_finish(&p->frame);
    image_finish(&p->image);
    mem_free(p->half);
    *p = (struct parcel){ .payload = NULL };
}
