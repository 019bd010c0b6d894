/* Skies made for tests: small lat-long images with known contents, and the environment made of them. */
#pragma once

#include "base/mem.h"
#include "base/rng.h"
#include "sky/tables/environment.h"

#include <math.h>

#include "support/unit.h"

/* An image of width x height texels of one value, to be painted on. Free with frame_finish. */
static inline struct frame sky_constant(uint32_t width, uint32_t height, float value)
{
    struct frame f = { 0 };
    assert_int_equal(frame_reserve_texels(&f, width, height), ERR_OK);
    for (size_t i = 0; i < 3 * (size_t)width * height; i++)
        f.rgb[i] = value;
    snprintf(f.name, sizeof(f.name), "a constant sky");
    return f;
}

static inline void sky_paint(struct frame *f, uint32_t x, uint32_t y, float r, float g, float b)
{
    float *t = f->rgb + 3 * ((size_t)y * f->width + x);
    t[0] = r;
    t[1] = g;
    t[2] = b;
}

/* Overcast: brighter at the zenith [Moon and Spencer 1942], coloured a little, a dim ground. */
static inline struct frame sky_overcast(uint32_t width, uint32_t height)
{
    struct frame f = sky_constant(width, height, 0.0f);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const double up = cos(PI * (y + 0.5) / height);
            const float l = up > 0.0 ? (float)((1.0 + 2.0 * up) / 3.0) : 0.1f;
            const float tint = 0.1f * (float)sin(2.0 * PI * (x + 0.5) / width);
            sky_paint(&f, x, y, l * (1.0f + tint), l, l * (1.0f - tint));
        }
    return f;
}

/* The overcast one with a sun of a texel, `ratio` times the zenith. */
static inline struct frame sky_with_sun(uint32_t width, uint32_t height, float ratio)
{
    struct frame f = sky_overcast(width, height);
    sky_paint(&f, width / 3, height / 4, ratio, 0.9f * ratio, 0.7f * ratio);
    return f;
}

/* The environment of a frame of some layout; the frame is finished here. */
static inline struct environment *sky_environment_of(struct frame f, enum layout layout, uint32_t n,
                                                     double rotation_degrees)
{
    struct reason why;
    struct environment *e = environment_create(
        &(struct environment_desc){ .n = n, .layout = layout, .rotation_degrees = rotation_degrees });
    assert_non_null(e);
    if (environment_update(e, &f, &why)) {
        printf("%s\n", why.text);
        fail();
    }
    frame_finish(&f);
    return e;
}

static inline struct environment *sky_environment(struct frame f, uint32_t n, double rotation_degrees)
{
    return sky_environment_of(f, LAYOUT_LATLONG, n, rotation_degrees);
}
