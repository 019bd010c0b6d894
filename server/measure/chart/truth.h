/* Two references a and b of an image with different random numbers, over the whole pixel and not only its centre.
 * Background, direct light and ordinary indirect light come from the path tracer (light/estimators/baselines/path.h),
 * caustics and their indirect light from the light tracer, and both of them in mirrors and behind glass from eye paths
 * with 4 x 4 camera rays in every pixel. They are not timed, and share no random numbers with what is charted.
 *
 * A reference is made in parts. After each part its sum is stored in a cache folder (light/cache/cache_file.h) under a
 * name that is the digest of scene, camera, size, sky, classes of light, seed and version. An interrupted run continues
 * from there; a damaged file is refused with a warning, and the reference made again. One thread of control. */
#pragma once

#include "base/err.h"
#include "image/codec/frame.h"
#include "light/frame/relight.h"

#include <stdint.h>

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
