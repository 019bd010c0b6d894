/* The error of images against a truth that is known only through two references a and b, computed with different
 * random numbers. With weights q = 1 / (r^2 + 1e-2 mean(r)^2), r = (a + b) / 2, the error of an image x is
 *     mean(q (x - a)(x - b)),
 * whose expectation is that of relMSE against the truth: the noise of a and b is independent of each other and of x, so
 * it cancels, where (x - r)^2 would add it. Such an error may be below 0 where x is better than the references can
 * tell; `doubt` says where that begins. Images are float[height][width][3], linear. Sums are in fixed order: the same
 * bits at any number of threads. */
#pragma once

#include "base/err.h"
#include "image/codec/frame.h"
#include "light/frame/relight.h"

#include <jansson.h>
#include <stdint.h>

struct judge {
    const float *a, *b; /* borrowed */
    float *mean;        /* [height][width][3]: r */
    float *weight;      /* likewise: q / (3 pixels); 0 where a pixel is left out */
    uint32_t width, height;
    uint64_t pixels; /* counted */
    /* mean(q (a - b)^2) / 4: what the noise of r would add to an error against r. */
    double noise;
    /* Standard deviation of the error that a perfect image is given, from the same differences: errors below two of
     * them cannot be told from 0. */
    double doubt;
};

/* mask: uint8_t[height][width], 0 = leave the pixel out. ERR_NOMEM; ERR_RANGE where no pixel is counted or the
 * references are black. On an error *j needs no finish. */
MUST_CHECK enum err judge_init(struct judge *j, const float *a, const float *b, const uint8_t *mask, uint32_t width,
                               uint32_t height, struct reason *why);
void judge_finish(struct judge *j); /* zeroed memory is allowed */

/* The error; INFINITY for an image with a NaN or an infinity. */
double judge_error(const struct judge *j, const float *x);

/* Each pixel's part of it, (x - a)(x - b) q averaged over the channels, at least 0: for a map. */
void judge_map(const struct judge *j, const float *x, float *map);

/* out[n][n]: mean(q (x_i - a)(x_k - b)), symmetric in i and k. The diagonal holds the errors. The other entries contain
 * no variance of x_i, which is independent of x_k's: their mean is the square of the bias. */
void judge_pairs(const struct judge *j, const float *const *x, uint32_t n, double *out);

/* The part of an error that no number of seeds removes. */
struct judge_floor {
    double error;    /* mean of the seeds' */
    double bias;     /* its part that is bias, squared like the error; may be below 0 by chance */
    double variance; /* the rest */
    double doubt;    /* standard deviation of `bias`: over the draw of the seeds, and the references' own */
    double z;        /* bias / doubt: above 3 it is real */
    double energy;   /* mean luminance over that of the truth, over all seeds */
    double energy_doubt;
};

/* pairs[n][n] as above of n >= 3 images; luminance[n], each image's mean over that of the references. */
void judge_floor(const struct judge *j, const double *pairs, const double *luminance, uint32_t n,
                 struct judge_floor *out);

/* Mean luminance over the pixels that count, over that of r. */
double judge_energy(const struct judge *j, const float *x);

/* ---- Small images ---- */

/* Small images within a page: data: addresses of JPEG files. Owned by the caller; NULL: out of memory. Any thread. */

/* Of a linear image rgb[height][width][3] with this gain, or of its errors: relative error from 0.1 % (black) over
 * violet and red to 100 % (pale yellow), grey where nothing is compared. */
json_t *thumb_image(const struct judge *j, double gain, const float *rgb);
json_t *thumb_errors(const struct judge *j, const float *rgb);

/* ---- Errors that are charted ---- */

/* The errors that are charted. To add one, add a value here, a name in errors.c, a line in errors_of, and a row in
 * scripts/winners.py. Any thread. */

enum error_kind {
    ERROR_REL_MSE, /* against two references, of all pixels with surfaces: judge.h */
    ERROR_NOISE,   /* the part of it that changes with the seed; independent of the references */
    ERROR_DELTA_E, /* mean CIE76 after one fixed tone map: measure/compare/metrics.h. Includes the references' noise */
    ERROR_FLIP,    /* mean FLIP under the same exposure: measure/compare/metrics.h. Likewise */
    ERROR_KINDS,
};

extern const char *const error_names[ERROR_KINDS]; /* of the script, in the CSV and in file names */

/* The errors out[ERROR_KINDS][n] of n images that differ in their seeds only. mask: as for judge_init; pairs: from
 * judge_pairs. ERR_NOMEM. */
MUST_CHECK enum err errors_of(const struct judge *j, const uint8_t *mask, const float *const *x, const double *pairs,
                              uint32_t n, double *out);

/* ---- The references ---- */

/* Two references a and b of an image with different random numbers, over the whole pixel and not only its centre.
 * Background, direct light and ordinary indirect light come from the path tracer (light/estimators/baselines/path.h),
 * caustics and their indirect light from the light tracer, and both of them in mirrors and behind glass from eye paths
 * with 4 x 4 camera rays in every pixel. They are not timed, and share no random numbers with what is charted.
 *
 * A reference is made in parts. After each part its sum is stored in a cache folder (light/cache/cache_file.h) under a
 * name that is the digest of scene, camera, size, sky, classes of light, seed and version. An interrupted run continues
 * from there; a damaged file is refused with a warning, and the reference made again. One thread of control. */

struct progress;

struct truth_desc {
    const struct prepared_scene *set;
    const struct environment *environment; /* ready, made of `frame` */
    const struct frame *frame;
    uint32_t classes;      /* PATH_* */
    uint32_t samples;      /* of each reference, per pixel; rounded up to whole parts. If the cache has
                            * more, they are used */
    const char *cache;     /* an existing folder; NULL: nothing is kept */
    struct progress *line; /* stepped by samples; may be NULL */
};

#define TRUTH_PART 64 /* samples per pixel in a part */

struct truth {
    float *half[2]; /* a and b: [height][width][3] */
    uint32_t samples[2];
    uint32_t found[2]; /* of these, in the cache */
    double seconds;    /* that it took */
};

/* On an error *out needs no finish. ERR_NOMEM, ERR_IO: a part could not be stored. */
MUST_CHECK enum err truth_make(const struct truth_desc *desc, struct truth *out, struct reason *why);
void truth_finish(struct truth *t); /* zeroed memory is allowed */

/* The file that keeps reference `half` of these, into name[size]. */
void truth_name(const struct truth_desc *desc, int half, char *name, size_t size);
