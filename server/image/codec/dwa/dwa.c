#include "image/codec/dwa/dwa_chunk.h"

#include "base/mem.h"

#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#define HEAD_NUMBERS 11 /* the format's, 64 bits each */
#define VERSION_MAX 2   /* the latest that is known */
#define AC_OF_BLOCK 63  /* 8 x 8 without the mean */

const char dwa_no_memory[] = "out of memory";

/* The rules of file versions that do not store them. */
static const struct rule old_rules[] = {
    { "r", SCHEME_LOSSY, 0, -1, true },     { "red", SCHEME_LOSSY, 0, -1, true },
    { "g", SCHEME_LOSSY, 1, -1, true },     { "grn", SCHEME_LOSSY, 1, -1, true },
    { "green", SCHEME_LOSSY, 1, -1, true }, { "b", SCHEME_LOSSY, 2, -1, true },
    { "blu", SCHEME_LOSSY, 2, -1, true },   { "blue", SCHEME_LOSSY, 2, -1, true },
    { "y", SCHEME_LOSSY, -1, -1, true },    { "by", SCHEME_LOSSY, -1, -1, true },
    { "ry", SCHEME_LOSSY, -1, -1, true },   { "a", SCHEME_RLE, -1, EXR_PIXEL_UINT, true },
    { "a", SCHEME_RLE, -1, -1, true },
};

void dwa_finish(struct dwa *d)
{
    mem_free(d->block);
    mem_free(d->to_linear);
    memset(d, 0, sizeof(*d));
}

static uint64_t read_u64(const uint8_t *p)
{
    uint64_t v = 0;

    for (int i = 7; i >= 0; i--)
        v = v << 8 | p[i];
    return v;
}

/* Reads the header and locates the four parts after it and, if present, after the rules. */
static const char *read_head(struct chunk *c, const uint8_t *packed, size_t size, const uint8_t **rules,
                             size_t *rules_size)
{
    struct head *h = &c->head;
    uint64_t *const numbers[HEAD_NUMBERS] = {
        &h->version,  &h->plain_size, &h->plain_packed, &h->ac_packed, &h->dc_packed, &h->rle_packed,
        &h->rle_size, &h->rle_raw,    &h->ac_count,     &h->dc_count,  &h->ac_coding,
    };
    size_t left = size;

    if (size < HEAD_NUMBERS * 8)
        return "the chunk header is truncated";
    for (int i = 0; i < HEAD_NUMBERS; i++)
        *numbers[i] = read_u64(packed + 8 * i);
    if (h->version > VERSION_MAX)
        return "unknown version";
    packed += HEAD_NUMBERS * 8;
    left -= HEAD_NUMBERS * 8;
    *rules = packed;
    *rules_size = 0;
    if (h->version == 2) {
        *rules_size = left >= 2 ? packed[0] | (size_t)packed[1] << 8 : 0;
        if (*rules_size < 2 || *rules_size > left)
            return "the rules are truncated";
        packed += *rules_size;
        left -= *rules_size;
    }
    const uint8_t **const parts[4] = { &c->plain, &c->ac, &c->dc, &c->rle };
    const uint64_t sizes[4] = { h->plain_packed, h->ac_packed, h->dc_packed, h->rle_packed };
    for (int i = 0; i < 4; i++) {
        if (sizes[i] > left)
            return "the parts exceed the chunk";
        *parts[i] = packed;
        packed += sizes[i];
        left -= sizes[i];
    }
    return NULL;
}

/* Reads the stored rules: a name, a NUL, a byte with colour + 1, scheme and case, and a byte with the type. */
static const char *read_rules(struct chunk *c, const uint8_t *bytes, size_t size)
{
    c->rule_count = 0;
    for (size_t at = 2; at < size; c->rule_count++) {
        const uint8_t *end = memchr(bytes + at, 0, size - at);
        if (!end || (size_t)(end - bytes) + 3 > size)
            return "a rule is truncated";
        const struct rule r = { (const char *)bytes + at, (enum scheme)(end[1] >> 2 & 3), (end[1] >> 4) - 1, end[2],
                                end[1] & 1 };
        if (r.scheme > SCHEME_RLE || r.colour > 2 || r.type > EXR_PIXEL_FLOAT || c->rule_count == RULES_MAX)
            return "a rule is invalid";
        c->rules[c->rule_count] = r;
        at = (size_t)(end - bytes) + 3;
    }
    return NULL;
}

static bool same_name(const char *a, const char *b, bool any_case)
{
    for (; *a && *b; a++, b++) {
        const int x = any_case && *a >= 'A' && *a <= 'Z' ? *a + 32 : *a;
        const int y = any_case && *b >= 'A' && *b <= 'Z' ? *b + 32 : *b;
        if (x != y)
            return false;
    }
    return *a == *b;
}

static bool rule_fits(const struct rule *r, const struct channel *ch)
{
    const char *suffix = ch->name + ch->prefix + (ch->name[ch->prefix] == '.');
    const bool type = r->type < 0 ? ch->type != EXR_PIXEL_UINT : ch->type == r->type;

    return type && same_name(suffix, r->suffix, r->any_case);
}

/* By layer, because the R, G and B of a layer are stored together, then in file order. */
static int compare_channels(const void *a, const void *b)
{
    const struct channel *x = a, *y = b;
    const size_t shorter = x->prefix < y->prefix ? x->prefix : y->prefix;
    const int order = memcmp(x->name, y->name, shorter);

    if (order)
        return order;
    if (x->prefix != y->prefix)
        return x->prefix < y->prefix ? -1 : 1;
    return x->number - y->number;
}

static int compare_numbers(const void *a, const void *b)
{
    return ((const struct channel *)a)->number - ((const struct channel *)b)->number;
}

static void classify(struct chunk *c, const exr_coding_channel_info_t *channels)
{
    c->row_bytes = 0;
    for (int i = 0; i < c->count; i++) {
        struct channel *ch = &c->channels[i];
        const char *dot = strrchr(channels[i].channel_name, '.');
        *ch = (struct channel){ .name = channels[i].channel_name,
                                .number = i,
                                .colour = -1,
                                .type = channels[i].data_type,
                                .linear = channels[i].p_linear != 0,
                                .size = (size_t)channels[i].bytes_per_element,
                                .offset = c->row_bytes };
        ch->prefix = dot ? (size_t)(dot - ch->name) : 0;
        c->row_bytes += ch->size * c->width;
        for (int r = 0; r < c->rule_count; r++) {
            if (rule_fits(&c->rules[r], ch)) {
                ch->scheme = c->rules[r].scheme;
                ch->colour = c->rules[r].colour >= 0 ? c->rules[r].colour : ch->colour;
            }
        }
    }
}

/* Unpacked size of the channels of a scheme, bytes. */
static size_t scheme_bytes(const struct chunk *c, enum scheme scheme)
{
    size_t bytes = 0;

    for (int i = 0; i < c->count; i++)
        if (c->channels[i].scheme == scheme)
            bytes += c->channels[i].size;
    return bytes * c->width * c->height;
}

static bool inflate_exactly(const uint8_t *packed, uint64_t packed_size, void *out, size_t size)
{
    uLongf got = (uLongf)size;

    return uncompress(out, &got, packed, (uLong)packed_size) == Z_OK && got == size;
}

/* Expands runs to exactly `room` bytes: n >= 0 and a byte that repeats n + 1 times, or n < 0 and -n literal bytes. */
static bool expand_runs(const uint8_t *in, size_t size, uint8_t *out, size_t room)
{
    size_t at = 0, n = 0;

    while (at < size) {
        const int code = (int8_t)in[at++];
        const size_t count = code < 0 ? (size_t)-code : (size_t)code + 1;
        if (count > room - n || (code < 0 ? count : 1) > size - at)
            return false;
        if (code < 0)
            memcpy(out + n, in + at, count);
        else
            memset(out + n, in[at], count);
        at += code < 0 ? count : 1;
        n += count;
    }
    return n == room;
}

/* DC values are stored like ZIP chunks: as byte differences, the low bytes of all values before the high ones. */
static void undo_differences(uint8_t *bytes, size_t count, uint16_t *out)
{
    for (size_t i = 1; i < 2 * count; i++)
        bytes[i] = (uint8_t)(bytes[i - 1] + bytes[i] - 128);
    for (size_t i = 0; i < count; i++)
        out[i] = (uint16_t)(bytes[i] | bytes[count + i] << 8);
}

static const char *unpack_ac(struct chunk *c)
{
    const struct head *h = &c->head;

    if (h->ac_coding == 0)
        return dwa_huffman(c->ac, h->ac_packed, c->ac_at, h->ac_count);
    if (h->ac_coding != 1)
        return "unknown coding of the AC coefficients";
    uint8_t *bytes = (uint8_t *)c->ac_at; /* little-endian values, converted in place */
    if (h->ac_count && !inflate_exactly(c->ac, h->ac_packed, bytes, 2 * h->ac_count))
        return "cannot inflate the AC coefficients";
    for (size_t i = 0; i < h->ac_count; i++)
        c->ac_at[i] = (uint16_t)(bytes[2 * i] | bytes[2 * i + 1] << 8);
    return NULL;
}

/* Unpacks all four parts into buffers of their computed sizes; the sizes stored in the chunk are not trusted. */
static const char *unpack_parts(struct chunk *c)
{
    const struct head *h = &c->head;
    size_t lossy = 0;
    const size_t blocks = (size_t)((c->width + 7) / 8) * ((c->height + 7) / 8);
    const size_t plain = scheme_bytes(c, SCHEME_DEFLATE), rle = scheme_bytes(c, SCHEME_RLE);

    for (int i = 0; i < c->count; i++)
        lossy += c->channels[i].scheme == SCHEME_LOSSY;
    if (h->plain_size != plain || h->rle_raw != rle || h->rle_size > 2 * rle || h->dc_count != lossy * blocks ||
        h->ac_count > lossy * blocks * AC_OF_BLOCK)
        return "the stored sizes do not match the number of texels";
    const size_t sizes[] = { 2 * (size_t)h->ac_count, 2 * (size_t)h->dc_count, 2 * (size_t)h->dc_count, plain, rle,
                             (size_t)h->rle_size };
    size_t total = 0;
    for (int i = 0; i < 6; i++)
        total += (sizes[i] + 15) / 16 * 16;
    if (total > c->dwa->block_size) {
        mem_free(c->dwa->block);
        c->dwa->block = mem_alloc(total, 1);
        c->dwa->block_size = c->dwa->block ? total : 0;
        if (!c->dwa->block)
            return dwa_no_memory;
    }
    uint8_t *at[6], *next = c->dwa->block;
    for (int i = 0; i < 6; i++) {
        at[i] = next;
        next += (sizes[i] + 15) / 16 * 16;
    }
    c->ac_at = (uint16_t *)at[0];
    c->ac_end = c->ac_at + h->ac_count;
    c->dc_at = (uint16_t *)at[1];
    c->plain_bytes = at[3];
    c->rle_bytes = at[4];
    if (h->dc_count && !inflate_exactly(c->dc, h->dc_packed, at[2], sizes[2]))
        return "cannot inflate the DC coefficients";
    undo_differences(at[2], (size_t)h->dc_count, c->dc_at);
    if (plain && !inflate_exactly(c->plain, h->plain_packed, at[3], plain))
        return "cannot inflate a channel";
    if (rle && (!inflate_exactly(c->rle, h->rle_packed, at[5], sizes[5]) || !expand_runs(at[5], sizes[5], at[4], rle)))
        return "the run-length encoded channels are damaged";
    return unpack_ac(c);
}

/* Decodes the R, G and B sets first, layer by layer. */
static const char *decode_sets(struct chunk *c)
{
    qsort(c->channels, (size_t)c->count, sizeof(*c->channels), compare_channels);
    for (int i = 0, end; i < c->count; i = end) {
        struct channel *set[3] = { NULL, NULL, NULL };
        for (end = i; end < c->count && c->channels[end].prefix == c->channels[i].prefix &&
                      memcmp(c->channels[end].name, c->channels[i].name, c->channels[i].prefix) == 0;
             end++)
            if (c->channels[end].colour >= 0)
                set[c->channels[end].colour] = &c->channels[end];
        if (!set[0] || !set[1] || !set[2])
            continue;
        for (int k = 0; k < 3; k++) {
            if (set[k]->scheme != SCHEME_LOSSY || set[k]->type == EXR_PIXEL_UINT)
                return "a rule is invalid";
            set[k]->done = true;
            set[k]->linear = false; /* the R, G and B of a set always use the curve */
        }
        const char *fault = dwa_lossy(c, set, 3);
        if (fault)
            return fault;
    }
    qsort(c->channels, (size_t)c->count, sizeof(*c->channels), compare_numbers);
    return NULL;
}

static void copy_plain(struct chunk *c, const struct channel *ch)
{
    const size_t row = ch->size * c->width;

    for (uint32_t y = 0; y < c->height; y++, c->plain_bytes += row)
        memcpy(c->out + y * c->row_bytes + ch->offset, c->plain_bytes, row);
}

static void copy_planes(struct chunk *c, const struct channel *ch)
{
    const size_t plane = (size_t)c->width * c->height;

    for (size_t b = 0; b < ch->size; b++, c->rle_bytes += plane)
        for (size_t i = 0; i < plane; i++)
            c->out[i / c->width * c->row_bytes + ch->offset + i % c->width * ch->size + b] = c->rle_bytes[i];
}

static const char *decode_channels(struct chunk *c)
{
    const char *fault = decode_sets(c);

    for (int i = 0; i < c->count && !fault; i++) {
        struct channel *ch = &c->channels[i];
        if (ch->done)
            continue;
        if (ch->scheme == SCHEME_DEFLATE)
            copy_plain(c, ch);
        else if (ch->scheme == SCHEME_RLE)
            copy_planes(c, ch);
        else if (ch->type == EXR_PIXEL_UINT)
            fault = "a rule is invalid";
        else
            fault = dwa_lossy(c, &ch, 1);
    }
    return fault;
}

static const char *unpack(struct chunk *c, const exr_coding_channel_info_t *channels, const uint8_t *packed,
                          size_t size)
{
    const uint8_t *rules;
    size_t rules_size;
    const char *fault = read_head(c, packed, size, &rules, &rules_size);

    if (!fault && c->head.version == 2)
        fault = read_rules(c, rules, rules_size);
    if (fault)
        return fault;
    if (c->head.version < 2) {
        memcpy(c->rules, old_rules, sizeof(old_rules));
        c->rule_count = (int)(sizeof(old_rules) / sizeof(old_rules[0]));
    }
    classify(c, channels);
    fault = unpack_parts(c);
    return fault ? fault : decode_channels(c);
}

const char *dwa_unpack(struct dwa *d, const exr_coding_channel_info_t *channels, int count, uint32_t width,
                       uint32_t height, const uint8_t *packed, size_t size, uint8_t *out)
{
    if (!d->to_linear)
        d->to_linear = mem_alloc(65536, sizeof(*d->to_linear));
    struct chunk *c = mem_alloc(1, sizeof(*c));
    if (c)
        c->channels = mem_alloc((size_t)count, sizeof(*c->channels));
    const char *fault = dwa_no_memory;
    if (d->to_linear && c && c->channels) {
        c->dwa = d;
        c->width = width;
        c->height = height;
        c->count = count;
        c->out = out;
        fault = unpack(c, channels, packed, size);
    }
    if (c)
        mem_free(c->channels);
    mem_free(c);
    return fault;
}
