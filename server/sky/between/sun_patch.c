#include "sky/between/sun_patch.h"

#include "base/luminance.h"
#include "base/mem.h"
#include "base/vec.h"
#include "sky/between/latlong.h"
#include "sky/daylight/sky.h"

#include <math.h>
#include <string.h>

/* ROWS_LEAST: in a smaller image a texel is wider than any sun and what surrounds it. REACH: a camera's glare is above
 * the level up to here; what is wider is a bright cloud. FAINT: of the sky's energy, as in sky/tables/sky_split.c.
 * LOOKS: texels along a side by which the level is found: it need not be exact. ROUNDS: of fit_disc. WIDER: light whose
 * mean square distance exceeds the disc's by this is not the sun's disc alone. */
#define LEVEL 16.0
#define ROWS_LEAST 16
#define REACH (3.0 * PI / 180.0)
#define FAINT 1e-3
#define LOOKS 256
#define ROUNDS 6
#define WIDER 1.5

struct view {
    float *rgb;
    uint32_t width, height;
};

/* The level c = LEVEL x mean of min(L, c) over the sphere: from above, each step lowers it, and eight bring it within
 * some per cent. The mean itself, too. ERR_NOMEM. */
static enum err find_level(const struct view *v, double *level, double *mean)
{
    const uint32_t wide = v->width > LOOKS ? v->width / LOOKS : 1, step = wide < v->height ? wide : v->height,
                   columns = v->width / step, rows = v->height / step;
    float *looks = mem_alloc((size_t)columns * rows, sizeof(*looks));
    float most = INFINITY;

    if (!looks)
        return ERR_NOMEM;
    for (uint32_t j = 0; j < rows; j++)
        for (uint32_t i = 0; i < columns; i++) {
            const float *t = v->rgb + 3 * ((size_t)(j * step + step / 2) * v->width + i * step + step / 2);
            looks[j * columns + i] = rgb_luminance(t[0], t[1], t[2]);
        }
    for (int k = 0; k < 9; k++) {
        double sum = 0.0, whole = 0.0;
        for (uint32_t j = 0; j < rows; j++) {
            const double size = sin(PI * (j + 0.5) / rows);
            float row = 0.0f;
            for (uint32_t i = 0; i < columns; i++)
                row += looks[j * columns + i] < most ? looks[j * columns + i] : most;
            sum += (double)row * size;
            whole += size * columns;
        }
        *mean = k == 0 ? sum / whole : *mean;
        most = (float)(LEVEL * sum / whole);
    }
    *level = (double)most;
    mem_free(looks);
    return ERR_OK;
}

/* The texels within `reach` of the centre, one after another. */
struct cap {
    const struct view *v;
    double centre[3], reach;
    uint32_t y, k; /* the next: its row, and which of the row's columns within reach */
};

/* The columns of row y that may be within reach: `count` from `first` on, which may lie left of 0. */
static void find_columns(const struct cap *c, uint32_t y, long *first, uint32_t *count)
{
    const double width = c->v->width, theta = acos(fmax(-1.0, fmin(1.0, c->centre[1])));
    const double here = PI * (y + 0.5) / c->v->height, least = fmin(sin(theta), sin(here));
    const double half = c->reach < 0.5 * PI && sin(c->reach) < least ? asin(sin(c->reach) / least) : PI;
    const double columns = ceil(half / PI * width) + 2.0;
    const double x = (PI - atan2(c->centre[0], c->centre[2])) / (2.0 * PI) * width;

    *count = columns < width ? (uint32_t)columns : c->v->width;
    *first = (long)floor(x - 0.5 * *count);
}

static bool next_texel(struct cap *c, uint32_t *at, double w[3], double *angle)
{
    const double step = PI / c->v->height, theta = acos(fmax(-1.0, fmin(1.0, c->centre[1])));
    const long width = (long)c->v->width;

    for (; c->y < c->v->height; c->y++, c->k = 0) {
        long first;
        uint32_t count;
        if (fabs(step * (c->y + 0.5) - theta) > c->reach)
            continue;
        find_columns(c, c->y, &first, &count);
        while (c->k < count) {
            const uint32_t x = (uint32_t)(((first + (long)c->k++) % width + width) % width);
            texel_direction(c->v->width, c->v->height, x + 0.5, c->y + 0.5, w);
            *angle = angle_between(w, c->centre);
            *at = c->y * c->v->width + x;
            if (*angle <= c->reach)
                return true;
        }
    }
    return false;
}

static void normalise(double w[3])
{
    const double length = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);

    for (int c = 0; c < 3 && length > 0.0; c++)
        w[c] /= length;
}

/* The middle of the texels above the level within REACH of `centre`, by their light, which it replaces, and how far
 * they are from it at most. */
static double find_middle(const struct view *v, double level, double centre[3])
{
    struct cap c = { .v = v, .centre = { centre[0], centre[1], centre[2] }, .reach = REACH };
    double sum[3] = { 0.0 }, w[3], angle, most = 0.0;
    uint32_t at;

    while (next_texel(&c, &at, w, &angle)) {
        const double above =
            (texel_luminance(v->rgb, at) - level) * texel_solid_angle(v->width, v->height, at / v->width);
        for (int k = 0; k < 3 && above > 0.0; k++)
            sum[k] += above * w[k];
    }
    normalise(sum);
    c = (struct cap){ .v = v, .centre = { sum[0], sum[1], sum[2] }, .reach = 1.5 * REACH };
    while (next_texel(&c, &at, w, &angle))
        most = texel_luminance(v->rgb, at) > level ? fmax(most, angle) : most;
    for (int k = 0; k < 3; k++)
        centre[k] = sum[k];
    return most;
}

/* The mean of what surrounds the sun. */
static void measure_ring(const struct view *v, const double centre[3], double inner, double outer, double level,
                         double ring[3])
{
    struct cap c = { .v = v, .centre = { centre[0], centre[1], centre[2] }, .reach = outer };
    double w[3], angle, sum[3] = { 0.0 }, count = 0.0;
    uint32_t at;

    while (next_texel(&c, &at, w, &angle)) {
        if (angle <= inner || texel_luminance(v->rgb, at) > level)
            continue;
        for (int k = 0; k < 3; k++)
            sum[k] += (double)v->rgb[3 * (size_t)at + (size_t)k];
        count += 1.0;
    }
    for (int k = 0; k < 3; k++)
        ring[k] = count > 0.0 ? sum[k] / count : 0.0;
}

static enum err keep_texel(struct sun_patch *p, uint32_t at, const float *rgb)
{
    if (p->count == p->capacity) {
        const uint32_t more = p->capacity ? 2 * p->capacity : 64;
        struct sun_texel *texels = mem_grow(p->texels, p->count, more, sizeof(*texels));
        if (!texels)
            return ERR_NOMEM;
        p->texels = texels;
        p->capacity = more;
    }
    p->texels[p->count++] = (struct sun_texel){ at, { rgb[0], rgb[1], rgb[2] } };
    return ERR_OK;
}

/* Adds a disc to rows first .. end - 1, of which v->rgb holds these alone. */
static void put_rows(const struct view *v, uint32_t first, uint32_t end, const double direction[3], double radius,
                     const double energy[3])
{
    const double size = 2.0 * PI * (1.0 - cos(radius));
    const struct sky_disc disc = {
        .theta = acos(fmax(-1.0, fmin(1.0, direction[1]))),
        .phi = atan2(direction[0], direction[2]),
        .radius = radius,
        .solid_angle = size,
        .radiance = { energy[0] / size, energy[1] / size, energy[2] / size },
        .width = v->width,
        .height = v->height,
        .first = first,
        .end = end,
    };

    sky_add_disc(&disc, v->rgb);
}

/* Moments of light over the texels that were kept: the middle, and the mean square distance from it. */
struct spread {
    double middle[3], square;
};

/* light: [p->count], radiance x sr. */
static void find_moments(const struct view *v, const struct sun_patch *p, const double *light, struct spread *out)
{
    double w[3], whole = 0.0, square = 0.0, sum[3] = { 0.0 };

    for (uint32_t i = 0; i < p->count; i++) {
        texel_direction(v->width, v->height, p->texels[i].at % v->width + 0.5, p->texels[i].at / v->width + 0.5, w);
        for (int k = 0; k < 3; k++)
            sum[k] += light[i] * w[k];
    }
    normalise(sum);
    for (uint32_t i = 0; i < p->count; i++) {
        texel_direction(v->width, v->height, p->texels[i].at % v->width + 0.5, p->texels[i].at / v->width + 0.5, w);
        const double angle = angle_between(w, sum);
        square += light[i] * angle * angle;
        whole += light[i];
    }
    for (int k = 0; k < 3; k++)
        out->middle[k] = sum[k];
    out->square = whole > 0.0 ? square / whole : 0.0;
}

/* What a disc of the sun's size at `direction` gives the kept texels. band: room for rows first .. end - 1. */
static void try_disc(const struct view *v, const struct sun_patch *p, const double direction[3], uint32_t first,
                     uint32_t end, float *band, double *light)
{
    const double one[3] = { 1.0, 1.0, 1.0 };
    const struct view rows = { band, v->width, v->height };

    memset(band, 0, 3 * (size_t)v->width * (end - first) * sizeof(*band));
    put_rows(&rows, first, end, direction, SUN_RADIUS, one);
    for (uint32_t i = 0; i < p->count; i++) {
        const uint32_t at = p->texels[i].at;
        light[i] =
            (double)band[3 * (size_t)(at - first * v->width)] * texel_solid_angle(v->width, v->height, at / v->width);
    }
}

/* Where the disc is. The middle of the light is that of its texels, and a disc that is smaller than a texel may lie
 * anywhere in it: so the disc is moved until the middle of the light that it would give is the one seen. A light that
 * is wider than that of the sun's disc is a disc of its own radius. taken: [p->count], radiance x sr. */
static enum err fit_disc(const struct view *v, const double *taken, struct sun_patch *p)
{
    const uint32_t first = p->texels[0].at / v->width, end = p->texels[p->count - 1].at / v->width + 1;
    float *band = mem_alloc((size_t)v->width * (end - first), 3 * sizeof(*band));
    double *light = mem_alloc(p->count, sizeof(*light));
    struct spread seen, tried = { .square = 0.0 };
    const double side = PI / v->height;

    find_moments(v, p, taken, &seen);
    for (int k = 0; k < 3; k++)
        p->direction[k] = seen.middle[k];
    for (int round = 0; round < ROUNDS && band && light; round++) {
        try_disc(v, p, p->direction, first, end, band, light);
        find_moments(v, p, light, &tried);
        for (int k = 0; k < 3 && round + 1 < ROUNDS; k++)
            p->direction[k] += seen.middle[k] - tried.middle[k];
        normalise(p->direction);
    }
    p->radius = SUN_RADIUS;
    if (seen.square > WIDER * tried.square) {
        p->radius = sqrt(2.0 * fmax(seen.square - side * side / 6.0, 0.5 * SUN_RADIUS * SUN_RADIUS));
        for (int k = 0; k < 3; k++)
            p->direction[k] = seen.middle[k];
    }
    const enum err e = band && light ? ERR_OK : ERR_NOMEM;
    mem_free(band);
    mem_free(light);
    return e;
}

/* What the texels within `reach` have above the ring: sets all but `found` and `others`. */
static enum err measure_sun(const struct view *v, const double centre[3], double reach, const double ring[3],
                            struct sun_patch *p)
{
    struct cap c = { .v = v, .centre = { centre[0], centre[1], centre[2] }, .reach = reach };
    double w[3], angle;
    uint32_t at;

    while (next_texel(&c, &at, w, &angle))
        if (keep_texel(p, at, v->rgb + 3 * (size_t)at))
            return ERR_NOMEM;
    double *taken = mem_alloc(p->count, sizeof(*taken));
    if (!taken)
        return ERR_NOMEM;
    for (uint32_t i = 0; i < p->count; i++) {
        const double size = texel_solid_angle(v->width, v->height, p->texels[i].at / v->width);
        double above[3];
        for (int k = 0; k < 3; k++) {
            above[k] = fmax(0.0, (double)p->texels[i].rgb[k] - ring[k]) * size;
            p->energy[k] += above[k];
        }
        taken[i] = (double)rgb_luminance((float)above[0], (float)above[1], (float)above[2]);
    }
    const enum err e = fit_disc(v, taken, p);
    mem_free(taken);
    return e;
}

/* The brightest texel, and the light above the level everywhere, radiance x sr. */
static uint32_t look_over(const struct view *v, double level, double *above)
{
    const float limit = (float)level;
    float most = -1.0f;
    uint32_t at = 0;

    *above = 0.0;
    for (uint32_t y = 0; y < v->height; y++) {
        double row = 0.0;
        for (uint32_t x = 0; x < v->width; x++) {
            const uint32_t k = y * v->width + x;
            const float *t = v->rgb + 3 * (size_t)k, g = rgb_luminance(t[0], t[1], t[2]);
            if (g <= limit)
                continue;
            row += (double)(g - limit);
            at = g > most ? k : at;
            most = g > most ? g : most;
        }
        *above += row * texel_solid_angle(v->width, v->height, y);
    }
    return at;
}

enum err sun_patch_take(float *rgb, uint32_t width, uint32_t height, struct sun_patch *out)
{
    const struct view v = { rgb, width, height };
    const double side = PI / height;
    double mean = 0.0, level, above, ring[3], centre[3];

    out->found = false;
    out->count = 0;
    out->others = 0.0;
    for (int k = 0; k < 3; k++)
        out->energy[k] = 0.0;
    if (height < ROWS_LEAST)
        return ERR_OK;
    if (find_level(&v, &level, &mean))
        return ERR_NOMEM;
    const uint32_t brightest = look_over(&v, level, &above);
    if (!(level > 0.0) || !(above > 0.0))
        return ERR_OK;
    texel_direction(width, height, brightest % width + 0.5, brightest / width + 0.5, centre);
    const double reach = find_middle(&v, level, centre) + 1.5 * side;
    if (reach > 1.4 * REACH + 1.5 * side)
        return ERR_OK;
    measure_ring(&v, centre, reach, reach + 3.0 * side, level, ring);
    if (measure_sun(&v, centre, reach, ring, out))
        return ERR_NOMEM;
    const double *e = out->energy;
    const double light = (double)rgb_luminance((float)e[0], (float)e[1], (float)e[2]);
    if (light < FAINT * 4.0 * PI * mean)
        return ERR_OK;
    for (uint32_t k = 0; k < out->count; k++)
        for (int c = 0; c < 3; c++)
            rgb[3 * (size_t)out->texels[k].at + (size_t)c] = fminf(out->texels[k].rgb[c], (float)ring[c]);
    out->others = fmax(0.0, above - light) / light;
    out->found = true;
    return ERR_OK;
}

void sun_patch_finish(struct sun_patch *p)
{
    mem_free(p->texels);
    *p = (struct sun_patch){ .found = false };
}

void sun_patch_restore(const struct sun_patch *p, float *rgb)
{
    for (uint32_t k = 0; k < p->count && p->found; k++)
        for (int c = 0; c < 3; c++)
            rgb[3 * (size_t)p->texels[k].at + (size_t)c] = p->texels[k].rgb[c];
}

void sun_put(float *rgb, uint32_t width, uint32_t height, const double direction[3], double radius,
             const double energy[3])
{
    const struct view v = { rgb, width, height };

    put_rows(&v, 0, height, direction, radius, energy);
}

void sun_way(const struct sun_mark *marks, uint32_t count, double seconds, double direction[3])
{
    double sum[3] = { 0.0 };

    for (uint32_t i = 0; i < count; i++) {
        double weight = 1.0; /* Lagrange's */
        for (uint32_t k = 0; k < count; k++)
            weight *= k == i ? 1.0 : (seconds - marks[k].seconds) / (marks[i].seconds - marks[k].seconds);
        for (int c = 0; c < 3; c++)
            sum[c] += weight * marks[i].direction[c];
    }
    normalise(sum);
    for (int c = 0; c < 3; c++)
        direction[c] = sum[c];
}
