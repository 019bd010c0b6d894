/* How many rays the audits of a relighter's images may trace, and what they may take over from the images before.
 * One thread of control. */
#pragma once

#include "sky/tables/environment.h"

#include <stdbool.h>
#include <stdint.h>

struct purse { /* zeroed: nothing was lit */
    bool settled;
    double rays;               /* left of what live images have paid */
    double begun_s;            /* the process's processor time before the first image; 0: there was none */
    double spent_s, traced;    /* by audits: processor time, rays */
    double energy[CUBE_FACES]; /* of the last image's sky */
    uint64_t way;              /* in which the last image was made */
};

/* Rays for an image that pays `rays`: what live ones save up, once it is worth an audit, else 500,000 more. Small
 * images, and those of a cache, cost less than any audit. settled: by a finished cache; the first of them may trace
 * more. */
uint64_t purse_pay(struct purse *p, bool live, bool settled, double rays);

/* So many of these rays that audits take at most the share `most` of the processor time since the first image, by
 * what their rays took; 0 when too few are left for one. used_s: the process's processor time. */
uint64_t purse_limit(struct purse *p, double most, double used_s, uint64_t rays);

/* An image's audit has traced so many, in so much processor time. */
void purse_spend(struct purse *p, bool live, uint64_t rays, double seconds);

/* How much of what is known of the last image's error is true of this one's, 0..1: 0 unless it was made in the same
 * way, any number that tells ways apart, under nearly the same sky. */
double purse_like_last(struct purse *p, const struct environment *e, uint64_t way);
