/* One environment map, ready to light a scene: the decoded image, for filtered lookups, and the cube map with its
 * sampling tables, for sampling and evaluation. Rebuilt for every frame in the same memory.
 * Thread: one at a time may update; between updates any number of threads may read. */
#pragma once

#include "base/err.h"
#include "base/vec.h"
#include "image/codec/decode.h"
#include "image/codec/frame.h"
#include "image/codec/image.h"
#include "sky/tables/cube.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct pyramid;
struct resampler;
struct resample_tables;

/* A texel of the cube map. density is luminance x solid angle x n^2/4, so that for a direction through (u, v) of face
 * f: pdf(w | f) = density * (1 + u^2 + v^2)^(3/2) / energy[f], sr^-1. This is the density of choosing the texel in
 * proportion to luminance x solid angle, and a point in it uniformly in (u, v). */
struct texel {
    float r, g, b, density;
};

struct environment {
    struct image image; /* as decoded, before gain and rotation */
    struct image face;  /* buffer for decoding cube face files, one after the other */
    enum layout layout; /* of image */
    double configured;  /* radians: the rotation without what frame and sun add */
    double rotation;    /* radians about +Y, right-handed */
    bool placed;        /* as frame.placed */
    double sun_azimuth; /* as environment_desc.sun_azimuth */
    bool sunless;       /* it is set, and the last frame has no sun */
    float gain;         /* 2^scale_stops */
    struct resampler *resampler;
    struct resample_tables *tables;
    const struct image_decoder *decoder; /* NULL: decode_image */
    uint32_t max_side;                   /* maximum side of a frame's image, texels; 0: IMAGE_MAX_SIDE */
    const char *layer;                   /* as image.layer; borrowed */

    uint32_t n;                /* texels along a face's edge */
    struct texel *texels;      /* [6][n][n] */
    double *row_cdf;           /* [6][n][n]: CDF of luminance x solid angle within each row (*) */
    double *face_cdf;          /* [6][n]: CDF over the rows of a face */
    double *solid_angle;       /* [n][n]: solid angle of a texel; the same on each face */
    double energy[CUBE_FACES]; /* luminance x solid angle of a face, W m^-2 up to the scale */
    double total_energy;       /* of all faces */
    struct pyramid *pyramid;   /* mip levels of the texels, for wide lookups (*) */
    bool lean;                 /* (*) deferred to environment_complete */
    struct environment_rest *rest;

    double units;    /* of the image, as those of the frame */
    bool calibrated; /* by the gain, radiance is in W sr^-1 m^-2 */
    uint64_t number; /* the frame's own number */
    int64_t capture_us;
    char name[256];
    bool ready; /* a frame has been loaded */
};

struct environment_desc {
    uint32_t n;         /* 1..1024; 0: 256 */
    enum layout layout; /* LAYOUT_AUTO: the file's */
    const char *layer;  /* of EXR files, as image.layer; borrowed */
    double rotation_degrees;
    double sun_azimuth; /* degrees, above 0 and at most 360, from north (+Z) over east (-X): each frame's sun is turned
                           there, in place of its rotation; a frame without one keeps it. 0: not at all */
    double scale_stops;
    bool calibrated; /* scale_stops makes real units of a captured map */
    bool lean;       /* a rebuild computes only what all methods need and defers the CDFs and the pyramid to
                        environment_complete */
    const struct image_decoder *decoder; /* decodes the files of frames; borrowed; NULL: decode_image */
    uint32_t max_side;                   /* maximum side of a frame's image, texels; 0: IMAGE_MAX_SIDE */
    struct resample_tables *tables;      /* shared resampling tables (resample.h), which must outlive the environment;
                                            NULL: it creates its own */
    const struct environment *like;      /* of the same n: copies what depends on n alone, which saves time; or NULL */
};

/* NULL: out of memory, or n out of range. The caller owns the result. */
struct environment *environment_create(const struct environment_desc *desc);
void environment_destroy(struct environment *e); /* NULL is allowed */

/* Frees the memory of the frame, but not the cube map's. The environment must not be read until an update succeeds. */
void environment_release_memory(struct environment *e);

/* Sets layout, rotation, scale, lean, decoder and size limit for the following updates; n and tables cannot
 * change. */
void environment_configure(struct environment *e, const struct environment_desc *desc);

/* Decodes the frame and rebuilds cube map and tables. On error *why names frame and fault, and the environment must not
 * be read until an update succeeds; to keep the last good frame, use two environments. */
MUST_CHECK enum err environment_update(struct environment *e, const struct frame *f, struct reason *why);

/* The two steps of environment_update, so that they can be timed separately. Same errors. */
MUST_CHECK enum err environment_decode(struct environment *e, const struct frame *f, struct reason *why);
/* Second step. */
MUST_CHECK enum err environment_rebuild(struct environment *e, struct reason *why);

/* Completes a lean rebuild, if not yet done; the result is identical to a full rebuild. Call it before threads sample
 * directions (samples.h) or do wide lookups, since it uses all OpenMP threads. Thread: any at any time; concurrent
 * callers wait. */
void environment_complete(const struct environment *e);
bool environment_is_complete(const struct environment *e); /* nothing is deferred */
bool environment_is_latlong(const struct environment *e);  /* its image; it must be ready */

/* As environment_complete, for the pyramid only, which wide lookups need. */
void environment_complete_pyramid(const struct environment *e);
bool environment_has_pyramid(const struct environment *e); /* the pyramid is complete */

/* Transfer the radiance of the cube map, float[6][n][n][3], to another process, whose environment with the same n
 * then samples and evaluates with the same bits as e. That environment has no image, so environment_lookup
 * and its callers must not use it. environment_set_faces uses the threads of a lean rebuild and defers the same
 * steps. */
void environment_get_faces(const struct environment *e, float *rgb);
void environment_set_faces(struct environment *e, const float *rgb);

/* Logs what was mended, chosen or ignored in the frame's file, and what may clip the sun, each kind the first time that
 * a sequence has it. *said remembers the kinds; initialise it to 0. */
void environment_report(const struct environment *e, unsigned *said);

/* The unit of radiance, gain included, for reports: "W sr^-1 m^-2", or "relative" where a captured map or another scale
 * leaves it open. Static. */
const char *environment_unit(const struct environment *e);

/* Radiance along w (unit, world) from the source image, interpolated bilinearly; on a cube map within each face.
 * Directions that the layout does not cover get the mean of those it covers. */
void environment_lookup(const struct environment *e, struct vec3 w, float rgb[3]);

/* Radiance averaged over a pixel of `width` x `width` radians about w, by a filter of the same variance (the width of a
 * square; a round cone of the same solid angle is 1.13 times as wide). Equals environment_lookup while the source's
 * texels exceed width / sqrt(3), and the mean over the sphere from sqrt(4 pi) on. Continuous in w and width. Needs the
 * pyramid. */
void environment_lookup_wide(const struct environment *e, struct vec3 w, float width, float rgb[3]);

/* The sampled function: sets rgb to the radiance of the cube map texel that contains w and *pdf to pdf(w | its face), 0
 * on a black face. Returns the face. */
uint32_t environment_evaluate(const struct environment *e, const float w[3], float rgb[3], float *pdf);

/* Skies with the same light on each of six faces are taken for the same one. */
uint64_t environment_digest(const struct environment *e);
