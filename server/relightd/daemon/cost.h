/* Estimates the cost of images from finished ones. Pure functions; the caller measures the time. Thread: one per
 * struct cost. */
#pragma once

#include "light/frame/relight.h"

struct cost {          /* seconds; zeroed: unknown */
    double sample_s;   /* per light sample of a shading point */
    double path_s;     /* per eye path; 0: unknown */
    double particle_s; /* per particle of the light tracer; 0: unknown */
    double fixed_s;    /* per image, independent of its samples */
};

/* Takes the cost of an image with this number of shading points and these sample counts. Do not pass images whose
 * counts the pilot chose. */
void cost_learn(struct cost *c, uint64_t points, const struct relight_desc *light, const struct relight_stats *stats);

/* Seconds that an image of a view with these facts would take with light's method, counts and paths, under the most
 * expensive sky. Unknown costs are estimated from known ones; 0: no cost is known. */
double cost_estimate(const struct cost *c, const struct plan_facts *facts, const struct relight_desc *light);
