/* How many rays the audits of a relighter's pictures may trace, and what they may take over from the pictures before.
 * One thread of control. */
#pragma once

#include "env/environment.h"

#include <stdbool.h>
#include <stdint.h>

struct purse { /* zeroed: nothing was lit */
    bool begun, settled;
    double rays;               /* left of what live pictures have paid */
    double energy[CUBE_FACES]; /* of the last picture's sky */
    uint64_t way;              /* in which the last picture was made */
};

/* Rays for a picture that pays `rays`: what live ones save up, once it is worth an audit, else 500,000 more. Small
 * pictures, and those of a cache, cost less than any audit. settled: by a finished cache; the first of them, like the
 * first of all, may trace more. */
uint64_t purse_pay(struct purse *p, bool live, bool settled, double rays);

/* A live picture's audit has traced so many. */
void purse_spend(struct purse *p, bool live, uint64_t rays);

/* How much of what is known of the last picture's error is true of this one's, 0..1: 0 unless it was made in the same
 * way, any number that tells ways apart, under nearly the same sky. */
double purse_like_last(struct purse *p, const struct environment *e, uint64_t way);
