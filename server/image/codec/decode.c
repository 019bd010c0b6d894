#include "image/codec/decode.h"

#include "base/mem.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#define FIRST_ROOM ((size_t)1 << 20) /* for a pipe, whose size is unknown; it doubles */

static const uint8_t exr_magic[4] = { 0x76, 0x2f, 0x31, 0x01 };

const char *decode_printable(const void *bytes, size_t size, char *out, size_t room)
{
    const unsigned char *from = bytes;
    size_t n = 0;

    for (; n < size && n + 1 < room && from[n]; n++)
        out[n] = from[n] >= 0x20 && from[n] < 0x7f ? (char)from[n] : '?';
    out[n] = '\0';
    return out;
}

static bool begins(const uint8_t *bytes, size_t size, size_t at, const char *with, size_t count)
{
    return size >= at + count && memcmp(bytes + at, with, count) == 0;
}

static bool is_jpeg(const uint8_t *bytes, size_t size)
{
    return begins(bytes, size, 0, "\xff\xd8\xff", 3);
}

static bool is_png(const uint8_t *bytes, size_t size)
{
    return begins(bytes, size, 0, "\x89PNG\r\n\x1a\n", 8);
}

bool decode_is_low_range(const uint8_t *bytes, size_t size)
{
    return is_jpeg(bytes, size) || is_png(bytes, size);
}

/* A format that people take for one of ours by a file's name; NULL: unknown. */
static const char *other_format(const uint8_t *bytes, size_t size)
{
    if (begins(bytes, size, 0, "II*\0", 4) || begins(bytes, size, 0, "MM\0*", 4))
        return "a TIFF";
    if (begins(bytes, size, 0, "RIFF", 4) && begins(bytes, size, 8, "WEBP", 4))
        return "a WebP";
    if (begins(bytes, size, 4, "ftypavif", 8) || begins(bytes, size, 4, "ftyphei", 7))
        return "an AVIF or HEIC";
    if (begins(bytes, size, 4, "ftyp", 4))
        return "an MP4 video";
    if (begins(bytes, size, 0, "\x1a\x45\xdf\xa3", 4))
        return "a Matroska or WebM video";
    if (begins(bytes, size, 0, "#EXTM3U", 7))
        return "an HLS playlist";
    return begins(bytes, size, 0, "GIF8", 4) ? "a GIF" : NULL;
}

enum err decode_image(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why)
{
    im->low_range = false;
    if (size >= sizeof(exr_magic) && memcmp(bytes, exr_magic, sizeof(exr_magic)) == 0)
        return decode_exr(bytes, size, name, im, why);
    if (size >= 2 && bytes[0] == '#' && bytes[1] == '?')
        return decode_hdr(bytes, size, name, im, why);
    if (is_jpeg(bytes, size))
        return decode_jpeg(bytes, size, name, im, why);
    if (is_png(bytes, size))
        return decode_png(bytes, size, name, im, why);
    if (other_format(bytes, size))
        return err_say(why, ERR_UNSUPPORTED, "%s: is %s file; expected OpenEXR, Radiance .hdr, JPEG or PNG", name,
                       other_format(bytes, size));
    if (begins(bytes, size, 0, "glTF", 4) || begins(bytes, size, 0, "ply", 3) ||
        begins(bytes, size, 0, "Kaydara FBX", 11) || begins(bytes, size, 0, "{", 1))
        return err_say(why, ERR_UNSUPPORTED, "%s: is a model or scene (for --scene), no image", name);
    if (size == 0)
        return err_say(why, ERR_FORMAT, "%s: the file is empty", name);
    const uint8_t head[4] = { bytes[0], size > 1 ? bytes[1] : 0, size > 2 ? bytes[2] : 0, size > 3 ? bytes[3] : 0 };
    return err_say(
        why, ERR_FORMAT,
        "%s: byte 0: neither an OpenEXR nor a Radiance file, nor a JPEG or PNG; it starts with %02x %02x %02x %02x",
        name, head[0], head[1], head[2], head[3]);
}

static enum err read_whole(FILE *f, const char *path, uint8_t **bytes, size_t *size, struct reason *why)
{
    size_t room = 0;

    for (;;) {
        if (*size == room) {
            if (room >= DECODE_FILE_MAX)
                return err_say(why, ERR_RANGE, "%s: larger than %zu bytes", path, DECODE_FILE_MAX);
            const size_t more = room ? 2 * room : FIRST_ROOM;
            uint8_t *p = mem_grow(*bytes, *size, more, 1);
            if (!p)
                return err_say(why, ERR_NOMEM, "%s: out of memory for %zu bytes", path, more);
            *bytes = p;
            room = more;
        }
        const size_t got = fread(*bytes + *size, 1, room - *size, f);
        *size += got;
        if (got == 0)
            return ferror(f) ? err_say(why, ERR_IO, "%s: byte %zu: cannot read: %s", path, *size, strerror(errno))
                             : ERR_OK;
    }
}

enum err decode_file(const char *path, struct image *im, struct reason *why)
{
    uint8_t *bytes = NULL;
    size_t size = 0;
    FILE *f = fopen(path, "rb");

    if (!f)
        return err_say(why, ERR_IO, "%s: cannot open: %s", path, strerror(errno));
    enum err e = read_whole(f, path, &bytes, &size, why);
    if (!e)
        e = decode_image(bytes, size, path, im, why);
    mem_free(bytes);
    fclose(f);
    return e;
}
