#include "sky/between/restore.h"

#include "base/half.h"
#include "base/luminance.h"
#include "base/mem.h"
#include "sky/between/latlong.h"
#include "sky/daylight/sky.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define DEGREE (PI / 180.0)

/* ---- The flat spot ---- */

#define NEARLY 0.97f               /* of the maximum: compression and RGBE blur a flat spot by so much */
#define SPOT_RADIUS (6.0 * DEGREE) /* a larger area is a bright sky or a window */
#define SPOT_ROUND 0.6             /* a disc's spread over the spot's: cuts off strips, and glare with clouds in one */
#define SPOT_FLAT 0.2              /* solid angle of the spot over that above half the maximum: a Gaussian has 0.04 */

static float brightest(const struct spot_area *a)
{
    float most = 0.0f;

    for (size_t i = 0; i < (size_t)a->rows * a->width; i++)
        most = fmaxf(most, texel_brightest(a->rgb, i));
    return most;
}

/* Whether the spot is compact, flat and well above its surroundings. */
static bool is_clipped(const struct spot_area *a, const struct spot *s, float most)
{
    const double reach = 3.0 * s->radius + 3.0 * PI / a->height;
    double half = 0.0;

    /* A sun smaller than a texel fills one; elsewhere one bright texel is not flat. */
    const size_t least = PI / a->height > 2.0 * SUN_RADIUS ? 1 : 2;
    if (s->texels < least || s->radius > SPOT_RADIUS || s->round < SPOT_ROUND)
        return false;
    for (uint32_t y = 0; y < a->rows; y++) {
        const double o = texel_solid_angle(a->width, a->height, y);
        for (uint32_t x = 0; x < a->width; x++) {
            const float v = texel_brightest(a->rgb, (size_t)y * a->width + x);
            double w[3];
            if (!(v >= 0.5f * most))
                continue;
            texel_direction(a->width, a->height, x + 0.5, y + 0.5, w);
            if (angle_between(w, s->w) < reach)
                half += o;
        }
    }
    return s->solid_angle >= SPOT_FLAT * half;
}

/* ---- The rest of the sky ---- */

#define LOWEST (10.0 * DEGREE) /* below are trees, houses and haze */
#define SAMPLES 4096           /* about */
#define STEPS 40               /* of turbidity, 4.6 % each */
#define T_LEAST 1.7            /* the model's range */
#define T_MOST 10.0
#define SHAPE_LEAST 2.2 /* beyond these the model holds its distribution (sky_model.c): the shape of the sky says */
#define SHAPE_MOST 6.0  /* nothing there */
#define LEVEL 0.1       /* trust in the units, of the logarithm */
#define BIN 0.03        /* of the logarithm of a ratio */
#define BINS 1200       /* factors of 1e-8 to 1e8 */
#define WIDTH 0.15      /* of agreement, of the logarithm */
#define AGREE 0.5       /* the least share that makes a clear sky: a uniform one reaches 0.48 */

struct sample {
    double w[3], log_luminance, weight; /* -HUGE_VAL: black */
};

struct fit {
    double turbidity, log_scale, share;
};

static size_t take_samples(const struct spot_area *a, struct sample *out)
{
    const uint32_t step = (uint32_t)fmax(1.0, ceil(sqrt((double)a->rows * a->width / SAMPLES)));
    size_t count = 0;

    for (uint32_t y = step / 2; y < a->rows; y += step) {
        for (uint32_t x = step / 2; x < a->width; x += step) {
            struct sample *at = &out[count];
            const double luminance = texel_luminance(a->rgb, (size_t)y * a->width + x);
            texel_direction(a->width, a->height, x + 0.5, y + 0.5, at->w);
            if (at->w[1] < sin(LOWEST))
                continue;
            at->log_luminance = luminance > 0.0 ? log(luminance) : -HUGE_VAL;
            at->weight = texel_solid_angle(a->width, a->height, y);
            count++;
        }
    }
    return count;
}

/* The sky of this sun at scale 1. */
static void model(const double w[3], double turbidity, struct sky_state *out)
{
    const struct sky_desc d = { .turbidity = turbidity, .ground_albedo = 0.2, .scale = 1.0 };

    *out = (struct sky_state){ .sun_elevation = asin(fmax(-1.0, fmin(1.0, w[1]))) };
    for (int c = 0; c < 3; c++)
        out->sun_direction[c] = w[c];
    sky_state_fill(&d, out);
}

/* The best scale at a turbidity: the mode of the logarithm of the ratio, by a Gaussian kernel. */
static struct fit vote(const struct sample *samples, size_t count, const struct sky_state *s, double turbidity)
{
    struct fit best = { .turbidity = turbidity };
    double bins[BINS] = { 0.0 }, whole = 0.0;
    const int reach = (int)(3.0 * WIDTH / BIN);

    for (size_t i = 0; i < count; i++) {
        double rgb[3];
        whole += samples[i].weight;
        sky_radiance(s, samples[i].w, rgb);
        const double ratio = samples[i].log_luminance - log(luminance_of(LUMINANCE_REC709, rgb));
        if (fabs(ratio) < 0.5 * BIN * BINS)
            bins[(int)(ratio / BIN + 0.5 * BINS)] += samples[i].weight;
    }
    for (int i = reach; i < BINS - reach; i++) {
        double sum = 0.0;
        for (int k = -reach; k <= reach; k++)
            sum += bins[i + k] * exp(-0.5 * (k * BIN / WIDTH) * (k * BIN / WIDTH));
        if (sum > best.share * whole) {
            best.share = sum / whole;
            best.log_scale = (i + 0.5 - 0.5 * BINS) * BIN;
        }
    }
    return best;
}

/* What the level says for a fit: 1 where its scale is that of the image's units. */
static double level_weight(const struct fit *f, double units)
{
    const double off = (f->log_scale - log(units)) / LEVEL;
    return exp(-0.5 * off * off);
}

/* The fit; its share is the highest at any turbidity, so that a known level does not hide a clear sky. units: 0 if
 * unknown. */
static enum err fit_sky(const struct spot_area *a, const double w[3], double units, struct fit *out)
{
    const size_t texels = (size_t)a->rows * a->width, most = 2 * (size_t)SAMPLES;
    struct sample *samples = mem_alloc_raw(texels < most ? texels : most, sizeof(*samples));
    double best = 0.0, agreement = 0.0;

    *out = (struct fit){ .turbidity = SHAPE_LEAST };
    if (!samples)
        return ERR_NOMEM;
    const size_t count = take_samples(a, samples);
    for (int i = 0; i < STEPS && count; i++) {
        struct sky_state sky;
        const double t = T_LEAST * pow(T_MOST / T_LEAST, i / (STEPS - 1.0));
        if (!(units > 0.0) && (t < SHAPE_LEAST || t > SHAPE_MOST))
            continue;
        model(w, t, &sky);
        const struct fit f = vote(samples, count, &sky, t);
        const double rank = units > 0.0 ? f.share * level_weight(&f, units) : f.share;
        agreement = fmax(agreement, f.share);
        if (rank > best) {
            best = rank;
            *out = f;
        }
    }
    out->share = agreement;
    mem_free(samples);
    return ERR_OK;
}

/* ---- The disc ---- */

#define WHOLE 0.25     /* of the energy that the sky calls for: a sun with more did not clip */
#define WHOLE_HALF 0.6 /* the same for a spot at the largest half float, where suns do clip */
#define MOST_OVER_REST 30.0 /* a clear sky's sun has a tenth of that: other units */
#define LOW 2.0             /* degrees: the light of a lower sun is a matter of haze, and at the horizon are lamps */

/* Horizontal, luminance: of the upper hemisphere, or of what lies within `reach` of a direction. */
static double irradiance(const struct spot_area *a, const double *around, double reach)
{
    double sum = 0.0;

    for (uint32_t y = 0; y < a->rows; y++) {
        const double o = texel_solid_angle(a->width, a->height, y);
        for (uint32_t x = 0; x < a->width; x++) {
            double w[3];
            texel_direction(a->width, a->height, x + 0.5, y + 0.5, w);
            if (!around || angle_between(w, around) < reach)
                sum += o * w[1] * texel_luminance(a->rgb, (size_t)y * a->width + x);
        }
    }
    return sum;
}

/* Adds a disc that brings this irradiance (luminance, horizontal), in the colour of the model's sun. */
static void add_disc(const struct spot_area *a, float *rgb, struct sky_state *sky, double wanted)
{
    const struct sky_desc size = { .width = a->width, .height = a->height };
    const double gain = wanted / luminance_of(LUMINANCE_REC709, sky->sun_irradiance);

    for (int c = 0; c < 3; c++)
        sky->sun_radiance[c] *= gain;
    sky_add_sun(&size, sky, rgb);
}

/* What is missing (luminance, horizontal), or 0 with the reason in the note. half: the maximum is a half float's. */
static double missing(const struct spot_area *a, const struct restore_desc *desc, const struct sky_state *sky,
                      bool half, struct restored *out)
{
    const double elevation = asin(out->direction[1]) / DEGREE;

    if (desc->lux > 0.0) {
        const double have = out->rest * LUMINOUS_EFFICACY / desc->units;
        out->kind = desc->lux > have && desc->lux < MOST_OVER_REST * have ? RESTORE_ADDED : RESTORE_DOUBT;
        if (out->kind == RESTORE_DOUBT)
            snprintf(out->note, sizeof(out->note),
                     "the sun at %.0f degrees elevation was clipped, but the rest of the sky alone has %.4g lx, which "
                     "%s %.4g lx: nothing was added",
                     elevation, have, desc->lux > have ? "is far too little for" : "is more than", desc->lux);
        return fmax(0.0, desc->lux / LUMINOUS_EFFICACY * desc->units - out->rest);
    }
    if (out->agreement < AGREE || elevation < LOW) {
        out->kind = RESTORE_DOUBT;
        snprintf(
            out->note, sizeof(out->note),
            "a flat spot at %.0f degrees elevation may be a clipped sun or a lamp; %.0f %% of the rest look like a "
            "clear sky%s: nothing was added",
            elevation, 100.0 * out->agreement,
            out->agreement < AGREE ? ", too little to tell its energy" : ", but it is too low to tell its energy");
        return 0.0;
    }
    const double calls = out->scale * luminance_of(LUMINANCE_REC709, sky->sun_irradiance);
    const double have = irradiance(a, out->direction, SUN_RADIUS + 1.5 * PI / a->height);
    out->kind = have < (half ? WHOLE_HALF : WHOLE) * calls ? RESTORE_ADDED : RESTORE_WHOLE;
    if (out->kind == RESTORE_WHOLE)
        snprintf(out->note, sizeof(out->note), "the sun at %.0f degrees elevation has its energy: it did not clip",
                 elevation);
    return out->kind == RESTORE_ADDED ? calls - have : 0.0;
}

static void describe(const struct restore_desc *desc, struct restored *out)
{
    char by[80], lux[40] = "";

    if (desc->lux > 0.0)
        snprintf(by, sizeof(by), "to %.4g lx in all", desc->lux);
    else
        snprintf(by, sizeof(by), "clear-sky model, turbidity %.1f%s", out->turbidity,
                 desc->units > 0.0 ? "" : " by the sky's shape alone");
    if (out->lux > 0.0)
        snprintf(lux, sizeof(lux), ", %.0f lx,", out->lux);
    snprintf(out->note, sizeof(out->note),
             "the sun was clipped: a disc of 0.533 degrees with %.3g times the light of the rest%s was added at %.1f "
             "degrees elevation (%s)",
             out->irradiance / out->rest, lux, asin(out->direction[1]) / DEGREE, by);
}

enum err restore_sun(float *rgb, uint32_t width, uint32_t height, const struct restore_desc *desc, struct restored *out,
                     struct reason *why)
{
    const struct spot_area a = { .rgb = rgb, .width = width, .height = height, .rows = height / 2 };
    struct spot s;
    struct fit f = { .turbidity = 3.0 };
    struct sky_state sky;

    *out = (struct restored){ .kind = RESTORE_NONE };
    if (desc->lux > 0.0 && !(desc->units > 0.0))
        return err_say(why, ERR_USAGE, "sun: %g lx need the image's units, which are unknown", desc->lux);
    const float most = brightest(&a);
    enum err result = most > 0.0f ? spot_find(&a, NEARLY * most, false, &s) : ERR_OK;
    if (result || !(most > 0.0f) || !is_clipped(&a, &s, most))
        return result;
    memcpy(out->direction, s.w, sizeof(s.w));
    out->spot_radius = s.radius;
    out->rest = irradiance(&a, NULL, 0.0);
    if (!(desc->lux > 0.0)) {
        result = fit_sky(&a, out->direction, desc->units, &f);
        if (result) {
            *out = (struct restored){ .kind = RESTORE_NONE };
            return result;
        }
        out->turbidity = f.turbidity;
        out->scale = exp(f.log_scale);
        out->agreement = f.share;
    }
    model(out->direction, f.turbidity, &sky);
    out->irradiance = missing(&a, desc, &sky, fabsf(most - HALF_MAX) < 1e-3f * HALF_MAX, out);
    if (out->kind != RESTORE_ADDED)
        return ERR_OK;
    if (desc->units > 0.0)
        out->lux = out->irradiance * LUMINOUS_EFFICACY / desc->units;
    add_disc(&a, rgb, &sky, out->irradiance);
    describe(desc, out);
    return ERR_OK;
}
