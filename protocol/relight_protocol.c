#include "protocol/relight_protocol.h"

#include <math.h>
#include <string.h>

/* Byte by byte, independent of byte order and alignment; compilers merge each into one move. */
static void put16(uint8_t *at, uint16_t v)
{
    at[0] = (uint8_t)v;
    at[1] = (uint8_t)(v >> 8);
}

static void put32(uint8_t *at, uint32_t v)
{
    put16(at, (uint16_t)v);
    put16(at + 2, (uint16_t)(v >> 16));
}

static void put64(uint8_t *at, uint64_t v)
{
    put32(at, (uint32_t)v);
    put32(at + 4, (uint32_t)(v >> 32));
}

static uint16_t get16(const uint8_t *at)
{
    return (uint16_t)(at[0] | at[1] << 8);
}

static uint32_t get32(const uint8_t *at)
{
    return get16(at) | (uint32_t)get16(at + 2) << 16;
}

static uint64_t get64(const uint8_t *at)
{
    return get32(at) | (uint64_t)get32(at + 4) << 32;
}

static int64_t get64s(const uint8_t *at)
{
    const uint64_t v = get64(at);
    int64_t s;
    memcpy(&s, &v, sizeof(s)); /* int64_t is two's complement by definition */
    return s;
}

static void put_float(uint8_t *at, float f)
{
    uint32_t v;
    memcpy(&v, &f, sizeof(v));
    put32(at, v);
}

static float get_float(const uint8_t *at)
{
    const uint32_t v = get32(at);
    float f;
    memcpy(&f, &v, sizeof(f));
    return f;
}

static int number_ok(uint64_t v)
{
    return v <= (uint64_t)PROTOCOL_NUMBER_MAX;
}

static int time_ok(int64_t v)
{
    return v >= -PROTOCOL_NUMBER_MAX && v <= PROTOCOL_NUMBER_MAX;
}

static int side_ok(uint32_t v)
{
    return v >= 1 && v <= PROTOCOL_SIDE_MAX;
}

/* Both headers start with magic bytes and the header's length, which a later minor version may increase. */
static enum protocol_result begin_ok(const uint8_t *bytes, size_t length, const char magic[4], size_t least)
{
    if (length >= 4 && memcmp(bytes, magic, 4) != 0)
        return PROTOCOL_MAGIC;
    if (length < least)
        return PROTOCOL_SHORT;
    const uint16_t header = get16(bytes + 4);
    if (header < least || header > PROTOCOL_HEADER_MAX || header % 4 != 0)
        return PROTOCOL_HEADER;
    return PROTOCOL_OK;
}

void protocol_picture_encode(const struct protocol_picture *p, uint8_t out[PROTOCOL_PICTURE_BYTES])
{
    memset(out, 0, PROTOCOL_PICTURE_BYTES);
    memcpy(out, "RLP1", 4);
    put16(out + 4, PROTOCOL_PICTURE_BYTES);
    out[6] = (uint8_t)p->format;
    out[7] = p->flags;
    put64(out + 8, p->sequence);
    put64(out + 16, p->frame);
    put64(out + 24, (uint64_t)p->capture_us);
    put64(out + 32, (uint64_t)p->published_us);
    put32(out + 40, p->queued_us);
    put32(out + 44, p->decoded_us);
    put32(out + 48, p->shaded_us);
    put32(out + 52, p->encoded_us);
    put32(out + 56, p->width);
    put32(out + 60, p->height);
    put_float(out + 64, p->gain);
    put32(out + 68, p->samples);
    put32(out + 72, p->payload);
}

uint64_t protocol_picture_sequence(const uint8_t *bytes, size_t length)
{
    const int whole = begin_ok(bytes, length, "RLP1", PROTOCOL_PICTURE_BYTES) == PROTOCOL_OK;

    return whole && number_ok(get64(bytes + 8)) ? get64(bytes + 8) : 0;
}

enum protocol_result protocol_picture_decode(const uint8_t *bytes, size_t length, struct protocol_picture *p,
                                             size_t *offset)
{
    const enum protocol_result result = begin_ok(bytes, length, "RLP1", PROTOCOL_PICTURE_BYTES);
    if (result)
        return result;

    const struct protocol_picture d = {
        .format = (enum protocol_format)bytes[6],
        .flags = bytes[7],
        .sequence = get64(bytes + 8),
        .frame = get64(bytes + 16),
        .capture_us = get64s(bytes + 24),
        .published_us = get64s(bytes + 32),
        .queued_us = get32(bytes + 40),
        .decoded_us = get32(bytes + 44),
        .shaded_us = get32(bytes + 48),
        .encoded_us = get32(bytes + 52),
        .width = get32(bytes + 56),
        .height = get32(bytes + 60),
        .gain = get_float(bytes + 64),
        .samples = get32(bytes + 68),
        .payload = get32(bytes + 72),
    };
    const size_t header = get16(bytes + 4);

    if (length < header || length - header != d.payload || d.payload == 0)
        return PROTOCOL_LENGTH;
    if (bytes[6] < PROTOCOL_JPEG || bytes[6] > PROTOCOL_CHANGES)
        return PROTOCOL_FORMAT;
    if (!side_ok(d.width) || !side_ok(d.height))
        return PROTOCOL_SIZE;
    if (!number_ok(d.sequence) || d.sequence == 0 || !number_ok(d.frame) || !time_ok(d.capture_us) ||
        !time_ok(d.published_us) || !isfinite(d.gain) || d.gain < 0.0f)
        return PROTOCOL_VALUE;
    *p = d;
    *offset = header;
    return PROTOCOL_OK;
}

void protocol_environment_encode(const struct protocol_environment *e, uint8_t out[PROTOCOL_ENVIRONMENT_BYTES])
{
    memset(out, 0, PROTOCOL_ENVIRONMENT_BYTES);
    memcpy(out, "RLE1", 4);
    put16(out + 4, PROTOCOL_ENVIRONMENT_BYTES);
    out[6] = (uint8_t)e->encoding;
    out[7] = (uint8_t)e->layout;
    out[8] = e->flags;
    out[9] = e->channels;
    put32(out + 12, e->width);
    put32(out + 16, e->height);
    put32(out + 20, e->payload);
    put64(out + 24, e->frame);
    put64(out + 32, (uint64_t)e->capture_us);
}

/* Raw texels must fill the payload exactly; files contain their size, so the header must not state one. */
static int environment_size_ok(const struct protocol_environment *e)
{
    if (e->encoding == PROTOCOL_FILE_EXR || e->encoding == PROTOCOL_FILE_HDR)
        return e->width == 0 && e->height == 0 && e->channels == 0;
    if (!side_ok(e->width) || !side_ok(e->height) || e->channels < 3 || e->channels > 4)
        return 0;
    /* 2^14 * 2^14 * 4 * 4 = 2^32 fits 64 bits */
    const uint64_t texel = e->encoding == PROTOCOL_RAW_HALF ? 2 : 4;
    return (uint64_t)e->width * e->height * e->channels * texel == e->payload;
}

enum protocol_result protocol_environment_decode(const uint8_t *bytes, size_t length, size_t total,
                                                 struct protocol_environment *e, size_t *offset)
{
    const enum protocol_result result = begin_ok(bytes, length, "RLE1", PROTOCOL_ENVIRONMENT_BYTES);
    if (result)
        return result;

    const struct protocol_environment d = {
        .encoding = (enum protocol_encoding)bytes[6],
        .layout = (enum protocol_layout)bytes[7],
        .flags = bytes[8],
        .channels = bytes[9],
        .width = get32(bytes + 12),
        .height = get32(bytes + 16),
        .payload = get32(bytes + 20),
        .frame = get64(bytes + 24),
        .capture_us = get64s(bytes + 32),
    };
    const size_t header = get16(bytes + 4);

    if (total < header || total - header != d.payload || d.payload == 0)
        return PROTOCOL_LENGTH;
    if (bytes[6] < PROTOCOL_FILE_EXR || bytes[6] > PROTOCOL_RAW_FLOAT || bytes[7] > PROTOCOL_CUBE_6X1)
        return PROTOCOL_FORMAT;
    if (!environment_size_ok(&d))
        return PROTOCOL_SIZE;
    if (!number_ok(d.frame) || !time_ok(d.capture_us))
        return PROTOCOL_VALUE;
    *e = d;
    *offset = header;
    return PROTOCOL_OK;
}

const char *protocol_clause(enum protocol_result result, int picture)
{
    static const char *const clauses[][2] = {
        [PROTOCOL_OK] = { "", "" },           [PROTOCOL_SHORT] = { "7.1", "6.1" },
        [PROTOCOL_MAGIC] = { "7.1", "6.1" },  [PROTOCOL_HEADER] = { "7.2", "6.2" },
        [PROTOCOL_LENGTH] = { "7.3", "6.3" }, [PROTOCOL_FORMAT] = { "7.4", "6.4" },
        [PROTOCOL_SIZE] = { "7.5", "6.5" },   [PROTOCOL_VALUE] = { "7.6", "6.6" },
    };
    return clauses[result][picture != 0];
}

const char *protocol_result_text(enum protocol_result result)
{
    static const char *const texts[] = {
        [PROTOCOL_OK] = "well-formed",
        [PROTOCOL_SHORT] = "the message ends inside its header",
        [PROTOCOL_MAGIC] = "the message does not begin with the header's magic bytes",
        [PROTOCOL_HEADER] = "the header's own length is not allowed",
        [PROTOCOL_LENGTH] = "header and payload do not add up to the message",
        [PROTOCOL_FORMAT] = "the format, encoding or layout is unknown",
        [PROTOCOL_SIZE] = "width, height or channels are out of range or do not match the payload",
        [PROTOCOL_VALUE] = "a number is out of its range",
    };
    return texts[result];
}
