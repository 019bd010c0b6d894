/* server/daemon/cost.h */
/* What a picture costs: learnt from finished pictures, to tell what others would cost. Pure functions; the clock is the
 * caller's. Thread: one per struct cost. */
#ifndef DAEMON_COST_H
#define DAEMON_COST_H

#include "light/relight.h"

struct cost {          /* seconds; zeroed: nothing is known */
    double sample_s;   /* per light sample of a shading point */
    double path_s;     /* per eye path; 0: unknown */
    double particle_s; /* per particle of the light tracer; 0: unknown */
    double fixed_s;    /* per picture, whatever its samples */
};

/* A picture of so many shading points was made by these counts of samples. Pictures of which the pilot chose the counts
 * teach nothing and must not be passed. */
void cost_learn(struct cost *c, uint64_t points, const struct relight_desc *light, const struct relight_stats *stats);

/* Seconds that a picture of a view with these facts would take by light's method, counts and paths, under the sky that
 * costs most. What is unknown is assumed from what is known; 0: nothing is. */
double cost_estimate(const struct cost *c, const struct plan_facts *facts, const struct relight_desc *light);

#endif
