#include "sky/tables/samples.h"

#include "base/mem.h"
#include "sky/tables/invert.h"
#include "sky/tables/layout.h"
#include "sky/tables/resample.h"

#include <assert.h>
#include <math.h>

/* At 16384 x 8192 texels, rounding to float moves a position by at most 4e-3 of a texel. */
#define MARGIN 0x1p-6

/* The minimum sine of a sampled theta, which keeps the density finite at the poles. */
#define MIN_SINE 1e-12

/* Radiance and luminance of a texel, for tables and densities alike. */
static double load(const struct latlong *t, uint32_t row, uint32_t column, float rgb[3])
{
    const float *s = t->environment->image.rgb + 3 * ((size_t)row * t->width + column);

    for (int c = 0; c < 3; c++)
        rgb[c] = t->gain * s[c];
    return rgb_luminance(rgb[0], rgb[1], rgb[2]);
}

static void build_row(struct latlong *t, uint32_t row)
{
    double *cdf = t->cdf + (size_t)row * t->width, sum = 0.0;
    float rgb[3];

    /* cos a - cos b as a product, which is accurate for thin rows. */
    t->row_angle[row] = 4.0 * PI / t->width * sin(PI * (row + 0.5) / t->height) * sin(0.5 * PI / t->height);
    for (uint32_t j = 0; j < t->width; j++) {
        sum += load(t, row, j, rgb) * t->row_angle[row];
        cdf[j] = sum;
    }
}

static enum err reserve(struct latlong *t, uint32_t width, uint32_t height)
{
    if (t->width == width && t->height == height)
        return ERR_OK;
    latlong_finish(t);
    t->cdf = mem_alloc((size_t)width * height, sizeof(*t->cdf));
    t->marginal = mem_alloc(height, sizeof(*t->marginal));
    t->row_angle = mem_alloc(height, sizeof(*t->row_angle));
    if (!t->cdf || !t->marginal || !t->row_angle)
        return ERR_NOMEM;
    t->width = width;
    t->height = height;
    return ERR_OK;
}

enum err latlong_build(struct latlong *t, const struct environment *e, struct reason *why)
{
    const uint32_t width = e->image.width, height = e->image.height;

    assert(e->ready);
    const enum layout layout = e->resampler->table->key.layout;
    if (!environment_is_latlong(e))
        return err_say(why, ERR_UNSUPPORTED,
                       "%s: the layout is %s; lat-long sampling requires latlong or latlong-bottom", e->name,
                       layout_name(layout));
    if (reserve(t, width, height))
        return err_say(why, ERR_NOMEM, "%s: out of memory for the tables of %ux%u texels", e->name, width, height);
    t->environment = e;
    t->bottom_first = layout == LAYOUT_LATLONG_BOTTOM_FIRST;
    t->gain = e->gain;
    t->rotation[0] = cos(e->resampler->table->key.rotation);
    t->rotation[1] = sin(e->resampler->table->key.rotation);
#pragma omp parallel for schedule(static)
    for (uint32_t row = 0; row < height; row++)
        build_row(t, row);
    t->total = 0.0;
    for (uint32_t row = 0; row < height; row++)
        t->marginal[row] = t->total += t->cdf[(size_t)row * width + width - 1];
    return ERR_OK;
}

void latlong_finish(struct latlong *t)
{
    mem_free(t->cdf);
    mem_free(t->marginal);
    mem_free(t->row_angle);
    *t = (struct latlong){ 0 };
}

/* Row and column of the texel that contains a world direction. */
static void find_texel(const struct latlong *t, const float w[3], uint32_t at[2])
{
    const double c = t->rotation[0], s = t->rotation[1];
    const double own[3] = { c * w[0] - s * w[2], w[1], c * w[2] + s * w[0] };
    struct layout_place place;

    (void)layout_find(t->bottom_first ? LAYOUT_LATLONG_BOTTOM_FIRST : LAYOUT_LATLONG, t->width, t->height, own, &place);
    at[0] = (uint32_t)fmax(0.0, place.y);
    at[1] = (uint32_t)fmax(0.0, place.x);
    at[0] = at[0] < t->height ? at[0] : t->height - 1;
    at[1] = at[1] < t->width ? at[1] : 0; /* the azimuth wraps around */
}

/* World direction from the azimuth of `column` (in texels, from the left) and the cosine and sine of the angle to +Y.
 */
static void direct(const struct latlong *t, double cosine, double sine, double column, float w[3])
{
    const double phi = PI - 2.0 * PI * column / t->width, x = sine * sin(phi), z = sine * cos(phi);
    const double c = t->rotation[0], s = t->rotation[1];

    w[0] = (float)(c * x + s * z);
    w[1] = (float)cosine;
    w[2] = (float)(c * z - s * x);
}

static double hold(double within)
{
    return fmin(fmax(within, MARGIN), 1.0 - MARGIN);
}

/* Direction of a position within a texel: `down` (0 at the upper border as stored) is uniform in theta or in solid
 * angle, that is, in cos theta. Kept off the border where rounding to float would cross it. */
static void direct_within(const struct latlong *t, const uint32_t at[2], double down, double along, bool in_solid_angle,
                          float w[3])
{
    const double to_top = t->bottom_first ? t->height - at[0] : at[0], step = t->bottom_first ? -1.0 : 1.0;
    uint32_t got[2];

    for (int attempt = 0; attempt < 2; attempt++) {
        const double a = PI * to_top / t->height, b = PI * (to_top + step) / t->height;
        double theta = a + (b - a) * down;
        if (in_solid_angle) { /* cos theta = cos a - down (cos a - cos b), from sin^2 (theta / 2), which is exact at the
                                 poles */
            const double sa = sin(0.5 * a), sb = sin(0.5 * b), half = sa * sa + (sb * sb - sa * sa) * down;
            theta = 2.0 * atan2(sqrt(half), sqrt(fmax(0.0, 1.0 - half)));
        }
        direct(t, cos(theta), sin(theta), at[1] + along, w);
        find_texel(t, w, got);
        if (got[0] == at[0] && got[1] == at[1])
            return;
        down = hold(down);
        along = hold(along);
    }
}

static double evaluate(const struct latlong *t, const float w[3], float rgb[3], uint32_t *row)
{
    uint32_t at[2];

    find_texel(t, w, at);
    *row = at[0];
    const double luminance = load(t, at[0], at[1], rgb);
    return t->total > 0.0 ? luminance * t->row_angle[at[0]] / t->total : 0.0;
}

void latlong_evaluate_rows(const struct latlong *t, const float w[3], float rgb[3], float *pdf)
{
    const double sine = sqrt((double)w[0] * w[0] + (double)w[2] * w[2]);
    uint32_t row;

    const double p = evaluate(t, w, rgb, &row);
    *pdf = (float)(p * t->width * t->height / (2.0 * PI * PI * fmax(sine, MIN_SINE)));
}

void latlong_evaluate(const struct latlong *t, const float w[3], float rgb[3], float *pdf)
{
    uint32_t row;

    const double p = evaluate(t, w, rgb, &row);
    *pdf = (float)(p / t->row_angle[row]);
}

void latlong_sample_rows(const struct latlong *t, const double x[2], float w[3], float rgb[3], float *pdf)
{
    const double place = invert(t->marginal, t->height, x[0]);
    const uint32_t row = (uint32_t)place;
    const double *cdf = t->cdf + (size_t)row * t->width;
    const double column = invert(cdf, t->width, place - row);
    const uint32_t at[2] = { row, (uint32_t)column };

    direct_within(t, at, x[1], column - at[1], false, w);
    latlong_evaluate_rows(t, w, rgb, pdf);
}

void latlong_sample(const struct latlong *t, const double x[2], float w[3], float rgb[3], float *pdf)
{
    const double place = invert(t->marginal, t->height, x[0]);
    const uint32_t row = (uint32_t)place;
    const double column = invert(t->cdf + (size_t)row * t->width, t->width, x[1]);
    const uint32_t at[2] = { row, (uint32_t)column };

    direct_within(t, at, place - row, column - at[1], true, w);
    latlong_evaluate(t, w, rgb, pdf);
}
