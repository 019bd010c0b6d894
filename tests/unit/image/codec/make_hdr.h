/* Radiance files in memory, for tests and for the corpus of the fuzzer. */
#pragma once

#include <stddef.h>
#include <stdint.h>

enum hdr_encoding {
    HDR_FLAT,
    HDR_OLD_RLE,
    HDR_NEW_RLE, /* scanlines of 8 to 32767 texels */
};

struct hdr_recipe {
    const char *header; /* lines between the magic one and the empty one; NULL: FORMAT=32-bit_rle_rgbe */
    const char *first;  /* axis of the scanlines' order, "-Y"; NULL: that */
    const char *second; /* axis along a scanline, "+X"; NULL: that */
    uint32_t scanlines, length;
    enum hdr_encoding encoding;
};

/* Mantissas and exponent of texel i of scanline s: normal ones, with runs that are longer than a code can say. */
void hdr_recipe_texel(uint32_t s, uint32_t i, uint8_t out[4]);

/* The file; the caller frees it with free(). Ends the program when out of memory. */
uint8_t *hdr_make(const struct hdr_recipe *recipe, size_t *size);
