/* Groups of pixels spread over the image, with the packets that hold their shade points, and error estimates for the
 * whole image from two independent estimates of a group. Thread: one at a time; loops over pixels run on all OpenMP
 * threads. */
#pragma once

#include "scene/geometry/gbuffer.h"

#include <stdbool.h>
#include <stdint.h>

#define GROUPS_MAX 24 /* of tiles, measured apart; bounds a table */

struct group {
    uint32_t *pixels; /* pixels with a shade point */
    uint32_t pixel_count;
    uint32_t *index;         /* of packets */
    struct packet_list list; /* view of `index` */
    uint64_t points;         /* in those packets, including points of pixels outside the group */
};

struct tiles { /* squares of pixels, row by row; each belongs to one group */
    uint32_t side, across, count;
    uint8_t *group;
};

struct groups {
    const struct gbuffer *gbuffer;
    struct tiles tiles;
    struct group group[GROUPS_MAX];
    uint32_t count;
    struct group all; /* the whole image */
};

/* Divides the image of a G-buffer, which must outlive it. False when out of memory; call groups_finish even then. */
bool groups_init(struct groups *s, const struct gbuffer *g);
void groups_finish(struct groups *s); /* zeroed memory is allowed */

/* The image r that errors are relative to, as in relMSE: they are divided by r^2 + 1e-2 mean(r)^2. In a noisy image
 * the mean over 3 x 3 pixels replaces r, so that an outlier is not divided by itself. All pointers are borrowed. */
struct yardstick {
    const float *rgb;    /* float[height][width][3] */
    const float *more;   /* likewise, added: light that the image has few particles of; NULL: nothing */
    const uint8_t *mask; /* [height][width]: 0 where there is no shade point */
    uint32_t width, height;
    bool noisy;
    double soft; /* 1e-2 mean(r)^2 */
};

/* From an image float[height][width][3] and its mask, both borrowed. */
void yardstick_init(struct yardstick *y, const float *rgb, const uint8_t *mask, uint32_t width, uint32_t height);

/* Writes the mean of two sparse images around each pixel to out, minus the pixel's own mean, which the image
 * contains. The mean is over 11 x 11 pixels without the three columns and rows at the pixel, so that the 3 x 3 means
 * of a noisy image do not contain it either: a particle where few others are would be divided by itself and seem
 * almost free of noise. All are float[height][width][3], including spare, which is scratch memory. */
void yardstick_spread(const float *a, const float *b, uint32_t width, uint32_t height, float *spare, float *out);

/* Compares two independent estimates of a part at the shade points, a and b: float[packet_count][3][16]. Returns half
 * of the squared difference, which is the error of each: a mean over a group's pixels and channels, relative as relMSE
 * is. Unless NULL, error[packet_count][16] receives each shade point's part of it, summed over the group's pixels, for
 * the group's packets; it may be negative by chance. */
double pair_of_points(const struct groups *s, const struct group *group, const float *a, const float *b,
                      const struct yardstick *y, float (*error)[PACKET]);

/* Compares two images of a part, float[height][width][3], likewise. */
double pair_of_images(const struct group *group, const float *a, const float *b, const struct yardstick *y);

/* ---- Model ---- */

/* Predicts error and time of a part of the image from its count n (samples or paths per point, units of particles).
 * Readings are few, noisy and grow old. Plain data; zeroed memory means no readings. Thread: any. */

struct model {
    double variance; /* error = variance / n; scaled when the distribution of samples changes */
    double unit_s;   /* seconds of a whole image = unit_s n; 0: unknown */
    uint32_t count;  /* readings averaged in `variance` */
    uint32_t fresh;  /* readings since the sky changed */
    bool known;      /* the error is known, perhaps from an earlier sky */
};

/* Adds a reading, a relMSE at n; the latest twelve have the most weight. */
void model_read(struct model *m, double n, double error);
/* Adds the time of a whole image. */
void model_ran(struct model *m, double n, double seconds);

/* The sky has changed: old readings serve until the first new one replaces them. */
void model_age(struct model *m);

double model_error(const struct model *m, double n);   /* relMSE at n; 0: unknown */
double model_seconds(const struct model *m, double n); /* of a whole image at n */

/* ---- Counts of packets ---- */

/* Distributes samples over packets: more where more error remains.
 *
 * The image's error is a sum over packets, E = sum h_i / n_i. h_i is the error of one sample per point in the pixels
 * of packet i, relative as relMSE is: large in dark regions, penumbrae and highlights; small where a pixel has many
 * shade points. For a given sum of the n_i, E is minimal with n_i in proportion to sqrt(h_i) [Cochran 1977, section
 * 5.5]. h_i is measured from pairs of estimates with separate random numbers, never the image's: a packet's count
 * must not depend on its own samples [Kirk and Arvo 1991].
 *
 * Counts are integers, or even integers. A threshold that belongs to the packet rounds its real count up or down, so
 * that the mean over packets is correct and the noise is static while the counts are. Thread: one at a time. */

struct allotment {
    const struct gbuffer *gbuffer;
    struct packet_list list; /* all packets that take part; borrowed */
    float *hard;             /* [packet_count]: h_i, of mean 1 over the list */
    float *share;            /* likewise: n_i over their mean, before rounding and the minimum count */
    uint8_t *readings;       /* [packet_count]: number of readings in hard[i] */
    uint32_t *counts;        /* [packet_count]: result of the last allot_counts */
};

struct allot_count {
    double n;      /* mean over the whole list, at least `step` */
    uint32_t step; /* counts are multiples of it and at least as large: 1 or 2 */
};

/* Sets shares by the weight of the points in pixels, which apply until there are readings. False when out of memory;
 * finish it even then. The list may be empty. */
bool allot_init(struct allotment *a, const struct gbuffer *g, const struct packet_list *list);
void allot_finish(struct allotment *a);

/* Adds the errors of sample packets that represent the whole list, from pair_of_points, at counts with mean n. */
void allot_read(struct allotment *a, const struct packet_list *of, const float (*error)[PACKET],
                const struct allot_count *mean);
/* The sky has changed: all readings together count as one. */
void allot_age(struct allotment *a);
/* Sets the shares from the readings; returns the factor by which that changes the error. */
double allot_deal(struct allotment *a);

/* The factor f for which max(step, f share) has mean n, and a packet's count with it, not rounded. */
double allot_factor(const struct allotment *a, const struct allot_count *mean);
double allot_real(const struct allotment *a, const struct allot_count *mean, double factor, uint32_t packet);
/* Writes the counts of the packets of `of`, a part of the list, to a->counts; returns the largest, 0 for an empty
 * list. */
uint32_t allot_counts(struct allotment *a, const struct allot_count *mean, const struct packet_list *of);
/* Their mean before rounding. */
double allot_mean(const struct allotment *a, const struct allot_count *mean, const struct packet_list *of);

/* ---- The division of time ---- */

/* Divides a frame's time among its parts so that the error is minimal. Pure functions. Thread: any.
 *
 * The parts' errors are independent, so their relative squared errors add up. A part is made with n units (samples,
 * paths, particles):
 *     error  E = V / n                V the variance of one unit
 *     time   t = b n
 * with n in least..most. A part that is not there has V = b = n = 0.
 *
 * For a time T the sum of E is minimal when an additional second lowers the error of every part equally [Everett 1963]:
 *     n = k sqrt(V / b), with one k for all parts [Cochran 1977, section 5.5].
 * Time increases and error decreases with k, so bisection finds it. */

#define BUDGET_PARTS_MAX 8 /* bounds a table; the pilot has fewer parts */

struct budget_part {
    double variance;    /* V >= 0 */
    double unit_s;      /* b >= 0; b > 0 where V is */
    double least, most; /* n; both 0: the part is not there */
};

struct budget_target { /* at least one is above 0; with both, the error is lowered within the time only */
    double seconds;    /* for an image, including measurements; 0: no limit */
    double error;      /* relMSE; 0: none */
};

struct budget {
    double n[BUDGET_PARTS_MAX];
    double error, seconds; /* sums over the parts */
    bool met;              /* the target is met; else this is the closest that the parts allow */
};

/* The minimum error within target->seconds, or the minimum time for target->error. count <= BUDGET_PARTS_MAX. */
void budget_spend(const struct budget_part *parts, uint32_t count, const struct budget_target *target,
                  struct budget *out);
