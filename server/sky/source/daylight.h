/* Environment frames from weather files (`epw:FILE`), of the standard skies (`cie:TYPE`), which are grey, and from
 * matrices of Radiance's gendaymtx (`mtx:FILE`), in W sr^-1 m^-2 with luminance = 179 cd m^-2 per unit, in lat-long
 * with OpenEXR's orientation, north +Z and east -X unless `north` turns them. Thread: any, after daylight_open. */
#pragma once

#include "base/err.h"
#include "sky/daylight/moments.h"
#include "sky/daylight/reinhart.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The keys of specs, one line each, for --help and the documentation. */
extern const char *const daylight_help;

struct daylight {
    char file[4096];          /* of epw: and mtx: */
    struct sky_matrix matrix; /* of mtx: */
    struct epw weather;       /* of epw: */
    struct moments year;      /* of epw: every moment that was chosen, dark ones included */
    size_t *lit;              /* [count]: those that make a frame; cie: one moment */
    size_t count;
    int cie;                /* type; 0: Perez et al. */
    double north;           /* radians: where north is, clockwise from +Z as seen from above */
    double ground_albedo;   /* grey, below the horizon, 0..1 */
    bool sun, sky;          /* which of them shines */
    double scale;           /* output units per W sr^-1 m^-2 */
    uint32_t width, height; /* texels; 2:1, even height */
};

/* Whether a spec is of this kind. */
bool daylight_is(const char *spec);

/* Reads "epw:FILE,key=value,...", "cie:TYPE,key=value,..." or "mtx:FILE,key=value,...", and the file. Missing hours are
 * named in the log. The caller frees *out with daylight_close. ERR_USAGE names an unknown key or a value out of range;
 * errors of epw_read, moments_choose and sky_matrix_read. */
MUST_CHECK enum err daylight_open(const char *spec, struct daylight **out, struct reason *why);
void daylight_close(struct daylight *d); /* NULL is allowed */

/* The moment of frame `index`, 0..count - 1. */
const struct moment *daylight_moment(const struct daylight *d, size_t index);

/* The unit direction towards the sun of a moment, in the scene: turned by `north`. */
void daylight_sun(const struct daylight *d, const struct moment *m, double w[3]);

/* Renders a moment to float[height][width][3], on all OpenMP threads. The horizontal illuminance of the upper half
 * without the sun's disc is exactly the moment's diffuse_lux. */
void daylight_render(const struct daylight *d, const struct moment *m, float *rgb);
