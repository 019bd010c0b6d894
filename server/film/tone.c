#include "film.h"

#include "vec.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* The way from exposed light to a code value is a table over the float's own bits: 64 nodes per octave, straight lines
 * between them. Below 2^-13 every curve's code is 0, from 2^4 on it is 255. */
#define LOWEST_OCTAVE (-13)
#define OCTAVES 17
#define NODE_BITS 6
#define NODES (OCTAVES << NODE_BITS)
#define STEP_BITS 11 /* of the mantissa between two nodes: 17 bits are left, 11 keep the product within 32 */
#define LOWEST 0x1p-13f
#define HIGHEST 0x1.fffffep3f
#define BLOCK 512 /* pixels treated at a time: 6 KB, stays in the first cache */

struct tone_table {
    struct {
        uint32_t base; /* code value in 1/65536, plus a half for rounding */
        uint32_t rise; /* up to the next node's */
    } node[NODES];
};

static const char *const names[] = {
    [TONE_FILMIC] = "filmic",
    [TONE_REINHARD] = "reinhard",
    [TONE_LINEAR] = "linear",
};

#define NAME_COUNT (sizeof(names) / sizeof(names[0]))

enum err tone_parse(const char *name, enum tone_curve *out, struct reason *why)
{
    for (size_t i = 0; i < NAME_COUNT; i++) {
        if (strcmp(name, names[i]) == 0) {
            *out = (enum tone_curve)i;
            return ERR_OK;
        }
    }
    return err_say(why, ERR_USAGE, "unknown tone curve '%s': filmic, reinhard or linear", name);
}

const char *tone_name(enum tone_curve curve)
{
    return (size_t)curve < NAME_COUNT ? names[curve] : "unknown";
}

/* The rational fit of the ACES curve by [Narkowicz 2015]. Its input is scaled so that 0.18 stays 0.18, whereby it
 * reaches 1 at 10.01; the rest, up to 1.033 at infinity, is cut off. */
static double filmic(double x)
{
    const double s = 0.72324 * x;
    return s * (2.51 * s + 0.03) / (s * (2.43 * s + 0.59) + 0.14);
}

double tone_value(enum tone_curve curve, double x)
{
    if (!(x > 0.0))
        return 0.0;
    x = fmin(x, 1e30); /* infinity over infinity is no number */
    switch (curve) {
    case TONE_FILMIC: return fmin(filmic(x), 1.0);
    case TONE_REINHARD: return fmin(x * (1.0 + x / (TONE_WHITE * TONE_WHITE)) / (1.0 + x), 1.0);
    case TONE_LINEAR: break;
    }
    return fmin(x, 1.0);
}

double tone_srgb(double linear)
{
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1.0 / 2.4) - 0.055;
}

/* `curve` acts per channel here. Node by node in double; non-decreasing because each rise is a difference of rounded
 * bases. */
static void fill(struct tone_table *t, enum tone_curve curve)
{
    uint32_t here = 0;

    for (int i = 0; i <= NODES; i++) {
        const double x =
            ldexp(1.0 + (i & ((1 << NODE_BITS) - 1)) / (double)(1 << NODE_BITS), LOWEST_OCTAVE + (i >> NODE_BITS));
        const uint32_t next = (uint32_t)(65536.0 * (255.0 * tone_srgb(tone_value(curve, x)) + 0.5));
        if (i > 0) {
            t->node[i - 1].base = here;
            t->node[i - 1].rise = next - here;
        }
        here = next;
    }
}

/* Scales and clamps count floats into the table's range. The comparisons are written so that NaN fails the first one
 * and comes out as the lowest value. */
static void expose(const float *in, size_t count, float gain, float *out)
{
    for (size_t i = 0; i < count; i++) {
        const float x = in[i] * gain;
        const float floored = x > LOWEST ? x : LOWEST;
        out[i] = floored < HIGHEST ? floored : HIGHEST;
    }
}

/* [Reinhard 2002, Eq. 4] on the luminance, the colour's ratios kept; what then exceeds 1 is clipped by the table.
 * Three plain loops, because compilers vectorise each of them and not the one that they would make together. */
static void expose_reinhard(const float *in, size_t count, float gain, float *out)
{
    const float bend = (float)(1.0 / (TONE_WHITE * TONE_WHITE));
    const float most = 0x1p60f; /* keeps infinity and its luminance finite */
    float scale[BLOCK];

    for (size_t i = 0; i < count; i++) {
        const float x = in[i] * gain;
        const float positive = x > 0.0f ? x : 0.0f;
        out[i] = positive < most ? positive : most;
    }
    for (size_t i = 0; i < count / 3; i++) {
        const float l = rgb_luminance(out[3 * i], out[3 * i + 1], out[3 * i + 2]);
        scale[i] = (1.0f + l * bend) / (1.0f + l);
    }
    for (size_t i = 0; i < count / 3; i++)
        for (size_t k = 0; k < 3; k++)
            out[3 * i + k] *= scale[i];
    expose(out, count, 1.0f, out);
}

static void look_up(const struct tone_table *t, const float *x, size_t count, uint8_t *out)
{
    const uint32_t lowest_bits = (uint32_t)(127 + LOWEST_OCTAVE) << 23;

    for (size_t i = 0; i < count; i++) {
        uint32_t bits;
        memcpy(&bits, &x[i], sizeof(bits));
        bits -= lowest_bits;
        const uint32_t n = bits >> (23 - NODE_BITS);
        const uint32_t step = bits >> (23 - NODE_BITS - STEP_BITS) & ((1u << STEP_BITS) - 1);
        out[i] = (uint8_t)((t->node[n].base + (t->node[n].rise * step >> STEP_BITS)) >> 16);
    }
}

void tone_map(const float *rgb, uint32_t width, uint32_t height, double gain, enum tone_curve curve, uint8_t *out)
{
    struct tone_table table;
    const size_t count = (size_t)width * height * 3;
    /* a factor that is no number, or not one that a float can hold, must not turn light into NaN */
    const float factor = (float)fmin(fmax(gain, 0x1p-126), 0x1p127);

    fill(&table, curve == TONE_FILMIC ? TONE_FILMIC : TONE_LINEAR);
#pragma omp parallel for schedule(static)
    for (size_t at = 0; at < count; at += 3 * BLOCK) {
        float block[3 * BLOCK];
        const size_t n = count - at < 3 * BLOCK ? count - at : 3 * BLOCK;
        if (curve == TONE_REINHARD)
            expose_reinhard(rgb + at, n, factor, block);
        else
            expose(rgb + at, n, factor, block);
        look_up(&table, block, n, out + at);
    }
}
