#include "image/codec/exr_zip.h"

#include "base/mem.h"

#include <libdeflate.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

#define RUN 64    /* bytes */
#define SAMPLED 8 /* one in so many runs */
#define WORTH 0.2 /* of the bytes */
#define LEVEL 1   /* of libdeflate, 1 to 12: see docs/performance.md, "EXR files" */

const char exr_zip_no_memory[] = "out of memory";

void exr_inflater_destroy(struct libdeflate_decompressor *inflater)
{
    libdeflate_free_decompressor(inflater);
}

void exr_zip_finish(struct exr_zip *z)
{
    scratch_free(z->scratch, z->bytes);
    z->bytes = NULL;
    z->room = 0;
}

static bool make_ready(struct exr_zip *z, size_t size)
{
    if (!*z->inflater)
        *z->inflater = libdeflate_alloc_decompressor();
    if (size > z->room) {
        scratch_free(z->scratch, z->bytes);
        z->bytes = scratch_alloc(z->scratch, size);
        z->room = z->bytes ? size : 0;
    }
    return *z->inflater && z->bytes;
}

void exr_zip_sum_ref(uint8_t *b, size_t n)
{
    for (size_t i = 1; i < n; i++)
        b[i] = (uint8_t)(b[i - 1] + b[i] - 128);
}

#ifdef __SSE2__

/* Prefix sums of sixteen bytes in four steps, each adding the byte 1, 2, 4 and 8 places before; then the previous
 * block's last sum is added, so only that addition is serial. */
void exr_zip_sum(uint8_t *b, size_t n)
{
    const __m128i middle = _mm_set1_epi8((char)0x80);
    __m128i last = middle; /* so that the first byte keeps its value */
    size_t i = 0;

    for (; i + 16 <= n; i += 16) {
        __m128i v = _mm_xor_si128(_mm_loadu_si128((const __m128i *)(b + i)), middle); /* - 128 */
        v = _mm_add_epi8(v, _mm_slli_si128(v, 1));
        v = _mm_add_epi8(v, _mm_slli_si128(v, 2));
        v = _mm_add_epi8(v, _mm_slli_si128(v, 4));
        v = _mm_add_epi8(_mm_add_epi8(v, _mm_slli_si128(v, 8)), last);
        _mm_storeu_si128((__m128i *)(b + i), v);
        last = _mm_srli_si128(v, 15);
        last = _mm_unpacklo_epi8(last, last);
        last = _mm_shufflelo_epi16(last, 0);
        last = _mm_unpacklo_epi64(last, last);
    }
    if (i > 0)
        exr_zip_sum_ref(b + i - 1, n - i + 1); /* the tail, starting at the last finished byte */
    else
        exr_zip_sum_ref(b, n);
}

#else

void exr_zip_sum(uint8_t *b, size_t n)
{
    exr_zip_sum_ref(b, n);
}

#endif

/* Interleaves the two halves of the buffer: the first half to even positions, the second to odd ones. With an odd size
 * the first half has one byte more. */
static void weave(const uint8_t *restrict from, size_t size, uint8_t *restrict to)
{
    const uint8_t *restrict second = from + (size + 1) / 2;

    for (size_t i = 0; i < size / 2; i++) {
        to[2 * i] = from[i];
        to[2 * i + 1] = second[i];
    }
    if (size % 2)
        to[size - 1] = from[size / 2];
}

const char *exr_zip_unpack(struct exr_zip *z, const uint8_t *packed, size_t packed_size, uint8_t *out, size_t size)
{
    if (!make_ready(z, size))
        return exr_zip_no_memory;
    const enum libdeflate_result got =
        libdeflate_zlib_decompress(*z->inflater, packed, packed_size, z->bytes, size, NULL);
    if (got == LIBDEFLATE_SHORT_OUTPUT)
        return "too few bytes";
    if (got != LIBDEFLATE_SUCCESS)
        return "cannot inflate";
    exr_zip_sum(z->bytes, size);
    weave(z->bytes, size, out);
    return NULL;
}

/* ---- Packing ---- */

enum err exr_deflater_init(struct exr_deflater *z, size_t room)
{
    *z = (struct exr_deflater){ .plain = mem_alloc_raw(room, 1),
                                .halves = mem_alloc_raw(room, 1),
                                .deflate = libdeflate_alloc_compressor(LEVEL) };
    if (z->plain && z->halves && z->deflate)
        return ERR_OK;
    exr_deflater_finish(z);
    return ERR_NOMEM;
}

void exr_deflater_finish(struct exr_deflater *z)
{
    mem_free(z->plain);
    mem_free(z->halves);
    libdeflate_free_compressor(z->deflate);
    *z = (struct exr_deflater){ .plain = NULL };
}

/* The inverse of weave. */
static void unweave(const uint8_t *restrict from, size_t size, uint8_t *restrict to)
{
    uint8_t *restrict second = to + (size + 1) / 2;

    for (size_t i = 0; i < size / 2; i++) {
        to[i] = from[2 * i];
        second[i] = from[2 * i + 1];
    }
    if (size % 2)
        to[size / 2] = from[size - 1];
}

/* The inverse of exr_zip_sum, not in place: each difference needs the byte before it as it was. */
static void take_differences(const uint8_t *restrict from, size_t size, uint8_t *restrict to)
{
    to[0] = from[0];
    for (size_t i = 1; i < size; i++)
        to[i] = (uint8_t)(from[i] - from[i - 1] + 128);
}

/* Bits of a value that occurs as often as counted among all `of`, summed over all values. */
static double bits_of(const uint32_t count[256], uint32_t of)
{
    double bits = 0.0;

    for (int v = 0; v < 256; v++)
        if (count[v] > 0)
            bits += count[v] * log2((double)of / count[v]);
    return bits;
}

/* Whether packing would save at least WORTH, by the entropy of one in SAMPLED runs of the differences. Of floats with
 * noise only signs and exponents pack, a seventh of the bytes for ten times the time of the rest of the file. */
static bool is_worth_packing(const uint8_t *plain, size_t size)
{
    uint32_t count[2][256] = { { 0 } }, runs = 0;

    if (size < SAMPLED * RUN)
        return true;
    for (size_t at = 2; at + RUN <= size; at += SAMPLED * RUN, runs++)
        for (size_t i = at; i < at + RUN; i += 2)
            for (int odd = 0; odd < 2; odd++)
                count[odd][(uint8_t)(plain[i + (size_t)odd] - plain[i + (size_t)odd - 2])]++;
    const uint32_t each = runs * RUN / 2;
    return bits_of(count[0], each) + bits_of(count[1], each) <= (1.0 - WORTH) * 8.0 * 2.0 * each;
}

size_t exr_zip_pack(struct exr_deflater *z, size_t size, uint8_t *out)
{
    if (!is_worth_packing(z->plain, size)) {
        memcpy(out, z->plain, size);
        return size;
    }
    unweave(z->plain, size, z->halves);
    take_differences(z->halves, size, out);
    /* at most one byte less than the chunk: readers take as many bytes as uncompressed */
    const size_t packed = size > 1 ? libdeflate_zlib_compress(z->deflate, out, size, z->halves, size - 1) : 0;
    memcpy(out, packed > 0 ? z->halves : z->plain, packed > 0 ? packed : size);
    return packed > 0 ? packed : size;
}
