#include "sky/daylight/sky.h"

#include "base/luminance.h"
#include "base/vec.h"
#include "sky/daylight/reinhart.h"
#include "sky/daylight/sun.h"

#include <assert.h>
#include <math.h>

/* The indicatrix over the sine of half the angle to the sun, with linear interpolation. */
#define STEPS 4096

struct dome {
    struct sky_pattern pattern;
    bool uniform; /* twilight: no pattern is known for a sun below the horizon */
    double theta, phi;
    uint32_t width, height;
    float table[STEPS + 2];
};

static void fill_table(struct dome *dome)
{
    for (int i = 0; i <= STEPS; i++)
        dome->table[i] =
            dome->uniform ? 1.0f : (float)pattern_indicatrix(&dome->pattern, 2.0 * asin((double)i / STEPS));
    dome->table[STEPS + 1] = dome->table[STEPS];
}

/* The relative luminance of a row's texels. Returns their sum. */
static double fill_row(const struct dome *dome, uint32_t y, float *rgb)
{
    const double theta = PI * (y + 0.5) / dome->height, apart = sin(0.5 * (theta - dome->theta));
    const double across = sin(theta) * sin(dome->theta);
    const float gradation = dome->uniform ? 1.0f : (float)pattern_gradation(&dome->pattern, cos(theta));
    double sum = 0.0;

    for (uint32_t x = 0; x < dome->width; x++) {
        const double h = sin(0.5 * (PI - 2.0 * PI * (x + 0.5) / dome->width - dome->phi));
        const double place = sqrt(fmin(1.0, apart * apart + across * h * h)) * STEPS; /* the haversine formula */
        const int step = (int)place;
        const float part = (float)(place - step);
        const float v = gradation * (dome->table[step] + part * (dome->table[step + 1] - dome->table[step]));
        rgb[3 * (size_t)x] = v;
        sum += v;
    }
    return sum;
}

/* The dome, scaled to a horizontal irradiance; the integral of the cosine over a texel is a closed form. */
static void render_dome(struct dome *dome, double irradiance, float *rgb)
{
    const uint32_t width = dome->width, rows = dome->height / 2;
    double sums[SKY_SIDE_MAX / 4], total = 0.0;

#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < rows; y++)
        sums[y] = fill_row(dome, y, rgb + 3 * (size_t)y * width);
    for (uint32_t y = 0; y < rows; y++) {
        const double top = sin(PI * y / dome->height), bottom = sin(PI * (y + 1.0) / dome->height);
        total += sums[y] * PI / width * (bottom * bottom - top * top);
    }
    if (!(total > 0.0 && total < 1e12) && !dome->uniform) { /* the formula left nothing */
        dome->uniform = true;
        fill_table(dome);
        render_dome(dome, irradiance, rgb);
        return;
    }
    const float gain = total > 0.0 ? (float)(irradiance / total) : 0.0f;
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < rows; y++)
        for (size_t i = (size_t)y * width; i < (size_t)(y + 1) * width; i++)
            rgb[3 * i] = rgb[3 * i + 1] = rgb[3 * i + 2] = gain * rgb[3 * i];
}

/* A lower sun would half sink into the texels of the horizon. It stands here instead, with the same light on the ground
 * and less on walls: some 100 lx, for a few minutes. */
#define LOWEST_SUN (1.5 * PI / 180.0)

/* Horizontal irradiance from the rows of texels around an elevation, by closed forms. */
static double rows_irradiance(const struct daylight *d, double elevation, const float *rgb)
{
    const double middle = (0.5 * PI - elevation) / PI * d->height, reach = 2.0 + SUN_RADIUS / PI * d->height;
    const uint32_t first = middle > reach ? (uint32_t)(middle - reach) : 0;
    double total = 0.0;

    for (uint32_t y = first; y < d->height / 2 && y < middle + reach; y++) {
        const double top = sin(PI * y / d->height), bottom = sin(PI * (y + 1.0) / d->height);
        double sum = 0.0;
        for (uint32_t x = 0; x < d->width; x++)
            sum += (double)rgb[3 * ((size_t)y * d->width + x)];
        total += sum * PI / d->width * (bottom * bottom - top * top);
    }
    return total;
}

/* The sun's disc, whose light on the ground is the file's, although a texel's is that of its middle height: of a low
 * sun that would be some per cent more or less. */
static void render_sun(const struct daylight *d, const struct moment *m, const double w[3], float *rgb)
{
    const double solid_angle = 2.0 * PI * (1.0 - cos(SUN_RADIUS)), elevation = fmax(m->altitude, LOWEST_SUN);
    const double want = d->scale * m->direct_normal_lux * sin(m->altitude) / LUMINOUS_EFFICACY;
    const struct sky_desc size = { .width = d->width, .height = d->height };
    struct sky_state sun = { .sun_elevation = elevation,
                             .sun_direction = { w[0], w[1], w[2] },
                             .sun_solid_angle = solid_angle,
                             .sun_visible = 1.0 };
    double radiance = want / (sin(elevation) * solid_angle);

    if (!d->sun || !(radiance > 0.0))
        return;
    const double before = rows_irradiance(d, elevation, rgb);
    for (int k = 0; k < 2; k++) {
        for (int c = 0; c < 3; c++)
            sun.sun_radiance[c] = radiance;
        sky_add_sun(&size, &sun, rgb);
        const double have = rows_irradiance(d, elevation, rgb) - before;
        radiance = have > 0.0 ? radiance * (want / have - 1.0) : 0.0;
        if (k == 0 && !(fabs(radiance) > 0.0))
            return;
    }
}

void daylight_render(const struct daylight *d, const struct moment *m, float *rgb)
{
    struct dome dome = { .width = d->width, .height = d->height };
    double w[3];

    if (d->matrix.mf) {
        reinhart_sky(d->matrix.mf, (const float(*)[3])d->matrix.radiance + m->number * d->matrix.patches, rgb);
        for (size_t i = 0; d->scale != 1.0 && i < (size_t)3 * d->width * d->height; i++)
            rgb[i] *= (float)d->scale;
        daylight_sun(d, m, w);
        render_sun(d, m, w, rgb);
        return;
    }
    assert(d->width == 2 * d->height && d->height % 2 == 0 && d->width <= SKY_SIDE_MAX);
    daylight_sun(d, m, w);
    dome.theta = 0.5 * PI - fmax(m->altitude, 0.0);
    dome.phi = atan2(w[0], w[2]);
    dome.uniform = !d->cie && m->altitude <= 0.0;
    if (d->cie)
        cie_pattern(d->cie, &dome.pattern);
    else
        perez_pattern(dome.theta, m->clearness, m->brightness, &dome.pattern);
    fill_table(&dome);
    render_dome(&dome, d->sky ? d->scale * m->diffuse_lux / LUMINOUS_EFFICACY : 0.0, rgb);
    const float ground =
        (float)(d->ground_albedo * d->scale * moment_open_lux(m, d->sun, d->sky) / (LUMINOUS_EFFICACY * PI));
    for (size_t i = (size_t)d->height / 2 * d->width * 3; i < (size_t)d->height * d->width * 3; i++)
        rgb[i] = ground;
    render_sun(d, m, w, rgb);
}
