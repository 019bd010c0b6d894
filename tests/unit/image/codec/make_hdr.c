#include "image/codec/make_hdr.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct sink {
    uint8_t *bytes;
    size_t size, room;
};

static void put(struct sink *s, const void *bytes, size_t count)
{
    if (s->size + count > s->room) {
        s->room = 2 * (s->size + count);
        s->bytes = realloc(s->bytes, s->room);
        if (!s->bytes) {
            fprintf(stderr, "make_hdr: out of memory\n");
            exit(1);
        }
    }
    memcpy(s->bytes + s->size, bytes, count);
    s->size += count;
}

static void put_byte(struct sink *s, unsigned value)
{
    const uint8_t byte = (uint8_t)value;

    put(s, &byte, 1);
}

void hdr_recipe_texel(uint32_t s, uint32_t i, uint8_t out[4])
{
    /* one texel to the end, or several stretches, in odd scanlines; noise in even ones */
    const uint32_t n = s % 4 == 3 && i > 3 ? s : s % 2 ? s + i / 9 : 31 * s + 17 * i;

    out[0] = (uint8_t)(128 + n % 128);
    out[1] = (uint8_t)(n * 7 % 256);
    out[2] = (uint8_t)(n / 2 % 256);
    out[3] = (uint8_t)(120 + n % 16);
}

/* How many texels from i on are the same as texel i. */
static uint32_t run_length(uint32_t s, uint32_t i, uint32_t length, int plane)
{
    uint8_t a[4], b[4];
    uint32_t n = 1;

    for (hdr_recipe_texel(s, i, a); i + n < length; n++) {
        hdr_recipe_texel(s, i + n, b);
        if (plane < 0 ? memcmp(a, b, 4) != 0 : a[plane] != b[plane])
            break;
    }
    return n;
}

static void put_old_scanline(struct sink *s, uint32_t scanline, uint32_t length)
{
    uint8_t t[4];

    for (uint32_t i = 0; i < length;) {
        uint32_t more = run_length(scanline, i, length, -1) - 1;
        hdr_recipe_texel(scanline, i, t);
        put(s, t, 4);
        i += 1 + more;
        for (; more; more >>= 8) /* the lowest eight bits first */
            put(s, (const uint8_t[]){ 1, 1, 1, (uint8_t)more }, 4);
    }
}

static void put_new_scanline(struct sink *s, uint32_t scanline, uint32_t length)
{
    uint8_t t[4];

    put(s, (const uint8_t[]){ 2, 2, (uint8_t)(length >> 8), (uint8_t)length }, 4);
    for (int plane = 0; plane < 4; plane++) {
        for (uint32_t i = 0; i < length;) {
            uint32_t run = run_length(scanline, i, length, plane), plain = 0;
            if (run >= 3) {
                run = run < 127 ? run : 127;
                put_byte(s, 128 + run);
                hdr_recipe_texel(scanline, i, t);
                put_byte(s, t[plane]);
                i += run;
                continue;
            }
            while (plain < 128 && i + plain < length && run_length(scanline, i + plain, length, plane) < 3)
                plain++;
            put_byte(s, plain);
            for (; plain; plain--, i++) {
                hdr_recipe_texel(scanline, i, t);
                put_byte(s, t[plane]);
            }
        }
    }
}

uint8_t *hdr_make(const struct hdr_recipe *r, size_t *size)
{
    struct sink s = { NULL, 0, 0 };
    char text[512];
    uint8_t t[4];

    const int n = snprintf(text, sizeof(text), "#?RADIANCE\n%s\n\n%s %u %s %u\n",
                           r->header ? r->header : "FORMAT=32-bit_rle_rgbe", r->first ? r->first : "-Y", r->scanlines,
                           r->second ? r->second : "+X", r->length);
    put(&s, text, (size_t)n);
    for (uint32_t scanline = 0; scanline < r->scanlines; scanline++) {
        if (r->encoding == HDR_NEW_RLE)
            put_new_scanline(&s, scanline, r->length);
        else if (r->encoding == HDR_OLD_RLE)
            put_old_scanline(&s, scanline, r->length);
        for (uint32_t i = 0; r->encoding == HDR_FLAT && i < r->length; i++) {
            hdr_recipe_texel(scanline, i, t);
            put(&s, t, 4);
        }
    }
    *size = s.size;
    return s.bytes;
}
