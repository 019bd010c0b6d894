/* How many samples each packet gets of those that a part of the picture has: more where more is left to be wrong.
 *
 * The picture's error is a sum over packets, E = sum h_i / n_i, h_i what one sample a point leaves in the pixels that
 * packet i is seen in, relative as relMSE is: large in the dark, at the rims of shadows, in highlights; small where a
 * pixel has many shade points, each of them with a small weight. For a given sum of the n_i it is the least with n_i in
 * proportion to sqrt(h_i) [Cochran 1977, section 5.5]. h_i is read from pairs of estimates with numbers of their own,
 * never with those of the picture: what a packet gets must not depend on how it came out [Kirk and Arvo 1991].
 *
 * Counts are whole, or even; a real one becomes one of its two neighbours by a turn that the packet keeps, so that
 * their mean over packets is what was asked for, and noise stands still while that does. One thread of control. */
#ifndef CHOOSE_PILOT_ALLOT_H
#define CHOOSE_PILOT_ALLOT_H

#include "scene/gbuffer.h"

#include <stdbool.h>
#include <stdint.h>

struct allotment {
    const struct gbuffer *gbuffer;
    struct packet_list list; /* among which it deals; borrowed */
    float *hard;             /* [packet_count]: h_i, of mean 1 over the list */
    float *share;            /* likewise: n_i over their mean, but for rounding and the least count */
    float *spare;            /* [packet_count]: scratch */
    uint8_t *readings;       /* [packet_count]: that hard[i] is made of */
    uint32_t *counts;        /* [packet_count]: of the last allot_counts */
    float *sorted;           /* [list.count]: shares, the smallest first, */
    double *above;           /* [list.count + 1]: and the sum from each on */
};

struct allot_count {
    double n;      /* mean over the whole list, at least `step` */
    uint32_t step; /* counts are multiples of it, and at least it: 1 or 2 */
};

/* Shares as pixels have points, until there are readings. False when out of memory; finish all the same. An empty list
 * is fine. */
bool allot_init(struct allotment *a, const struct gbuffer *g, const struct packet_list *list);
void allot_finish(struct allotment *a);

/* The error of packets that stand for the whole list, as pair_by_point has it, with counts of a mean of n. */
void allot_read(struct allotment *a, const struct packet_list *of, const float (*error)[PACKET],
                const struct allot_count *mean);
/* Everything read counts as one reading: the sky is another. */
void allot_age(struct allotment *a);
/* Shares by what has been read, if that gains enough over the present ones; returns the error's ratio, 1: as before. */
double allot_deal(struct allotment *a);

/* Counts of the packets of `of`, a part of the list, into a->counts; returns the largest, 0 of none. */
uint32_t allot_counts(struct allotment *a, const struct allot_count *mean, const struct packet_list *of);
/* The factor of the shares by which max(step, factor share) has the mean n, and a packet's count by it, not rounded. */
double allot_factor(const struct allotment *a, const struct allot_count *mean);
double allot_real(const struct allotment *a, const struct allot_count *mean, double factor, uint32_t packet);
/* Their mean without rounding; times their number, over n times that of the whole list, it is the part's share of the
 * work. */
double allot_mean(const struct allotment *a, const struct allot_count *mean, const struct packet_list *of);
double allot_work(const struct allotment *a, const struct allot_count *mean, const struct packet_list *of);

#endif
