#include "sky/daylight/sky.h"

#include "base/vec.h"

#include <assert.h>
#include <math.h>

/* ---- Sky ---- */

/* The indicatrix depends only on the angle to the sun: four tables over the sine of half that angle, with linear
 * interpolation in 2048 steps. The error is below 1e-5, or 1e-3 within some degrees of the antisolar point, where the
 * formula has a cusp that real skies do not have. */
#define STEPS 2048

struct angle_entry {
    float value[4], slope[4]; /* luminance, x and y, and the kept warmth; 32 bytes, within one cache line */
};

static void fill_table(const struct sky_dome *dome, struct angle_entry table[STEPS + 1])
{
    double next[4] = { 0.0 }, here[4];

    for (int i = STEPS; i >= 0; i--) {
        const double angle = 2.0 * asin((double)i / STEPS), c = cos(angle);
        for (int k = 0; k < 3; k++) {
            const double *p = dome->perez[k];
            here[k] = dome->gain[k] * (1.0 + p[2] * exp(p[3] * angle) + p[4] * c * c);
        }
        here[3] = sky_warmth_kept(angle);
        for (int k = 0; k < 4; k++) {
            table[i].value[k] = (float)here[k];
            table[i].slope[k] = i < STEPS ? (float)(next[k] - here[k]) : 0.0f;
            next[k] = here[k];
        }
    }
}

/* Terms common to a row. */
struct sky_row {
    float across[2];    /* sin^2 of half the angle to the sun = [0] + [1] sin^2 of half the azimuth difference */
    float gradation[3]; /* luminance, x and y */
    float twilight[2];  /* added to x and y */
    float night[3];
};

static void fill_row(const struct sky_state *s, double theta, struct sky_row *row)
{
    const struct sky_dome *dome = &s->dome;
    const double sun_theta = 0.5 * PI - s->sun_elevation, up = cos(theta) > 1e-6 ? cos(theta) : 1e-6;
    const double apart = sin(0.5 * (theta - sun_theta)), blue = sky_twilight_weight(dome, up);

    row->across[0] = (float)(apart * apart); /* the haversine formula, accurate near the sun */
    row->across[1] = (float)(sin(theta) * sin(sun_theta));
    for (int k = 0; k < 3; k++) {
        const double keep = k == 0 ? 1.0 : 1.0 - blue;
        row->gradation[k] = (float)(keep * (1.0 + dome->perez[k][0] * exp(dome->perez[k][1] / up)));
        row->night[k] = (float)(dome->night[k] * (1.0 + dome->perez[0][0] * exp(dome->perez[0][1] / up)));
    }
    row->twilight[0] = (float)(blue * SKY_TWILIGHT_X);
    row->twilight[1] = (float)(blue * SKY_TWILIGHT_Y);
}

#define TOGETHER 16 /* texels, in loops that the compiler vectorises: without fminf and fmaxf, which are calls */

static inline float least_of(float a, float b)
{
    return a < b ? a : b;
}

static inline float most_of(float a, float b)
{
    return a > b ? a : b;
}

/* The tables' luminance, x, y and kept warmth at `count` columns. */
static void look_up(const struct sky_row *row, const struct angle_entry table[STEPS + 1], const float *half_sine,
                    uint32_t count, float out[4][TOGETHER])
{
    for (uint32_t i = 0; i < count; i++) {
        const float across = row->across[0] + row->across[1] * half_sine[i];
        const float place = sqrtf(across < 1.0f ? across : 1.0f) * STEPS;
        const int step = (int)place;
        const float part = place - (float)step;
        const struct angle_entry *t = &table[step];
        for (int k = 0; k < 4; k++)
            out[k][i] = t->value[k] + part * t->slope[k];
    }
}

/* sky_radiance of TOGETHER texels, in float, from what look_up wrote. */
static void colour(const struct sky_row *row, const float fit[4][TOGETHER], float out[3][TOGETHER])
{
    for (int i = 0; i < TOGETHER; i++) {
        const float luminance = row->gradation[0] * fit[0][i];
        const float x_fit = row->gradation[1] * fit[1][i] + row->twilight[0];
        const float warm = most_of(x_fit - (float)SKY_WHITE_X, 0.0f);
        const float x = x_fit - warm + warm * fit[3][i];
        const float y_fit = row->gradation[2] * fit[2][i] + row->twilight[1];
        const float locus = (-3.0f * x + 2.870f) * x - 0.275f; /* sky_locus */
        const float y = least_of(most_of(y_fit, locus - (float)SKY_LOCUS_BELOW), locus + (float)SKY_LOCUS_ABOVE);
        const float sum = luminance / y, cx = x * sum, cz = sum - cx - luminance;
        const float r = 3.2404542f * cx - 1.5371385f * luminance - 0.4985314f * cz; /* sky_rgb_from_xyy */
        const float g = -0.9692660f * cx + 1.8760108f * luminance + 0.0415560f * cz;
        const float b = 0.0556434f * cx - 0.2040259f * luminance + 1.0572252f * cz;
        const float below = least_of(least_of(least_of(r, g), b), 0.0f);
        const float keep = luminance / (luminance - below);
        out[0][i] = most_of(luminance + (below < 0.0f ? keep : 1.0f) * (r - luminance), 0.0f) + row->night[0];
        out[1][i] = most_of(luminance + (below < 0.0f ? keep : 1.0f) * (g - luminance), 0.0f) + row->night[1];
        out[2][i] = most_of(luminance + (below < 0.0f ? keep : 1.0f) * (b - luminance), 0.0f) + row->night[2];
    }
}

/* half_sine: of the columns, as in sky_row. */
static void render_row(const struct sky_row *row, const struct angle_entry table[STEPS + 1], const float *half_sine,
                       uint32_t width, float *rgb)
{
    float fit[4][TOGETHER] = { { 0.0f } }, out[3][TOGETHER];

    for (uint32_t first = 0; first < width; first += TOGETHER) {
        const uint32_t count = width - first < TOGETHER ? width - first : TOGETHER;
        look_up(row, table, half_sine + first, count, fit);
        colour(row, (const float(*)[TOGETHER])fit, out);
        for (uint32_t i = 0; i < count; i++)
            for (int c = 0; c < 3; c++)
                rgb[3 * (size_t)(first + i) + (size_t)c] = out[c][i];
    }
}

static void render_dome(const struct sky_desc *d, const struct sky_state *s, float *rgb)
{
    struct angle_entry table[STEPS + 1];
    float half_sine[SKY_SIDE_MAX];
    const double sun_phi = atan2(s->sun_direction[0], s->sun_direction[2]);
    const uint32_t width = d->width;

    assert(width == 2 * d->height && d->height % 2 == 0 && width <= SKY_SIDE_MAX);
    fill_table(&s->dome, table);
    for (uint32_t i = 0; i < width; i++) {
        /* The azimuth phi of the centre of column i, where w = (sin theta sin phi, cos theta, sin theta cos phi). */
        const double h = sin(0.5 * ((PI - 2.0 * PI * (i + 0.5) / width) - sun_phi));
        half_sine[i] = (float)(h * h);
    }
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < d->height / 2; y++) {
        struct sky_row row;
        fill_row(s, PI * (y + 0.5) / d->height, &row);
        render_row(&row, table, half_sine, width, rgb + (size_t)3 * y * width);
    }
    const float ground[3] = { (float)s->dome.ground[0], (float)s->dome.ground[1], (float)s->dome.ground[2] };
    for (size_t i = (size_t)d->height / 2 * width; i < (size_t)d->height * width; i++)
        for (int c = 0; c < 3; c++)
            rgb[3 * i + c] = ground[c];
}

/* ---- Sun ---- */

/* Half extent in azimuth of the disc on the circle of zenith angle z; 0 outside the disc, pi where the whole circle is
 * inside (the disc contains a pole). */
static double half_width(double radius, double sun_theta, double z)
{
    const double across = sin(z) * sin(sun_theta), rise = cos(radius) - cos(z) * cos(sun_theta);

    if (rise >= across)
        return 0.0;
    return rise <= -across ? PI : acos(rise / across);
}

/* Length of the intersection of lo..hi and a..b. */
static double overlap(double lo, double hi, double a, double b)
{
    const double from = lo > a ? lo : a, to = hi < b ? hi : b;
    return to > from ? to - from : 0.0;
}

/* The texels that the disc may touch. Each row is integrated in slices uniform in t, where zenith angle z = centre -
 * radius cos t, so that the integrand is smooth at the rim. */
#define SLICES 32

struct sun_grid {
    double theta, phi, radius; /* of the disc */
    uint32_t width, height;
    uint32_t row_begin, row_end;
    long column;      /* the first column, modulo the width */
    uint32_t columns; /* at most width + 1: the last may equal the first */
};

static void find_grid(const struct sky_disc *d, struct sun_grid *g)
{
    const double r = d->radius, texel = 2.0 * PI / d->width;

    g->theta = d->theta;
    g->phi = d->phi;
    g->radius = r;
    g->width = d->width;
    g->height = d->height;
    const double begin = (g->theta - r) / PI * d->height, end = (g->theta + r) / PI * d->height + 1.0;
    g->row_begin = begin > d->first ? (uint32_t)begin : d->first;
    g->row_end = end < d->end ? (uint32_t)end : d->end;
    const bool pole = g->theta <= r || PI - g->theta <= r;
    const double half = pole ? PI : asin(sin(r) / sin(g->theta)); /* the disc's maximum extent in azimuth */
    const double columns = ceil(2.0 * half / texel) + 1.0;
    g->column = (long)floor((PI - g->phi - half) / texel);
    g->columns = columns < d->width + 1.0 ? (uint32_t)columns : d->width + 1;
}

/* Adds gain (three channels) times the solid angle of the disc within each texel of a row, exact in azimuth and by
 * Simpson's rule across rows. Returns the sum without gain. rgb NULL: only the sum. */
static double cover_row(const struct sun_grid *g, uint32_t y, const double gain[3], float *rgb)
{
    const double r = g->radius, texel = 2.0 * PI / g->width;
    const double cos_from = (g->theta - PI * y / g->height) / r, cos_to = (g->theta - PI * (y + 1.0) / g->height) / r;
    const double from = cos_from >= 1.0 ? 0.0 : acos(fmax(cos_from, -1.0));
    const double to = cos_to <= -1.0 ? PI : acos(fmin(cos_to, 1.0));
    double half[SLICES + 1], weight[SLICES + 1], sum = 0.0;

    for (int i = 0; i <= SLICES; i++) {
        const double t = from + (to - from) * i / SLICES, z = fabs(g->theta - r * cos(t));
        const double simpson = (i == 0 || i == SLICES ? 1.0 : i % 2 ? 4.0 : 2.0) * (to - from) / (3.0 * SLICES);
        half[i] = half_width(r, g->theta, z);
        weight[i] = simpson * sin(z) * r * sin(t);
    }
    for (uint32_t k = 0; k < g->columns; k++) {
        /* Azimuth from the disc's centre, increasing to the right, as phi decreases. */
        const long column = g->column + (long)k, width = (long)g->width;
        const double left = (double)column * texel - (PI - g->phi);
        double share = 0.0;
        for (int i = 0; i <= SLICES; i++)
            share += weight[i] * overlap(left, left + texel, -half[i], half[i]);
        sum += share;
        if (rgb)
            for (int c = 0; c < 3; c++)
                rgb[3 * ((column % width + width) % width) + c] += (float)(gain[c] * share);
    }
    return sum;
}

void sky_add_disc(const struct sky_disc *d, float *rgb)
{
    struct sun_grid g;
    double sum = 0.0;

    find_grid(d, &g);
    for (uint32_t y = g.row_begin; y < g.row_end; y++)
        sum += cover_row(&g, y, NULL, NULL);
    if (sum <= 0.0)
        return;
    /* Rescale to correct the quadrature error of about 1e-4. */
    const double right = d->solid_angle / sum;
    for (uint32_t y = g.row_begin; y < g.row_end; y++) {
        const double top = cos(PI * y / g.height), bottom = cos(PI * (y + 1.0) / g.height);
        const double per_texel = right * g.width / (2.0 * PI * (top - bottom));
        const double gain[3] = { per_texel * d->radiance[0], per_texel * d->radiance[1], per_texel * d->radiance[2] };
        cover_row(&g, y, gain, rgb + (size_t)3 * (y - d->first) * g.width);
    }
}

void sky_add_sun(const struct sky_desc *d, const struct sky_state *s, float *rgb)
{
    const struct sky_disc disc = {
        .theta = 0.5 * PI - s->sun_elevation,
        .phi = atan2(s->sun_direction[0], s->sun_direction[2]),
        .radius = SKY_SUN_RADIUS,
        .solid_angle = s->sun_visible * s->sun_solid_angle,
        .radiance = { s->sun_radiance[0], s->sun_radiance[1], s->sun_radiance[2] },
        .width = d->width,
        .height = d->height,
        .end = d->height / 2,
    };

    if (s->sun_visible > 0.0)
        sky_add_disc(&disc, rgb);
}

void sky_render(const struct sky_desc *d, const struct sky_state *s, float *rgb)
{
    render_dome(d, s, rgb);
    sky_add_sun(d, s, rgb);
}
