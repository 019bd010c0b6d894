/* What the tests of the samplers share: skies where samplers fail, and a chi-square sum over many bins. */
#pragma once

#include "support/skies.h"

/* Probability that a chi-square variable with k degrees of freedom exceeds x [Wilson and Hilferty 1931]: good to a few
 * per cent for k > 10, which is enough to tell 0.5 from 1e-6. */
static inline double chi_square_tail(double x, double k)
{
    const double z = (cbrt(x / k) - (1.0 - 2.0 / (9.0 * k))) / sqrt(2.0 / (9.0 * k));
    return 0.5 * erfc(z / sqrt(2.0));
}

/* Bins come one after another; those that expect less than 5 are merged with their followers, what is left over at the
 * end of a histogram with the bin before. A bin that expects nothing must get nothing. */
struct chi_square {
    double sum, degrees;
    double want, got, last_want, last_got; /* of the open bin, and of the one before it, not yet counted */
};

static inline void chi_square_close(struct chi_square *c)
{
    if (c->last_want > 0.0) {
        c->sum += (c->last_got - c->last_want) * (c->last_got - c->last_want) / c->last_want;
        c->degrees += 1.0;
    }
    c->last_want = c->want;
    c->last_got = c->got;
    c->want = c->got = 0.0;
}

static inline void chi_square_bin(struct chi_square *c, double want, double got)
{
    assert_true(want > 0.0 || got == 0.0);
    c->want += want;
    c->got += got;
    if (c->want >= 5.0)
        chi_square_close(c);
}

/* Ends one histogram, whose total is given: it has one degree less than bins. */
static inline void chi_square_end(struct chi_square *c)
{
    c->last_want += c->want;
    c->last_got += c->got;
    c->want = c->got = 0.0;
    if (c->last_want > 0.0) {
        chi_square_close(c);
        c->degrees -= 1.0;
    }
    c->last_want = c->last_got = 0.0;
}

enum {
    SKY_OVERCAST,
    SKY_SUN,        /* of 1e6 */
    SKY_SUN_TURNED, /* an odd size, the same sun, turned */
    SKY_BLACK_ROWS,
    SKY_SEAM,     /* a single lit texel, where left and right border meet */
    SKY_POLE,     /* a single lit texel, at +Y */
    SKY_NADIR,    /* a single lit texel in the last corner, turned by less than a texel */
    SKY_ONE,      /* 1 x 1 */
    SKY_SEVEN,    /* 7 x 5, coloured noise */
    SKY_TWO,      /* 2 x 1 */
    SKY_UPSIDE,   /* 12 x 6, bottom first, coloured noise with black texels */
    SKY_BLUE,     /* of which luminance sees little */
    SKY_CONTRAST, /* texels of 1e-6 to 1e6 side by side */
    SKY_BLACK,
    SKY_COUNT
};

static inline struct frame sky_noise(uint32_t width, uint32_t height, uint64_t seed, double octaves, double black)
{
    struct frame f = sky_constant(width, height, 0.0f);
    struct rng r = { seed };

    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const double l = rng_next(&r) < black ? 0.0 : exp2(octaves * (rng_next(&r) - 0.5));
            float c[3];
            for (int k = 0; k < 3; k++)
                c[k] = (float)(l * rng_next(&r));
            sky_paint(&f, x, y, c[0], c[1], c[2]);
        }
    return f;
}

struct sky_shape {
    uint32_t width, height, n;
    double rotation_degrees;
    enum layout layout;
};

static const struct sky_shape sky_shapes[SKY_COUNT] = {
    [SKY_OVERCAST] = { 64, 32, 16, 0.0, LAYOUT_LATLONG },
    [SKY_SUN] = { 128, 64, 32, 0.0, LAYOUT_LATLONG },
    [SKY_SUN_TURNED] = { 97, 49, 24, 33.0, LAYOUT_LATLONG },
    [SKY_BLACK_ROWS] = { 64, 32, 16, 0.0, LAYOUT_LATLONG },
    [SKY_SEAM] = { 16, 8, 16, 0.0, LAYOUT_LATLONG },
    [SKY_POLE] = { 16, 8, 16, 0.0, LAYOUT_LATLONG },
    [SKY_NADIR] = { 16, 8, 16, 10.0, LAYOUT_LATLONG },
    [SKY_ONE] = { 1, 1, 1, 0.0, LAYOUT_LATLONG },
    [SKY_SEVEN] = { 7, 5, 8, -50.0, LAYOUT_LATLONG },
    [SKY_TWO] = { 2, 1, 8, 0.0, LAYOUT_LATLONG },
    [SKY_UPSIDE] = { 12, 6, 16, 120.0, LAYOUT_LATLONG_BOTTOM_FIRST },
    [SKY_BLUE] = { 8, 4, 8, 0.0, LAYOUT_LATLONG },
    [SKY_CONTRAST] = { 32, 16, 16, 5.0, LAYOUT_LATLONG },
    [SKY_BLACK] = { 16, 8, 8, 0.0, LAYOUT_LATLONG },
};

static inline struct frame make_frame(int which)
{
    const uint32_t width = sky_shapes[which].width, height = sky_shapes[which].height;
    struct frame f;

    switch (which) {
    case SKY_OVERCAST: return sky_overcast(width, height);
    case SKY_SUN:
    case SKY_SUN_TURNED: return sky_with_sun(width, height, 1e6f);
    case SKY_BLACK_ROWS:
        f = sky_overcast(width, height);
        for (uint32_t y = 3; y < 9; y++)
            for (uint32_t x = 0; x < width; x++)
                sky_paint(&f, x, y, 0, 0, 0);
        return f;
    case SKY_ONE: return sky_constant(width, height, 2.0f);
    case SKY_SEVEN: return sky_noise(width, height, 7, 4.0, 0.0);
    case SKY_UPSIDE: return sky_noise(width, height, 12, 4.0, 0.3);
    case SKY_CONTRAST: return sky_noise(width, height, 32, 40.0, 0.1);
    default: break;
    }
    f = sky_constant(width, height, 0.0f);
    if (which == SKY_SEAM)
        sky_paint(&f, 0, 3, 1, 1, 1);
    else if (which == SKY_POLE)
        sky_paint(&f, 5, 0, 1, 2, 3);
    else if (which == SKY_NADIR)
        sky_paint(&f, width - 1, height - 1, 3, 2, 1);
    else if (which == SKY_TWO)
        sky_paint(&f, 1, 0, 0.5f, 0.25f, 1.0f);
    else if (which == SKY_BLUE)
        sky_paint(&f, 3, 1, 0, 0, 5);
    return f;
}

static inline struct environment *make_sky(int which)
{
    const struct sky_shape *s = &sky_shapes[which];
    const struct environment_desc desc = { .n = s->n,
                                           .layout = s->layout,
                                           .rotation_degrees = s->rotation_degrees,
                                           .scale_stops = 1.0 };
    struct environment *e = environment_create(&desc);
    struct frame f = make_frame(which);
    struct reason why;

    assert_non_null(e);
    assert_int_equal(environment_update(e, &f, &why), ERR_OK);
    frame_finish(&f);
    return e;
}

static inline float luminance_at(const struct environment *e, uint32_t at)
{
    return rgb_luminance(e->texels[at].r, e->texels[at].g, e->texels[at].b);
}

/* The middle of part (row, column) of a grid of `fine` x `fine` parts of a face, unit. */
static inline void grid_direction(uint32_t fine, uint32_t face, uint32_t row, uint32_t column, float w[3])
{
    double d[3];

    cube_direction(face, -1.0 + 2.0 * (column + 0.5) / fine, -1.0 + 2.0 * (row + 0.5) / fine, d);
    const double scale = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    for (int c = 0; c < 3; c++)
        w[c] = (float)(d[c] * scale);
}

/* Of part (row, column), the same on each face; kept for the last grid that was asked for. */
static inline double grid_solid_angle(uint32_t fine, uint32_t row, uint32_t column)
{
    static double kept[128 * 128];
    static uint32_t of = 0;

    assert_true(fine <= 128);
    for (uint32_t k = 0; fine != of && k < fine * fine; k++) {
        const double s = 2.0 / fine, u = -1.0 + s * (k % fine), v = -1.0 + s * (k / fine);
        kept[k] = cube_solid_angle(u, v, u + s, v + s);
    }
    of = fine;
    return kept[row * fine + column];
}
