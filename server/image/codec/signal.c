#include "base/luminance.h"
#include "image/codec/signal.h"

#include "image/codec/primaries.h"

#include <math.h>

#define UNSTATED 2 /* H.273: in every table */

const struct setting_choice signal_transfer_choices[] = {
    { "auto", SIGNAL_AUTO, "as the stream says", 0 },
    { "srgb", SIGNAL_SRGB, "sRGB", 0 },
    { "bt1886", SIGNAL_BT1886, "BT.1886, a power of 2.4: most 8-bit video", 0 },
    { "gamma22", SIGNAL_GAMMA22, "a power of 2.2", 0 },
    { "gamma28", SIGNAL_GAMMA28, "a power of 2.8", 0 },
    { "linear", SIGNAL_LINEAR, "linear light", 0 },
    { "pq", SIGNAL_PQ, "BT.2100 PQ (HDR10), absolute", 0 },
    { "hlg", SIGNAL_HLG, "BT.2100 HLG", 0 },
    { NULL, 0, NULL, 0 },
};

const char *signal_transfer_name(enum signal_transfer transfer)
{
    return choice_name(signal_transfer_choices, (int)transfer);
}

/* ---- Code points [ITU-T H.273] ---- */

static const struct {
    uint8_t code;
    struct chromaticities xy;
} primaries[] = {
    /* Table 2. White is D65 except where stated. */
    { 1, { { 0.640, 0.330 }, { 0.300, 0.600 }, { 0.150, 0.060 }, { 0.3127, 0.3290 } } },  /* BT.709 */
    { 4, { { 0.67, 0.33 }, { 0.21, 0.71 }, { 0.14, 0.08 }, { 0.310, 0.316 } } },          /* BT.470 M, illuminant C */
    { 5, { { 0.64, 0.33 }, { 0.29, 0.60 }, { 0.15, 0.06 }, { 0.3127, 0.3290 } } },        /* BT.601, 625 lines */
    { 6, { { 0.630, 0.340 }, { 0.310, 0.595 }, { 0.155, 0.070 }, { 0.3127, 0.3290 } } },  /* BT.601, 525 lines */
    { 7, { { 0.630, 0.340 }, { 0.310, 0.595 }, { 0.155, 0.070 }, { 0.3127, 0.3290 } } },  /* SMPTE 240M */
    { 9, { { 0.708, 0.292 }, { 0.170, 0.797 }, { 0.131, 0.046 }, { 0.3127, 0.3290 } } },  /* BT.2020, BT.2100 */
    { 11, { { 0.680, 0.320 }, { 0.265, 0.690 }, { 0.150, 0.060 }, { 0.314, 0.351 } } },   /* DCI-P3 */
    { 12, { { 0.680, 0.320 }, { 0.265, 0.690 }, { 0.150, 0.060 }, { 0.3127, 0.3290 } } }, /* Display P3 */
};

static const struct chromaticities *find_primaries(uint8_t code)
{
    if (code == UNSTATED)
        return &primaries[0].xy;
    for (size_t i = 0; i < sizeof(primaries) / sizeof(primaries[0]); i++)
        if (primaries[i].code == code)
            return &primaries[i].xy;
    return NULL;
}

/* Table 3. AUTO: a code point that this program does not know. */
static enum signal_transfer find_transfer(const struct signal_desc *d)
{
    switch (d->transfer) {
    case UNSTATED: return d->rgb ? SIGNAL_SRGB : SIGNAL_BT1886;
    case 1:  /* BT.709 */
    case 6:  /* BT.601 */
    case 7:  /* SMPTE 240M */
    case 11: /* xvYCC */
    case 12: /* BT.1361 */
    case 14: /* BT.2020, 10 bits */
    case 15: /* BT.2020, 12 bits */ return SIGNAL_BT1886;
    case 4: return SIGNAL_GAMMA22;
    case 5: return SIGNAL_GAMMA28;
    case 8: return SIGNAL_LINEAR;
    case 13: return SIGNAL_SRGB;
    case 16: return SIGNAL_PQ;
    case 18: return SIGNAL_HLG;
    default: return SIGNAL_AUTO;
    }
}

/* Table 4: the luma weights of red and blue. False: not known. */
static bool find_weights(uint8_t matrix, double *red, double *blue)
{
    switch (matrix) {
    case 1:
        *red = 0.2126;
        *blue = 0.0722;
        return true; /* BT.709 */
    case 4:
        *red = 0.30;
        *blue = 0.11;
        return true; /* FCC */
    case UNSTATED:   /* the caller guesses by size */
    case 5:
    case 6:
        *red = 0.299;
        *blue = 0.114;
        return true; /* BT.601 */
    case 7:
        *red = 0.212;
        *blue = 0.087;
        return true; /* SMPTE 240M */
    case 9:
        *red = 0.2627;
        *blue = 0.0593;
        return true; /* BT.2020, non-constant luminance */
    default: return false;
    }
}

/* ---- Transfer functions: signal 0..1 to light ---- */

/* cd/m^2 [ITU-R BT.2100-2, Table 4]. */
static double light_of_pq(double signal)
{
    const double m1 = 2610.0 / 16384.0, m2 = 128.0 * 2523.0 / 4096.0;
    const double c1 = 3424.0 / 4096.0, c2 = 32.0 * 2413.0 / 4096.0, c3 = 32.0 * 2392.0 / 4096.0;
    const double p = pow(signal, 1.0 / m2);

    return 1e4 * pow(fmax(p - c1, 0.0) / (c2 - c3 * p), 1.0 / m1);
}

/* Light of the scene, 0..1 [ITU-R BT.2100-2, Table 5: the inverse of the OETF]. */
static double light_of_hlg(double signal)
{
    const double a = 0.17883277, b = 1.0 - 4.0 * a, c = 0.5 - a * log(4.0 * a);

    return signal <= 0.5 ? signal * signal / 3.0 : (exp((signal - c) / a) + b) / 12.0;
}

static double light_of(enum signal_transfer transfer, double signal)
{
    switch (transfer) {
    case SIGNAL_SRGB: return srgb_decode(signal);
    case SIGNAL_AUTO:
    case SIGNAL_BT1886: return pow(signal, 2.4);
    case SIGNAL_GAMMA22: return pow(signal, 2.2);
    case SIGNAL_GAMMA28: return pow(signal, 2.8);
    case SIGNAL_LINEAR: return signal;
    case SIGNAL_PQ: return light_of_pq(signal);
    case SIGNAL_HLG: return light_of_hlg(signal);
    }
    return 0.0;
}

/* ---- Preparation ---- */

/* Black at 16 and white at 235, 240 for colour differences, in 8 bits; more bits scale them [ITU-R BT.2100-2, Table
 * 9]. */
static void prepare_range(const struct signal_desc *d, struct signal *s)
{
    const double unit = (double)(1u << (d->depth - 8)), most = (double)((1u << d->depth) - 1u);

    for (int c = 0; c < 3; c++) {
        const bool difference = c > 0 && !s->rgb;
        const double black = difference ? 128.0 * unit : d->full_range ? 0.0 : 16.0 * unit;
        const double span = d->full_range ? most : difference ? 224.0 * unit : 219.0 * unit;
        s->scale[c] = (float)(1.0 / span);
        s->offset[c] = (float)(-black / span);
    }
}

static void prepare_matrix(double red, double blue, struct signal *s)
{
    const double green = 1.0 - red - blue;

    s->red_cr = (float)(2.0 * (1.0 - red));
    s->blue_cb = (float)(2.0 * (1.0 - blue));
    s->green_cr = (float)(-2.0 * red * (1.0 - red) / green);
    s->green_cb = (float)(-2.0 * blue * (1.0 - blue) / green);
}

static void prepare_light(const struct signal_desc *d, struct signal *s)
{
    const bool absolute = s->transfer == SIGNAL_PQ, scene = s->transfer == SIGNAL_HLG;
    const double peak = d->peak_cdm2 > 0.0 ? d->peak_cdm2 : scene ? SIGNAL_HLG_PEAK_CDM2 : SIGNAL_WHITE_CDM2;

    /* Cameras put highlights above white, up to code value 255 of 235. PQ ends at 1. */
    s->top = absolute ? 1.0f : 1.1f;
    s->peak = (float)peak;
    s->ootf = (float)(0.2 + 0.42 * log10(peak / 1000.0)); /* [ITU-R BT.2100-2, Table 5, note 5f] */
    for (int i = 0; i < SIGNAL_STEPS + 2; i++) {
        const double signal = fmin((double)i / SIGNAL_STEPS, 1.0) * (double)s->top;
        double light = light_of(s->transfer, signal);
        if (absolute && d->peak_cdm2 > 0.0)
            light = fmin(light, d->peak_cdm2);
        else if (!absolute && !scene)
            light *= peak;
        s->light[i] = (float)light;
    }
}

/* The second row of the matrix from RGB to XYZ is the luminance of the primaries. */
static void prepare_luminance(const struct chromaticities *xy, struct signal *s)
{
    static const double y_of_rec709[3] = { 0.2126, 0.7152, 0.0722 };

    (void)xy;
    for (int c = 0; c < 3; c++) {
        s->luminance[c] = 0.0f;
        for (int k = 0; k < 3; k++)
            s->luminance[c] += (float)y_of_rec709[k] * s->to_rec709[3 * k + c];
    }
}

enum err signal_prepare(const struct signal_desc *d, const char *name, struct signal *s, struct reason *why)
{
    const struct chromaticities *xy = find_primaries(d->primaries);
    double red = 0.0, blue = 0.0, m[9];

    if (d->depth < 8 || d->depth > 16)
        return err_say(why, ERR_UNSUPPORTED, "%s: %u bits per component; 8 to 16 are supported", name, d->depth);
    if (!xy)
        return err_say(why, ERR_UNSUPPORTED, "%s: its primaries (number %u of H.273) are not supported", name,
                       d->primaries);
    s->rgb = d->rgb || d->matrix == 0;
    if (!s->rgb && !find_weights(d->matrix, &red, &blue))
        return err_say(why, ERR_UNSUPPORTED, "%s: its colour matrix (number %u of H.273) is not supported", name,
                       d->matrix);
    s->transfer = d->override != SIGNAL_AUTO ? d->override : find_transfer(d);
    s->transfer_assumed = d->override == SIGNAL_AUTO && d->transfer == UNSTATED;
    if (s->transfer == SIGNAL_AUTO)
        return err_say(
            why, ERR_UNSUPPORTED,
            "%s: its transfer function (number %u of H.273) is not supported; set another with --source-transfer", name,
            d->transfer);
    const enum err e = colour_to_rec709(xy, m);
    if (e)
        return err_say(why, e, "%s: its primaries are not valid", name);
    for (int i = 0; i < 9; i++)
        s->to_rec709[i] = (float)m[i];
    prepare_range(d, s);
    if (!s->rgb)
        prepare_matrix(red, blue, s);
    prepare_luminance(xy, s);
    prepare_light(d, s);
    return ERR_OK;
}

/* ---- Conversion ---- */

/* Between two entries of the table. */
static inline float light_at(const struct signal *s, float signal, float per_signal)
{
    float at = signal * per_signal;

    at = at > 0.0f ? at : 0.0f; /* also NaN */
    at = at < (float)SIGNAL_STEPS ? at : (float)SIGNAL_STEPS;
    const int i = (int)at;
    return s->light[i] + (at - (float)i) * (s->light[i + 1] - s->light[i]);
}

void signal_row(const struct signal *s, const float *a, const float *b, const float *c, size_t count, float *rgb)
{
    const float per_signal = (float)SIGNAL_STEPS / s->top, *m = s->to_rec709;

    for (size_t i = 0; i < count; i++) {
        const float x = a[i] * s->scale[0] + s->offset[0], y = b[i] * s->scale[1] + s->offset[1],
                    z = c[i] * s->scale[2] + s->offset[2];
        float l[3];
        l[0] = light_at(s, s->rgb ? x : x + s->red_cr * z, per_signal);
        l[1] = light_at(s, s->rgb ? y : x + s->green_cb * y + s->green_cr * z, per_signal);
        l[2] = light_at(s, s->rgb ? z : x + s->blue_cb * y, per_signal);
        if (s->transfer == SIGNAL_HLG) {
            const float scene = s->luminance[0] * l[0] + s->luminance[1] * l[1] + s->luminance[2] * l[2];
            const float gain = scene > 0.0f ? s->peak * powf(scene, s->ootf) : 0.0f;
            for (int k = 0; k < 3; k++)
                l[k] *= gain;
        }
        for (int k = 0; k < 3; k++)
            rgb[3 * i + (size_t)k] = m[3 * k] * l[0] + m[3 * k + 1] * l[1] + m[3 * k + 2] * l[2];
    }
}
