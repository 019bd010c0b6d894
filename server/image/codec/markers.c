#include "image/codec/markers.h"

#include "image/codec/calendar.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static size_t big(const uint8_t *at, int bytes)
{
    size_t v = 0;

    while (bytes-- > 0)
        v = v << 8 | *at++;
    return v;
}

static const uint8_t *find(const uint8_t *in, size_t size, const void *text, size_t length)
{
    for (size_t i = 0; i + length <= size; i++)
        if (in[i] == *(const uint8_t *)text && memcmp(in + i, text, length) == 0)
            return in + i;
    return NULL;
}

/* ---- Exif: a TIFF directory ---- */

enum {
    TAG_ORIENTATION = 0x112,
    TAG_EXPOSURE = 0x829a,
    TAG_DIRECTORY = 0x8769, /* where a photograph's own tags are */
    TAG_TAKEN = 0x9003,
    TAG_OFFSET = 0x9011,
    TAG_FRACTION = 0x9291,
};

struct tiff {
    const uint8_t *at;
    size_t size;
    bool little;
};

static size_t tiff_number(const struct tiff *t, const uint8_t *at, int bytes)
{
    size_t v = 0;

    if (!t->little)
        return big(at, bytes);
    while (bytes-- > 0)
        v = v << 8 | at[bytes];
    return v;
}

/* Opens the block; *directory is the byte of its first directory. */
static bool tiff_open(const uint8_t *at, size_t size, struct tiff *t, size_t *directory)
{
    if (size < 14 || (memcmp(at, "II*\0", 4) != 0 && memcmp(at, "MM\0*", 4) != 0))
        return false;
    *t = (struct tiff){ at, size, at[0] == 'I' };
    *directory = tiff_number(t, at + 4, 4);
    return true;
}

/* The 12 bytes of a tag in the directory: tag, type, count, and the value or its place. NULL: there is none. */
static const uint8_t *tiff_find(const struct tiff *t, size_t directory, size_t tag)
{
    if (directory > t->size - 2)
        return NULL;
    const uint8_t *p = t->at + directory;
    const size_t count = tiff_number(t, p, 2);
    for (size_t i = 0; i < count && directory + 2 + 12 * (i + 1) <= t->size; i++)
        if (tiff_number(t, p + 2 + 12 * i, 2) == tag)
            return p + 2 + 12 * i;
    return NULL;
}

unsigned markers_orientation(const uint8_t *tiff, size_t size)
{
    struct tiff t;
    size_t directory;

    const uint8_t *entry = tiff_open(tiff, size, &t, &directory) ? tiff_find(&t, directory, TAG_ORIENTATION) : NULL;
    const size_t value = entry ? tiff_number(&t, entry + 8, 2) : 0;
    return value >= 1 && value <= 8 ? (unsigned)value : 0;
}

/* A text of up to 31 characters; "": there is none, or it lies outside the block. */
static void tiff_text(const struct tiff *t, size_t directory, size_t tag, char out[32])
{
    const uint8_t *entry = tiff_find(t, directory, tag);
    const size_t count = entry ? tiff_number(t, entry + 4, 4) : 0;
    const size_t place = count > 4 ? tiff_number(t, entry + 8, 4) : 0;

    out[0] = '\0';
    if (count < 1 || count > 31 || (count > 4 && (place > t->size || count > t->size - place)))
        return;
    memcpy(out, count > 4 ? t->at + place : entry + 8, count);
    out[count] = '\0';
}

/* "+02:00" in microseconds; else 0. */
static int64_t zone_of(const char *text)
{
    int hours, minutes;

    if ((text[0] != '+' && text[0] != '-') || sscanf(text + 1, "%2d:%2d", &hours, &minutes) != 2 || hours < 0 ||
        hours > 14 || minutes < 0 || minutes > 59)
        return 0;
    return (text[0] == '-' ? -1 : 1) * (hours * 60 + minutes) * INT64_C(60000000);
}

void markers_taken(const struct marker *exif, struct image *im)
{
    struct tiff t;
    size_t directory;
    char text[32];

    const uint8_t *entry =
        exif->at && tiff_open(exif->at, exif->size, &t, &directory) ? tiff_find(&t, directory, TAG_DIRECTORY) : NULL;
    if (!entry)
        return;
    directory = tiff_number(&t, entry + 8, 4);
    entry = tiff_find(&t, directory, TAG_EXPOSURE);
    const size_t place = entry ? tiff_number(&t, entry + 8, 4) : t.size;
    if (place <= t.size - 8) {
        const size_t part = tiff_number(&t, t.at + place, 4), whole = tiff_number(&t, t.at + place + 4, 4);
        if (whole > 0 && (double)part / (double)whole <= IMAGE_EXPOSURE_MAX_S)
            im->exposure_s = (double)part / (double)whole;
    }
    tiff_text(&t, directory, TAG_TAKEN, text);
    im->taken_us = calendar_of_text(text, strlen(text));
    if (text[0] && im->taken_us == 0)
        image_note(im, "its Exif time is no time and is ignored");
    if (im->taken_us == 0)
        return;
    tiff_text(&t, directory, TAG_FRACTION, text);
    int64_t unit = 100000;
    for (const char *s = text; *s >= '0' && *s <= '9'; s++, unit /= 10)
        im->taken_us += (*s - '0') * unit;
    tiff_text(&t, directory, TAG_OFFSET, text);
    const int64_t utc = im->taken_us - zone_of(text);
    im->taken_us = utc > 0 ? utc : 0;
}

/* ---- JPEG ---- */

static bool take(const uint8_t *at, size_t size, const char *name, size_t length, struct marker *out)
{
    if (size < length || memcmp(at, name, length) != 0)
        return false;
    if (!out->at)
        *out = (struct marker){ at + length, size - length };
    return true;
}

/* The contents of a segment. */
static void take_segment(uint8_t code, const uint8_t *at, size_t size, struct markers *m)
{
    struct marker exif = { .size = 0 }, jfif = { .size = 0 };

    if (code == 0xe0 && take(at, size, "JFIF\0", 5, &jfif) && m->aspect == 0.0 && jfif.size >= 7 &&
        big(jfif.at + 3, 2) > 0)
        m->aspect = (double)big(jfif.at + 5, 2) / (double)big(jfif.at + 3, 2); /* densities: texels per length */
    if (code == 0xe1 && take(at, size, "Exif\0", 6, &exif) && m->orientation == 0) {
        m->orientation = markers_orientation(exif.at, exif.size);
        m->exif = m->exif.at ? m->exif : exif;
    }
    if (code == 0xe1)
        (void)take(at, size, "http://ns.adobe.com/xap/1.0/", 29, &m->xmp);
    if (code == 0xe2 && !take(at, size, "ICC_PROFILE", 12, &m->icc))
        (void)take(at, size, "urn:iso:std:iso:ts:21496:-1", 28, &m->gain);
}

void markers_of_jpeg(const uint8_t *bytes, size_t size, struct markers *out)
{
    size_t at = 2;

    *out = (struct markers){ .end = size };
    while (at + 4 <= size) {
        if (bytes[at] != 0xff || bytes[at + 1] == 0 || (bytes[at + 1] >= 0xd0 && bytes[at + 1] <= 0xd7)) {
            at++; /* compressed data, which no other marker can interrupt */
            continue;
        }
        const uint8_t code = bytes[at + 1];
        if (code == 0xff) { /* padding */
            at++;
            continue;
        }
        if (code == 0xd9) {
            out->end = at + 2;
            return;
        }
        const size_t length = big(bytes + at + 2, 2);
        if (length < 2 || length > size - at - 2)
            return;
        take_segment(code, bytes + at + 4, length - 2, out);
        at += 2 + length;
    }
}

/* ---- XMP, an XML text: enough of it for numbers ---- */

int markers_numbers(const struct marker *xmp, const char *key, double out[3])
{
    const size_t length = strlen(key);
    const uint8_t *at = xmp->at ? find(xmp->at, xmp->size, key, length) : NULL;
    int count = 0;

    if (!at)
        return 0;
    at += length;
    const uint8_t *end = xmp->at + xmp->size;
    while (at < end && (*at == ' ' || *at == '='))
        at++;
    if (at == end || (*at != '"' && *at != '\'' && *at != '>'))
        return 0;
    const uint8_t *stop =
        *at == '>' ? find(at, (size_t)(end - at), key, length) : memchr(at + 1, *at, (size_t)(end - at - 1));
    bool tag = false;
    for (at++; stop && at < stop && count < 3; at++) {
        char number[32] = "", *rest;
        tag = *at == '<' || (tag && *at != '>');
        if (tag || !memchr("+-.0123456789", *at, 13))
            continue;
        for (size_t i = 0; i + 1 < sizeof(number) && at + i < stop && memchr("+-.0123456789eE", at[i], 15); i++)
            number[i] = (char)at[i];
        const double v = strtod(number, &rest);
        if (rest == number || !isfinite(v))
            return count;
        out[count++] = v;
        at += rest - number - 1;
    }
    return count;
}

/* ---- Placement ---- */

static double number(const struct markers *m, const char *key, double otherwise)
{
    double v[3] = { otherwise, 0.0, 0.0 };

    (void)markers_numbers(&m->xmp, key, v);
    return v[0];
}

/* A part of a panorama [Google's Photo Sphere XMP Metadata]. */
static enum err place_panorama(const struct markers *m, struct image *im)
{
    const double full_width = number(m, "GPano:FullPanoWidthPixels", 0.0);
    const double full_height = number(m, "GPano:FullPanoHeightPixels", 0.0);
    const double width = number(m, "GPano:CroppedAreaImageWidthPixels", full_width);
    const double height = number(m, "GPano:CroppedAreaImageHeightPixels", full_height);
    const double left = number(m, "GPano:CroppedAreaLeftPixels", 0.0);
    const double top = number(m, "GPano:CroppedAreaTopPixels", 0.0);
    const double heading = number(m, "GPano:PoseHeadingDegrees", 0.0);

    if (!m->xmp.at || !find(m->xmp.at, m->xmp.size, "GPano:", 6))
        return ERR_OK;
    if (heading != 0.0 || number(m, "GPano:PosePitchDegrees", 0.0) != 0.0 ||
        number(m, "GPano:PoseRollDegrees", 0.0) != 0.0)
        image_note(im, "its heading of %.4g degrees, its pitch and its roll are ignored: use --rotate", heading);
    if (!(width > 0.0 && height > 0.0 && full_width >= width && full_height >= height && full_width < 1e6 &&
          full_height < 1e6 && left >= 0.0 && top >= 0.0 && left < full_width && top < full_height))
        return ERR_OK;
    /* The file may have been scaled since. */
    const double x = im->width / width, y = im->height / height;
    const uint32_t w = (uint32_t)lround(full_width * x), h = (uint32_t)lround(full_height * y);
    if (w == im->width && h == im->height)
        return ERR_OK;
    image_note(im, "a part, %ux%u, of a panorama of %ux%u: the rest is black", im->width, im->height, w, h);
    return image_place(im, w, h, lround(left * x), lround(top * y));
}

/* By its description. Profiles of the same colours without sRGB's curve have none or a power [ICC.1:2022, 10.6]. */
static bool is_srgb(const struct marker *icc)
{
    const uint8_t *curve = find(icc->at, icc->size, "curv\0\0\0\0\0\0\0", 11);

    if (curve && curve + 11 < icc->at + icc->size && curve[11] < 2)
        return false;
    return find(icc->at, icc->size, "sRGB", 4) || find(icc->at, icc->size, "s\0R\0G\0B", 7);
}

enum err markers_place(const struct markers *m, struct image *im)
{
    if (m->icc.at && !is_srgb(&m->icc))
        image_note(im, "its ICC profile is ignored: it is read as sRGB, to which it is best converted");
    markers_taken(&m->exif, im);
    image_take_aspect(im, m->aspect);
    const double stated = number(m, "tiff:Orientation", 0.0);
    const unsigned also = stated >= 1.0 && stated <= 8.0 ? (unsigned)stated : 0;
    const enum err e = image_orient(im, m->orientation ? m->orientation : also);
    return e ? e : place_panorama(m, im);
}

/* ---- Gain maps ---- */

static void all_three(const struct markers *m, const char *key, double otherwise, double out[3])
{
    out[0] = otherwise;
    const int count = markers_numbers(&m->xmp, key, out);
    if (count < 3)
        out[1] = out[2] = out[0];
}

/* A quotient of 32-bit numbers; *at moves on. With `common`, both have one denominator. */
static double quotient(const uint8_t **at, double common)
{
    const double n = (double)(int32_t)(uint32_t)big(*at, 4);

    *at += 4;
    if (common > 0.0)
        return n / common;
    const double d = (double)(uint32_t)big(*at, 4);
    *at += 4;
    return d > 0.0 ? n / d : NAN;
}

/* ISO 21496-1, Annex C: versions, flags, headrooms, then five quotients for one channel or each of three. */
static bool take_binary(const struct marker *iso, struct gain_map *g)
{
    if (iso->size < 5 || big(iso->at, 2) != 0)
        return false;
    const uint8_t flags = iso->at[4];
    const bool is_common = flags & 0x08;
    const int channels = flags & 0x80 ? 3 : 1;
    const uint8_t *at = iso->at + 5;
    const size_t pair = is_common ? 4 : 8;
    if ((flags & 0x04) || iso->size < 5 + (is_common ? 4 : 0) + 2 * pair + 5 * pair * (size_t)channels)
        return false;
    const double common = is_common ? (double)big(at, 4) : 0.0;
    at += (is_common ? 4 : 0) + 2 * pair;
    double *const rows[5] = { g->low, g->high, g->gamma, g->base, g->alternate };
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 5; k++)
            rows[k][c] = c < channels ? quotient(&at, common) : rows[k][0];
    return true;
}

static bool take_xmp(const struct markers *m, struct gain_map *g)
{
    double high[3];

    if (markers_numbers(&m->xmp, "hdrgm:GainMapMax", high) == 0 ||
        find(m->xmp.at, m->xmp.size, "BaseRenditionIsHDR=\"True\"", 25))
        return false;
    all_three(m, "hdrgm:GainMapMin", 0.0, g->low);
    all_three(m, "hdrgm:GainMapMax", 0.0, g->high);
    all_three(m, "hdrgm:Gamma", 1.0, g->gamma);
    all_three(m, "hdrgm:OffsetSDR", 1.0 / 64.0, g->base);
    all_three(m, "hdrgm:OffsetHDR", 1.0 / 64.0, g->alternate);
    return true;
}

bool markers_gain(const struct markers *m, struct gain_map *out)
{
    if (!take_xmp(m, out) && !(m->gain.at && take_binary(&m->gain, out)))
        return false;
    for (int c = 0; c < 3; c++)
        if (!(fabs(out->low[c]) < 64.0 && fabs(out->high[c]) < 64.0 && out->gamma[c] > 1e-3 && out->gamma[c] < 1e3 &&
              fabs(out->base[c]) < 1e3 && fabs(out->alternate[c]) < 1e3))
            return false;
    return true;
}
