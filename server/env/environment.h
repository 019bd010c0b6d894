/* server/env/environment.h */
/* One environment frame, ready to light a scene: the decoded picture (what is looked at) and the cube map with its
 * sampling tables (what is sampled and evaluated), rebuilt for every frame in the same memory.
 * environment_update is for one thread at a time; between updates any number of threads may read. */
#ifndef ENV_ENVIRONMENT_H
#define ENV_ENVIRONMENT_H

#include "cube.h"
#include "decode.h"
#include "err.h"
#include "frame.h"
#include "image.h"
#include "vec.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct pyramid;
struct resampler;
struct resample_tables;

/* What a texel's light is weighed by when samples are drawn: one number for three. Each is 0 only where all three are.
 */
enum importance {
    IMPORTANCE_LUMINANCE, /* what the eye sees; blue light gets few samples and is noisy where it meets blue albedo */
    IMPORTANCE_MEAN,      /* of r, g and b */
    IMPORTANCE_MAX,       /* of r, g and b, as [Nori]: no colour's radiance over density is larger than a grey's */
};

static inline float importance_of(enum importance kind, float r, float g, float b)
{
    if (kind == IMPORTANCE_LUMINANCE)
        return rgb_luminance(r, g, b);
    return kind == IMPORTANCE_MEAN ? (r + g + b) * (1.0f / 3.0f) : fmaxf(r, fmaxf(g, b));
}

/* "luminance", "mean" or "max"; IMPORTANCE_LUMINANCE and ERR_USAGE for anything else. */
MUST_CHECK enum err importance_parse(const char *name, enum importance *out, struct reason *why);
const char *importance_name(enum importance kind);

/* One texel of the cube map. density is importance x solid angle x n^2/4, so that, for a direction through (u, v) of
 * face f, pdf(w | f) = density * (1 + u^2 + v^2)^(3/2) / energy[f]      per steradian, which is the density of choosing
 * the texel in proportion to importance x solid angle and a point of it evenly in (u, v). */
struct texel {
    float r, g, b, density;
};

struct environment {
    struct image image; /* as decoded, without gain and rotation */
    struct image face;  /* where the files of six faces are decoded, one after the other */
    enum layout layout; /* of image */
    double rotation;    /* radians about +Y, right-handed */
    float gain;         /* 2^scale_stops */
    enum importance importance;
    struct resampler *resampler;
    struct resample_tables *tables;
    const struct image_decoder *decoder; /* NULL: decode_image */
    uint32_t most_side;                  /* of a frame's picture, in texels; 0: IMAGE_MAX_SIDE */

    uint32_t n;                /* texels along a face's edge */
    struct texel *texels;      /* [6][n][n] */
    double *row_cdf;           /* [6][n][n]: running sums of importance x solid angle within each row (*) */
    double *face_cdf;          /* [6][n]: running sums over the rows of a face */
    double *solid_angle;       /* [n][n]: of a texel, the same on each face */
    double energy[CUBE_FACES]; /* sum of importance x solid angle of a face, W m^-2 up to the scale */
    double total_energy;       /* over the six */
    struct pyramid *pyramid;   /* of texels: what is looked at with a wide eye (*) */
    bool lean;                 /* (*) wait for environment_complete */
    struct environment_rest *rest;

    uint64_t number; /* the frame's own */
    int64_t capture_us;
    char name[256];
    bool ready; /* a frame is in */
};

struct environment_desc {
    uint32_t n;         /* 1..1024; 0: 256 */
    enum layout layout; /* LAYOUT_AUTO: by the file */
    double rotation_degrees;
    double scale_stops;
    enum importance importance;
    bool lean; /* a rebuild makes what all methods read, and leaves the rest, by which directions are
                * drawn and wide eyes look, to environment_complete */
    const struct image_decoder *decoder; /* who decodes the files of frames; it is borrowed. NULL: decode_image */
    uint32_t most_side;                  /* of a frame's picture, in texels; 0: IMAGE_MAX_SIDE */
    struct resample_tables *tables; /* where environments find each other's resampling tables (resample_table.h); they
                                     * must outlive the environment. NULL: it makes its own. */
};

/* NULL when out of memory or n is out of range. */
struct environment *environment_create(const struct environment_desc *desc);
void environment_destroy(struct environment *e); /* NULL is allowed */

/* Gives back the memory that frames have taken; not that of the cube map. Nobody may read it until an update succeeds.
 */
void environment_forget(struct environment *e);

/* Takes another layout, rotation, scale, importance, leanness, decoder and limit from the next update on; n and tables
 * stay.
 */
void environment_set(struct environment *e, const struct environment_desc *desc);

/* Decodes the frame and rebuilds cube map and tables. On any error *why names frame and fault and the environment must
 * not be read until an update succeeds: whoever must keep the last good frame holds two. */
MUST_CHECK enum err environment_update(struct environment *e, const struct frame *f, struct reason *why);

/* The same in two steps, so that the time of each can be told. */
MUST_CHECK enum err environment_decode(struct environment *e, const struct frame *f, struct reason *why);
MUST_CHECK enum err environment_rebuild(struct environment *e, struct reason *why);

/* Makes what a lean rebuild has left, where it has not been made since: the same bits as a rebuild that is not lean.
 * For whoever is about to draw directions by the tables (samples.h) or to look with a wide eye, before threads do: it
 * uses all of OpenMP's. Any thread at any time; whoever comes second waits. */
void environment_complete(const struct environment *e);
bool environment_is_complete(const struct environment *e);

/* The same for the pyramid alone, by which wide eyes look. */
void environment_complete_pyramid(const struct environment *e);
bool environment_has_pyramid(const struct environment *e);

/* One warning, the first time that a sequence holds values at a half float's largest: its sun may have been cut off
 * when it was captured. *warned remembers; it begins false. */
void environment_warn_clipped(const struct environment *e, bool *warned);

/* What is seen when looking along w (unit, world): the source image, bilinear, so that it is not blocky. Faces of a
 * cube are interpolated each within itself. What the layout does not show is the mean of what it does. */
void environment_look(const struct environment *e, struct vec3 w, float rgb[3]);

/* The same for an eye that sees all about w at once: the mean over a pixel of `width` x `width` radians, by a filter of
 * the same variance (full width of the square; a round cone of as much solid angle is 1.13 times as wide). As long as
 * the source's texels are wider, width / sqrt(3) being compared, it is environment_look; from sqrt(4 pi) on it is
 * the mean of the sphere. Continuous in w and in width. */
void environment_look_wide(const struct environment *e, struct vec3 w, float width, float rgb[3]);

/* The sampled function itself: radiance of the cube texel that w falls in, and pdf(w | its face) (0 where that is
 * black). */
uint32_t environment_evaluate(const struct environment *e, const float w[3], float rgb[3], float *pdf);

#endif
