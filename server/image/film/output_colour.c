#include "image/film/film.h"

#include "base/luminance.h"
#include "base/vec.h"
#include "image/film/tone_kernel.h"

#include <math.h>
#include <stddef.h>

#define BLOCK 512 /* pixels processed at a time: 6 KB, stays in the first-level cache */

const struct setting_choice tone_choices[] = {
    { "filmic", TONE_FILMIC, "soft toe and shoulder, close to the ACES curve", 0 },
    { "reinhard", TONE_REINHARD, "compresses highlights by luminance and keeps their colour", 0 },
    { "linear", TONE_LINEAR, "no curve: values above 1 are clipped", 0 },
    { "false-colour", TONE_FALSE_COLOUR, "luminance as a colour, over three decades: 0.01 to 10 after exposure", 0 },
    { "pq", TONE_PQ, "HDR video with PQ and Rec.2020: no curve, 1 becomes 203 cd/m2, clipped at 1000 cd/m2",
      FOR_MOVIES },
    { NULL, 0, NULL, 0 },
};

/* The rational fit of the ACES curve by [Narkowicz 2015]. The input is scaled so that 0.18 maps to 0.18; it then
 * reaches 1 at 10.01, and the rest, up to 1.033 at infinity, is clamped. */
static double filmic(double x)
{
    const double s = 0.72324 * x;
    return s * (2.51 * s + 0.03) / (s * (2.43 * s + 0.59) + 0.14);
}

double tone_value(enum tone_curve curve, double x)
{
    if (!(x > 0.0))
        return 0.0;
    x = fmin(x, 1e30); /* avoids infinity / infinity */
    switch (curve) {
    case TONE_FILMIC: return fmin(filmic(x), 1.0);
    case TONE_REINHARD: return fmin(x * (1.0 + x / (TONE_WHITE * TONE_WHITE)) / (1.0 + x), 1.0);
    case TONE_LINEAR:
    case TONE_FALSE_COLOUR:
    case TONE_PQ: break;
    }
    return fmin(x, 1.0);
}

/* The code value before rounding and clamping; `curve` acts per channel. */
static double smooth_code(enum tone_curve curve, double x)
{
    return 255.0 * srgb_encode(curve == TONE_FILMIC ? filmic(x) : x);
}

extern const struct tone_kernel tone_kernel_baseline, tone_kernel_v3, tone_kernel_v4;

const struct tone_kernel *tone_kernel_select(const char *level)
{
    static const struct tone_kernel *const by_level[CPU_LEVELS] = KERNEL_TABLE(tone_kernel);
    enum cpu_level chosen;
    struct reason ignored;

    return by_level[cpu_select(level, &chosen, &ignored) ? cpu_best() : chosen];
}

/* Interpolates a cubic at four points of each half octave, including both ends, so that neighbouring segments meet: u =
 * -1/4, -1/8, 1/8, 1/4, the extrema of the third Chebyshev polynomial. */
void tone_table_fill(struct tone_table *t, enum tone_curve curve)
{
    for (uint32_t k = 0; k < TONE_SEGMENTS; k++) {
        const double octave = ldexp(1.0 / TONE_SCALE, -13 + (int)(k / 2)), middle = k % 2 ? 1.75 : 1.25;
        double f[4];
        for (int i = 0; i < 4; i++) {
            static const double places[4] = { -0.25, -0.125, 0.125, 0.25 };
            f[i] = smooth_code(curve, octave * (middle + places[i]));
        }
        /* Even and odd parts: (f(u) + f(-u)) / 2 = c0 + c2 u^2, (f(u) - f(-u)) / 2 = c1 u + c3 u^3. */
        const double even1 = 0.5 * (f[1] + f[2]), even2 = 0.5 * (f[0] + f[3]);
        const double odd1 = 8.0 * 0.5 * (f[2] - f[1]), odd2 = 4.0 * 0.5 * (f[3] - f[0]);
        const double c2 = (even2 - even1) / (1.0 / 16.0 - 1.0 / 64.0), c3 = (odd2 - odd1) / (1.0 / 16.0 - 1.0 / 64.0);
        /* 114 is the biased exponent of 2^-13 */
        const uint32_t s = (2 * 114 + k) % TONE_SEGMENTS;
        t->c[0][s] = (float)(even1 - c2 / 64.0 + 0.5);
        t->c[1][s] = (float)(odd1 - c3 / 64.0);
        t->c[2][s] = (float)c2;
        t->c[3][s] = (float)c3;
    }
}

/* [Reinhard 2002, Eq. 4] on luminance, keeping the ratios of the channels; values above 1 are clamped with the codes.
 * Three simple loops, each of which compilers vectorise, unlike a single combined loop. */
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
}

static void colour_pixel(double gain, const float *in, uint8_t out[3])
{
    double lit[3];

    for (int c = 0; c < 3; c++)
        lit[c] = in[c] > 0.0f ? fmin((double)in[c], 1e30) : 0.0;
    false_colour(false_colour_share(luminance_of(LUMINANCE_REC709, lit) * gain), out);
}

static void map_false_colour(const float *rgb, size_t pixels, double gain, uint8_t *out)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < pixels; i++)
        colour_pixel(gain, rgb + 3 * i, out + 3 * i);
}

void tone_map(const float *rgb, uint32_t width, uint32_t height, const struct tone_desc *desc, uint8_t *out)
{
    const struct tone_kernel *kernel = tone_kernel_select(desc->level);
    const enum tone_curve curve = desc->curve;
    struct tone_table table;
    const size_t count = (size_t)width * height * 3;
    /* a gain that is NaN or exceeds a float must not turn light into NaN */
    const float factor = (float)fmin(fmax(desc->gain, 0x1p-126), 0x1p127);
    const float scaled = (float)fmin(fmax(desc->gain * TONE_SCALE, 0x1p-126), 0x1p127);

    if (curve == TONE_FALSE_COLOUR) {
        map_false_colour(rgb, count / 3, fmin(fmax(desc->gain, 0x1p-126), 0x1p127), out);
        return;
    }
    tone_table_fill(&table, curve == TONE_FILMIC ? TONE_FILMIC : TONE_LINEAR);
#pragma omp parallel for schedule(static)
    for (size_t at = 0; at < count; at += 3 * BLOCK) {
        const size_t n = count - at < 3 * BLOCK ? count - at : 3 * BLOCK;
        float block[3 * BLOCK];
        if (curve == TONE_REINHARD) {
            expose_reinhard(rgb + at, n, factor, block);
            kernel->codes(&table, block, n, (float)TONE_SCALE, out + at);
        } else {
            kernel->codes(&table, rgb + at, n, scaled, out + at);
        }
    }
}

/* Exposed values to display-linear light. */
static void display_pixel(enum tone_curve curve, double gain, const float *from, double out[3])
{
    double x[3];

    if (curve == TONE_FALSE_COLOUR) {
        uint8_t codes[3];
        colour_pixel(gain, from, codes);
        for (int c = 0; c < 3; c++)
            out[c] = srgb_decode(codes[c] / 255.0);
        return;
    }
    for (int c = 0; c < 3; c++)
        x[c] = from[c] > 0.0f ? fmin((double)from[c] * gain, 1e30) : 0.0;
    if (curve != TONE_REINHARD) {
        for (int c = 0; c < 3; c++)
            out[c] = tone_value(curve, x[c]);
        return;
    }
    const double l = luminance_of(LUMINANCE_REC709, x);
    const double scale = l > 0.0 ? (1.0 + l / (TONE_WHITE * TONE_WHITE)) / (1.0 + l) : 0.0;
    for (int c = 0; c < 3; c++)
        out[c] = fmin(x[c] * scale, 1.0);
}

void tone_map_deep(const float *from, uint32_t width, uint32_t height, uint32_t channels, const struct tone_desc *desc,
                   uint16_t *out)
{
    const double gain = fmin(fmax(desc->gain, 0x1p-126), 0x1p127);

#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < (size_t)width * height; i++) {
        const float *pixel = from + channels * i;
        double light[3];
        display_pixel(desc->curve, gain, pixel, light);
        for (size_t c = 0; c < 3; c++)
            out[channels * i + c] = (uint16_t)lrint(65535.0 * srgb_encode(light[c]));
        if (channels == 4)
            out[4 * i + 3] = (uint16_t)lrint(65535.0 * fmin(fmax((double)pixel[3], 0.0), 1.0));
    }
}

double tone_pq(double luminance)
{
    const double m1 = 2610.0 / 16384.0, m2 = 2523.0 / 32.0;
    const double c1 = 3424.0 / 4096.0, c2 = 2413.0 / 128.0, c3 = 2392.0 / 128.0;
    const double y = pow(fmin(fmax(luminance, 0.0), 10000.0) / 10000.0, m1);

    return pow((c1 + c2 * y) / (1.0 + c3 * y), m2);
}

void tone_map_pq(const float *rgb, uint32_t width, uint32_t height, double gain, uint16_t *out)
{
    /* From Rec.709 primaries to Rec.2020 [ITU-R BT.2087-0, 4, M2]; rows sum to 1. */
    static const double to_2020[3][3] = {
        { 0.6274, 0.3293, 0.0433 },
        { 0.0691, 0.9195, 0.0114 },
        { 0.0164, 0.0880, 0.8956 },
    };

#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < (size_t)width * height; i++) {
        const float *in = rgb + 3 * i;
        double x[3];
        for (int c = 0; c < 3; c++)
            x[c] = in[c] > 0.0f ? fmin((double)in[c] * gain, 1e30) : 0.0;
        for (int c = 0; c < 3; c++) {
            const double light = to_2020[c][0] * x[0] + to_2020[c][1] * x[1] + to_2020[c][2] * x[2];
            out[3 * i + (size_t)c] = (uint16_t)lrint(65535.0 * tone_pq(fmin(TONE_PQ_WHITE * light, TONE_PQ_PEAK)));
        }
    }
}
