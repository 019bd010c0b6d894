/* What a file's header claims, before the rest is read: a file can be any size without taking up a disk. */
#include "image/codec/decode.h"

#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#define SLACK ((uint64_t)64 << 20)    /* for what else a file may have in it: profiles, previews */
#define UNKNOWN ((uint64_t)256 << 20) /* of a file whose header is right so far, but goes on */
#define PARTS 16                      /* of an EXR file, each as large as the first */

static uint32_t big32(const uint8_t *p)
{
    return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

static int32_t little32(const uint8_t *p)
{
    return (int32_t)((uint32_t)p[3] << 24 | (uint32_t)p[2] << 16 | (uint32_t)p[1] << 8 | p[0]);
}

/* Most bytes of that many texels; UINT64_MAX: no image is that large, which the decoder will say. */
static uint64_t most_bytes(uint64_t width, uint64_t height, uint64_t texel_bytes)
{
    if (width > UINT32_MAX || height > UINT32_MAX || width * height > UINT64_MAX / 4 / texel_bytes)
        return UINT64_MAX;
    return 2 * width * height * texel_bytes + SLACK; /* none of the compressions doubles it */
}

/* The size stands behind an empty line. */
static uint64_t of_hdr(const uint8_t *head, size_t size)
{
    unsigned long long height, width;
    char line[64];

    for (size_t at = 0; at + 2 < size; at++) {
        if (head[at] != '\n' || head[at + 1] != '\n')
            continue;
        const size_t n = size - at - 2 < sizeof(line) - 1 ? size - at - 2 : sizeof(line) - 1;
        memcpy(line, head + at + 2, n);
        line[n] = 0;
        return sscanf(line, "%*1[+-]%*1[XY] %llu %*1[+-]%*1[XY] %llu", &height, &width) == 2
                   ? most_bytes(width, height, 4)
                   : 0;
    }
    return size >= DECODE_HEAD && !memchr(head, 0, size) ? UNKNOWN : 0; /* a long comment is text, a hole is none */
}

static uint64_t of_exr(const uint8_t *head, size_t size)
{
    struct reason why;
    struct exr_header h = { .bytes = head, .size = size, .at = 8, .name = "", .why = &why };
    struct exr_entry a;
    uint64_t channels = 0, width = 0, height = 0;

    if (size < 8)
        return 0;
    while (h.at < size && head[h.at] && exr_header_next(&h, &a) == ERR_OK) {
        if (strcmp(a.name, "channels") == 0)
            channels = 1 + a.size / 18; /* the least bytes that describe one */
        if (strcmp(a.name, "dataWindow") != 0 || a.size != 16)
            continue;
        width = (uint64_t)((int64_t)little32(a.value + 8) - little32(a.value) + 1);
        height = (uint64_t)((int64_t)little32(a.value + 12) - little32(a.value + 4) + 1);
    }
    const bool parts = head[5] & 0x10, tiles = head[5] & 0x02; /* of the latter there may be a pyramid */
    if (width == 0)
        return size >= DECODE_HEAD && (h.at >= size || head[h.at]) ? UNKNOWN : 0; /* 0: the header has ended */
    return most_bytes(width, height, 4 * (channels + 1) * (parts ? PARTS : 1) * (tiles ? 2 : 1));
}

/* The size stands in the first frame, behind whatever the camera wrote. */
static uint64_t of_jpeg(const uint8_t *head, size_t size)
{
    size_t at = 2;

    while (at + 9 < size && head[at] == 0xff) {
        const uint8_t kind = head[at + 1];
        if (kind >= 0xc0 && kind <= 0xcf && kind != 0xc4 && kind != 0xc8 && kind != 0xcc)
            return most_bytes((uint64_t)head[at + 7] << 8 | head[at + 8], (uint64_t)head[at + 5] << 8 | head[at + 6],
                              4);
        at += 2 + ((size_t)head[at + 2] << 8 | head[at + 3]);
    }
    return at + 9 >= size && size >= DECODE_HEAD ? UNKNOWN : 0;
}

uint64_t decode_claimed(const uint8_t *head, size_t size)
{
    static const uint8_t exr[] = { 0x76, 0x2f, 0x31, 0x01 }, png[] = { 0x89, 'P', 'N', 'G' }, jpeg[] = { 0xff, 0xd8 };

    if (size >= sizeof(exr) && memcmp(head, exr, sizeof(exr)) == 0)
        return of_exr(head, size);
    if (size >= 2 && memcmp(head, "#?", 2) == 0)
        return of_hdr(head, size);
    if (size >= 24 && memcmp(head, png, sizeof(png)) == 0)
        return most_bytes(big32(head + 16), big32(head + 20), 8);
    return size >= 2 && memcmp(head, jpeg, sizeof(jpeg)) == 0 ? of_jpeg(head, size) : 0;
}
