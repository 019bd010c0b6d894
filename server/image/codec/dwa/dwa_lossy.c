#include "image/codec/dwa/dwa_chunk.h"

#include "base/half.h"

#include <math.h>
#include <string.h>

#define BLOCK_END 0xff00 /* end of block among AC values; 0xff00 + n means n zeros */

/* Position, as 8 * row + column, of the k-th coefficient [JPEG, ITU-T T.81, Figure A.6]. */
static const uint8_t zigzag[64] = {
    0,  1,  8,  16, 9,  2,  3,  10, 17, 24, 32, 25, 18, 11, 4,  5,  12, 19, 26, 33, 40, 48,
    41, 34, 27, 20, 13, 6,  7,  14, 21, 28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23,
    30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63,
};

/* The inverse of the curve: |v|^2.2 up to 1, e^(2.2 (|v| - 1)) above. Cached in a table on first use; 0 means not yet
 * computed, or that the value is 0. */
static uint16_t linear_half(uint16_t *table, uint16_t bits)
{
    if (!table[bits] && (bits & 0x7fff) && (bits & 0x7c00) != 0x7c00) {
        const float v = half_widen(bits & 0x7fff);
        const float linear = v <= 1.0f ? powf(v, 2.2f) : powf(expf(2.2f), v - 1.0f);
        table[bits] = (uint16_t)(half_round(linear) | (bits & 0x8000));
    }
    return table[bits];
}

/* Inverse discrete cosine transform of length 8, orthonormal [Ahmed, Natarajan and Rao 1974], down columns or along
 * rows. */
static void transform_lines(const float *in, float *out, size_t along, size_t across)
{
    /* sqrt(1/4) cos((2 i + 1) k pi / 16), and sqrt(1/8) for k = 0, for the first four i; the others mirror them */
    static const float basis[8][4] = {
        { 0.353553391f, 0.353553391f, 0.353553391f, 0.353553391f },
        { 0.490392640f, 0.415734806f, 0.277785117f, 0.097545161f },
        { 0.461939766f, 0.191341716f, -0.191341716f, -0.461939766f },
        { 0.415734806f, -0.097545161f, -0.490392640f, -0.277785117f },
        { 0.353553391f, -0.353553391f, -0.353553391f, 0.353553391f },
        { 0.277785117f, -0.490392640f, 0.097545161f, 0.415734806f },
        { 0.191341716f, -0.461939766f, 0.461939766f, -0.191341716f },
        { 0.097545161f, -0.277785117f, 0.415734806f, -0.490392640f },
    };

    for (size_t l = 0; l < 8; l++) {
        for (size_t i = 0; i < 4; i++) {
            float even = 0.0f, odd = 0.0f;
            for (size_t k = 0; k < 8; k += 2) {
                even += basis[k][i] * in[l * across + k * along];
                odd += basis[k + 1][i] * in[l * across + (k + 1) * along];
            }
            out[l * across + i * along] = even + odd;
            out[l * across + (7 - i) * along] = even - odd;
        }
    }
}

/* Reads one block of one channel from the DC and AC streams. */
static const char *read_block(struct chunk *c, uint16_t dc, float block[64])
{
    float coefficients[64] = { half_widen(dc) };
    bool flat = true;

    for (unsigned k = 1; k < 64;) {
        if (c->ac_at == c->ac_end)
            return "the AC coefficients are truncated";
        const uint16_t v = *c->ac_at++;
        if (v == BLOCK_END)
            break;
        if (v >> 8 == BLOCK_END >> 8) {
            k += v & 0xff;
            continue;
        }
        coefficients[zigzag[k++]] = half_widen(v);
        flat = false;
    }
    if (flat) {
        for (int i = 0; i < 64; i++)
            block[i] = coefficients[0] * 0.125f;
        return NULL;
    }
    float columns[64];
    transform_lines(coefficients, columns, 8, 1);
    transform_lines(columns, block, 1, 8);
    return NULL;
}

/* Luma and chroma to R, G and B, all under the curve [ITU-R BT.709-6, 3.2, chroma without offset]. */
static void to_rgb(float blocks[3][64])
{
    for (int i = 0; i < 64; i++) {
        const float y = blocks[0][i], cb = blocks[1][i], cr = blocks[2][i];
        blocks[0][i] = y + 1.5747f * cr;
        blocks[1][i] = y - 0.1873f * cb - 0.4682f * cr;
        blocks[2][i] = y + 1.8556f * cb;
    }
}

static void put_half(const struct channel *ch, uint8_t *to, uint16_t bits)
{
    if (ch->type == EXR_PIXEL_FLOAT) {
        const float v = half_widen(bits);
        uint32_t whole;
        memcpy(&whole, &v, 4);
        for (int i = 0; i < 4; i++)
            to[i] = (uint8_t)(whole >> 8 * i);
    } else {
        to[0] = (uint8_t)bits;
        to[1] = (uint8_t)(bits >> 8);
    }
}

static void put_block(const struct chunk *c, const struct channel *ch, const float block[64], uint32_t x0, uint32_t y0)
{
    for (uint32_t y = y0; y < c->height && y < y0 + 8; y++) {
        uint8_t *to = c->out + y * c->row_bytes + ch->offset + x0 * ch->size;
        for (uint32_t x = x0; x < c->width && x < x0 + 8; x++, to += ch->size) {
            const uint16_t bits = half_round(block[8 * (y - y0) + x - x0]);
            put_half(ch, to, ch->linear ? bits : linear_half(c->dwa->to_linear, bits));
        }
    }
}

/* Block by block; the channels of a set are interleaved per block. */
const char *dwa_lossy(struct chunk *c, struct channel *const set[], int count)
{
    const uint32_t across = (c->width + 7) / 8, down = (c->height + 7) / 8;
    float blocks[3][64];

    for (uint32_t i = 0; i < across * down; i++) {
        for (int k = 0; k < count; k++) {
            const char *fault = read_block(c, c->dc_at[(size_t)k * across * down + i], blocks[k]);
            if (fault)
                return fault;
        }
        if (count == 3)
            to_rgb(blocks);
        for (int k = 0; k < count; k++)
            put_block(c, set[k], blocks[k], i % across * 8, i / across * 8);
    }
    c->dc_at += (size_t)count * across * down;
    return NULL;
}
