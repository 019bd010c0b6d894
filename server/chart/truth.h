/* server/chart/truth.h */
/* What a picture should be: two references a and b from different random numbers, over the whole pixel and not only its
 * centre. Background, direct light and ordinary interreflection come from the path tracer (baselines/path.h),
 * caustics and their interreflection from the light tracer, and those of the two that are seen in a mirror or through
 * glass from eye paths, with 4 x 4 camera rays in every pixel. None of these is timed, and none shares random numbers
 * with what is charted.
 *
 * A reference is made in parts. After each its sum is stored in a cache folder under a name that is the digest of
 * scene, camera, size, sky, classes of light, seed and version; an interrupted run goes on from there, and a file that
 * is damaged is refused with a warning and made again. */
#ifndef CHART_TRUTH_H
#define CHART_TRUTH_H

#include "base/err.h"
#include "codec/frame.h"
#include "light/relight.h"

#include <stdbool.h>
#include <stdint.h>

struct progress;

struct truth_desc {
    const struct set *set;
    const struct environment *environment; /* ready, made of `frame` */
    const struct frame *frame;
    uint32_t classes;      /* PATH_* */
    uint32_t samples;      /* of each reference, per pixel; rounded up to whole parts. More that stand in the cache
                            * are used */
    const char *cache;     /* an existing folder; NULL: nothing is kept */
    struct progress *line; /* stepped by samples; may be NULL */
};

#define TRUTH_PART 64 /* samples per pixel in a part */

struct truth {
    float *half[2]; /* a and b: [height][width][3] */
    uint32_t samples[2];
    uint32_t found[2]; /* of these, in the cache */
    double seconds;    /* that were spent */
};

/* On an error *out needs no finish. ERR_NOMEM, ERR_IO: a part could not be stored. */
MUST_CHECK enum err truth_make(const struct truth_desc *desc, struct truth *out, struct reason *why);
void truth_finish(struct truth *t); /* zeroed memory is allowed */

/* The file that keeps reference `half` of these, into name[size]. */
void truth_name(const struct truth_desc *desc, int half, char *name, size_t size);

#endif
