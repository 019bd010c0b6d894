/* server/choose/pilot_measure.h */
/* Parts of a picture by which the whole is judged: groups of pixels spread over it, with the packets that hold their
 * shade points, and what two independent estimates of a group say. One thread of control; loops over pixels run on all
 * OpenMP threads. */
#ifndef CHOOSE_PILOT_MEASURE_H
#define CHOOSE_PILOT_MEASURE_H

#include "scene/gbuffer.h"

#include <stdbool.h>
#include <stdint.h>

#define GROUPS_MAX 24

struct group {
    uint32_t *pixels; /* that hold a shade point */
    uint32_t pixel_count;
    uint32_t *index;         /* of packets */
    struct packet_list list; /* into it */
    uint64_t points;         /* in those packets, other pixels' included */
};

struct tile_mean { /* of both estimates together */
    double sum[3], pixels;
};

struct groups {
    const struct gbuffer *gbuffer;
    struct group group[GROUPS_MAX];
    uint32_t count;
    struct group all;             /* the whole picture */
    uint32_t side, across, tiles; /* tiles of side x side pixels, row by row: each is of one group */
    struct tile_mean *mean;       /* [tiles]: scratch */
};

/* The G-buffer must outlive it. False when out of memory; finish all the same. */
bool groups_init(struct groups *s, const struct gbuffer *g);
void groups_finish(struct groups *s); /* zeroed memory is allowed */

/* The picture r by which errors are made relative, as relMSE is: r^2 + 1e-2 mean(r)^2. Of a noisy one the mean over 3 x
 * 3 pixels stands for r, since a pixel that is far off must not be measured by itself. All is borrowed. */
struct yardstick {
    const float *rgb;    /* float[height][width][3] */
    const float *more;   /* likewise, to be added: a part that it lacks, or has too few particles of; NULL: nothing */
    const uint8_t *mask; /* [height][width]: 0 where there is no shade point */
    uint32_t width, height;
    bool noisy;
    bool lacks_part; /* the picture is without the part: the mean of both estimates over a neighbourhood is added */
    double soft;     /* 1e-2 mean(r)^2 */
};

void yardstick_init(struct yardstick *y, const float *rgb, const uint8_t *mask, uint32_t width, uint32_t height);

/* The mean of two sparse pictures over 9 x 9 pixels, less that of the pixel itself where the picture has it already;
 * into out. All float[height][width][3]; spare too, which is scratch. */
void yardstick_spread(const float *a, const float *b, bool in_picture, uint32_t width, uint32_t height, float *spare,
                      float *out);

/* Means over a group's pixels and channels, relative as relMSE is. */
struct pair {
    double error;  /* of either of the two: half of the squared difference */
    double energy; /* product: of the part itself, squared */
};

/* Two independent estimates of a part at the shade points, a and b: float[packet_count][3][16]. */
struct pair pair_of_points(struct groups *s, const struct group *group, const float *a, const float *b,
                           const struct yardstick *y);

/* What each shade point has of the error, as a sum over the group's pixels: into error[packet_count][16], for the
 * group's packets. It may be negative by chance. */
void pair_by_point(const struct groups *s, const struct group *group, const float *a, const float *b,
                   const struct yardstick *y, float (*error)[PACKET]);

/* Two pictures of a part. */
struct pair pair_of_pictures(const struct group *group, const float *a, const float *b, const struct yardstick *y);

#endif
