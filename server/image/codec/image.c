#include "image/codec/image.h"

#include "base/half.h"
#include "base/log.h"
#include "base/mem.h"
#include "image/codec/exr_zip.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define BLOCK 64          /* texels processed together: 768 bytes, which stay in the first-level cache */

const struct setting_choice layout_choices[] = {
    { "auto", LAYOUT_AUTO, "as the file says; otherwise 2:1 is lat-long", 0 },
    { "latlong", LAYOUT_LATLONG, "lat-long, 2:1", 0 },
    { "latlong-bottom", LAYOUT_LATLONG_BOTTOM_FIRST, "lat-long with the bottom row first", 0 },
    { "cube", LAYOUT_CUBE, "six stacked cube faces, 1:6", 0 },
    { "hcross", LAYOUT_HCROSS, "horizontal cross, 4:3", 0 },
    { "vcross", LAYOUT_VCROSS, "vertical cross, 3:4", 0 },
    { "ball", LAYOUT_BALL, "mirror ball", 0 },
    { "cube-3x2", LAYOUT_CUBE_3X2, "cube faces of video in two rows, 3:2", 0 },
    { "cube-6x1", LAYOUT_CUBE_6X1, "cube faces of video in one row, 6:1", 0 },
    { "fisheye", LAYOUT_FISHEYE, "equidistant fisheye of the upper hemisphere", 0 },
    { NULL, 0, NULL, 0 },
};

enum err image_check_size(const struct image *im, uint64_t width, uint64_t height, const char *where,
                          struct reason *why)
{
    const uint64_t side = im->max_side ? im->max_side : IMAGE_MAX_SIDE, texels = side * ((side + 1) / 2);

    if (width > side || height > side || width * height > texels)
        return err_say(why, ERR_RANGE,
                       "%s: an image of %" PRIu64 "x%" PRIu64 " texels is too large; the limit is %" PRIu64
                       " per side and %" PRIu64 " in all",
                       where, width, height, side, texels);
    return ERR_OK;
}

enum err image_resize(struct image *im, uint32_t width, uint32_t height)
{
    struct reason why;

    if (width == 0 || height == 0 || image_check_size(im, width, height, "", &why))
        return ERR_RANGE;
    const size_t count = (size_t)width * height * 3;
    if (count > im->capacity) {
        /* freed first: both may not fit at once */
        mem_free(im->rgb);
        im->width = im->height = 0;
        im->capacity = 0;
        im->rgb = mem_alloc_raw(count, sizeof(*im->rgb));
        if (!im->rgb)
            return ERR_NOMEM;
        im->capacity = count;
    }
    im->width = width;
    im->height = height;
    im->layout = LAYOUT_AUTO;
    im->note[0] = '\0';
    im->taken_us = 0;
    im->exposure_s = 0.0;
    memset(&im->faults, 0, sizeof(im->faults));
    return ERR_OK;
}

void image_trim(struct image *im)
{
    const size_t count = (size_t)im->width * im->height * 3, bytes = count * sizeof(*im->rgb);

    recent_add(&im->recent, bytes);
    if (!recent_is_outgrown(&im->recent, im->capacity * sizeof(*im->rgb)))
        return;
    float *rgb = mem_alloc_raw(count, sizeof(*rgb));
    if (!rgb)
        return;
    memcpy(rgb, im->rgb, bytes);
    mem_free(im->rgb);
    im->rgb = rgb;
    im->capacity = count;
    mem_trim(); /* the resampling tables of such an image were freed in pieces */
}

void image_finish(struct image *im)
{
    if (!im)
        return;
    mem_free(im->rgb);
    scratch_destroy(im->scratch);
    exr_inflater_destroy(im->inflater);
    memset(im, 0, sizeof(*im));
}

/* Whether no value needs to be corrected or counted: the common case, one comparison per value and no branch. */
static bool are_plain(const float *v, size_t count)
{
    int odd = 0;

    for (size_t i = 0; i < count; i++)
        odd |= !(v[i] >= 0.0f && v[i] < HALF_MAX);
    return !odd;
}

/* Before the change of primaries: marks NaN and infinities, clamps to +-IMAGE_MAX. */
static void bound(float *v, size_t count, struct image_faults *faults)
{
    for (size_t i = 0; i < count; i++) {
        if (isnan(v[i])) {
            faults->nan++;
        } else if (fabsf(v[i]) > IMAGE_MAX) {
            faults->infinite++;
            if (isfinite(v[i]) || v[i] < 0.0f)
                v[i] = v[i] > 0.0f ? IMAGE_MAX : 0.0f;
        } else if (v[i] == HALF_MAX) {
            faults->clipped++;
        }
    }
}

static void drop_negative(float *v, size_t count, struct image_faults *faults)
{
    for (size_t i = 0; i < count; i++) {
        if (v[i] < 0.0f) {
            faults->negative++;
            v[i] = 0.0f;
        }
    }
}

/* A bounded value can exceed the bound only by the matrix; it is clamped without counting it again. */
static void transform(float *v, size_t texels, const float *m)
{
    for (size_t i = 0; i < texels; i++, v += 3) {
        const float r = v[0], g = v[1], b = v[2];
        for (int c = 0; c < 3; c++)
            v[c] = fminf(m[3 * c] * r + m[3 * c + 1] * g + m[3 * c + 2] * b, IMAGE_MAX);
    }
}

/* As transform, where texels may be marked: what mixes with a mark is unknown, too. */
static void transform_marked(float *v, size_t texels, const float *m)
{
    for (size_t i = 0; i < texels; i++, v += 3) {
        const float sum = v[0] + v[1] + v[2]; /* no mark is negative, so that an infinity stays one beside numbers */
        if (isfinite(sum))
            transform(v, 1, m);
        else
            v[0] = v[1] = v[2] = sum;
    }
}

void image_sanitise_texels(float *rgb, size_t count, const float *to_rec709, struct image_faults *faults)
{
    for (size_t done = 0; done < count; done += BLOCK) {
        const size_t texels = count - done < BLOCK ? count - done : BLOCK;
        float *v = rgb + 3 * done;

        const bool plain = are_plain(v, 3 * texels);
        if (!plain)
            bound(v, 3 * texels, faults);
        if (to_rec709)
            (plain ? transform : transform_marked)(v, texels, to_rec709);
        if (to_rec709 || !plain)
            drop_negative(v, 3 * texels, faults);
    }
}

/* ---- Mending ---- */

#define MASK_SHARE 100 /* of the image's texels: a larger area of NaN is a mask */
#define MASK_MIN 64    /* texels: a smaller one never is */
#define SEEN -1.0f     /* a mark in the current area; no other value is negative */
#define SEEN_INFINITE -2.0f

/* A connected area of marked values of one channel. */
struct area {
    uint32_t *texels; /* owned; its texels so far */
    size_t count, capacity;
    float around; /* highest finite value beside it */
};

static void look_at_texel(const struct image *im, size_t channel, uint32_t at, struct area *a)
{
    float *v = &im->rgb[3 * (size_t)at + channel];

    if (isfinite(*v)) {
        a->around = fmaxf(a->around, *v);
        return;
    }
    if (!mem_reserve(&a->texels, a->count, &a->capacity, sizeof(*a->texels)))
        return; /* the rest of it counts as an area of its own */
    a->texels[a->count++] = at;
    *v = isnan(*v) ? SEEN : SEEN_INFINITE;
}

static void look_around(const struct image *im, size_t channel, uint32_t at, struct area *a)
{
    const uint32_t x = at % im->width, y = at / im->width;
    const uint32_t x0 = x > 0 ? x - 1 : 0, x1 = x + 1 < im->width ? x + 1 : x;
    const uint32_t y0 = y > 0 ? y - 1 : 0, y1 = y + 1 < im->height ? y + 1 : y;

    for (uint32_t j = y0; j <= y1; j++)
        for (uint32_t i = x0; i <= x1; i++)
            look_at_texel(im, channel, j * im->width + i, a);
}

static void mend_area(const struct image *im, size_t channel, uint32_t first, struct area *a)
{
    const size_t all = (size_t)im->width * im->height, most = all / MASK_SHARE > MASK_MIN ? all / MASK_SHARE : MASK_MIN;

    a->count = 0;
    a->around = 0.0f;
    look_at_texel(im, channel, first, a);
    for (size_t i = 0; i < a->count; i++)
        look_around(im, channel, a->texels[i], a);
    for (size_t i = 0; i < a->count; i++) {
        float *v = &im->rgb[3 * (size_t)a->texels[i] + channel];
        *v = *v == SEEN_INFINITE ? fmaxf(a->around, HALF_MAX) : a->count > most ? 0.0f : a->around;
    }
    float *v = &im->rgb[3 * (size_t)first + channel];
    if (!isfinite(*v)) /* out of memory */
        *v = isnan(*v) ? 0.0f : HALF_MAX;
}

void image_mend(struct image *im)
{
    const uint32_t count = im->width * im->height; /* below 2^32: IMAGE_MAX_TEXELS */
    struct area a = { .count = 0 };

    if (im->faults.nan == 0 && im->faults.infinite == 0)
        return;
    for (uint32_t t = 0; t < count; t++)
        for (size_t c = 0; c < 3; c++)
            if (!isfinite(im->rgb[3 * (size_t)t + c]))
                mend_area(im, c, t, &a);
    mem_free(a.texels);
}

void image_note(struct image *im, const char *format, ...)
{
    const size_t at = strlen(im->note), room = sizeof(im->note) - at;
    va_list args;

    const size_t between = at > 0 && room > 2 ? 2 : 0;
    memcpy(im->note + at, "; ", between);
    va_start(args, format);
    (void)vsnprintf(im->note + at + between, room - between, format, args);
    va_end(args);
}

enum { SAID_NOTE = 1, SAID_LOW = 2, SAID_CLIPPED = 4, SAID_INFINITE = 8, SAID_NAN = 16, SAID_NEGATIVE = 32 };
_Static_assert(SAID_NEGATIVE == IMAGE_SAID_LAST, "callers have kinds of their own behind these");

/* Whether this kind is to be said now. */
static bool is_new(unsigned *said, unsigned kind, bool present)
{
    const bool now = present && !(*said & kind);

    *said |= now ? kind : 0;
    return now;
}

void image_report(const struct image *im, const char *name, unsigned *said)
{
    const struct image_faults *f = &im->faults;

    if (is_new(said, SAID_NOTE, im->note[0]))
        log_info("%s: %s", name, im->note);
    if (is_new(said, SAID_LOW, im->low_range))
        log_warning("%s: not HDR: values brighter than white, such as the sun, are clipped", name);
    if (is_new(said, SAID_INFINITE, f->infinite > 0))
        log_warning("%s: %" PRIu64 " values are infinite or beyond 1e12: infinite ones became the highest around them, "
                    "at least 65504, where half floats end. Write 32-bit floats, or capture at a lower exposure and "
                    "compensate with --scale STOPS",
                    name, f->infinite);
    if (is_new(said, SAID_NAN, f->nan > 0))
        log_warning("%s: %" PRIu64 " values are no numbers (NaN): they became the highest around them, or 0 where "
                    "all are such. If they were the sun, its light is missing",
                    name, f->nan);
    if (is_new(said, SAID_NEGATIVE, f->negative > 0))
        log_info("%s: %" PRIu64 " values are negative: they became 0", name, f->negative);
    if (is_new(said, SAID_CLIPPED, f->clipped > 0))
        log_warning("%s: %" PRIu64 " values are 65504, the largest half float: the capture may have been clipped. "
                    "Capture at a lower exposure and compensate with --scale STOPS",
                    name, f->clipped);
}

/* ---- Placement ---- */

/* The image's texels, which the caller frees; the image then has another size, and black texels. */
static enum err replace_texels(struct image *im, uint32_t width, uint32_t height, float **texels)
{
    const struct image before = *im;
    const size_t count = 3 * (size_t)im->width * im->height;

    *texels = mem_alloc_raw(count, sizeof(**texels));
    if (!*texels)
        return ERR_NOMEM;
    memcpy(*texels, im->rgb, count * sizeof(**texels));
    const enum err e = image_resize(im, width, height);
    if (e) {
        mem_free(*texels);
        *texels = NULL;
        return e;
    }
    im->layout = before.layout;
    im->faults = before.faults;
    memcpy(im->note, before.note, sizeof(im->note));
    memset(im->rgb, 0, 3 * (size_t)width * height * sizeof(*im->rgb));
    return ERR_OK;
}

enum err image_orient(struct image *im, unsigned orientation)
{
    const uint32_t w = im->width, h = im->height;
    const bool swaps = orientation >= 5 && orientation <= 8; /* rows are columns */
    /* of the stored image, seen upright: */
    const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
    const bool from_bottom = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
    float *from = NULL;

    if (orientation < 2 || orientation > 8)
        return ERR_OK;
    const enum err e = replace_texels(im, swaps ? h : w, swaps ? w : h, &from);
    if (e)
        return e;
    for (uint32_t y = 0; y < im->height; y++)
        for (uint32_t x = 0; x < im->width; x++) {
            const uint32_t i = swaps ? y : x, j = swaps ? x : y;
            const uint32_t column = from_right ? w - 1 - i : i, row = from_bottom ? h - 1 - j : j;
            memcpy(im->rgb + 3 * ((size_t)y * im->width + x), from + 3 * ((size_t)row * w + column), 3 * sizeof(float));
        }
    mem_free(from);
    return ERR_OK;
}

unsigned image_orientation_of(const int32_t m[9])
{
    const bool upright = !m[1] && !m[3] && m[0] && m[4], turned = !m[0] && !m[4] && m[1] && m[3];

    if (upright)
        return m[4] > 0 ? (m[0] > 0 ? 1 : 2) : m[0] > 0 ? 4 : 3;
    if (turned)
        return m[1] > 0 ? (m[3] > 0 ? 5 : 6) : m[3] > 0 ? 8 : 7;
    return 0;
}

enum err image_place(struct image *im, uint32_t width, uint32_t height, int64_t left, int64_t top)
{
    const int64_t w = im->width, h = im->height;
    const int64_t x0 = left > 0 ? left : 0, x1 = left + w < width ? left + w : width;
    const int64_t y0 = top > 0 ? top : 0, y1 = top + h < height ? top + h : height;
    float *from = NULL;

    if (x0 >= x1 || y0 >= y1)
        return ERR_RANGE;
    const enum err e = replace_texels(im, width, height, &from);
    if (e)
        return e;
    for (int64_t y = y0; y < y1; y++)
        memcpy(im->rgb + 3 * (size_t)(y * width + x0), from + 3 * (size_t)((y - top) * w + x0 - left),
               3 * (size_t)(x1 - x0) * sizeof(float));
    mem_free(from);
    return ERR_OK;
}

void image_take_aspect(struct image *im, double pixel_aspect)
{
    const double shape = pixel_aspect * im->width / im->height;

    if (!(pixel_aspect > 0.0) || fabs(pixel_aspect - 1.0) < 1e-3)
        return;
    if (im->layout == LAYOUT_AUTO && fabs(shape - 2.0) < 0.02)
        im->layout = LAYOUT_LATLONG;
    else if (im->layout == LAYOUT_AUTO)
        image_note(im, "the shape of its pixels, %.4g:1, is ignored", pixel_aspect);
}

const char *layout_name(enum layout layout)
{
    return choice_name(layout_choices, (int)layout);
}
