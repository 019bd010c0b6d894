#include "image/codec/decode.h"

#include <stdbool.h>
#include <string.h>

enum {
    MAGIC = 20000630, /* the format's magic number */
    VERSION = 2,
    FLAG_TILED = 0x200,
    FLAG_LONG_NAMES = 0x400, /* 255 bytes instead of 31; names up to 255 are accepted either way */
    FLAG_DEEP = 0x800,
    FLAG_PARTS = 0x1000,
    NAME_MAX_BYTES = 255,
};

const char *const exr_compression_names[EXR_COMPRESSIONS] = {
    "no", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB",
};
enum { COMPRESSION_LAST_TAKEN = 3 };

static uint32_t get32(const uint8_t *p)
{
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

static enum err truncated(const struct exr_header *h)
{
    return err_say(h->why, ERR_FORMAT, "%s: byte %zu: the file ends inside the EXR header", h->name, h->size);
}

/* Reads a NUL-terminated text of at least one byte. */
static enum err take_text(struct exr_header *h, const char **out)
{
    const size_t left = h->size - h->at, most = left < NAME_MAX_BYTES + 1 ? left : NAME_MAX_BYTES + 1;
    const uint8_t *begin = h->bytes + h->at, *end = memchr(begin, 0, most);

    if (!end && left <= NAME_MAX_BYTES)
        return truncated(h);
    if (!end || end == begin)
        return err_say(h->why, ERR_FORMAT, "%s: byte %zu: the name of an EXR attribute has %s", h->name, h->at,
                       end ? "no characters" : "more than 255 bytes");
    *out = (const char *)begin;
    h->at += (size_t)(end - begin) + 1;
    return ERR_OK;
}

enum err exr_header_next(struct exr_header *h, struct exr_entry *a)
{
    enum err e = take_text(h, &a->name);

    if (!e)
        e = take_text(h, &a->type);
    if (e)
        return e;
    if (h->size - h->at < 4)
        return truncated(h);
    a->size = get32(h->bytes + h->at);
    h->at += 4;
    if (a->size > INT32_MAX)
        return err_say(h->why, ERR_FORMAT, "%s: byte %zu: an EXR attribute has a negative length", h->name, h->at - 4);
    if (a->size > h->size - h->at)
        return truncated(h);
    a->value = h->bytes + h->at;
    h->at += a->size;
    return ERR_OK;
}

static enum err check_compression(struct exr_header *h, bool *has_compression, const struct exr_entry *a)
{
    /* Readers disagree about which of two wins, so a duplicate is rejected. */
    if (*has_compression || a->size != 1 || strcmp(a->type, "compression") != 0)
        return err_say(h->why, ERR_FORMAT, "%s: the EXR header's compression is %s", h->name,
                       *has_compression ? "duplicated" : "malformed");
    *has_compression = true;
    if (a->value[0] >= EXR_COMPRESSIONS)
        return err_say(h->why, ERR_FORMAT, "%s: unknown EXR compression %u", h->name, a->value[0]);
    if (a->value[0] > COMPRESSION_LAST_TAKEN)
        return err_say(h->why, ERR_UNSUPPORTED,
                       "%s: %s compression is not accepted from the network; use none, RLE, ZIPS or ZIP", h->name,
                       exr_compression_names[a->value[0]]);
    return ERR_OK;
}

static enum err check_attribute(struct exr_header *h, bool *has_compression, const struct exr_entry *a)
{
    static const char scanlines[] = "scanlineimage";
    char type[32];

    if (strcmp(a->name, "compression") == 0)
        return check_compression(h, has_compression, a);
    if (strcmp(a->name, "type") == 0 &&
        (a->size != sizeof(scanlines) - 1 || memcmp(a->value, scanlines, sizeof(scanlines) - 1) != 0))
        return err_say(h->why, ERR_UNSUPPORTED, "%s: an EXR part of type \"%s\" is not accepted from the network",
                       h->name, decode_printable(a->value, a->size, type, sizeof(type)));
    return ERR_OK;
}

static enum err check_version(const struct exr_header *h)
{
    const uint32_t version = get32(h->bytes + 4), flags = version & ~0xffu;
    const char *what = flags & FLAG_PARTS   ? "of several parts"
                       : flags & FLAG_DEEP  ? "with deep data"
                       : flags & FLAG_TILED ? "in tiles"
                                            : NULL;

    if ((version & 0xff) != VERSION || (flags & ~(uint32_t)(FLAG_TILED | FLAG_LONG_NAMES | FLAG_DEEP | FLAG_PARTS)))
        return err_say(h->why, ERR_FORMAT, "%s: byte 4: unknown EXR version 0x%x", h->name, version);
    if (what)
        return err_say(h->why, ERR_UNSUPPORTED, "%s: an EXR file %s is not accepted from the network", h->name, what);
    return ERR_OK;
}

enum err exr_policy_check(const uint8_t *bytes, size_t size, const char *name, struct reason *why)
{
    struct exr_header h = { .bytes = bytes, .size = size, .at = 8, .name = name, .why = why };
    struct exr_entry a = { 0 };
    bool has_compression = false;

    if (size >= 4 && get32(bytes) != MAGIC)
        return err_say(why, ERR_FORMAT, "%s: not an EXR file", name);
    if (size < 8)
        return truncated(&h);
    enum err e = check_version(&h);
    for (int i = 0; !e && i <= EXR_POLICY_ATTRIBUTES; i++) {
        if (h.at == size)
            return truncated(&h);
        if (bytes[h.at] == 0) /* end of the header */
            return has_compression ? ERR_OK
                                   : err_say(why, ERR_FORMAT, "%s: the EXR header has no compression attribute", name);
        e = exr_header_next(&h, &a);
        if (!e)
            e = check_attribute(&h, &has_compression, &a);
    }
    return e ? e
             : err_say(why, ERR_FORMAT, "%s: the EXR header has more than %d attributes", name, EXR_POLICY_ATTRIBUTES);
}
