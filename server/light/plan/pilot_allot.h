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
#pragma once

#include "scene/geometry/gbuffer.h"

#include <stdbool.h>
#include <stdint.h>

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
