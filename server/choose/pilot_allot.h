/* server/choose/pilot_allot.h */
/* How many samples each packet gets: more where more error is left.
 *
 * The picture's error is a sum over packets, E = sum h_i / n_i. h_i is what one sample per point leaves in the pixels
 * that packet i is seen in, relative as relMSE is: large in the dark, in penumbrae and in highlights; small where a
 * pixel has many shade points. For a given sum of the n_i it is least with n_i in proportion to sqrt(h_i) [Cochran
 * 1977, section 5.5]. h_i is read from pairs of estimates with random numbers of their own, never with those of the
 * picture: what a packet gets must not depend on how it came out [Kirk and Arvo 1991].
 *
 * Counts are whole, or even. A real count is rounded up or down by a threshold that belongs to the packet, so that the
 * mean over packets is right and noise stands still while the counts do. One thread of control. */
#ifndef CHOOSE_PILOT_ALLOT_H
#define CHOOSE_PILOT_ALLOT_H

#include "scene/gbuffer.h"

#include <stdbool.h>
#include <stdint.h>

struct allotment {
    const struct gbuffer *gbuffer;
    struct packet_list list; /* all packets that take part; borrowed */
    float *hard;             /* [packet_count]: h_i, of mean 1 over the list */
    float *share;            /* likewise: n_i over their mean, but for rounding and the least count */
    uint8_t *readings;       /* [packet_count]: in hard[i] */
    uint32_t *counts;        /* [packet_count]: of the last allot_counts */
};

struct allot_count {
    double n;      /* mean over the whole list, at least `step` */
    uint32_t step; /* counts are multiples of it, and at least it: 1 or 2 */
    bool powers;   /* counts are powers of two: whole nets of samples */
};

/* Shares by the weight of the points in pixels, until there are readings. False when out of memory; finish it all the
 * same. An empty list is fine. */
bool allot_init(struct allotment *a, const struct gbuffer *g, const struct packet_list *list);
void allot_finish(struct allotment *a);

/* Adds the error of packets that stand for the whole list, as pair_of_points returns it, at counts of a mean of n. */
void allot_read(struct allotment *a, const struct packet_list *of, const float (*error)[PACKET],
                const struct allot_count *mean);
/* The sky has changed: all readings count as one. */
void allot_age(struct allotment *a);
/* Sets the shares by what has been read; returns the factor by which that changes the error. */
double allot_deal(struct allotment *a);

/* The factor f by which max(step, f share) has the mean n, and a packet's count by it, not rounded. */
double allot_factor(const struct allotment *a, const struct allot_count *mean);
double allot_real(const struct allotment *a, const struct allot_count *mean, double factor, uint32_t packet);
/* Counts of the packets of `of`, a part of the list, into a->counts; returns the largest, 0 of none. */
uint32_t allot_counts(struct allotment *a, const struct allot_count *mean, const struct packet_list *of);
/* Their mean without rounding. */
double allot_mean(const struct allotment *a, const struct allot_count *mean, const struct packet_list *of);

#endif
